//! A simulated EtherCAT line: SubDevices that any MainDevice brings to OP over a raw Ethernet socket.
//! [`line::Line`] is the pure model, frame in and frame out; [`program`] adds the socket, the clock and the control port.

pub use crate::terminals as model;

pub mod clock;
pub mod control;
pub mod drive;
pub mod drive_objects;
pub mod eeprom;
pub mod fmmu;
pub mod frame;
pub mod line;
pub mod mailbox;
pub mod model_objects;
pub mod objects;
pub mod options;
pub mod program;
pub mod registers;
pub mod state_machine;
pub mod sub_device;
