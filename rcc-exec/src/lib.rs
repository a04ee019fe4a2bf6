//! The executor: one SCHED_FIFO thread that runs plans every cycle, and two helper threads around it.
//!
//! `engine` is the real-time thread's work without clock and boards, so that tests run it in virtual
//! time; `rt` is its loop; `intake` makes what it runs; `pump` carries away what it says.
#![forbid(unsafe_code)]

pub mod engine;
pub mod intake;
pub mod net;
pub mod pump;
pub mod queue;
pub mod rt;
pub mod setup;
