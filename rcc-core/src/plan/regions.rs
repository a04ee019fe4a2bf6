//! Conditional activity: parts of a net that are evaluated only while a condition is true. While it is false, a region
//! costs one test, its outputs are null, and its states are frozen. Decided by the real-time thread, once per cycle and
//! region.

use serde::{Deserialize, Serialize};

use super::{OPERANDS_MAX, Plan, PlanError};
use crate::frame::Frame;
use crate::primitive::{Bool, Slot};
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store};

/// Maximum number of regions of a net.
pub const REGIONS_MAX: usize = 1 << 16;
/// Stands for "no region": for blocks that are always evaluated, and as parent of top-level regions.
pub const NO_REGION: u32 = u32::MAX;

/// Consecutive runs of one region. A net without regions has no blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunBlock {
    /// Index of the region, or [`NO_REGION`]. The region is decided at its first block, and regions are numbered in the
    /// order of their first blocks.
    pub region: u32,
    /// Number of runs; may be 0.
    pub runs: u32,
}

/// A region: a part of the net that is evaluated only under a condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlanRegion {
    /// Slot of the condition; null counts as false.
    pub condition: u32,
    /// The `active` slot of the enclosing region, or [`NO_REGION`].
    pub within: u32,
    /// Slot that is true while the region is evaluated; written only when the region is decided.
    pub active: u32,
    /// Number of its [`NullRange`]s; they follow those of the regions before it.
    pub blanks: u32,
}

/// Values that become null when a region is deactivated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NullRange {
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of elements.
    pub width: u32,
}

impl Plan<'_> {
    /// Checks blocks, regions and null ranges; returns the largest number of elements and steps that regions cost in
    /// one cycle.
    pub(super) fn check_regions(&self) -> Result<u64, PlanError> {
        if self.regions.len() > REGIONS_MAX || self.blocks.len() > OPERANDS_MAX {
            return Err(PlanError::TooLarge);
        }
        if self.blocks.is_empty() {
            return match (self.regions, self.blanks) {
                ([], []) => Ok(0),
                _ => Err(PlanError::BadRegion { region: 0 }),
            };
        }
        let (mut runs, mut decided) = (0u64, 0u32);
        for (block, index) in self.blocks.iter().zip(0u32..) {
            runs += u64::from(block.runs);
            if block.region == decided {
                decided += 1;
            } else if block.region != NO_REGION && block.region > decided {
                return Err(PlanError::BadBlock { block: index });
            }
        }
        if runs != self.runs.len() as u64 || decided as usize != self.regions.len() {
            let block = self.blocks.len() as u32;
            return Err(PlanError::BadBlock { block });
        }
        let mut blanks = 0u64;
        for (region, index) in self.regions.iter().zip(0u32..) {
            blanks += u64::from(region.blanks);
            let around = region.within == NO_REGION || self.contains(Store::Bool, region.within, 1);
            let good = around
                && self.contains(Store::Bool, region.condition, 1)
                && self.contains(Store::Bool, region.active, 1);
            if !good {
                return Err(PlanError::BadRegion { region: index });
            }
        }
        if blanks != self.blanks.len() as u64 {
            let region = self.regions.len() as u32;
            return Err(PlanError::BadRegion { region });
        }
        let mut work = self.blocks.len() as u64 + self.regions.len() as u64;
        for (blank, index) in self.blanks.iter().zip(0u32..) {
            work = work.saturating_add(u64::from(blank.width));
            if !self.contains(blank.store, blank.slot, blank.width) {
                return Err(PlanError::BadBlank { blank: index });
            }
        }
        Ok(work)
    }
}

impl PlanRegion {
    /// Decides whether the region is evaluated in this cycle, and sets its values to null when it is deactivated;
    /// `blanks` are the region's own ranges.
    pub(crate) fn decide(&self, blanks: &[NullRange], frame: &mut Frame<'_>) {
        let is_true = |slot: u32| frame.get(Slot::<Bool>::at(slot)) == Some(1);
        let around = self.within == NO_REGION || is_true(self.within);
        let active = around && is_true(self.condition);
        if self.is_active(frame) && !active {
            for blank in blanks {
                blank.make_null(frame);
            }
        }
        frame.put(Slot::<Bool>::at(self.active), u8::from(active));
    }

    /// Returns true if the region is evaluated in this cycle.
    pub(crate) fn is_active(&self, frame: &Frame<'_>) -> bool {
        frame.get(Slot::<Bool>::at(self.active)) == Some(1)
    }
}

impl NullRange {
    fn make_null(&self, frame: &mut Frame<'_>) {
        let (slot, width) = (self.slot as usize, self.width as usize);
        match self.store {
            Store::Real => fill(frame.reals, slot, width, NULL_REAL),
            Store::Bool => fill(frame.bools, slot, width, NULL_BOOL),
            Store::Int => fill(frame.ints, slot, width, NULL_INT),
        }
    }
}

fn fill<T: Copy>(arena: &mut [T], slot: usize, width: usize, null: T) {
    let slots = arena.get_mut(slot..).and_then(|tail| tail.get_mut(..width));
    if let Some(slots) = slots {
        slots.fill(null);
    }
}
