//! What the loader and its clients share: the bodies and codes of the REST interface, its limits, its messages for
//! people, and a compiled net with everything that the loader stores beside it. Nothing here is real-time.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod bodies;
pub mod catalogue;
pub mod codes;
pub mod command_file;
pub mod compile;
pub mod error;
pub mod manual;
pub mod messages;
pub mod routes;
pub mod token;
pub mod topics;
