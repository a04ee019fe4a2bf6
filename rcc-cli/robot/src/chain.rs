//! The revolute joints of a URDF between two links, and their pose with all joints at 0. Plain data and mathematics;
//! runs once per import.

use std::collections::{HashMap, HashSet};

use nalgebra::{Isometry3, Unit, UnitQuaternion, Vector3};
use rcc_core::message::Joints;
use rcc_core::pose::Pose;

use crate::ImportError;
use crate::urdf::{JointKind, UrdfJoint, UrdfRobot};

/// Largest number of names in a message.
const LISTED_MAX: usize = 20;

/// Conventional names of the flange link, used if a robot has several leaves (REP 199).
const FLANGE_LINKS: [&str; 4] = ["tool0", "flange", "ee_link", "ee"];

/// A revolute joint of the chain.
#[derive(Clone, Debug)]
pub struct RevoluteJoint {
    /// Name of the joint.
    pub name: String,
    /// Transformation from the previous revolute joint (or the base) to this joint's frame, with this joint at 0.
    pub origin: Isometry3<f64>,
    /// Unit axis in the joint's frame.
    pub axis: Unit<Vector3<f64>>,
    /// Smallest and largest position, rad; `None` if continuous or not given.
    pub range: Option<[f64; 2]>,
    /// Largest speed, rad/s; `None` if not given.
    pub velocity: Option<f64>,
}

/// Chain of revolute joints from a base to a tip.
#[derive(Clone, Debug)]
pub struct JointChain {
    /// Name of the base link.
    pub base: String,
    /// Name of the flange link.
    pub tip: String,
    /// Joints in order.
    pub revolute_joints: Vec<RevoluteJoint>,
    /// Transformation from the last joint to the tip.
    pub end: Isometry3<f64>,
}

