//! The command line of RCC: verbs, the supervisor behind `up`, and the demo. Everything runs in ordinary threads;
//! nothing here can affect a cycle.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod arguments;
pub mod cells;
pub mod client;
pub mod context;
pub mod csv;
pub mod dashboard;
pub mod demo;
pub mod doctor;
pub mod duration;
pub mod failure;
pub mod follow;
pub mod identify;
pub mod interrupt;
pub mod kept_state;
pub mod lease;
pub mod net_source;
pub mod output;
pub mod plot;
pub mod reach;
pub mod result_file;
pub mod scenario;
pub mod simulate;
pub mod supervisor;
pub mod table;
pub mod task;
pub mod units;
pub mod value;
pub mod verbs;
