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
                    (lower < upper).then_some([lower, upper])
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
