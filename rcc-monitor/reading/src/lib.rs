//! Read access to a cell for every program that watches one: the record stream of its executor, the boards of its devices, its events,
//! the names of its values; and the messages that recordings and viewers get from them. It can do a cell no harm.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod messages;
pub mod names;
pub mod nets;
pub mod selection;
pub mod source;
pub mod stream;
