//! Singularities of all kinds of arms, and the distance from the nearest one. Plain data without heap.

use core::fmt;

/// The kinds of singularities: the flange loses a direction of motion, or aligned axes leave their joints undetermined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SingularityKind {
    /// Stretched (or folded): no motion further out.
    Elbow,
    /// The first and the last axis of the wrist are aligned.
    Wrist,
    /// S-R-S: the axes of joints 1 and 3 are aligned. Ortho-parallel: the wrist is above (or below) axis 1.
    Shoulder,
    /// S-R-S: the wrist is above (or below) the shoulder, where the arm angle is undefined.
    ArmAngle,
    /// `SerialArm`: the Jacobian loses rank.
    Rank,
}

impl SingularityKind {
    /// Returns the kind as a number from 1, in the order of declaration.
    #[must_use]
    pub fn number(self) -> u32 {
        self as u32 + 1
    }

    /// Returns the kind of a [`SingularityKind::number`]; `None` if the number is unknown.
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        let all = [
            Self::Elbow,
            Self::Wrist,
            Self::Shoulder,
            Self::ArmAngle,
            Self::Rank,
        ];
        all.into_iter().find(|kind| kind.number() == number)
    }
}

impl fmt::Display for SingularityKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Elbow => "the elbow is stretched",
            Self::Wrist => "two wrist axes are aligned",
            Self::Shoulder => "the wrist or elbow is above the shoulder",
            Self::ArmAngle => "the wrist is above the shoulder",
            Self::Rank => "the flange cannot move in one direction",
        })
    }
}

/// The nearest singularity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Singularity {
    /// Kind.
    pub kind: SingularityKind,
    /// Distance: the sine of the remaining angle, 0 to 1; for a wrist above axis 1 its distance from the axis relative
    /// to the arm's reach; for a `SerialArm` the smallest singular value of the Jacobian, with 1 m weighted as 1 rad. NaN
    /// for null joints.
    pub distance: f64,
}

impl Singularity {
    pub(super) fn nearest<const N: usize>(all: [(SingularityKind, f64); N]) -> Singularity {
        let first = Singularity {
            kind: SingularityKind::Elbow,
            distance: f64::INFINITY,
        };
        all.into_iter().fold(first, |nearest, (kind, distance)| {
            // The comparison is written so that null wins and stays.
            if distance >= nearest.distance || nearest.distance.is_nan() {
                nearest
            } else {
                Singularity { kind, distance }
            }
        })
    }
}
