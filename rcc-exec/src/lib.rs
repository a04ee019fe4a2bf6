//! The executor: one SCHED_FIFO thread that runs plans every cycle, and two helper threads around it.
//!
//! `rcc-engine` is the real-time thread's work; `rt` is its loop, `clock` says when it wakes; `intake` makes what it
//! runs; `pump` carries away what it says.
#![forbid(unsafe_code)]

pub mod clock;
pub mod intake;
pub mod pump;
pub mod rt;
pub mod setup;
