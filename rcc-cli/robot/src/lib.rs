//! Creates robot files from URDF: recognises the chain between two links as an arm with closed-form inverse kinematics by
//! its geometry, or else takes its axes as they are, and verifies the result by comparing forward kinematics. Runs once,
//! on the main thread of a program; not real time.

mod chain;
mod fit;
mod serial;
mod urdf;
mod yaml;

use rcc_core::kinematics::{AXES_MAX, Arm};
use rcc_core::message::{JOINTS_MAX, Joints};

pub use chain::{JointChain, RevoluteJoint};
pub use fit::GeometryMismatch;
pub use urdf::{BYTES_MAX, UrdfError};
pub use yaml::yaml;

/// Tolerance between the two forward kinematics, m and rad.
pub const TOLERANCE: f64 = 1e-9;

/// Number of random joint positions that are compared.
const SAMPLES: usize = 1000;

/// A recognised robot.
#[derive(Clone, Debug)]
pub struct Imported {
    /// Name of the robot in the URDF.
    pub name: String,
    /// Chain of its joints.
    pub chain: JointChain,
    /// Kinematics of the arm.
    pub arm: Arm,
    /// Why the arm has no closed-form inverse kinematics; `None` if it has.
    pub not_closed: Option<ClosedFormMismatch>,
    /// Largest difference between the two forward kinematics, m or rad.
    pub difference: f64,
}

/// Reason why a URDF is not a supported robot.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The text is not a URDF.
    #[error("invalid URDF: {0}")]
    NotUrdf(#[from] UrdfError),
    /// The link does not exist.
    #[error("link `{link}` not found; available links: {links}")]
    UnknownLink {
        /// Name of the link.
        link: String,
        /// Names of the existing links.
        links: String,
    },
    /// Several links could be the base or the tip.
    #[error("several links can be the {what}: {links}; select one with --{what}")]
    Ambiguous {
        /// `base` or `tip`.
        what: &'static str,
        /// Names of these links.
        links: String,
    },
    /// Base and tip are not on one chain.
    #[error("no chain of joints leads from link `{base}` to link `{tip}`")]
    NoChain {
        /// Name of the base.
        base: String,
        /// Name of the tip.
        tip: String,
    },
    /// The robot has no first or last link.
    #[error(
        "no link can be the {what}: the joints form a loop; an arm is a chain from its base to its flange"
    )]
    Loop {
        /// `base` or `tip`.
        what: &'static str,
    },
    /// The text is a xacro file.
    #[error("this is a xacro file: expand it first (`xacro FILE -o robot.urdf`)")]
    Xacro,
    /// A joint of the chain is not revolute.
    #[error("joint `{joint}` is {kind}; an arm has revolute joints only")]
    NotRevolute {
        /// Name of the joint.
        joint: String,
        /// Type of the joint.
        kind: String,
    },
    /// A joint has values that no arm can have.
    #[error("joint `{joint}` {what}")]
    Unusable {
        /// Name of the joint.
        joint: String,
        /// The problem and the remedy.
        what: String,
    },
    /// The range of a joint is reversed.
    #[error(
        "joint `{joint}`: its range goes from {lower} to {upper} rad: swap `lower` and `upper` in the URDF"
    )]
    Reversed {
        /// Name of the joint.
        joint: String,
        /// `lower`, rad.
        lower: f64,
        /// `upper`, rad; less than `lower`.
        upper: f64,
    },
    /// No supported arm has this number of revolute joints.
    #[error("the chain has {count} revolute joints ({joints}); an arm has 1 to {AXES_MAX}")]
    Count {
        /// Number of revolute joints.
        count: usize,
        /// Their names.
        joints: String,
    },
    /// The arm by its axes differs from the URDF.
    #[error(
        "the arm by its axes differs from the URDF by up to {difference:.1e} m or rad (allowed: {TOLERANCE:.0e})"
    )]
    Differs {
        /// Largest difference, m or rad.
        difference: f64,
    },
}

