//! The 7-joint arm with spherical shoulder, elbow hinge and spherical wrist (S-R-S), such as KUKA's LWR 4+ and iiwa.
//! Closed form, no iteration, no table; used by the loader and by the real-time thread.
//!
//! Inside, joints are *canonical*: Rz(q1)·Ry(q2)·Rz(q3)·Ry(q4)·Rz(q5)·Ry(q6)·Rz(q7), each a robot's joint times its sign.
//! The redundancy is the arm angle of Shimizu et al., "Analytical inverse kinematic computation for 7-DOF redundant
//! manipulators with joint limits and its application to redundancy resolution", IEEE T-RO 24(5), 2008; the eight
//! branches are the global configuration of Faria et al., "Position-based kinematics for 7-DoF serial manipulators with
//! global configuration control, joint limit and singularity avoidance", Mech. Mach. Theory 121, 2018. Unlike there, the
//! arm angle is defined by the plane through the shoulder axis and the wrist, so that it is the same in every branch.

use core::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use super::axes::{
    NEAR_SINGULAR, SAME_ARM_ANGLE, STRETCH_TOLERANCE, azimuth_polar, is_same_pose, length, matrix,
    rows, rz, sign, turned_y, turned_z, wrist, y_of, z_of,
};
use super::branch::{Branch, Unreachable};
use super::singularity::{Singularity, SingularityKind};
use crate::pose::Pose;

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
    /// +1 or −1 per joint: the direction of the robot's joint in the canonical chain.
    pub signs: [f64; 7],
}

/// Axes and origins of the chain at one joint position, base frame.
struct SrsFrames {
    /// Direction of each canonical joint axis.
    axes: [Vector3<f64>; 7],
    shoulder: Vector3<f64>,
    elbow: Vector3<f64>,
    wrist: Vector3<f64>,
    flange: Vector3<f64>,
    rotation: Matrix3<f64>,
}

/// The elbow for a wrist position and an arm angle.
struct ElbowGeometry {
    q4: f64,
    sin4: f64,
    cos4: f64,
    /// Shoulder to elbow, unit.
    upper_arm: Vector3<f64>,
    /// In the arm plane, perpendicular to the upper arm, on the side of the wrist; unit.
    inward: Vector3<f64>,
    /// Sine of the angle between the first axis and the line from shoulder to wrist.
    level: f64,
}

impl SrsArm {
    /// Returns the flange pose in the base frame, for joints in rad. NaN in, NaN out.
    #[must_use]
    pub fn forward(&self, joints: &[f64; 7]) -> Pose {
        let chain = self.chain(joints);
        Pose::from_rotation_matrix(chain.flange.into(), &rows(&chain.rotation))
    }

    /// Returns base, shoulder, elbow, wrist and flange in the base frame, m, for joints in rad. NaN in, NaN out.
    #[must_use]
    pub fn origins(&self, joints: &[f64; 7]) -> [[f64; 3]; 5] {
        let chain = self.chain(joints);
        let base = Vector3::zeros();
        [base, chain.shoulder, chain.elbow, chain.wrist, chain.flange].map(Into::into)
    }

    /// Returns the geometric Jacobian for joints in rad: rows vx vy vz (m/s) wx wy wz (rad/s) of the flange origin, in
    /// base axes, per rad/s of each joint.
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

    /// Returns the arm angle for joints in rad: the rotation of the elbow about the line from shoulder to wrist, in
    /// (−π, π], 0 with the elbow up. Continuous through the stretched arm (q4 = 0).
    #[must_use]
    pub fn arm_angle(&self, joints: &[f64; 7]) -> f64 {
        let chain = self.chain(joints);
        let [_, _, _, axis4, ..] = chain.axes;
        let (up, side) = reference((chain.wrist - chain.shoulder).normalize());
        // The elbow is perpendicular to the hinge axis; unlike the elbow's own offset, the hinge axis is defined at q4
        // = 0 too.
        let hinge = if self.branch(joints).elbow_negative {
            -axis4
        } else {
            axis4
        };
        libm::atan2(hinge.dot(&up), -hinge.dot(&side))
    }

    /// Returns the branch of joints (rad).
    #[must_use]
    pub fn branch(&self, joints: &[f64; 7]) -> Branch {
        let [_, q2, _, q4, _, q6, _] = self.canonical(joints);
        Branch {
            shoulder_negative: q2 < 0.0,
            elbow_negative: q4 < 0.0,
            wrist_negative: q6 < 0.0,
        }
    }

    /// Returns the singularity nearest to joints (rad), with its distance as the sine of an angle.
    #[must_use]
    pub fn singularity(&self, joints: &[f64; 7]) -> Singularity {
        let [_, q2, _, q4, _, q6, _] = *joints;
        let sine = |q: f64| libm::sin(q).abs();
        Singularity::nearest([
            (SingularityKind::Elbow, sine(q4)),
            (SingularityKind::Wrist, sine(q6)),
            (SingularityKind::Shoulder, sine(q2)),
            (SingularityKind::ArmAngle, levelness(self, joints)),
        ])
    }

