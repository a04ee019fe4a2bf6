//! The arenas of a plan while they grow: variables one after the other, equal constants once.
//! The loader's threads.

use std::collections::HashMap;

use rcc_core::types::Store;

use super::Slot;
use crate::syntax::literal::Stored;

/// The initial arenas.
#[derive(Debug, Default)]
pub struct Arena {
    /// `Real` and composites.
    pub reals: Vec<f64>,
    /// `Bool`.
    pub bools: Vec<u8>,
    /// `Int`.
    pub ints: Vec<i64>,
    constants: HashMap<Bits, Slot>,
}

/// A value by its bits: those that are equal here are the same in a cycle.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Bits {
    /// One number.
    Real(u64),
    /// One truth value.
    Bool(u8),
    /// One whole number.
    Int(i64),
    /// A composite or an array of numbers.
    Reals(Vec<u64>),
    /// An array of truth values.
    Bools(Vec<u8>),
    /// An array of whole numbers.
    Ints(Vec<i64>),
}

impl Bits {
    /// Of a value.
    pub fn of(value: &Stored) -> Bits {
        match value {
            Stored::Reals(values) => match values[..] {
                [value] => Bits::Real(value.to_bits()),
                _ => Bits::Reals(values.iter().map(|value| value.to_bits()).collect()),
            },
            Stored::Bools(values) => match values[..] {
                [value] => Bits::Bool(value),
                _ => Bits::Bools(values.clone()),
            },
            Stored::Ints(values) => match values[..] {
                [value] => Bits::Int(value),
                _ => Bits::Ints(values.clone()),
            },
        }
    }

    /// The value.
    pub fn stored(&self) -> Stored {
        let real = |bits: &u64| f64::from_bits(*bits);
        match self {
            Bits::Real(bits) => Stored::Reals(vec![real(bits)]),
            Bits::Bool(value) => Stored::Bools(vec![*value]),
            Bits::Int(value) => Stored::Ints(vec![*value]),
            Bits::Reals(bits) => Stored::Reals(bits.iter().map(real).collect()),
            Bits::Bools(values) => Stored::Bools(values.clone()),
            Bits::Ints(values) => Stored::Ints(values.clone()),
        }
    }
}

impl Arena {
    /// New slots that begin with these values.
    pub fn variable(&mut self, initial: &Stored) -> Slot {
        let (store, slot, width) = match initial {
            Stored::Reals(values) => (Store::Real, extend(&mut self.reals, values), values.len()),
            Stored::Bools(values) => (Store::Bool, extend(&mut self.bools, values), values.len()),
            Stored::Ints(values) => (Store::Int, extend(&mut self.ints, values), values.len()),
        };
        Slot {
            store,
            slot,
            width: width as u32,
        }
    }

    /// Slots that nobody writes; equal constants share them.
    pub fn constant(&mut self, value: &Stored) -> Slot {
        let key = Bits::of(value);
        if let Some(slot) = self.constants.get(&key) {
            return *slot;
        }
        let slot = self.variable(value);
        self.constants.insert(key, slot);
        slot
    }

    /// Changes the initial values from a slot on, in the arena of the value.
    pub fn write(&mut self, slot: u32, value: &Stored) {
        match value {
            Stored::Reals(values) => write(&mut self.reals, slot, values),
            Stored::Bools(values) => write(&mut self.bools, slot, values),
            Stored::Ints(values) => write(&mut self.ints, slot, values),
        }
    }

    /// Gives the slots from `to` on the initial values of others.
    pub fn repeat(&mut self, from: Slot, to: u32) {
        let range = from.slot as usize..(from.slot + from.width) as usize;
        match from.store {
            Store::Real => repeat(&mut self.reals, range, to),
            Store::Bool => repeat(&mut self.bools, range, to),
            Store::Int => repeat(&mut self.ints, range, to),
        }
    }

    /// The first of `count` new slots that begin with the first value of `one`.
    pub fn repeated(&mut self, one: &Stored, count: u32) -> u32 {
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

fn extend<T: Copy>(arena: &mut Vec<T>, values: &[T]) -> u32 {
    // The plan's limit of 2^20 slots is checked in the end; a text of 4 MiB cannot ask for 2^32.
    let slot = arena.len() as u32;
    arena.extend_from_slice(values);
    slot
}
