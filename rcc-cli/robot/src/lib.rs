//! Robot files from URDF: the chain between two links is recognised as one of the arms that the core knows, by its geometry,
//! and nothing is written before forward kinematics of both agree. Runs once, on the main thread of a program; no real time.

mod chain;
mod fit;
mod urdf;
mod yaml;

use rcc_core::kinematics::Arm;
use rcc_core::message::{JOINTS_MAX, Joints};

pub use chain::{Chain, RevoluteJoint};
pub use fit::GeometryMismatch;
pub use urdf::{BYTES_MAX, UrdfError};
pub use yaml::yaml;

/// Both forward kinematics may differ by this, m and rad.
pub const TOLERANCE: f64 = 1e-9;

/// How many random joint positions are compared.
const SAMPLES: usize = 1000;

/// What was recognised.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The robot's name in the URDF.
    pub name: String,
    /// The chain that was looked at.
    pub chain: Chain,
    /// Its kinematics.
    pub arm: Arm,
    /// The largest difference of both forward kinematics, m or rad.
    pub difference: f64,
}

/// Why a URDF gives no robot.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The text is no URDF.
    #[error("invalid URDF: {0}")]
    NotUrdf(#[from] UrdfError),
    /// A link is not there.
    #[error("link `{link}` not found; available links: {links}")]
    UnknownLink {
        /// The link.
        link: String,
        /// Those that are there.
        links: String,
    },
    /// Several links may be meant.
    #[error("several links could be the {what}: {links}; name one")]
    Ambiguous {
        /// "base" or "tip".
        what: &'static str,
        /// Which.
        links: String,
    },
    /// Base and tip are not on one chain.
    #[error("no chain of joints leads from link `{base}` to link `{tip}`")]
    NoChain {
        /// The base.
        base: String,
        /// The tip.
        tip: String,
    },
    /// No link begins or ends the robot.
    #[error(
        "no link can be the {what}: the joints form a loop; an arm is a chain from its base to its flange"
    )]
    Loop {
        /// `base` or `tip`.
        what: &'static str,
    },
    /// A text from which URDF is made.
    #[error("this is a xacro file: expand it first (`xacro FILE -o robot.urdf`)")]
    Xacro,
    /// A joint of the chain that is no hinge.
    #[error("joint `{joint}` is {kind}; an arm has revolute joints only")]
    NotRevolute {
        /// The joint.
        joint: String,
        /// What it is.
        kind: String,
    },
    /// A joint of which the URDF says what no arm can be.
    #[error("joint `{joint}` {what}")]
    Unusable {
        /// The joint.
        joint: String,
        /// What is said, and what to do.
        what: String,
    },
    /// The range of a joint ends before it begins.
    #[error(
        "joint `{joint}`: its range goes from {lower} to {upper} rad: swap `lower` and `upper` in the URDF"
    )]
    Reversed {
        /// The joint.
        joint: String,
        /// `lower`, rad.
        lower: f64,
        /// `upper`, rad; less than it.
        upper: f64,
    },
    /// The number of hinges fits no arm.
    #[error(
        "the chain has {count} revolute joints ({joints}); supported arms have 6 (ortho-parallel) or 7 (S-R-S)"
    )]
    Count {
        /// How many.
        count: usize,
        /// Their names.
        joints: String,
    },
    /// A joint does not fit.
    #[error("joint `{joint}`: {mismatch}")]
    Joint {
        /// The joint.
        joint: String,
        /// What it lacks.
        mismatch: GeometryMismatch,
    },
    /// The base or the tip does not fit.
    #[error("link `{link}`: {mismatch}")]
    Link {
        /// The link.
        link: String,
        /// What it lacks.
        mismatch: GeometryMismatch,
    },
    /// Everything fits, but not exactly enough.
    #[error(
        "the recognised arm differs from the URDF by up to {difference:.1e} m or rad (allowed: {TOLERANCE:.0e}): the URDF's numbers are rounded; write them with all digits (π/2 is 1.5707963267948966)"
    )]
    Differs {
        /// By so much.
        difference: f64,
    },
}

/// Recognises the arm between two links; without names from the root to the only leaf (or to `tool0`, `flange`, `ee`).
///
/// # Errors
/// The text is no URDF, or xacro, or the chain is no arm that the core knows, with the joint that does not fit.
pub fn import(text: &str, base: Option<&str>, tip: Option<&str>) -> Result<Imported, ImportError> {
    if text.len() <= BYTES_MAX && text.contains("<xacro:") {
        return Err(ImportError::Xacro);
    }
    let robot = urdf::read(text)?;
    let chain = Chain::of(&robot, base, tip)?;
    let arm = fit::arm(&chain)?;
    let difference = difference(&chain, &arm);
    if difference > TOLERANCE || difference.is_nan() {
        return Err(ImportError::Differs { difference });
    }
    Ok(Imported {
        name: robot.name,
        chain,
        arm,
        difference,
    })
}

/// The largest difference of both forward kinematics at many joint positions, m or rad.
fn difference(chain: &Chain, arm: &Arm) -> f64 {
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    let mut worst = 0.0_f64;
    for _ in 0..SAMPLES {
        let mut joints: Joints = [0.0; JOINTS_MAX];
        for joint in joints.iter_mut().take(chain.revolute_joints.len()) {
            // xorshift64*: the same positions every time.
            seed ^= seed >> 12;
            seed ^= seed << 25;
            seed ^= seed >> 27;
            let share =
                (seed.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64;
            *joint = (share * 2.0 - 1.0) * core::f64::consts::PI;
        }
        let (theirs, ours) = (chain.forward(&joints), arm.forward(&joints));
        worst = worst
            .max(theirs.distance_to(&ours))
            .max(theirs.angle_to(&ours));
    }
    worst
}

#[cfg(test)]
mod tests;
