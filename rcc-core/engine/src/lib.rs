//! The work of the real-time thread, without clock, board names and sleep: nets, command table, devices and guard.
//!
//! The executor runs it on its SCHED_FIFO thread; tests, replay and simulation run the same code in virtual time, where
//! a cycle is a step.
#![forbid(unsafe_code)]

pub mod boards;
pub mod costs;
pub mod engine;
pub mod hash;
pub mod incident;
pub mod input;
pub mod kernel_nets;
pub mod net;
pub mod queue;
pub mod record;
pub mod rehearsal;
pub mod replay;
pub mod rows;
pub mod rule;
pub mod rule_set;
pub mod snapshot;
