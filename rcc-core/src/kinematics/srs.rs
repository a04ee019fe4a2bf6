//! The 7-joint arm with spherical shoulder, elbow hinge and spherical wrist (S-R-S), such as KUKA's LWR 4+ and iiwa.
//! Closed form, no iteration, no table; used by the loader and by the real-time thread.
//!
//! Inside, joints are *canonical*: Rz(q1)·Ry(q2)·Rz(q3)·Ry(q4)·Rz(q5)·Ry(q6)·Rz(q7), each a robot's joint times its sign.
//! The redundancy is the arm angle of Shimizu et al., "Analytical inverse kinematic computation for 7-DOF redundant
//! manipulators with joint limits and its application to redundancy resolution", IEEE T-RO 24(5), 2008; the eight
//! branches are the global configuration of Faria et al., "Position-based kinematics for 7-DoF serial manipulators with
//! global configuration control, joint limit and singularity avoidance", Mech. Mach. Theory 121, 2018. Unlike there, the
//! arm angle is defined by the plane through the shoulder axis and the wrist, so that it is the same in every branch.

use core::fmt;

use nalgebra::{Matrix3, Vector3};

use crate::pose::Pose;

/// Below this sine of q2 or q6 the two axes beside it count as one, and the hint decides how they share the turn. The
/// pose is then wrong by at most this angle (rad).
const ALIGNED_SINE: f64 = 1e-9;

/// A wrist this little beyond the stretched arm, relative to its length, is rounding and counts as stretched.
const STRETCH_TOLERANCE: f64 = 1e-12;

/// Lengths and joint directions of an S-R-S arm. Base: z along the first axis, on the mounting face; flange: z along
/// the last axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SrsArm {
    /// Base to shoulder, m.
    pub shoulder_height: f64,
    /// Shoulder to elbow, m.
    pub upper_arm: f64,
    /// Elbow to wrist, m.
    pub forearm: f64,
    /// Wrist to flange, m.
    pub wrist_to_flange: f64,
    /// +1 or −1 a joint: the direction of the robot's joint in the canonical chain.
    pub signs: [f64; 7],
}

/// One of the eight ways to reach a pose with a given arm angle: on which side of zero the canonical joints 2, 4 and 6
/// are (Faria 2018: GC2, GC4, GC6). Zero counts as not negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Branch {
    /// Canonical q2 < 0.
    pub shoulder_negative: bool,
    /// Canonical q4 < 0.
    pub elbow_negative: bool,
    /// Canonical q6 < 0.
    pub wrist_negative: bool,
}

impl Branch {
    /// The branch as a number in 0..8: bit 0 shoulder, bit 1 elbow, bit 2 wrist.
    #[must_use]
    pub fn index(self) -> u8 {
        u8::from(self.shoulder_negative)
            | u8::from(self.elbow_negative) << 1
            | u8::from(self.wrist_negative) << 2
    }

    /// The branch of a number in 0..8, `None` beyond.
    #[must_use]
    pub fn from_index(index: u8) -> Option<Self> {
        let bit = |n: u8| index >> n & 1 == 1;
        let branch = Self {
            shoulder_negative: bit(0),
            elbow_negative: bit(1),
            wrist_negative: bit(2),
        };
        (index < 8).then_some(branch)
    }
}

/// Why no joint position was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unreachable {
    /// The wrist would be `distance` m from the shoulder, but the stretched arm reaches only `reach` m.
    TooFar {
        /// Shoulder to wrist, m.
        distance: f64,
        /// Largest possible distance, m.
        reach: f64,
    },
    /// The wrist would be `distance` m from the shoulder; the folded arm does not come to within `reach` m.
    TooClose {
        /// Shoulder to wrist, m.
        distance: f64,
        /// Smallest possible distance (excluded), m.
        reach: f64,
    },
    /// The pose, the arm angle or a hint that was needed is null (NaN) or infinite.
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
            Self::NotFinite => write!(f, "the pose, arm angle or hint is null"),
        }
    }
}

