//! The 6-joint arm with an ortho-parallel basis and a spherical wrist, such as KUKA's KR series: axis 1 vertical, axes
//! 2 and 3 parallel to each other and perpendicular to it. Closed form, no iteration, no table; used by the loader and
//! by the real-time thread.
//!
//! Inside, joints are *canonical*: Rz(θ1)·Ry(θ2)·Ry(θ3)·Rz(θ4)·Ry(θ5)·Rz(θ6), all 0 with the arm stretched upwards, θ =
//! sign·q + zero for a robot's joint q. Lengths as in Brandstötter, Angerer, Hofbaur, "An analytical solution of the
//! inverse kinematics problem of industrial serial manipulators with an ortho-parallel basis and a spherical wrist",
//! Austrian Robotics Workshop 2014; solved here without arc cosines, which would lose digits near stretched and aligned
//! positions.

use nalgebra::{Matrix3, Vector3};

use super::axes::{
    NEAR_SINGULAR, STRETCH_TOLERANCE, beside_hint, is_same_pose, length, matrix, rows, rz, sign,
    turned_y, turned_z, wrist, x_of, y_of, z_of,
};
use super::branch::{Branch, Unreachable};
use super::singularity::{Singularity, SingularityKind};
use crate::pose::Pose;

/// A wrist closer to axis 1 than this (m) counts as on it, and the hint decides joint 1 …
const ON_AXIS_M: f64 = 1e-9;

/// … unless the position would then be wrong by more than this (m).
const HINT_ERROR_M: f64 = 1e-12;

/// Lengths, directions and zeros of an ortho-parallel arm. Base: z along the first axis, on the mounting face; flange:
/// z along the last axis. With θ = 0 the arm points up, and x is the direction in which its offsets are measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrthoParallelArm {
    /// Base to axis 2, along axis 1, m (c1).
    pub shoulder_height: f64,
    /// Axis 1 to axis 2, forwards, m (a1).
    pub shoulder_offset: f64,
    /// Axis 1 to the plane of the arm, to the left, m (b).
    pub lateral_offset: f64,
    /// Axis 2 to axis 3, m (c2).
    pub upper_arm: f64,
    /// Axis 3 to axis 4, perpendicular to axis 4, forwards with the arm upright, m (a2).
    pub elbow_offset: f64,
    /// Axis 3 to the wrist, along axis 4, m (c3).
    pub forearm: f64,
    /// Wrist to flange, m (c4).
    pub wrist_to_flange: f64,
    /// +1 or −1 per joint: the direction of the robot's joint in the canonical chain.
    pub signs: [f64; 6],
    /// The canonical angle at which the robot's joint is 0, rad.
    pub zeros: [f64; 6],
}

/// Axes and origins of the chain at one joint position, base frame.
struct OrthoFrames {
    axes: [Vector3<f64>; 6],
    shoulder: Vector3<f64>,
    elbow: Vector3<f64>,
    wrist: Vector3<f64>,
    flange: Vector3<f64>,
    rotation: Matrix3<f64>,
}

/// Joint 1 for a wrist position, and the wrist relative to axis 2.
struct ArmPlane {
    theta1: f64,
    turn1: (f64, f64),
    /// Forwards from axis 2, m.
    x: f64,
    /// Upwards from axis 2, m.
    z: f64,
}

/// Joints 2 and 3 for a wrist in the plane of the arm.
struct PlanarJoints {
    theta2: f64,
    theta3: f64,
    /// Sine and cosine of θ2 + θ3.
    turn: (f64, f64),
}

impl OrthoParallelArm {
    /// Returns the flange pose in the base frame, for joints in rad. NaN in, NaN out.
    #[must_use]
    pub fn forward(&self, joints: &[f64; 6]) -> Pose {
        let chain = self.chain(joints);
        Pose::from_rotation_matrix(chain.flange.into(), &rows(&chain.rotation))
    }

    /// Returns base, shoulder, elbow, wrist and flange in the base frame, m, for joints in rad. NaN in, NaN out.
    #[must_use]
    pub fn origins(&self, joints: &[f64; 6]) -> [[f64; 3]; 5] {
        let chain = self.chain(joints);
        let base = Vector3::zeros();
        [base, chain.shoulder, chain.elbow, chain.wrist, chain.flange].map(Into::into)
    }

