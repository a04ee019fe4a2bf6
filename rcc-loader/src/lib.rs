//! The loader's library: the REST server of a cell, see [`server`]. Nothing here is real-time.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod server;
