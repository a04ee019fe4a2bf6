//! A simulated KRC with a KUKA LWR 4+: a controller that sends first, supervises the answers, and moves a simulated
//! arm.
//! [`krc::Krc`] is the pure model in virtual time; [`program`] adds sockets, a clock and threads.

pub mod control;
pub mod fault;
pub mod impedance;
pub mod krc;
mod krl_program;
mod measurement;
pub mod model;
pub mod options;
pub mod program;
pub mod settings;
pub mod statistics;

#[cfg(test)]
mod tests;

pub use super::arm::{JOINTS, Joints};
