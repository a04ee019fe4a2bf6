//! A `trajectory_msgs/JointTrajectory` of ROS becomes a net: read, interpolated, checked against a robot's limits, written
//! with primitives of the catalogue. Pure functions of texts, run by whoever imports; never on the real-time thread.

mod brake;
mod excess;
mod net;
mod path;
mod read;

pub use brake::Brake;
pub use excess::{Excess, Quantity, excesses, stretch};
pub use net::{NetParts, text};
pub use path::{Interpolation, PathError, TrajectoryPath};
pub use read::{JointTrajectory, Point, read};
