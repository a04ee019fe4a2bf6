//! Closed-form kinematics of the arms that the core knows: forward, Jacobian and inverse in a fixed number of steps.
//! Pure functions of their arguments; used by the loader and by the real-time thread.

mod srs;

pub use srs::{Branch, SrsArm, Unreachable};
