//! Robot-side and I/O-side simulators: the other end of the wires that our drivers speak, and nothing else of us.
//! Each simulator is a program of its own; its model is pure and runs in virtual time as well.

pub mod control_socket;
pub mod io;
pub mod line_server;
pub mod lwr;
