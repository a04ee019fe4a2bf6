//! Cells on several hosts over Zenoh: the gateway `rcc-link` publishes what a cell's nets publish, its events and states;
//! the driver `rcc-link-device` presents topics of another cell as inputs of a device. Processes of their own: none of
//! this is real-time, and none of it runs in a cycle.

pub mod access;
pub mod age;
pub mod cell_file;
pub mod certificate;
pub mod deploy;
pub mod device;
pub mod doctor;
pub mod fleet;
pub mod gateway;
pub mod handshake;
pub mod keys;
pub mod message;
pub mod named;
pub mod overview;
pub mod rights;
pub mod screen;
pub mod session;