impl core::error::Error for Unreachable {}

/// Axes and origins of the chain at one joint position, base frame.
struct Chain {
    /// Direction of each canonical joint axis.
    axes: [Vector3<f64>; 7],
    shoulder: Vector3<f64>,
    elbow: Vector3<f64>,
    wrist: Vector3<f64>,
    flange: Vector3<f64>,
    rotation: Matrix3<f64>,
}

/// Where the elbow is for a wrist position and an arm angle.
struct Elbow {
    q4: f64,
    sin4: f64,
    cos4: f64,
    /// Shoulder to elbow, unit.
    upper_arm: Vector3<f64>,
    /// In the arm plane, square to the upper arm, on the side of the wrist; unit.
    inward: Vector3<f64>,
}

impl SrsArm {
    /// Where the flange is, base frame, for joints in rad. NaN in, NaN out.
    #[must_use]
    pub fn forward(&self, joints: &[f64; 7]) -> Pose {
        let chain = self.chain(joints);
        Pose::from_rotation_matrix(chain.flange.into(), &rows(&chain.rotation))
    }

    /// The geometric Jacobian for joints in rad: rows vx vy vz (m/s) wx wy wz (rad/s) of the flange origin, in base
    /// axes, per rad/s of each joint.
    #[must_use]
    pub fn jacobian(&self, joints: &[f64; 7]) -> [[f64; 7]; 6] {
        let chain = self.chain(joints);
        let (s, e, w) = (chain.shoulder, chain.elbow, chain.wrist);
        let mut jacobian = [[0.0; 7]; 6];
        let [vx, vy, vz, wx, wy, wz] = &mut jacobian;
        let linear = vx.iter_mut().zip(vy).zip(vz);
        let angular = wx.iter_mut().zip(wy).zip(wz);
        let columns = chain.axes.iter().zip([s, s, s, e, w, w, w]).zip(self.signs);
        for (((axis, origin), sign), (((vx, vy), vz), ((wx, wy), wz))) in
            columns.zip(linear.zip(angular))
        {
            let axis = axis * sign;
            [*vx, *vy, *vz] = axis.cross(&(chain.flange - origin)).into();
            [*wx, *wy, *wz] = axis.into();
        }
        jacobian
    }

    /// The arm angle for joints in rad: how far the elbow is turned about the line from shoulder to wrist, in (−π, π],
    /// 0 with the elbow up. Continuous through the stretched arm (q4 = 0).
    #[must_use]
    pub fn arm_angle(&self, joints: &[f64; 7]) -> f64 {
        let chain = self.chain(joints);
        let [_, _, _, axis4, ..] = chain.axes;
        let (up, side) = reference((chain.wrist - chain.shoulder).normalize());
        // The elbow is square to the hinge; unlike the elbow's own offset, the hinge is defined at q4 = 0 too.
        let hinge = if self.branch(joints).elbow_negative {
            -axis4
        } else {
            axis4
        };
        libm::atan2(hinge.dot(&up), -hinge.dot(&side))
    }

    /// The branch that joints (rad) are in.
    #[must_use]
    pub fn branch(&self, joints: &[f64; 7]) -> Branch {
        let [_, q2, _, q4, _, q6, _] = self.canonical(joints);
        Branch {
            shoulder_negative: q2 < 0.0,
            elbow_negative: q4 < 0.0,
            wrist_negative: q6 < 0.0,
        }
    }

