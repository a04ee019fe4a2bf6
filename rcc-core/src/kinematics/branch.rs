//! The branches in which an arm reaches a pose, and the reasons why it cannot. Plain data; used by the loader and by
//! the real-time thread.

use core::fmt;

/// Number of branches, for every arm.
pub const BRANCHES: usize = 8;

/// One of the eight solutions for a pose (with a given arm angle, if the arm has one).
///
/// S-R-S arm: the signs of the canonical joints 2, 4 and 6 (Faria 2018: GC2, GC4, GC6). Ortho-parallel arm: the side of
/// axis 1 on which the wrist is, the side of the line through axes 2 and 3 on which the forearm is, and the sign of the
/// canonical joint 5. Zero counts as not negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Branch {
    /// S-R-S: canonical q2 < 0. Ortho-parallel: the wrist is behind axis 1 (reached overhead).
    pub shoulder_negative: bool,
    /// S-R-S: canonical q4 < 0. Ortho-parallel: the forearm is bent backwards from the stretched arm.
    pub elbow_negative: bool,
    /// S-R-S: canonical q6 < 0. Ortho-parallel: canonical θ5 < 0.
    pub wrist_negative: bool,
}

impl Branch {
    /// Returns the branch as a number in 0..8: bit 0 shoulder, bit 1 elbow, bit 2 wrist.
    #[must_use]
    pub fn index(self) -> u8 {
        u8::from(self.shoulder_negative)
            | u8::from(self.elbow_negative) << 1
            | u8::from(self.wrist_negative) << 2
    }

    /// Returns the branch of a number in 0..8, `None` for other numbers.
    #[must_use]
    pub fn from_index(index: u8) -> Option<Self> {
        (index < 8).then_some(Self::from_bits(index))
    }

    /// Returns the branch of the lowest three bits of a number.
    #[must_use]
    pub fn from_bits(bits: u8) -> Self {
        let bit = |n: u8| bits >> n & 1 == 1;
        Self {
            shoulder_negative: bit(0),
            elbow_negative: bit(1),
            wrist_negative: bit(2),
        }
    }

    /// Returns all branches, by their number.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..BRANCHES as u8).map(Self::from_bits)
    }
}

/// Branch and arm angle of joint positions: together with the flange pose they determine the joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmConfiguration {
    /// The branch.
    pub branch: Branch,
    /// The arm angle, rad; 0 for an arm without one.
    pub arm_angle: f64,
}

/// The reason why no joint position was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unreachable {
    /// The wrist would be `distance` m from the shoulder, but the stretched arm reaches only `reach` m.
    TooFar {
        /// Shoulder to wrist, m.
        distance: f64,
        /// Largest possible distance, m.
        reach: f64,
    },
    /// The wrist would be `distance` m from the shoulder (or from axis 1, for an arm with a lateral offset); the folded
    /// arm reaches no closer than `reach` m.
    TooClose {
        /// Shoulder to wrist, m.
        distance: f64,
        /// Smallest possible distance (excluded for an S-R-S arm), m.
        reach: f64,
    },
    /// The numeric inverse kinematics ended this far from the pose: m and rad, as one vector.
    NoSolution {
        /// Remaining distance from the pose.
        residual: f64,
    },
    /// The pose, the arm angle or a required hint is null (NaN) or infinite.
    NotFinite,
}

impl fmt::Display for Unreachable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFar { distance, reach } => {
                write!(
                    f,
                    "the wrist would be {distance:.4} m from the shoulder, the arm reaches {reach:.4} m"
                )
            }
            Self::TooClose { distance, reach } => {
                write!(
                    f,
                    "the wrist would be {distance:.4} m from the shoulder, the arm needs more than {reach:.4} m"
                )
            }
            Self::NoSolution { residual } => write!(
                f,
                "the numeric inverse found no joint positions: it ended {residual:.1e} m or rad from the pose"
            ),
            Self::NotFinite => write!(f, "the pose, arm angle or hint is null"),
        }
    }
}

impl core::error::Error for Unreachable {}
