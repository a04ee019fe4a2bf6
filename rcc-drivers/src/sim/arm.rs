//! The simulated arm of every robot: geometry, weight and friction, position and impedance control, stops, and the
//! supervision of a commanded stream.
//! Pure; run by a simulator's clock thread.

pub mod command_stream;
pub mod dynamics;
pub mod environment;
pub mod impedance;
pub mod model;
pub mod simulated_arm;
pub mod stop_ramp;
#[cfg(test)]
pub(crate) mod wall_fixture;

/// Number of joints.
pub const JOINTS: usize = 7;

/// One value per joint, in kinematic order; rad and its derivatives.
pub type Joints = [f64; JOINTS];
