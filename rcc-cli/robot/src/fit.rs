//! Derives lengths, directions and zero positions of an arm from the axes of a chain with all joints at 0, or reports
//! what does not fit. Pure mathematics; runs once per import.

use std::fmt;

use nalgebra::{Isometry3, Vector3};
use rcc_core::kinematics::{Arm, OrthoParallelArm, SrsArm};

use crate::{ClosedFormMismatch, JointChain};

/// Tolerance of the axes, rad or m; the comparison of forward kinematics is stricter.
const TOLERANCE_AXES: f64 = 1e-6;

type Vector = Vector3<f64>;

/// Mismatch of a joint or link.
#[derive(Clone, Debug, PartialEq)]
pub enum GeometryMismatch {
    /// The axis has another direction.
    Direction {
        /// Axis in the base frame, with all joints at 0.
        axis: [f64; 3],
        /// Required direction.
        wanted: &'static str,
    },
    /// The axis misses a point in which others meet.
    Beside {
        /// Distance from the point, m.
        by: f64,
        /// Description of the point.
        point: &'static str,
    },
    /// Two points coincide that must be apart.
    NoLength {
        /// Description of the points.
        between: &'static str,
    },
}

impl fmt::Display for GeometryMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            GeometryMismatch::Direction { axis, wanted } => {
                let [x, y, z] = axis.map(|value| value + 0.0);
                write!(
                    f,
                    "its axis is [{x:.6}, {y:.6}, {z:.6}] with all joints 0, but must be {wanted}"
                )
            }
            GeometryMismatch::Beside { by, point } => {
                write!(f, "its axis misses {point} by {:.6} mm", by * 1e3)
            }
            GeometryMismatch::NoLength { between } => {
                write!(f, "the distance between {between} is zero")
            }
        }
    }
}

/// The axis of a joint as a line in space.
#[derive(Clone, Copy)]
struct AxisLine {
    axis: Vector,
    origin: Vector,
}

impl AxisLine {
    /// Returns the point of this line nearest to another line, and the distance of the lines, m; `None` if they are
    /// parallel.
    fn nearest_point(&self, other: &AxisLine) -> Option<(Vector, f64)> {
        let across = self.axis.cross(&other.axis);
        let square = across.norm_squared();
        if square < TOLERANCE_AXES {
            return None;
        }
        let apart = other.origin - self.origin;
        let along = apart.cross(&other.axis).dot(&across) / square;
        Some((
            self.origin + self.axis * along,
            apart.dot(&across).abs() / square.sqrt(),
        ))
    }

    fn distance(&self, point: &Vector) -> f64 {
        (point - self.origin).cross(&self.axis).norm()
    }
}

/// A chain and its axes, while an arm is fitted to it.
struct ChainFit<'c> {
    chain: &'c JointChain,
    lines: Vec<AxisLine>,
    tip: Isometry3<f64>,
}

/// Recognises the arm of a chain.
pub(crate) fn arm(chain: &JointChain) -> Result<Arm, ClosedFormMismatch> {
    let (axes, tip) = chain.at_zero();
    let lines = axes
        .into_iter()
        .map(|[axis, origin]| AxisLine { axis, origin })
        .collect();
    let fit = ChainFit { chain, lines, tip };
    match *fit.lines.as_slice() {
        [a, b, c, d, e, f] => fit
            .ortho_parallel([a, b, c, d, e, f])
            .map(Arm::OrthoParallel),
        [a, b, c, d, e, f, g] => fit.srs([a, b, c, d, e, f, g]).map(Arm::Srs),
        _ => Err(ClosedFormMismatch::Count {
            count: chain.revolute_joints.len(),
        }),
    }
}

