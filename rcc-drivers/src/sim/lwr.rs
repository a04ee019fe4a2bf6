//! A simulated KRC with a KUKA LWR 4+: a controller that sends first, supervises the answers, and moves a simulated
//! arm.
//! [`krc::Krc`] is the pure model in virtual time; [`program`] adds sockets, a clock and threads.

pub mod arm;
pub mod command_stream;
pub mod control;
pub mod dynamics;
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

/// Number of joints.
pub const JOINTS: usize = crate::fri_lwr::wire::JOINTS;

/// One value per joint, A1 to J7 in kinematic order; rad and its derivatives.
pub type Joints = [f64; JOINTS];
