//! The server of a cell: REST on its Unix socket and on TCP, the names of commands, and the link to the executor. One
//! thread serves connections, blocking threads do the work, and one thread maintains the link to the executor.

pub mod address;
pub mod api;
pub mod bodies;
pub mod caller;
pub mod catalogue;
pub mod codes;
pub mod command_summary;
pub mod compile;
pub mod configuration;
pub mod connection;
pub mod error;
pub mod executor;
mod handover;
mod impedance;
pub mod listeners;
pub mod manual;
pub mod messages;
mod rehearsal;
pub mod request_head;
pub mod routes;
pub mod service;
pub mod socket;
mod status;
pub mod stop_workers;
pub mod store;
mod timing;
pub mod token;
pub mod topics;
pub mod values;
