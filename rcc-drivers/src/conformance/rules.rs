//! The rules, one function each; a rule panics if the driver breaks it.
//! Test code only.

mod configuration;
mod exchange;
mod faults;
mod in_a_cell;
mod outputs;
mod rest;
mod restart;

pub use configuration::*;
pub use exchange::*;
pub use faults::*;
pub use in_a_cell::*;
pub use outputs::*;
pub use rest::*;
pub use restart::*;

pub use super::capture::{replays_a_recording, replays_its_capture};