    /// Returns the joints (rad, each in [−π, π]) that bring the flange to `pose` (base frame) with the given arm angle
    /// (rad) in the given branch. Where q2 or q6 is 0, q1 or q5 is taken from `hint` (rad). Near a singularity, joints
    /// that reach the pose by themselves, in this branch and with this arm angle, are returned if `hint` has them, in
    /// their turns: where several axes are aligned, rounding would choose others. Joint limits are not checked.
    ///
    /// # Errors
    /// Returns `Unreachable` if the wrist is too far from the shoulder or too close to it, or an argument is null.
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
        let aim = azimuth_polar(e.x, e.y, e.z, gc2, hint1);
        // … and rotates it until the forearm lies in the arm plane.
        let shoulder = turned_y(&rz(aim.turn), aim.tilt);
        let inward = shoulder.tr_mul(&elbow.inward);
        let (sin3, cos3) = (gc4 * inward.y, gc4 * inward.x);

        // The remaining rotation is that of the wrist: W = Rz(q5)·Ry(q6)·Rz(q7).
        let upper_arm = turned_z(&shoulder, (sin3, cos3));
        let forearm = turned_y(&upper_arm, (elbow.sin4, elbow.cos4));
        let (q5, q6, q7) = wrist(&forearm.tr_mul(&rotation), gc6, hint5);

        let sine = |q: f64| libm::sin(q).abs();
        let least = [elbow.sin4.abs(), sine(aim.polar), sine(q6)];
        let least = least.into_iter().fold(elbow.level, f64::min);
        if least < NEAR_SINGULAR && self.reaches(hint, pose, arm_angle, branch) {
            return Ok(*hint);
        }

        let q3 = libm::atan2(sin3, cos3);
        let joints = self.canonical(&[aim.azimuth, aim.polar, q3, elbow.q4, q5, q6, q7]);
        if joints.iter().all(|q| q.is_finite()) {
            Ok(joints)
        } else {
            Err(Unreachable::NotFinite)
        }
    }

    /// Returns true if joints bring the flange to `pose` in the given branch and with the given arm angle. False for
    /// null.
    #[cold]
    fn reaches(&self, joints: &[f64; 7], pose: &Pose, arm_angle: f64, branch: Branch) -> bool {
        let away = self.arm_angle(joints) - arm_angle;
        self.branch(joints) == branch
            && (away - TAU * libm::rint(away / TAU)).abs() <= SAME_ARM_ANGLE
            && is_same_pose(&self.forward(joints), pose)
    }

    /// Returns the triangle of shoulder, elbow and wrist, rotated to the arm angle (Shimizu 2008).
    fn elbow(
        &self,
        pose: &Pose,
        rotation: &Matrix3<f64>,
        arm_angle: f64,
        branch: Branch,
    ) -> Result<ElbowGeometry, Unreachable> {
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
        Ok(ElbowGeometry {
            q4: gc4 * 2.0 * libm::atan2(beyond, within),
            sin4: gc4 * 2.0 * beyond * within / sum,
            cos4: (within - beyond) * (within + beyond) / sum,
            upper_arm: along * cosine + outward * sine,
            inward: along * sine - outward * cosine,
            level: length(along.x, along.y),
        })
    }

    fn chain(&self, joints: &[f64; 7]) -> SrsFrames {
        let [t1, t2, t3, t4, t5, t6, t7] = self.canonical(joints).map(libm::sincos);
        let r1 = rz(t1);
        let r2 = turned_y(&r1, t2);
        let r3 = turned_z(&r2, t3);
        let r4 = turned_y(&r3, t4);
        let r5 = turned_z(&r4, t5);
        let r6 = turned_y(&r5, t6);
        let rotation = turned_z(&r6, t7);
        let shoulder = Vector3::z() * self.shoulder_height;
        let elbow = shoulder + z_of(&r2) * self.upper_arm;
        let wrist = elbow + z_of(&r4) * self.forearm;
        let flange = wrist + z_of(&r6) * self.wrist_to_flange;
        let axes = [
            Vector3::z(),
            y_of(&r1),
            z_of(&r2),
            y_of(&r3),
            z_of(&r4),
            y_of(&r5),
            z_of(&r6),
        ];
        SrsFrames {
            axes,
            shoulder,
            elbow,
            wrist,
            flange,
            rotation,
        }
    }

    /// Returns the lengths in the order of the fields.
    pub(super) fn lengths(&self) -> [f64; 4] {
        [
            self.shoulder_height,
            self.upper_arm,
            self.forearm,
            self.wrist_to_flange,
        ]
    }

    /// Converts robot joints to canonical ones, or back.
    pub(super) fn canonical(&self, joints: &[f64; 7]) -> [f64; 7] {
        let mut turned = *joints;
        for (joint, sign) in turned.iter_mut().zip(self.signs) {
            *joint *= sign;
        }
        turned
    }
}

/// Returns the directions that span the plane perpendicular to `along` (unit): up (arm angle 0) and side (arm angle
/// 90°). Where `along` is vertical, "up" is undefined, and the limit for a wrist that approaches from −x is used.
fn reference(along: Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let (x, y, z) = (along.x, along.y, along.z);
    let level = length(x, y);
    let (cos, sin) = if level > 0.0 {
        (x / level, y / level)
    } else {
        (-1.0, 0.0)
    };
    // e_z minus its component along `along`, which is −z·(cos, sin) horizontally and `level` vertically: of length one
    // by construction.
    let up = Vector3::new(-z * cos, -z * sin, level);
    (up, along.cross(&up))
}

/// Returns the sine of the angle between the first axis and the line from shoulder to wrist, at joints in rad: 0 where
/// the arm angle is undefined.
fn levelness(arm: &SrsArm, joints: &[f64; 7]) -> f64 {
    let chain = arm.chain(joints);
    let along = chain.wrist - chain.shoulder;
    length(along.x, along.y) / along.norm()
}

#[cfg(test)]
mod tests;
