//! The template: two drivers in a repository of their own, to be copied. [`line_io`] is for a small I/O box, [`line_arm`] for
//! the controller of an arm; both speak lines of text over UDP. Keep the one that is nearer to your device, see
//! `docs/drivers.md`. The simulated devices are for the tests, and to try the drivers without hardware.

pub mod line_arm;
pub mod line_io;
pub mod simulated_arm;
pub mod simulated_box;
pub mod text_line;
