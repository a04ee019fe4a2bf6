//! The executor: one SCHED_FIFO thread that evaluates plans in each cycle, and helper threads around it.
//!
//! `rcc-engine` contains the work of a cycle. Here, `rt` is the real-time loop, `boards` connects the engine to shared
//! memory, and `clock` computes the deadlines of cycles;
//! `intake` takes requests, and `net_builder` builds the nets that it hands over; `pump` publishes records and logs
//! events; `incidents` writes the recordings of the flight recorder to files; `rule_texts` has the names of rules, and
//! `ids` keeps ids from being given twice.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod boards;
pub mod clock;
pub mod ids;
pub mod incidents;
pub mod intake;
pub mod net_builder;
pub mod pump;
pub mod rt;
pub mod rule_texts;
pub mod setup;
