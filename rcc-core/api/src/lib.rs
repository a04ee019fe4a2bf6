//! The REST interface as loader and clients share it: bodies, error codes, limits, messages for people, and the compiled
//! net that the loader stores. Nothing here is real-time.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod bodies;
pub mod catalogue;
pub mod codes;
pub mod command_file;
pub mod compile;
pub mod conditions;
pub mod error;
pub mod events;
pub mod findings;
pub mod incident_nets;
pub mod incidents;
pub mod manual;
pub mod messages;
pub mod own_hosts;
pub mod routes;
pub mod streams;
pub mod token;
pub mod topics;