    /// The joints (rad, each in [−π, π]) that bring the flange to `pose` (base frame) with the given arm angle (rad) in
    /// the given branch. Where q2 or q6 is 0, q1 or q5 is taken from `hint` (rad). Joint limits are not looked at.
    ///
    /// # Errors
    /// The wrist is too far from the shoulder or too close to it, or an argument is null.
    pub fn inverse(
        &self,
        pose: &Pose,
        arm_angle: f64,
        branch: Branch,
        hint: &[f64; 7],
    ) -> Result<[f64; 7], Unreachable> {
        if !pose.is_finite() || !arm_angle.is_finite() {
            return Err(Unreachable::NotFinite);
        }
        let rotation = matrix(&pose.rotation_matrix());
        let elbow = self.elbow(pose, &rotation, arm_angle, branch)?;
        let [hint1, _, _, _, hint5, _, _] = self.canonical(hint);
        let [gc2, gc4, gc6] = [
            branch.shoulder_negative,
            branch.elbow_negative,
            branch.wrist_negative,
        ]
        .map(sign);

        // Shimizu 2008, with the branch signs of Faria 2018: the shoulder points the upper arm at the elbow …
        let e = elbow.upper_arm;
        let (q1, q2) = azimuth_polar(e.x, e.y, e.z, gc2, hint1);
        // … and turns it until the forearm lies in the arm plane.
        let shoulder = rz(libm::sincos(q1)) * ry(libm::sincos(q2));
        let inward = shoulder.tr_mul(&elbow.inward);
        let q3 = libm::atan2(gc4 * inward.y, gc4 * inward.x);

        // What is left of the rotation is the wrist's: W = Rz(q5)·Ry(q6)·Rz(q7).
        let elbow_rotation = shoulder * rz(libm::sincos(q3)) * ry((elbow.sin4, elbow.cos4));
        let rest = elbow_rotation.tr_mul(&rotation);
        let (q5, q6) = azimuth_polar(rest.m13, rest.m23, rest.m33, gc6, hint5);
        // From the residual, not from W31 and W32, which vanish with q6.
        let (sin5, cos5) = libm::sincos(q5);
        let q7 = libm::atan2(
            cos5 * rest.m21 - sin5 * rest.m11,
            cos5 * rest.m22 - sin5 * rest.m12,
        );

        let joints = self.canonical(&[q1, q2, q3, elbow.q4, q5, q6, q7]);
        if joints.iter().all(|q| q.is_finite()) {
            Ok(joints)
        } else {
            Err(Unreachable::NotFinite)
        }
    }

    /// The triangle of shoulder, elbow and wrist, turned to the arm angle (Shimizu 2008).
    fn elbow(
        &self,
        pose: &Pose,
        rotation: &Matrix3<f64>,
        arm_angle: f64,
        branch: Branch,
    ) -> Result<Elbow, Unreachable> {
        let (a, b) = (self.upper_arm, self.forearm);
        let base_to_shoulder = Vector3::new(0.0, 0.0, self.shoulder_height);
        let reach = Vector3::from(pose.position)
            - rotation.column(2) * self.wrist_to_flange
            - base_to_shoulder;
        let distance = reach.norm();
        // Products, not squares minus squares: exact near the stretched and the folded arm.
        let beyond = (a + b - distance) * (a + b + distance);
        let within = (distance - (a - b)) * (distance + (a - b));
        if beyond < -STRETCH_TOLERANCE * (a + b) * (a + b) {
            return Err(Unreachable::TooFar {
                distance,
                reach: a + b,
            });
        }
        if within <= 0.0 || distance <= 0.0 {
            return Err(Unreachable::TooClose {
                distance,
                reach: libm::fabs(a - b),
            });
        }
        let (beyond, within) = (libm::sqrt(libm::fmax(beyond, 0.0)), libm::sqrt(within));
        let gc4 = sign(branch.elbow_negative);
        let sum = beyond * beyond + within * within;

        let along = reach / distance;
        let (up, side) = reference(along);
        let (sin_angle, cos_angle) = libm::sincos(arm_angle);
        let outward = up * cos_angle + side * sin_angle;
        // The angle between upper arm and wrist direction, by the law of cosines.
        let cosine = (a * a + distance * distance - b * b) / (2.0 * a * distance);
        let sine = beyond * within / (2.0 * a * distance);
        Ok(Elbow {
            q4: gc4 * 2.0 * libm::atan2(beyond, within),
            sin4: gc4 * 2.0 * beyond * within / sum,
            cos4: (within - beyond) * (within + beyond) / sum,
            upper_arm: along * cosine + outward * sine,
            inward: along * sine - outward * cosine,
        })
    }

