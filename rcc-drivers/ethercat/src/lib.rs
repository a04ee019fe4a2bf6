//! EtherCAT (IEC 61158, type 12; ETG.1000): the driver `ethercat`, sessions of a MainDevice with a line of terminals, and a
//! simulated line.
//! Each program of this package is a process of its own; each module says which thread runs it.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod driver;
pub mod raw_socket;
pub mod session;
pub mod sim;
pub mod terminals;
pub mod wire;
