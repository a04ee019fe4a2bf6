//! The hinges of a URDF from one link to another, and where they are with all joints 0.
//! Plain data and mathematics; run once by whoever imports a robot.

use nalgebra::{Isometry3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use urdf_rs::{JointType, Robot};

use crate::ImportError;

/// Links that are flanges by custom, where a robot has several leaves (REP 199).
const TIPS: [&str; 4] = ["tool0", "flange", "ee_link", "ee"];

/// A hinge.
#[derive(Clone, Debug)]
pub struct Hinge {
    /// The joint's name.
    pub name: String,
    /// From the hinge before it (or from the base) to its own frame with the joint 0.
    pub origin: Isometry3<f64>,
    /// Its axis in its frame, unit.
    pub axis: Unit<Vector3<f64>>,
    /// Smallest and largest position, rad; `None` if it turns without end or says none.
    pub range: Option<[f64; 2]>,
    /// Largest speed, rad/s; `None` if it says none.
    pub velocity: Option<f64>,
}

/// The hinges from a base to a tip.
#[derive(Clone, Debug)]
pub struct Chain {
    /// The link that stands.
    pub base: String,
    /// The link that is the flange.
    pub tip: String,
    /// The hinges in order.
    pub hinges: Vec<Hinge>,
    /// From the last hinge to the tip.
    pub end: Isometry3<f64>,
}

impl Chain {
    /// The chain between two links of a robot.
    pub(crate) fn of(
        robot: &Robot,
        base: Option<&str>,
        tip: Option<&str>,
    ) -> Result<Chain, ImportError> {
        let base = find(robot, base, "base", |link| {
            robot.joints.iter().all(|joint| joint.child.link != link)
        })?;
        let tip = find(robot, tip, "tip", |link| {
            robot.joints.iter().all(|joint| joint.parent.link != link)
        })?;
        // From the tip to the base: every link has one parent at most, and no way is longer than the robot.
        let (mut upwards, mut link) = (Vec::new(), tip.as_str());
        while link != base {
            let joint = robot.joints.iter().find(|joint| joint.child.link == link);
            let Some(joint) = joint.filter(|_| upwards.len() < robot.joints.len()) else {
                return Err(ImportError::NoChain { base, tip });
            };
            upwards.push(joint);
            link = &joint.parent.link;
        }
        let (mut hinges, mut between) = (Vec::new(), Isometry3::identity());
        for joint in upwards.into_iter().rev() {
            between *= isometry(&joint.origin);
            usable(joint, robot)?;
            let range = match joint.joint_type {
                JointType::Fixed => continue,
                JointType::Revolute => {
                    let [lower, upper] = [joint.limit.lower, joint.limit.upper];
                    if lower > upper {
                        return Err(ImportError::Reversed {
                            joint: joint.name.clone(),
                            lower,
                            upper,
                        });
                    }
                    let range = (lower < upper).then_some([lower, upper]);
                    within_soft_limits(joint, range)?
                }
                JointType::Continuous => None,
                ref other => {
                    return Err(ImportError::NoHinge {
                        joint: joint.name.clone(),
                        kind: format!("{other:?}").to_lowercase(),
                    });
                }
            };
            hinges.push(Hinge {
                name: joint.name.clone(),
                origin: between,
                axis: Unit::new_normalize(Vector3::from(joint.axis.xyz.0)),
                range,
                velocity: Some(joint.limit.velocity).filter(|velocity| *velocity > 0.0),
            });
            between = Isometry3::identity();
        }
        Ok(Chain {
            base,
            tip,
            hinges,
            end: between,
        })
    }

    /// Where the tip is in the base, by the URDF.
    #[must_use]
    pub fn forward(&self, joints: &Joints) -> Pose {
        let mut at = Isometry3::identity();
        for (hinge, joint) in self.hinges.iter().zip(joints) {
            at *= hinge.origin * UnitQuaternion::from_axis_angle(&hinge.axis, *joint);
        }
        at *= self.end;
        let rotation = at.rotation.to_rotation_matrix();
        let m = rotation.matrix();
        let rows = [0, 1, 2].map(|row| [0, 1, 2].map(|column| m[(row, column)]));
        Pose::from_rotation_matrix(at.translation.vector.into(), &rows)
    }

    /// Axis and origin of each hinge in the base, and the tip, with all joints 0.
    pub(crate) fn at_zero(&self) -> (Vec<[Vector3<f64>; 2]>, Isometry3<f64>) {
        let mut at = Isometry3::identity();
        let axes = self.hinges.iter().map(|hinge| {
            at *= hinge.origin;
            [at.rotation * hinge.axis.into_inner(), at.translation.vector]
        });
        let axes = axes.collect();
        (axes, at * self.end)
    }
}

/// Nothing that is said of a joint is passed over.
fn usable(joint: &urdf_rs::Joint, robot: &Robot) -> Result<(), ImportError> {
    let unusable = |what: String| {
        Err(ImportError::Unusable {
            joint: joint.name.clone(),
            what,
        })
    };
    let same = robot.joints.iter().filter(|other| other.name == joint.name);
    if same.count() > 1 {
        return unusable("is there twice: rename one of the two".to_owned());
    }
    if matches!(joint.joint_type, JointType::Fixed) {
        return Ok(());
    }
    if let Some(mimic) = &joint.mimic {
        return unusable(format!(
            "follows `{}` (`mimic`): joints of an arm are commanded one by one; take `mimic` out if this one is, too",
            mimic.joint
        ));
    }
    let length = joint.axis.xyz.0.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length.is_nan() || length < 1e-9 {
        return unusable("has an axis without direction: give `<axis xyz=\"0 0 1\"/>`".to_owned());
    }
    let limit = &joint.limit;
    let numbers = [limit.lower, limit.upper, limit.velocity];
    if !numbers.iter().all(|number| number.is_finite()) || limit.velocity < 0.0 {
        return unusable(format!(
            "has limits that are none: lower {}, upper {} rad, velocity {} rad/s; without an end it is `continuous`",
            limit.lower, limit.upper, limit.velocity
        ));
    }
    Ok(())
}

/// The range that soft limits leave, if there are any.
fn within_soft_limits(
    joint: &urdf_rs::Joint,
    range: Option<[f64; 2]>,
) -> Result<Option<[f64; 2]>, ImportError> {
    let (Some([lower, upper]), Some(soft)) = (range, &joint.safety_controller) else {
        return Ok(range);
    };
    let [from, to] = [soft.soft_lower_limit, soft.soft_upper_limit];
    // Without them in the URDF both are 0.
    if from == 0.0 && to == 0.0 {
        return Ok(range);
    }
    let [least, most] = [lower.max(from), upper.min(to)];
    match least < most {
        true => Ok(Some([least, most])),
        false => Err(ImportError::Unusable {
            joint: joint.name.clone(),
            what: format!(
                "has soft limits from {from} to {to} rad, which leave nothing of {lower} to {upper}"
            ),
        }),
    }
}

fn find(
    robot: &Robot,
    named: Option<&str>,
    what: &'static str,
    fits: impl Fn(&str) -> bool,
) -> Result<String, ImportError> {
    let links = || robot.links.iter().map(|link| link.name.as_str());
    if let Some(link) = named {
        return match links().find(|known| *known == link) {
            Some(link) => Ok(link.to_owned()),
            None => Err(ImportError::UnknownLink {
                link: link.to_owned(),
                links: links().collect::<Vec<_>>().join(", "),
            }),
        };
    }
    let found: Vec<&str> = links().filter(|link| fits(link)).collect();
    let usual = TIPS.iter().find(|tip| found.contains(tip));
    match (found.as_slice(), usual) {
        ([one], _) => Ok((*one).to_owned()),
        (_, Some(tip)) => Ok((*tip).to_owned()),
        ([], None) => Err(ImportError::Loop { what }),
        (several, None) => Err(ImportError::Ambiguous {
            what,
            links: several.join(", "),
        }),
    }
}

/// URDF: rpy are angles about the fixed axes x, y, z in that order.
fn isometry(pose: &urdf_rs::Pose) -> Isometry3<f64> {
    let [roll, pitch, yaw] = pose.rpy.0;
    let rotation = Rotation3::from_euler_angles(roll, pitch, yaw);
    Isometry3::from_parts(
        Translation3::from(Vector3::from(pose.xyz.0)),
        UnitQuaternion::from_rotation_matrix(&rotation),
    )
}