    fn chain(&self, joints: &[f64; 7]) -> Chain {
        let [t1, t2, t3, t4, t5, t6, t7] = self.canonical(joints).map(libm::sincos);
        let r1 = rz(t1);
        let r2 = r1 * ry(t2);
        let r3 = r2 * rz(t3);
        let r4 = r3 * ry(t4);
        let r5 = r4 * rz(t5);
        let r6 = r5 * ry(t6);
        let rotation = r6 * rz(t7);
        let y = |r: &Matrix3<f64>| Vector3::new(r.m12, r.m22, r.m32);
        let z = |r: &Matrix3<f64>| Vector3::new(r.m13, r.m23, r.m33);
        let shoulder = Vector3::z() * self.shoulder_height;
        let elbow = shoulder + z(&r2) * self.upper_arm;
        let wrist = elbow + z(&r4) * self.forearm;
        let flange = wrist + z(&r6) * self.wrist_to_flange;
        let axes = [Vector3::z(), y(&r1), z(&r2), y(&r3), z(&r4), y(&r5), z(&r6)];
        Chain {
            axes,
            shoulder,
            elbow,
            wrist,
            flange,
            rotation,
        }
    }

    /// Robot joints to canonical ones, or back.
    fn canonical(&self, joints: &[f64; 7]) -> [f64; 7] {
        let mut turned = *joints;
        for (joint, sign) in turned.iter_mut().zip(self.signs) {
            *joint *= sign;
        }
        turned
    }
}

fn sign(negative: bool) -> f64 {
    if negative { -1.0 } else { 1.0 }
}

/// The directions that span the plane square to `along` (unit): up (arm angle 0) and side (arm angle 90°). Straight up
/// or down "up" is undefined, and the limit for a wrist that comes from −x is taken.
fn reference(along: Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let (x, y, z) = (along.x, along.y, along.z);
    let level = libm::hypot(x, y);
    let (cos, sin) = if level > 0.0 {
        (x / level, y / level)
    } else {
        (-1.0, 0.0)
    };
    // e_z less its part along `along`, which is −z·(cos, sin) level and `level` up: of length one by construction.
    let up = Vector3::new(-z * cos, -z * sin, level);
    (up, along.cross(&up))
}

/// Azimuth and polar angle of the unit vector (x, y, z) = Rz(azimuth)·Ry(polar)·e_z with the given sign of the polar
/// angle; the azimuth of a vector along z is `hint`.
fn azimuth_polar(x: f64, y: f64, z: f64, sign: f64, hint: f64) -> (f64, f64) {
    let level = libm::hypot(x, y);
    let azimuth = if level < ALIGNED_SINE {
        hint
    } else {
        libm::atan2(sign * y, sign * x)
    };
    (azimuth, sign * libm::atan2(level, z))
}

fn rz((sin, cos): (f64, f64)) -> Matrix3<f64> {
    Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
}

fn ry((sin, cos): (f64, f64)) -> Matrix3<f64> {
    Matrix3::new(cos, 0.0, sin, 0.0, 1.0, 0.0, -sin, 0.0, cos)
}

fn matrix(&[[a, b, c], [d, e, f], [g, h, i]]: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::new(a, b, c, d, e, f, g, h, i)
}

fn rows(m: &Matrix3<f64>) -> [[f64; 3]; 3] {
    [
        [m.m11, m.m12, m.m13],
        [m.m21, m.m22, m.m23],
        [m.m31, m.m32, m.m33],
    ]
}

#[cfg(test)]
mod tests;
