//! Values as arenas hold them: a word for each element. Runs on the loader's threads.

use rcc_core::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store, Type};

/// A value for an arena. Values that are equal have the same bits, so that they are interchangeable in a cycle.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StoredValue {
    store: Store,
    words: Words,
}

/// The words of a value; one of them, as nearly all values have, needs no memory of its own.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
enum Words {
    One(u64),
    Several(Vec<u64>),
}

impl FromIterator<u64> for Words {
    fn from_iter<I: IntoIterator<Item = u64>>(words: I) -> Words {
        let words: Vec<u64> = words.into_iter().collect();
        match words[..] {
            [word] => Words::One(word),
            _ => Words::Several(words),
        }
    }
}

impl StoredValue {
    /// Returns a number.
    #[must_use]
    pub fn real(value: f64) -> StoredValue {
        StoredValue {
            store: Store::Real,
            words: Words::One(value.to_bits()),
        }
    }

    /// Returns a truth value: 0 for false, 1 for true, or null.
    #[must_use]
    pub fn bool(value: u8) -> StoredValue {
        StoredValue {
            store: Store::Bool,
            words: Words::One(value.into()),
        }
    }

    /// Returns a whole number.
    #[must_use]
    pub fn int(value: i64) -> StoredValue {
        StoredValue {
            store: Store::Int,
            words: Words::One(value.cast_unsigned()),
        }
    }

    /// Returns a composite or an array of numbers.
    pub fn reals(values: impl IntoIterator<Item = f64>) -> StoredValue {
        StoredValue {
            store: Store::Real,
            words: values.into_iter().map(f64::to_bits).collect(),
        }
    }

    /// Returns an array of truth values.
    pub fn bools(values: impl IntoIterator<Item = u8>) -> StoredValue {
        StoredValue {
            store: Store::Bool,
            words: values.into_iter().map(u64::from).collect(),
        }
    }

    /// Returns an array of whole numbers.
    pub fn ints(values: impl IntoIterator<Item = i64>) -> StoredValue {
        StoredValue {
            store: Store::Int,
            words: values.into_iter().map(i64::cast_unsigned).collect(),
        }
    }

    /// Returns null of a type.
    #[must_use]
    pub fn null(ty: Type) -> StoredValue {
        let store = ty.store().unwrap_or(Store::Real);
        let word = match store {
            Store::Real => NULL_REAL.to_bits(),
            Store::Bool => NULL_BOOL.into(),
            Store::Int => NULL_INT.cast_unsigned(),
        };
        let words = match ty.width() {
            1 => Words::One(word),
            width => Words::Several(vec![word; width as usize]),
        };
        StoredValue { store, words }
    }

    /// Returns the arena.
    #[must_use]
    pub fn store(&self) -> Store {
        self.store
    }

    /// Returns the words: bits of numbers, truth values, whole numbers in two's complement.
    #[must_use]
    pub fn words(&self) -> &[u64] {
        match &self.words {
            Words::One(word) => std::slice::from_ref(word),
            Words::Several(words) => words,
        }
    }

    /// Returns the number of elements; types have at most 2^16.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.words().len() as u32
    }
}
