//! Reads the record stream of a cell's executor and resolves the names of its values: printed by `tail`, shown in browsers
//! by `serve`. Runs in a process of its own, so that nothing here can affect a cycle.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod reader;
pub mod record;
pub mod serve;
pub mod signals;
pub mod tail;