    /// Returns the geometric Jacobian for joints in rad: rows vx vy vz (m/s) wx wy wz (rad/s) of the flange origin, in
    /// base axes, per rad/s of each joint.
    #[must_use]
    pub fn jacobian(&self, joints: &[f64; 6]) -> [[f64; 6]; 6] {
        let chain = self.chain(joints);
        let (s, e, w) = (chain.shoulder, chain.elbow, chain.wrist);
        let mut jacobian = [[0.0; 6]; 6];
        let [vx, vy, vz, wx, wy, wz] = &mut jacobian;
        let linear = vx.iter_mut().zip(vy).zip(vz);
        let angular = wx.iter_mut().zip(wy).zip(wz);
        let origins = [Vector3::zeros(), s, e, w, w, w];
        let columns = chain.axes.iter().zip(origins).zip(self.signs);
        for (((axis, origin), sign), (((vx, vy), vz), ((wx, wy), wz))) in
            columns.zip(linear.zip(angular))
        {
            let axis = axis * sign;
            [*vx, *vy, *vz] = axis.cross(&(chain.flange - origin)).into();
            [*wx, *wy, *wz] = axis.into();
        }
        jacobian
    }

    /// Returns the branch of joints (rad): the wrist behind axis 1, the forearm bent backwards, canonical θ5 < 0 (of
    /// the turn in (−π, π]).
    #[must_use]
    pub fn branch(&self, joints: &[f64; 6]) -> Branch {
        let [_, t2, t3, _, t5, _] = self.canonical(joints);
        let (forward, _) = self.wrist_in_plane(t2, t3);
        let (sin3, cos3) = libm::sincos(t3);
        Branch {
            shoulder_negative: self.shoulder_offset + forward < 0.0,
            // The bend from the upper arm to the line from axis 3 to the wrist, which is inclined by the elbow's
            // offset.
            elbow_negative: sin3 * self.forearm + cos3 * self.elbow_offset < 0.0,
            wrist_negative: libm::sin(t5) < 0.0,
        }
    }

    /// Returns KUKA's Status (S) of joints (rad), as defined by its controllers (KUKA System Software, operating and
    /// programming instructions for system integrators, section on Status and Turn): bit 0: the wrist is in the
    /// overhead area, behind axis 1; bit 1: A3 is beyond the stretched arm (A3 ≥ φ, φ = 0 without offset between A3 and
    /// A4, else its angle); bit 2: A5 < 0. (Bit 3 is not used, bit 4 says that the robot is calibrated.)
    #[must_use]
    pub fn status(&self, joints: &[f64; 6]) -> u8 {
        let branch = self.branch(joints);
        u8::from(branch.shoulder_negative)
            | u8::from(branch.elbow_negative == self.elbow_is_mirrored()) << 1
            | u8::from(branch.wrist_negative != self.wrist_is_mirrored()) << 2
    }

    /// Returns the branch of KUKA's Status; bits from 3 on are ignored.
    #[must_use]
    pub fn branch_of_status(&self, status: u8) -> Branch {
        let bit = |n: u8| status >> n & 1 == 1;
        Branch {
            shoulder_negative: bit(0),
            elbow_negative: bit(1) == self.elbow_is_mirrored(),
            wrist_negative: bit(2) != self.wrist_is_mirrored(),
        }
    }

    fn elbow_is_mirrored(&self) -> bool {
        let [_, _, sign, ..] = self.signs;
        sign < 0.0
    }

    fn wrist_is_mirrored(&self) -> bool {
        let [.., sign, _] = self.signs;
        sign < 0.0
    }

    /// Returns the singularity nearest to joints (rad).
    #[must_use]
    pub fn singularity(&self, joints: &[f64; 6]) -> Singularity {
        let [_, t2, t3, _, t5, _] = self.canonical(joints);
        let (forward, _) = self.wrist_in_plane(t2, t3);
        let (sin3, cos3) = libm::sincos(t3);
        let lower = length(self.forearm, self.elbow_offset);
        let bend = (sin3 * self.forearm + cos3 * self.elbow_offset) / lower;
        let beside = (self.shoulder_offset + forward) / (self.upper_arm + lower);
        Singularity::nearest([
            (SingularityKind::Elbow, bend.abs()),
            (SingularityKind::Wrist, libm::sin(t5).abs()),
            (SingularityKind::Shoulder, beside.abs()),
        ])
    }

