//! The executor: one SCHED_FIFO thread that runs plans every cycle, and two helper threads around it.
//!
//! `rcc-engine` is the real-time thread's work; `rt` is its loop, `clock` says when it wakes; `intake` takes
//! requests and `net_builder` makes what it runs; `pump` carries away what it says; `incidents` writes what its flight recorder kept.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod clock;
pub mod incidents;
pub mod intake;
pub mod net_builder;
pub mod pump;
pub mod rt;
pub mod setup;
