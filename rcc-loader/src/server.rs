//! The server of a cell: REST on its Unix socket and on TCP, the names of commands, and the link to the executor. One
//! thread accepts connections and carries out CANCEL and ABORT, one serves all other requests, blocking threads do the
//! work, and one thread maintains the link to the executor.

pub mod address;
pub mod bodies;
pub mod caller;
pub mod command_summary;
pub mod connection;
pub mod error;
pub mod executor;
mod fair_queue;
pub mod file_body;
pub mod listeners;
pub mod live;
pub mod peer;
pub mod published;
pub mod quota;
pub mod request_class;
pub mod request_head;
pub mod routes;
pub mod service;
pub mod socket;
mod stop_steps;
pub mod stop_workers;
pub mod store;
