//! The loader as a server: REST on the cell's Unix socket, names of commands, and the link to the executor.
//! One thread serves connections, blocking threads do the work, one thread tends the link to the executor.

pub mod address;
pub mod api;
pub mod bodies;
pub mod caller;
pub mod catalogue;
pub mod codes;
pub mod compile;
pub mod configuration;
pub mod door;
pub mod doors;
pub mod error;
pub mod executor;
mod handover;
pub mod head;
mod impedance;
pub mod index;
pub mod lane;
pub mod manual;
mod rehearsal;
pub mod routes;
pub mod service;
mod show;
pub mod socket;
pub mod store;
mod timing;
pub mod token;
pub mod topics;
pub mod values;
pub mod words;