impl ChainFit<'_> {
    fn joint(&self, number: usize, mismatch: GeometryMismatch) -> ClosedFormMismatch {
        let revolute = self.chain.revolute_joints.get(number - 1);
        ClosedFormMismatch::Joint {
            joint: revolute
                .map(|revolute| revolute.name.clone())
                .unwrap_or_default(),
            mismatch,
        }
    }

    fn tip_mismatch(&self, mismatch: GeometryMismatch) -> ClosedFormMismatch {
        ClosedFormMismatch::Link {
            link: self.chain.tip.clone(),
            mismatch,
        }
    }

    /// Returns the sign of an axis along a direction.
    fn sign(
        &self,
        number: usize,
        line: &AxisLine,
        direction: &Vector,
        wanted: &'static str,
    ) -> Result<f64, ClosedFormMismatch> {
        if line.axis.cross(direction).norm() < TOLERANCE_AXES {
            return Ok(line.axis.dot(direction).signum());
        }
        let axis = line.axis.into();
        Err(self.joint(number, GeometryMismatch::Direction { axis, wanted }))
    }

    fn require_through(
        &self,
        number: usize,
        line: &AxisLine,
        at: &Vector,
        point: &'static str,
    ) -> Result<(), ClosedFormMismatch> {
        let by = line.distance(at);
        if by < TOLERANCE_AXES {
            return Ok(());
        }
        Err(self.joint(number, GeometryMismatch::Beside { by, point }))
    }

    /// Fits seven joints along z y z y z y z, all at 0 with the arm straight up.
    fn srs(&self, lines: [AxisLine; 7]) -> Result<SrsArm, ClosedFormMismatch> {
        const Z: &str = "along the base's z axis (upright, all joints 0)";
        const Y: &str = "along the base's y axis (upright, all joints 0)";
        let mut signs = [0.0; 7];
        let wanted = [Vector::z(), Vector::y()];
        for (((slot, line), number), along_y) in signs
            .iter_mut()
            .zip(&lines)
            .zip(1..)
            .zip([false, true].into_iter().cycle())
        {
            let [z, y] = &wanted;
            *slot = match along_y {
                false => self.sign(number, line, z, Z)?,
                true => self.sign(number, line, y, Y)?,
            };
        }
        let height = |line: &AxisLine| line.origin.z;
        for (number, line) in (1..).zip(&lines) {
            let at = Vector::z() * height(line);
            self.require_through(number, line, &at, "the base's z axis")?;
        }
        let [_, l2, _, l4, _, l6, _] = &lines;
        let [shoulder, elbow, wrist] = [l2, l4, l6].map(height);
        let flange = self.tip.translation.vector;
        let turned = self.tip.rotation.angle();
        if turned > TOLERANCE_AXES {
            return Err(self.tip_mismatch(GeometryMismatch::Direction {
                axis: (self.tip.rotation * Vector::x()).into(),
                wanted: "that of the base (x axis of the flange, all joints 0)",
            }));
        }
        let by = flange.xy().norm();
        if by > TOLERANCE_AXES {
            let point = "the last axis";
            return Err(self.tip_mismatch(GeometryMismatch::Beside { by, point }));
        }
        for (number, between, length) in [
            (4, "shoulder and elbow", elbow - shoulder),
            (6, "elbow and wrist", wrist - elbow),
        ] {
            if length < TOLERANCE_AXES {
                return Err(self.joint(number, GeometryMismatch::NoLength { between }));
            }
        }
        if flange.z < wrist || shoulder < 0.0 {
            let between = "wrist and flange, upwards";
            return Err(self.tip_mismatch(GeometryMismatch::NoLength { between }));
        }
        Ok(SrsArm {
            shoulder_height: shoulder,
            upper_arm: elbow - shoulder,
            forearm: wrist - elbow,
            wrist_to_flange: flange.z - wrist,
            signs,
        })
    }

    /// Fits six joints: a vertical one, two parallel ones, and three that meet in a point; in any position with all
    /// joints at 0.
    fn ortho_parallel(&self, lines: [AxisLine; 6]) -> Result<OrthoParallelArm, ClosedFormMismatch> {
        let [l1, l2, l3, l4, l5, l6] = &lines;
        let up = Vector::z();
        let sign1 = self.sign(1, l1, &up, "along the base's z axis")?;
        self.require_through(1, l1, &Vector::zeros(), "the base's z axis")?;
        // The axis of joint 2 points to the left of the forward direction at joint 1 = 0, which is closer to x than to
        // −x.
        let left = l2.axis - up * l2.axis.z;
        if l2.axis.z.abs() > TOLERANCE_AXES {
            let wanted = "perpendicular to axis 1";
            let axis = l2.axis.into();
            return Err(self.joint(2, GeometryMismatch::Direction { axis, wanted }));
        }
        let backwards =
            left.y < -TOLERANCE_AXES || (left.y.abs() <= TOLERANCE_AXES && left.x > 0.0);
        let left = if backwards { -left } else { left }.normalize();
        let forwards = left.cross(&up);
        let sign2 = self.sign(2, l2, &left, "perpendicular to axis 1")?;
        let sign3 = self.sign(3, l3, &left, "parallel to axis 2")?;

        // The wrist: axes 4, 5 and 6 meet there.
        let wrist = l4.nearest_point(l5).filter(|(_, by)| *by < TOLERANCE_AXES);
        let Some((wrist, _)) = wrist else {
            let by = l4.nearest_point(l5).map_or(0.0, |(_, by)| by);
            let point = "axis 4 (or is parallel to it)";
            return Err(self.joint(5, GeometryMismatch::Beside { by, point }));
        };
        self.require_through(6, l6, &wrist, "the point where axes 4 and 5 meet")?;
        for (number, a, b, wanted) in [
            (4, l4, &left, "perpendicular to axis 3"),
            (5, l5, &l4.axis, "perpendicular to axis 4"),
            (6, l6, &l5.axis, "perpendicular to axis 5"),
        ] {
            if a.axis.dot(b).abs() > TOLERANCE_AXES {
                let axis = a.axis.into();
                return Err(self.joint(number, GeometryMismatch::Direction { axis, wanted }));
            }
        }

        let level = |point: Vector| (point.dot(&forwards), point.z);
        let (shoulder_offset, shoulder_height) = level(l2.origin);
        let (along, rise) = level(l3.origin - l2.origin);
        let upper_arm = along.hypot(rise);
        if upper_arm < TOLERANCE_AXES {
            let between = "axes 2 and 3";
            return Err(self.joint(3, GeometryMismatch::NoLength { between }));
        }
        let theta2 = along.atan2(rise);
        let lower = wrist - l3.origin;
        let lower = lower - left * lower.dot(&left);
        // Axis 4 points to the wrist, and axis 6 to the flange.
        let sign4 = if lower.dot(&l4.axis) < 0.0 { -1.0 } else { 1.0 };
        let z3 = l4.axis * sign4;
        let x3 = left.cross(&z3);
        let (forearm, elbow_offset) = (lower.dot(&z3), lower.dot(&x3));
        if forearm < TOLERANCE_AXES {
            let between = "axis 3 and the wrist";
            return Err(self.joint(4, GeometryMismatch::NoLength { between }));
        }
        let (along, rise) = level(z3);
        let theta3 = along.atan2(rise) - theta2;
        let side = l5.axis.dot(&left);
        let sign5 =
            if side < -TOLERANCE_AXES || (side.abs() <= TOLERANCE_AXES && l5.axis.dot(&x3) > 0.0) {
                -1.0
            } else {
                1.0
            };
        let y4 = l5.axis * sign5;
        let theta4 = (-y4.dot(&x3)).atan2(y4.dot(&left));
        let [flange_x, z5] = [Vector::x(), Vector::z()].map(|axis| self.tip.rotation * axis);
        let sign6 = if l6.axis.cross(&z5).norm() < TOLERANCE_AXES {
            l6.axis.dot(&z5).signum()
        } else {
            return Err(self.tip_mismatch(GeometryMismatch::Direction {
                axis: z5.into(),
                wanted: "along the last axis (z axis of the flange, all joints 0)",
            }));
        };
        let to_flange = self.tip.translation.vector - wrist;
        let by = to_flange.cross(&z5).norm();
        if by > TOLERANCE_AXES {
            let point = "the last axis";
            return Err(self.tip_mismatch(GeometryMismatch::Beside { by, point }));
        }
        let wrist_to_flange = to_flange.dot(&z5);
        if wrist_to_flange < 0.0 {
            let between = "wrist and flange along the flange's z axis (it points inwards)";
            return Err(self.tip_mismatch(GeometryMismatch::NoLength { between }));
        }
        let x4 = y4.cross(&z3);
        let theta5 = z5.dot(&x4).atan2(z5.dot(&z3));
        let x5 = y4.cross(&z5);
        let theta6 = flange_x.dot(&y4).atan2(flange_x.dot(&x5));
        let theta1 = forwards.y.atan2(forwards.x);
        Ok(OrthoParallelArm {
            shoulder_height,
            shoulder_offset,
            lateral_offset: wrist.dot(&left),
            upper_arm,
            elbow_offset,
            forearm,
            wrist_to_flange,
            signs: [sign1, sign2, sign3, sign4, sign5, sign6],
            zeros: [theta1, theta2, theta3, theta4, theta5, theta6],
        })
    }
}