/// Reason why a chain is no arm with closed-form inverse kinematics.
#[derive(Clone, Debug, thiserror::Error)]
pub enum ClosedFormMismatch {
    /// The number of joints does not fit.
    #[error(
        "closed forms are for 6 joints (ortho-parallel) or 7 (S-R-S), and the chain has {count}"
    )]
    Count {
        /// Number of revolute joints.
        count: usize,
    },
    /// The axis of a joint does not fit.
    #[error("joint `{joint}`: {mismatch}")]
    Joint {
        /// Name of the joint.
        joint: String,
        /// The mismatch.
        mismatch: GeometryMismatch,
    },
    /// The base or the tip does not fit.
    #[error("link `{link}`: {mismatch}")]
    Link {
        /// Name of the link.
        link: String,
        /// The mismatch.
        mismatch: GeometryMismatch,
    },
    /// The arm fits, but not exactly enough.
    #[error(
        "the recognised arm differs from the URDF by up to {difference:.1e} m or rad (allowed: {TOLERANCE:.0e}): the URDF's numbers are rounded; write them with all digits (π/2 is 1.5707963267948966)"
    )]
    Differs {
        /// Largest difference, m or rad.
        difference: f64,
    },
}

/// Recognises the arm between two links; by default from the root to the only leaf (or to `tool0`, `flange`, `ee_link`,
/// `ee`).
///
/// # Errors
/// Fails if the text is not a URDF or is xacro, or if the chain has no revolute joint, more than seven, or other joints;
/// names the joint that does not fit.
pub fn import(text: &str, base: Option<&str>, tip: Option<&str>) -> Result<Imported, ImportError> {
    if text.len() <= BYTES_MAX && text.contains("<xacro:") {
        return Err(ImportError::Xacro);
    }
    let robot = urdf::read(text)?;
    let chain = JointChain::of(&robot, base, tip)?;
    let (arm, not_closed) = match closed_form(&chain) {
        Ok(arm) => (arm, None),
        Err(mismatch) => (serial::arm(&chain)?, Some(mismatch)),
    };
    let difference = difference(&chain, &arm);
    if difference > TOLERANCE || difference.is_nan() {
        return Err(ImportError::Differs { difference });
    }
    Ok(Imported {
        name: robot.name,
        chain,
        arm,
        not_closed,
        difference,
    })
}

/// Returns the arm if its inverse kinematics has a closed form.
fn closed_form(chain: &JointChain) -> Result<Arm, ClosedFormMismatch> {
    let arm = fit::arm(chain)?;
    let difference = difference(chain, &arm);
    if difference > TOLERANCE || difference.is_nan() {
        return Err(ClosedFormMismatch::Differs { difference });
    }
    Ok(arm)
}

/// Returns the largest difference between the two forward kinematics at random joint positions, m or rad.
fn difference(chain: &JointChain, arm: &Arm) -> f64 {
    let mut worst = 0.0_f64;
    for joints in samples(chain.revolute_joints.len()) {
        let (theirs, ours) = (chain.forward(&joints), arm.forward(&joints));
        worst = worst
            .max(theirs.distance_to(&ours))
            .max(theirs.angle_to(&ours));
    }
    worst
}

/// Returns random positions of this many joints, the same in each run; each joint in [−π, π).
fn samples(count: usize) -> impl Iterator<Item = Joints> {
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    (0..SAMPLES).map(move |_| {
        let mut joints: Joints = [0.0; JOINTS_MAX];
        for joint in joints.iter_mut().take(count) {
            // xorshift64*.
            seed ^= seed >> 12;
            seed ^= seed << 25;
            seed ^= seed >> 27;
            let share =
                (seed.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64;
            *joint = (share * 2.0 - 1.0) * core::f64::consts::PI;
        }
        joints
    })
}

#[cfg(test)]
mod tests;
