//! The joints of a device: vectors of them, their limits, and the motion of an arm. Plain data of fixed size; used by
//! every thread.

/// Maximum number of joints of a device.
pub const JOINTS_MAX: usize = 8;

/// A joint vector; elements past the device's joints are 0. For linear axes "rad" is m wherever joints are meant, here and in
/// all users of this type.
pub type Joints = [f64; JOINTS_MAX];

/// Joint limits of a robot's configuration; elements at and beyond index `joints` are ignored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits {
    /// Smallest position, rad.
    pub lower: Joints,
    /// Largest position, rad.
    pub upper: Joints,
    /// Largest |velocity|, rad/s.
    pub velocity_max: Joints,
    /// Largest |acceleration|, rad/s².
    pub acceleration_max: Joints,
    /// Largest |jerk|, rad/s³: used for planning motions and for checking a net before it starts; the guard itself does
    /// not check it.
    pub jerk_max: Joints,
    /// Number of joints, at most [`JOINTS_MAX`].
    pub joints: usize,
}

/// Where an arm is in its motion: what its last set-point leaves for the net that follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmMotion {
    /// Last set-point, rad.
    pub position: Joints,
    /// Velocity there, rad/s.
    pub velocity: Joints,
    /// Acceleration there, rad/s².
    pub acceleration: Joints,
}

impl ArmMotion {
    /// At rest at a position.
    #[must_use]
    pub fn at_rest(position: Joints) -> ArmMotion {
        ArmMotion {
            position,
            velocity: [0.0; JOINTS_MAX],
            acceleration: [0.0; JOINTS_MAX],
        }
    }
}
