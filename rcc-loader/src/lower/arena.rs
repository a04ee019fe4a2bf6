//! The arenas of a plan while they grow: variables one after the other, equal constants once.
//! The loader's threads.

use std::collections::BTreeMap;

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
    /// Constants by their bits.
    constants: BTreeMap<(u8, Vec<u64>), Slot>,
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
        let key = match value {
            Stored::Reals(values) => (0, values.iter().map(|value| value.to_bits()).collect()),
            Stored::Bools(values) => (1, values.iter().map(|value| u64::from(*value)).collect()),
            Stored::Ints(values) => (
                2,
                values.iter().map(|value| value.cast_unsigned()).collect(),
            ),
        };
        if let Some(slot) = self.constants.get(&key) {
            return *slot;
        }
        let slot = self.variable(value);
        self.constants.insert(key, slot);
        slot
    }

    /// The first of `count` new slots that begin with the first value of `one`.
    pub fn repeated(&mut self, one: &Stored, count: u32) -> u32 {
        (0..count)
            .map(|_| self.variable(one).slot)
            .min()
            .unwrap_or(0)
    }
}

fn extend<T: Copy>(arena: &mut Vec<T>, values: &[T]) -> u32 {
    // The plan's limit of 2^20 slots is checked in the end; a text of 4 MiB cannot ask for 2^32.
    let slot = arena.len() as u32;
    arena.extend_from_slice(values);
    slot
}
