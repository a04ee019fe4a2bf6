//! Builds the initial arenas of a plan: variables in the order of allocation, equal constants once. Runs on the
//! loader's threads.

use foldhash::HashMap;
use rcc_core::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store, Type};

use super::SlotRange;
use crate::syntax::literal::StoredValue;

/// The initial arenas.
#[derive(Debug, Default)]
pub struct ArenaBuilder {
    /// Arena of `Real` and composites.
    pub reals: Vec<f64>,
    /// Arena of `Bool`.
    pub bools: Vec<u8>,
    /// Arena of `Int`.
    pub ints: Vec<i64>,
    constants: HashMap<ValueBits, SlotRange>,
}

/// A value by its bits: values that are equal here are interchangeable in a cycle.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ValueBits {
    /// A number.
    Real(u64),
    /// A truth value.
    Bool(u8),
    /// A whole number.
    Int(i64),
    /// A composite or an array of numbers.
    Reals(Vec<u64>),
    /// An array of truth values.
    Bools(Vec<u8>),
    /// An array of whole numbers.
    Ints(Vec<i64>),
}

impl ValueBits {
    /// Returns the bits of a value.
    pub fn of(value: &StoredValue) -> ValueBits {
        match value {
            StoredValue::Reals(values) => match values[..] {
                [value] => ValueBits::Real(value.to_bits()),
                _ => ValueBits::Reals(values.iter().map(|value| value.to_bits()).collect()),
            },
            StoredValue::Bools(values) => match values[..] {
                [value] => ValueBits::Bool(value),
                _ => ValueBits::Bools(values.clone()),
            },
            StoredValue::Ints(values) => match values[..] {
                [value] => ValueBits::Int(value),
                _ => ValueBits::Ints(values.clone()),
            },
        }
    }

    /// Returns the value.
    pub fn stored(&self) -> StoredValue {
        let real = |bits: &u64| f64::from_bits(*bits);
        match self {
            ValueBits::Real(bits) => StoredValue::Reals(vec![real(bits)]),
            ValueBits::Bool(value) => StoredValue::Bools(vec![*value]),
            ValueBits::Int(value) => StoredValue::Ints(vec![*value]),
            ValueBits::Reals(bits) => StoredValue::Reals(bits.iter().map(real).collect()),
            ValueBits::Bools(values) => StoredValue::Bools(values.clone()),
            ValueBits::Ints(values) => StoredValue::Ints(values.clone()),
        }
    }
}

impl ArenaBuilder {
    /// Allocates slots with these initial values.
    pub fn variable(&mut self, initial: &StoredValue) -> SlotRange {
        let (store, slot, width) = match initial {
            StoredValue::Reals(values) => {
                (Store::Real, extend(&mut self.reals, values), values.len())
            }
            StoredValue::Bools(values) => {
                (Store::Bool, extend(&mut self.bools, values), values.len())
            }
            StoredValue::Ints(values) => (Store::Int, extend(&mut self.ints, values), values.len()),
        };
        SlotRange {
            store,
            slot,
            width: width as u32,
        }
    }

    /// Allocates slots for a value that begins as null.
    pub fn null(&mut self, ty: Type) -> SlotRange {
        let width = ty.width();
        let count = width as usize;
        let (store, slot) = match ty.store() {
            Some(Store::Bool) => (Store::Bool, fill(&mut self.bools, NULL_BOOL, count)),
            Some(Store::Int) => (Store::Int, fill(&mut self.ints, NULL_INT, count)),
            _ => (Store::Real, fill(&mut self.reals, NULL_REAL, count)),
        };
        SlotRange { store, slot, width }
    }

    /// Returns slots that nothing writes; equal constants share them.
    pub fn constant(&mut self, value: &StoredValue) -> SlotRange {
        let key = ValueBits::of(value);
        if let Some(slot) = self.constants.get(&key) {
            return *slot;
        }
        let slot = self.variable(value);
        self.constants.insert(key, slot);
        slot
    }

    /// Overwrites the initial values from a slot on, in the arena of the value.
    pub fn write(&mut self, slot: u32, value: &StoredValue) {
        match value {
            StoredValue::Reals(values) => write(&mut self.reals, slot, values),
            StoredValue::Bools(values) => write(&mut self.bools, slot, values),
            StoredValue::Ints(values) => write(&mut self.ints, slot, values),
        }
    }

    /// Copies the initial values of `from` to the slots from `to` on.
    pub fn repeat(&mut self, from: SlotRange, to: u32) {
        let range = from.slot as usize..(from.slot + from.width) as usize;
        match from.store {
            Store::Real => repeat(&mut self.reals, range, to),
            Store::Bool => repeat(&mut self.bools, range, to),
            Store::Int => repeat(&mut self.ints, range, to),
        }
    }

    /// Allocates `count` copies of the value, and returns the first slot.
    pub fn repeated(&mut self, one: &StoredValue, count: u32) -> u32 {
        (0..count)
            .map(|_| self.variable(one).slot)
            .min()
            .unwrap_or(0)
    }
}

fn write<T: Copy>(arena: &mut [T], slot: u32, values: &[T]) {
    for (place, value) in arena.iter_mut().skip(slot as usize).zip(values) {
        *place = *value;
    }
}

fn repeat<T: Copy>(arena: &mut [T], range: std::ops::Range<usize>, to: u32) {
    let values = arena.get(range).unwrap_or(&[]).to_vec();
    write(arena, to, &values);
}

fn fill<T: Copy>(arena: &mut Vec<T>, value: T, count: usize) -> u32 {
    let slot = arena.len() as u32;
    arena.resize(arena.len() + count, value);
    slot
}

fn extend<T: Copy>(arena: &mut Vec<T>, values: &[T]) -> u32 {
    // The limit of 2^20 slots is checked at the end; a text of 4 MiB cannot ask for 2^32.
    let slot = arena.len() as u32;
    arena.extend_from_slice(values);
    slot
}
