//! RCC's own device drivers, made with `rcc-driver-kit`, and robot-side simulators that speak the same wire protocols.
//! Each driver and each simulator is a process of its own; each module says which thread runs it.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod drivers;
pub mod fri_iiwa;
pub mod fri_lwr;
pub mod sim;