    /// Returns the joints (rad, within two turns of 0) that bring the flange to `pose` (base frame) in the given
    /// branch. Where θ5 is 0, joint 4 is taken from `hint` (rad), and where the wrist is on axis 1, joint 1. Near a
    /// singularity, a `hint` that reaches the pose by itself in this branch is returned, in its turns. Joint limits are
    /// not checked.
    ///
    /// # Errors
    /// Returns `Unreachable` if the wrist is too far from the shoulder or too close to it, or an argument is null.
    pub fn inverse(
        &self,
        pose: &Pose,
        branch: Branch,
        hint: &[f64; 6],
    ) -> Result<[f64; 6], Unreachable> {
        if !pose.is_finite() {
            return Err(Unreachable::NotFinite);
        }
        let rotation = matrix(&pose.rotation_matrix());
        let [hint1, _, _, hint4, _, _] = self.canonical(hint);
        let wrist_at = Vector3::from(pose.position) - z_of(&rotation) * self.wrist_to_flange;
        let plane = self.plane(&wrist_at, sign(branch.shoulder_negative), hint1)?;
        let reach = self.reach(&plane, sign(branch.elbow_negative))?;
        // The remaining rotation is that of the wrist: Rz(θ4)·Ry(θ5)·Rz(θ6).
        let forearm = turned_y(&rz(plane.turn1), reach.turn);
        let rest = forearm.tr_mul(&rotation);
        let (theta4, theta5, theta6) = wrist(&rest, sign(branch.wrist_negative), hint4);
        let canonical = [
            plane.theta1,
            reach.theta2,
            reach.theta3,
            theta4,
            theta5,
            theta6,
        ];
        let joints = self.joints(&canonical);
        if self.singularity(&joints).distance < NEAR_SINGULAR
            && self.branch(hint) == branch
            && is_same_pose(&self.forward(hint), pose)
        {
            return Ok(*hint);
        }
        if joints.iter().all(|q| q.is_finite()) {
            Ok(joints)
        } else {
            Err(Unreachable::NotFinite)
        }
    }

    /// Solves joint 1: the plane of the arm contains the wrist, which is in front of axis 1 (`side` = 1) or behind it
    /// (−1).
    fn plane(&self, wrist: &Vector3<f64>, side: f64, hint: f64) -> Result<ArmPlane, Unreachable> {
        let (cx, cy, b) = (wrist.x, wrist.y, self.lateral_offset);
        let from_axis = length(cx, cy);
        let beside = (from_axis - b.abs()) * (from_axis + b.abs());
        if beside < -STRETCH_TOLERANCE * b * b {
            return Err(Unreachable::TooClose {
                distance: from_axis,
                reach: b.abs(),
            });
        }
        let z = wrist.z - self.shoulder_height;
        if from_axis < ON_AXIS_M
            && let Some((forward, turn1)) = beside_hint(cx, cy, hint, HINT_ERROR_M)
        {
            return Ok(ArmPlane {
                theta1: hint,
                turn1,
                x: forward - self.shoulder_offset,
                z,
            });
        }
        let forward = side * libm::sqrt(libm::fmax(beside, 0.0));
        // (forward, b) rotated by θ1 is (cx, cy).
        let square = from_axis * from_axis;
        let sin = (cy * forward - cx * b) / square;
        let cos = (cx * forward + cy * b) / square;
        Ok(ArmPlane {
            theta1: libm::atan2(sin, cos),
            turn1: (sin, cos),
            x: forward - self.shoulder_offset,
            z,
        })
    }

    /// Solves joints 2 and 3: the triangle of axis 2, axis 3 and wrist, bent forwards (`side` = 1) or backwards (−1).
    fn reach(&self, plane: &ArmPlane, side: f64) -> Result<PlanarJoints, Unreachable> {
        let ArmPlane { x, z, .. } = *plane;
        let (a, b) = (self.upper_arm, length(self.forearm, self.elbow_offset));
        let distance = length(x, z);
        // Products, not squares minus squares: exact near the stretched and the folded arm.
        let beyond = (a + b - distance) * (a + b + distance);
        let within = (distance - (a - b)) * (distance + (a - b));
        let rounding = STRETCH_TOLERANCE * (a + b) * (a + b);
        if beyond < -rounding {
            return Err(Unreachable::TooFar {
                distance,
                reach: a + b,
            });
        }
        if within < -rounding || distance <= ON_AXIS_M {
            return Err(Unreachable::TooClose {
                distance,
                reach: (a - b).abs(),
            });
        }
        let (beyond, within) = (libm::fmax(beyond, 0.0), libm::fmax(within, 0.0));
        // The bend φ from the upper arm to the line from axis 3 to the wrist; tan²(φ/2) = beyond/within.
        let sum = beyond + within;
        let sin_bend = side * 2.0 * libm::sqrt(beyond * within) / sum;
        let cos_bend = (within - beyond) / sum;
        // The upper arm, rotated from the line to the wrist by the triangle's angle at axis 2.
        let (along, across) = (a + b * cos_bend, b * sin_bend);
        let square = along * along + across * across;
        let sin2 = (x * along - z * across) / square;
        let cos2 = (z * along + x * across) / square;
        // Without the part of the bend that stems from the elbow's offset.
        let (c, o) = (self.forearm, self.elbow_offset);
        let sin3 = (c * sin_bend - o * cos_bend) / b;
        let cos3 = (c * cos_bend + o * sin_bend) / b;
        let turn = (sin2 * cos3 + cos2 * sin3, cos2 * cos3 - sin2 * sin3);
        let unit = 1.0 / length(turn.0, turn.1);
        Ok(PlanarJoints {
            theta2: libm::atan2(sin2, cos2),
            theta3: libm::atan2(sin3, cos3),
            turn: (turn.0 * unit, turn.1 * unit),
        })
    }

