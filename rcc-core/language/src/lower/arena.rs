//! Builds the initial arenas of a plan: variables in the order of allocation, equal constants once. Runs on the
//! loader's threads.

use foldhash::HashMap;
use rcc_core::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store, Type};

use super::SlotRange;
use crate::syntax::stored_value::StoredValue;

/// The initial arenas.
#[derive(Debug, Default)]
pub struct ArenaBuilder {
    /// Arena of `Real` and composites.
    pub reals: Vec<f64>,
    /// Arena of `Bool`.
    pub bools: Vec<u8>,
    /// Arena of `Int`.
    pub ints: Vec<i64>,
    constants: HashMap<StoredValue, SlotRange>,
}

impl ArenaBuilder {
    /// Allocates slots with these initial values.
    pub fn variable(&mut self, initial: &StoredValue) -> SlotRange {
        let words = initial.words().iter();
        let slot = match initial.store() {
            Store::Real => extend(&mut self.reals, words.map(real)),
            Store::Bool => extend(&mut self.bools, words.map(bool)),
            Store::Int => extend(&mut self.ints, words.map(int)),
        };
        SlotRange {
            store: initial.store(),
            slot,
            width: initial.width(),
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
        if let Some(slot) = self.constants.get(value) {
            return *slot;
        }
        let slot = self.variable(value);
        self.constants.insert(value.clone(), slot);
        slot
    }

    /// Overwrites the initial values from a slot on, in the arena of the value.
    pub fn write(&mut self, slot: u32, value: &StoredValue) {
        let words = value.words().iter();
        match value.store() {
            Store::Real => write(&mut self.reals, slot, words.map(real)),
            Store::Bool => write(&mut self.bools, slot, words.map(bool)),
            Store::Int => write(&mut self.ints, slot, words.map(int)),
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

fn real(word: &u64) -> f64 {
    f64::from_bits(*word)
}

/// Truth values and null are less than 256.
fn bool(word: &u64) -> u8 {
    *word as u8
}

fn int(word: &u64) -> i64 {
    word.cast_signed()
}

fn write<T>(arena: &mut [T], slot: u32, values: impl Iterator<Item = T>) {
    for (place, value) in arena.iter_mut().skip(slot as usize).zip(values) {
        *place = value;
    }
}

fn repeat<T: Copy>(arena: &mut [T], range: std::ops::Range<usize>, to: u32) {
    let values = arena.get(range).unwrap_or(&[]).to_vec();
    write(arena, to, values.into_iter());
}

fn fill<T: Copy>(arena: &mut Vec<T>, value: T, count: usize) -> u32 {
    let slot = arena.len() as u32;
    arena.resize(arena.len() + count, value);
    slot
}

fn extend<T>(arena: &mut Vec<T>, values: impl Iterator<Item = T>) -> u32 {
    // The limit of 2^20 slots is checked at the end; a text of 4 MiB cannot ask for 2^32.
    let slot = arena.len() as u32;
    arena.extend(values);
    slot
}
