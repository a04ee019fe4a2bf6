//! Reads the record stream of a cell's executor and gives its values their names.
//! Run by one thread of a process of its own: whatever happens here, no cycle notices.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod names;
pub mod reader;
pub mod signals;
pub mod stream;
pub mod tail;
pub mod value;
