//! A plan: a net lowered to numbers. The loader checks it before sending it, and the executor checks it again before
//! accepting it; the cycle relies on nothing else.

mod check;
mod error;
mod regions;
mod resources;

use serde::{Deserialize, Serialize};

use crate::topic::Topic;
use crate::types::Store;

pub use check::CheckedPlan;
pub use error::PlanError;
pub use regions::{NO_REGION, NullRange, PlanRegion, REGIONS_MAX, RunBlock};
pub use resources::{Resource, Resources};

/// Maximum number of slots in one arena of a net.
pub const SLOTS_MAX: usize = 1 << 20;
/// Maximum number of operands of a net.
pub const OPERANDS_MAX: usize = 1 << 20;
/// Maximum number of elements that a net reads and writes in one cycle, delayed links included. Without it, a net
/// within all other limits could still take hours per cycle.
pub const WORK_MAX: u64 = 1 << 24;
/// Maximum number of path clocks of a net.
pub const CLOCKS_MAX: u32 = 64;
/// Maximum number of monitors of a net.
pub const MONITORS_MAX: usize = 256;
/// Maximum number of a net's inputs that are set from outside.
pub const INPUTS_MAX: usize = 256;
/// Maximum number of elements of these inputs together.
pub const INPUT_ELEMENTS_MAX: u32 = 4096;
/// Maximum number of topics that a net publishes, and that it subscribes to.
pub const TOPICS_MAX: usize = 32;
/// Maximum number of named outcomes of a net.
pub const OUTCOMES_MAX: u32 = 32;
/// Maximum number of cycles from one evaluation of a net to the next: one second at the shortest period.
pub const EVERY_MAX: u32 = 10_000;

/// The executor cycles in which a net is evaluated: those with `cycle % every == phase`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rate {
    /// Cycles from one evaluation to the next, 1 to [`EVERY_MAX`]; 1 for a net that commands joints.
    pub every: u32,
    /// Less than `every`.
    pub phase: u32,
}

impl Rate {
    /// Evaluated in every cycle.
    pub const EVERY_CYCLE: Rate = Rate { every: 1, phase: 0 };

    /// Returns true if a net with this rate is evaluated in executor cycle `cycle`.
    pub fn is_due(&self, cycle: u64) -> bool {
        let rest = cycle.checked_rem(u64::from(self.every)).unwrap_or(0);
        self.every <= 1 || rest == u64::from(self.phase)
    }

    fn is_good(&self) -> bool {
        (1..=EVERY_MAX).contains(&self.every) && self.phase < self.every
    }
}

impl Default for Rate {
    fn default() -> Rate {
        Rate::EVERY_CYCLE
    }
}

/// Consecutive primitives that share one kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KernelRun {
    /// Number of the kernel, see [`primitives::kernel`].
    pub kernel: u16,
    /// First operand.
    pub first: u32,
    /// Number of operands, a whole number of groups.
    pub operands: u32,
}

/// A delayed link: after the cycle, `from` is copied to `to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Delay {
    /// Arena.
    pub store: Store,
    /// Slot of the source.
    pub from: u32,
    /// Slot that the sink reads.
    pub to: u32,
    /// Number of elements.
    pub width: u32,
}

/// A value that is copied out after the cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MonitorPoint {
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of elements.
    pub width: u32,
    /// Number of cycles between two copies, at least 1.
    pub every: u32,
}

/// A published value: other nets can read it after the cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PublishPoint {
    /// The topic: its name and type.
    pub topic: Topic,
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of elements.
    pub width: u32,
}

/// A value that is set from outside between two evaluations of the net: through the control interface, or by another
/// net.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputPoint {
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of elements.
    pub width: u32,
    /// `Int` slot: evaluations since the value was set, 0 in the first evaluation that sees it; null if it was never
    /// set.
    pub since: u32,
    /// `Real` slot: the same as a time, s.
    pub age: u32,
    /// The value becomes null when it was set more than this many evaluations ago; 0 = never.
    pub expires: u32,
    /// First slot of the lower bounds of its elements, in the same arena.
    pub at_least: Option<u32>,
    /// First slot of the upper bounds of its elements, in the same arena.
    pub at_most: Option<u32>,
    /// The value is set only by the net that publishes this topic.
    pub topic: Option<Topic>,
}

/// Values in an arena, for display.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ValuePoint {
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of elements.
    pub width: u32,
}

/// A net lowered to numbers; borrows its arrays from their owner.
#[derive(Clone, Copy, Debug)]
pub struct Plan<'a> {
    /// Fingerprint of the catalogue that the kernel numbers refer to.
    pub catalogue: u64,
    /// Fingerprint of the device table that the device indices refer to.
    pub configuration: u64,
    /// Initial arena of `Real`: constants, states, and null elsewhere.
    pub reals: &'a [f64],
    /// Initial arena of `Bool`.
    pub bools: &'a [u8],
    /// Initial arena of `Int`.
    pub ints: &'a [i64],
    /// Kernel runs, in evaluation order.
    pub runs: &'a [KernelRun],
    /// Operands of all runs.
    pub operands: &'a [u32],
    /// The division of the runs among regions; empty: all runs are always evaluated.
    pub blocks: &'a [RunBlock],
    /// Conditionally evaluated regions; an enclosing region comes before the regions inside it.
    pub regions: &'a [PlanRegion],
    /// Values that become null when a region is deactivated, in the order of the regions.
    pub blanks: &'a [NullRange],
    /// Delayed links.
    pub delays: &'a [Delay],
    /// Monitors.
    pub monitors: &'a [MonitorPoint],
    /// Values that are set from outside.
    pub inputs: &'a [InputPoint],
    /// Published values, by ascending topic key.
    pub publishes: &'a [PublishPoint],
    /// Number of path clocks.
    pub clocks: u32,
    /// The cycles in which the net is evaluated.
    pub rate: Rate,
    /// The net continues, with null, when a device that it commands is lost.
    pub survives_device_loss: bool,
}
