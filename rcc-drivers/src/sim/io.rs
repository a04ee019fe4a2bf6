//! A simulated Modbus TCP server with 64 points of each kind; outputs can be looped back to inputs.
//! [`process_image::ProcessImage`] is the pure model; [`program`] adds the server and the control port.

pub mod control;
pub mod options;
pub mod process_image;
pub mod program;