    /// Returns the wrist position relative to axis 2, forwards and upwards, m.
    fn wrist_in_plane(&self, theta2: f64, theta3: f64) -> (f64, f64) {
        let (sin2, cos2) = libm::sincos(theta2);
        let (sin, cos) = libm::sincos(theta2 + theta3);
        (
            self.upper_arm * sin2 + self.forearm * sin + self.elbow_offset * cos,
            self.upper_arm * cos2 + self.forearm * cos - self.elbow_offset * sin,
        )
    }

    fn chain(&self, joints: &[f64; 6]) -> OrthoFrames {
        let [t1, t2, t3, t4, t5, t6] = self.canonical(joints);
        let r1 = rz(libm::sincos(t1));
        let r2 = turned_y(&r1, libm::sincos(t2));
        let r3 = turned_y(&r1, libm::sincos(t2 + t3));
        let r4 = turned_z(&r3, libm::sincos(t4));
        let r5 = turned_y(&r4, libm::sincos(t5));
        let rotation = turned_z(&r5, libm::sincos(t6));
        let shoulder = Vector3::z() * self.shoulder_height
            + x_of(&r1) * self.shoulder_offset
            + y_of(&r1) * self.lateral_offset;
        let elbow = shoulder + z_of(&r2) * self.upper_arm;
        let wrist = elbow + z_of(&r3) * self.forearm + x_of(&r3) * self.elbow_offset;
        let flange = wrist + z_of(&r5) * self.wrist_to_flange;
        let across = y_of(&r1);
        OrthoFrames {
            axes: [
                Vector3::z(),
                across,
                across,
                z_of(&r3),
                y_of(&r4),
                z_of(&r5),
            ],
            shoulder,
            elbow,
            wrist,
            flange,
            rotation,
        }
    }

    /// Converts robot joints to canonical ones.
    fn canonical(&self, joints: &[f64; 6]) -> [f64; 6] {
        let mut turned = *joints;
        for ((joint, sign), zero) in turned.iter_mut().zip(self.signs).zip(self.zeros) {
            *joint = *joint * sign + zero;
        }
        turned
    }

    /// Converts canonical joints to robot joints.
    fn joints(&self, canonical: &[f64; 6]) -> [f64; 6] {
        let mut turned = *canonical;
        for ((joint, sign), zero) in turned.iter_mut().zip(self.signs).zip(self.zeros) {
            *joint = (*joint - zero) * sign;
        }
        turned
    }

    /// Returns the lengths in the order of the fields.
    pub(super) fn lengths(&self) -> [f64; 7] {
        [
            self.shoulder_height,
            self.shoulder_offset,
            self.lateral_offset,
            self.upper_arm,
            self.elbow_offset,
            self.forearm,
            self.wrist_to_flange,
        ]
    }

    pub(super) fn from_lengths(
        &[
            shoulder_height,
            shoulder_offset,
            lateral_offset,
            upper_arm,
            elbow_offset,
            forearm,
            wrist_to_flange,
        ]: &[f64; 7],
        signs: [f64; 6],
        zeros: [f64; 6],
    ) -> Self {
        Self {
            shoulder_height,
            shoulder_offset,
            lateral_offset,
            upper_arm,
            elbow_offset,
            forearm,
            wrist_to_flange,
            signs,
            zeros,
        }
    }
}

#[cfg(test)]
mod tests;