impl JointChain {
    /// Returns the chain between two links of a robot.
    pub(crate) fn of(
        robot: &UrdfRobot,
        base: Option<&str>,
        tip: Option<&str>,
    ) -> Result<JointChain, ImportError> {
        // Builds the tables once, so that the effort grows linearly with the number of links. If several joints have
        // the same child link, the first one counts.
        let parents: HashSet<&str> = robot.joints.iter().map(|joint| &*joint.parent).collect();
        let mut above: HashMap<&str, &UrdfJoint> = HashMap::new();
        let mut names: HashMap<&str, usize> = HashMap::new();
        for joint in &robot.joints {
            above.entry(&joint.child).or_insert(joint);
            *names.entry(&joint.name).or_default() += 1;
        }
        let base = find(robot, base, "base", |link| !above.contains_key(link))?;
        let tip = find(robot, tip, "tip", |link| !parents.contains(link))?;
        // Walks from the tip to the base: each link has at most one parent, and no path is longer than the robot.
        let (mut upwards, mut link) = (Vec::new(), tip.as_str());
        while link != base {
            let joint = above.get(link).copied();
            let Some(joint) = joint.filter(|_| upwards.len() < robot.joints.len()) else {
                return Err(ImportError::NoChain { base, tip });
            };
            upwards.push(joint);
            link = &joint.parent;
        }
        let (mut revolute_joints, mut between) = (Vec::new(), Isometry3::identity());
        for joint in upwards.into_iter().rev() {
            between *= joint.origin;
            check_usable(joint, names.get(&*joint.name) == Some(&1))?;
            let range = match joint.kind {
                JointKind::Fixed => continue,
                JointKind::Revolute => {
                    let [lower, upper] = joint.range;
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
                JointKind::Continuous => None,
                JointKind::Other(kind) => {
                    return Err(ImportError::NotRevolute {
                        joint: joint.name.clone(),
                        kind: kind.to_owned(),
                    });
                }
            };
            revolute_joints.push(RevoluteJoint {
                name: joint.name.clone(),
                origin: between,
                axis: Unit::new_normalize(Vector3::from(joint.axis)),
                range,
                velocity: Some(joint.velocity).filter(|velocity| *velocity > 0.0),
            });
            between = Isometry3::identity();
        }
        Ok(JointChain {
            base,
            tip,
            revolute_joints,
            end: between,
        })
    }

    /// Returns the pose of the tip in the base frame, according to the URDF.
    #[must_use]
    pub fn forward(&self, joints: &Joints) -> Pose {
        let mut at = Isometry3::identity();
        for (revolute, joint) in self.revolute_joints.iter().zip(joints) {
            at *= revolute.origin * UnitQuaternion::from_axis_angle(&revolute.axis, *joint);
        }
        at *= self.end;
        pose(&at)
    }

    /// Returns axis and origin of each joint, and the pose of the tip, in the base frame with all joints at 0.
    pub(crate) fn at_zero(&self) -> (Vec<[Vector3<f64>; 2]>, Isometry3<f64>) {
        let mut at = Isometry3::identity();
        let axes = self.revolute_joints.iter().map(|revolute| {
            at *= revolute.origin;
            [
                at.rotation * revolute.axis.into_inner(),
                at.translation.vector,
            ]
        });
        let axes = axes.collect();
        (axes, at * self.end)
    }
}

/// Returns an isometry as a pose of the core.
pub(crate) fn pose(isometry: &Isometry3<f64>) -> Pose {
    let rotation = isometry.rotation.to_rotation_matrix();
    let m = rotation.matrix();
    let rows = [0, 1, 2].map(|row| [0, 1, 2].map(|column| m[(row, column)]));
    Pose::from_rotation_matrix(isometry.translation.vector.into(), &rows)
}

/// Checks all properties of a joint, so that none is ignored silently.
fn check_usable(joint: &UrdfJoint, is_only_one: bool) -> Result<(), ImportError> {
    let unusable = |what: String| {
        Err(ImportError::Unusable {
            joint: joint.name.clone(),
            what,
        })
    };
    if !is_only_one {
        return unusable("is defined twice: rename one of the two".to_owned());
    }
    if joint.kind == JointKind::Fixed {
        return Ok(());
    }
    if let Some(mimic) = &joint.mimic {
        return unusable(format!(
            "follows `{}` (`mimic`): joints of an arm are commanded individually; remove `mimic` if this joint is as well",
            mimic
        ));
    }
    let length = joint.axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length.is_nan() || length < 1e-9 {
        return unusable(
            "has a zero axis: write a direction such as `<axis xyz=\"0 0 1\"/>`".to_owned(),
        );
    }
    let ([lower, upper], velocity) = (joint.range, joint.velocity);
    let are_finite = [lower, upper, velocity]
        .iter()
        .all(|number| number.is_finite());
    if !are_finite || velocity < 0.0 {
        return unusable(format!(
            "has invalid limits: lower {lower}, upper {upper} rad, velocity {velocity} rad/s; a joint without limits is `continuous`"
        ));
    }
    Ok(())
}

/// Returns the range limited by the soft limits, if given.
fn within_soft_limits(
    joint: &UrdfJoint,
    range: Option<[f64; 2]>,
) -> Result<Option<[f64; 2]>, ImportError> {
    let (Some([lower, upper]), Some(soft)) = (range, joint.soft) else {
        return Ok(range);
    };
    let [from, to] = soft;
    // Both are 0 if the URDF does not give them.
    if from == 0.0 && to == 0.0 {
        return Ok(range);
    }
    let [least, most] = [lower.max(from), upper.min(to)];
    match least < most {
        true => Ok(Some([least, most])),
        false => Err(ImportError::Unusable {
            joint: joint.name.clone(),
            what: format!(
                "has soft limits from {from} to {to} rad, which do not overlap its range of {lower} to {upper} rad"
            ),
        }),
    }
}

fn find(
    robot: &UrdfRobot,
    named: Option<&str>,
    what: &'static str,
    fits: impl Fn(&str) -> bool,
) -> Result<String, ImportError> {
    let links = || robot.links.iter().map(String::as_str);
    if let Some(link) = named {
        return match links().find(|known| *known == link) {
            Some(link) => Ok(link.to_owned()),
            None => Err(ImportError::UnknownLink {
                link: link.to_owned(),
                links: listed(links()),
            }),
        };
    }
    let found: Vec<&str> = links().filter(|link| fits(link)).collect();
    let usual = FLANGE_LINKS.iter().find(|tip| found.contains(tip));
    match (found.as_slice(), usual) {
        ([one], _) => Ok((*one).to_owned()),
        (_, Some(tip)) => Ok((*tip).to_owned()),
        ([], None) => Err(ImportError::Loop { what }),
        (several, None) => Err(ImportError::Ambiguous {
            what,
            links: listed(several.iter().copied()),
        }),
    }
}

/// Joins names with commas; long lists are truncated.
pub(crate) fn listed<'a>(mut names: impl Iterator<Item = &'a str>) -> String {
    let first: Vec<&str> = names.by_ref().take(LISTED_MAX).collect();
    let others = match names.count() {
        0 => String::new(),
        others => format!(" and {others} more"),
    };
    first.join(", ") + &others
}
