//! The parameter `start`: whether what a primitive begins from is where the arm was held when the command was prepared, or
//! what the net in which it runs takes over in its first cycle. Run by the real-time thread.

use crate::frame::Frame;
use crate::joints::ArmMotion;
use crate::primitive::{DefaultValue, Device, Int, Parameter, ParameterKind, Slot};

/// Where the primitive begins.
const STARTS: &[&str] = &["hold", "continue"];
/// Index of `continue` in [`STARTS`].
pub(super) const CONTINUE: i64 = 1;

/// The parameter `start`; `doc` says what both words mean.
pub(super) const fn parameter(doc: &'static str) -> Parameter {
    Parameter::new("start", ParameterKind::Word(STARTS), doc).default(DefaultValue::Word("hold"))
}

/// Returns where the arm is in its motion, in the first cycle of a net with `start: continue`; nothing in all other cycles,
/// and while it is not known. `None` outside of the arena.
pub(super) fn taken_over(
    frame: &Frame<'_>,
    device: Device,
    start: Slot<Int>,
) -> Option<Option<ArmMotion>> {
    if frame.cycle != 0 || frame.get(start)? != CONTINUE {
        return Some(None);
    }
    Some(frame.arms.get(device.0 as usize).copied().flatten())
}
