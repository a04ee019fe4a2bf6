//! Why a plan is refused.

use serde::{Deserialize, Serialize};

use super::Resource;

/// Reason for refusing a plan. Numbers are indices into the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PlanError {
    /// The plan was made for another catalogue: loader and executor are different builds.
    OtherCatalogue,
    /// The plan was made for another device configuration.
    OtherConfiguration,
    /// An array is larger than allowed.
    TooLarge,
    /// No kernel has this number.
    UnknownKernel {
        /// Index of the run.
        run: u32,
    },
    /// The operands of a run are outside the operand array, or are not a whole number of groups.
    BadRun {
        /// Index of the run.
        run: u32,
    },
    /// An operand points outside its arena, or refers to a device, channel or clock that does not exist.
    BadOperand {
        /// Index of the operand.
        operand: u32,
    },
    /// Two primitives command the same resource.
    ClaimedTwice {
        /// The resource.
        resource: Resource,
    },
    /// The plan has no condition of `Termination`, or more than [`OUTCOMES_MAX`](super::OUTCOMES_MAX).
    Terminations {
        /// Number of conditions.
        count: u32,
    },
    /// The blocks do not cover the runs exactly, or refer to regions out of order.
    BadBlock {
        /// Index of the block; one past the last: all blocks together.
        block: u32,
    },
    /// A slot of a region is outside the `Bool` arena, or the region's numbers do not add up.
    BadRegion {
        /// Index of the region; one past the last: all regions together.
        region: u32,
    },
    /// A range that a region sets to null is outside its arena.
    BadBlank {
        /// Index of the range.
        blank: u32,
    },
    /// A delayed link points outside its arena.
    BadDelay {
        /// Index of the delay.
        delay: u32,
    },
    /// A monitor points outside its arena, is too wide, or is never due.
    BadMonitor {
        /// Index of the monitor.
        monitor: u32,
    },
    /// A value that is set from outside lies outside its arena, is published by the net itself, or exceeds
    /// [`INPUT_ELEMENTS_MAX`](super::INPUT_ELEMENTS_MAX) together with those before it.
    BadInput {
        /// Index of the input.
        input: u32,
    },
    /// A published value lies outside its arena, or is not in the order of the topic keys.
    BadPublish {
        /// Index of the value.
        publish: u32,
    },
    /// A path clock is used twice or not at all.
    Clocks,
    /// `every` or `phase` of the rate is out of range.
    BadRate,
    /// A net that commands joints is not evaluated in every cycle.
    SlowArm {
        /// Device index.
        device: u32,
    },
    /// An initial `Bool` is not 0, 1 or 2.
    BadBool {
        /// Index of the slot.
        slot: u32,
    },
}
