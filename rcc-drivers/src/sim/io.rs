//! A Modbus TCP server with 64 points of each kind, some of whose outputs can be wired back to inputs.
//! [`process_image::ProcessImage`] is the pure model; [`program`] puts the server and the control port around it.

pub mod control;
pub mod options;
pub mod process_image;
pub mod program;
