//! The KRC side of a KUKA LWR 4+: a controller that sends first, judges the answers, and moves a simulated arm.
//! [`krc::Krc`] is the pure model in virtual time; [`program`] puts sockets, a clock and threads around it.

pub mod arm;
pub mod command_stream;
pub mod control;
pub mod environment;
pub mod fault;
pub mod impedance;
pub mod krc;
mod krl_program;
mod measurement;
pub mod model;
pub mod network;
pub mod options;
pub mod program;
pub mod quality;
pub mod settings;
pub mod statistics;
pub mod stop_ramp;
pub mod trace;

#[cfg(test)]
mod tests;

/// Joints of the arm.
pub const JOINTS: usize = crate::fri_lwr::wire::JOINTS;

/// One value for each joint, A1 to J7 in kinematic order; rad and its derivatives.
pub type Joints = [f64; JOINTS];
