//! The server that loads nets, see the module.
//! Run by the loader's threads; nothing here is real-time.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod server;
