//! Simulators of robots and I/O stations: the other end of the wire protocols that our drivers speak, independent of
//! all other RCC code.
//! Each simulator is a program of its own; its model is pure and also runs in virtual time.

pub mod arm;
#[cfg(test)]
mod census;
pub mod control_socket;
pub mod iiwa;
pub mod io;
pub mod line_server;
pub mod lwr;
pub mod network;
pub mod number_list;
pub mod quality;
pub mod requests;
pub mod robot_options;
pub mod robot_program;
pub mod robot_settings;
pub mod robot_snapshot;
pub mod simulated_robot;
pub mod trace;
