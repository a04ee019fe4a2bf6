//! The intervals of arm angles of an S-R-S arm that the joint limits allow for a pose: the usable range of its
//! redundancy. Closed form with a constant number of steps, no heap; used by the loader and by the real-time thread.
//!
//! Shimizu et al., IEEE T-RO 24(5), 2008, section IV: while the elbow swivels, every element of the shoulder's and of
//! the wrist's rotation is A·sin ψ + B·cos ψ + C, so each limit of a joint is reached at no more than two arm angles.
//! Between two neighbouring ones the joints are within their limits either everywhere or nowhere, which one inverse in
//! the middle decides.

use core::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};

use super::axes::{matrix, rz, turned_y, turned_z, z_of};
use super::branch::{Branch, Unreachable};
use super::srs::SrsArm;
use super::turns::within_limits;
use crate::joints::JointLimits;
use crate::pose::Pose;

/// Two limits of six joints with two arm angles each; Shimizu counts 20, for symmetric limits.
const ROOTS_MAX: usize = 24;

/// Arm angles closer to each other than this (rad) are merged.
const SAME: f64 = 1e-12;

/// Intervals of arm angles, rad: within each, all joints stay within their limits and in their branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmAngles {
    intervals: [[f64; 2]; ROOTS_MAX],
    count: usize,
}

impl ArmAngles {
    const NONE: ArmAngles = ArmAngles {
        intervals: [[0.0; 2]; ROOTS_MAX],
        count: 0,
    };

    /// Returns the intervals [lower, upper] in order; lower is in (−π, π], and upper exceeds π if π is inside. The
    /// whole circle is [−π, π]. Empty if no arm angle is allowed for this pose in this branch.
    #[must_use]
    pub fn intervals(&self) -> &[[f64; 2]] {
        self.intervals.get(..self.count).unwrap_or(&[])
    }

    /// Returns the interval that contains an arm angle, shifted by whole turns to the angle; the bounds belong to the
    /// interval. The whole circle extends π to both sides of the angle.
    #[must_use]
    pub fn around(&self, angle: f64) -> Option<[f64; 2]> {
        self.intervals().iter().find_map(|&[lower, upper]| {
            if upper - lower >= TAU - SAME {
                return angle.is_finite().then_some([angle - PI, angle + PI]);
            }
            let middle = 0.5 * (lower + upper);
            let turns = TAU * libm::rint((angle - middle) / TAU);
            let [lower, upper] = [lower + turns, upper + turns];
            let inside = angle >= lower - 1e-9 && angle <= upper + 1e-9;
            inside.then_some([lower, upper])
        })
    }

    fn push(&mut self, interval: [f64; 2]) {
        if let Some(place) = self.intervals.get_mut(self.count) {
            *place = interval;
            self.count += 1;
        }
    }
}

/// Sorted arm angles at which a joint may be at a limit.
struct LimitAngles {
    angles: [f64; ROOTS_MAX],
    count: usize,
}

impl LimitAngles {
    /// Adds the solutions of a·sin ψ + b·cos ψ + c = 0.
    fn add(&mut self, [a, b, c]: [f64; 3]) {
        let radius = libm::sqrt(a * a + b * b);
        if radius <= c.abs() || radius.is_nan() || c.is_nan() {
            return;
        }
        let (middle, side) = (libm::atan2(a, b), libm::acos(-c / radius));
        for angle in [middle - side, middle + side] {
            if let Some(place) = self.angles.get_mut(self.count) {
                *place = angle - TAU * libm::rint(angle / TAU);
                self.count += 1;
            }
        }
    }

    fn sorted(&mut self) -> &[f64] {
        let angles = self.angles.get_mut(..self.count).unwrap_or(&mut []);
        angles.sort_unstable_by(f64::total_cmp);
        angles
    }
}

/// A rotation as a function of the arm angle ψ: `sin`·sin ψ + `cos`·cos ψ + `rest`.
struct ElbowRotation {
    sin: Matrix3<f64>,
    cos: Matrix3<f64>,
    rest: Matrix3<f64>,
}

impl ElbowRotation {
    /// Returns the coefficients of the condition that a joint with tangent `y`/`x` is at this angle (or 180° away).
    fn tangent(
        &self,
        y: impl Fn(&Matrix3<f64>) -> f64,
        x: impl Fn(&Matrix3<f64>) -> f64,
        limit: f64,
    ) -> [f64; 3] {
        let (sin, cos) = libm::sincos(limit);
        [&self.sin, &self.cos, &self.rest].map(|m| y(m) * cos - x(m) * sin)
    }

    /// Returns the coefficients of the condition that a joint with the last element as cosine is at ± this angle.
    fn cosine(&self, limit: f64) -> [f64; 3] {
        [self.sin.m33, self.cos.m33, self.rest.m33 - libm::cos(limit)]
    }
}

impl SrsArm {
    /// Returns the arm angles with which the joints (each in [−π, π]) that reach `pose` in `branch` are within
    /// `limits`.
    ///
    /// # Errors
    /// Returns `Unreachable` if the pose is out of reach for every arm angle, or is null.
    pub fn arm_angles(
        &self,
        pose: &Pose,
        branch: Branch,
        limits: &JointLimits,
    ) -> Result<ArmAngles, Unreachable> {
        let hint = [0.0; 7];
        let at_0 = self.inverse(pose, 0.0, branch, &hint)?;
        let allowed = |angle: f64| {
            self.inverse(pose, angle, branch, &hint)
                .is_ok_and(|[q1, q2, q3, q4, q5, q6, q7]| {
                    within_limits(&[q1, q2, q3, q4, q5, q6, q7, 0.0], limits).is_ok()
                })
        };
        let mut roots = self.roots(pose, &at_0, limits);
        Ok(between(roots.sorted(), allowed))
    }

    fn roots(&self, pose: &Pose, at_0: &[f64; 7], limits: &JointLimits) -> LimitAngles {
        let [q1, q2, q3, q4, ..] = self.canonical(at_0);
        let upper_arm = turned_y(&rz(libm::sincos(q1)), libm::sincos(q2));
        let shoulder = turned_z(&upper_arm, libm::sincos(q3));
        let rotation = matrix(&pose.rotation_matrix());
        let reach = Vector3::from(pose.position)
            - z_of(&rotation) * self.wrist_to_flange
            - Vector3::z() * self.shoulder_height;
        let along = reach / reach.norm();
        let cross = along.cross_matrix();
        let rest = along * along.transpose();
        let shoulder = ElbowRotation {
            sin: cross * shoulder,
            cos: -cross * cross * shoulder,
            rest: rest * shoulder,
        };
        let elbow = turned_y(&Matrix3::identity(), libm::sincos(q4));
        let to_wrist = |part: &Matrix3<f64>| (part * elbow).tr_mul(&rotation);
        let wrist = ElbowRotation {
            sin: to_wrist(&shoulder.sin),
            cos: to_wrist(&shoulder.cos),
            rest: to_wrist(&shoulder.rest),
        };
        let mut roots = LimitAngles {
            angles: [0.0; ROOTS_MAX],
            count: 0,
        };
        for side in [&limits.lower, &limits.upper] {
            // Solutions are in [−π, π].
            let [l1, l2, l3, l4, l5, l6, l7, _] =
                side.map(|limit| libm::fmax(libm::fmin(limit, PI), -PI));
            let [l1, l2, l3, _, l5, l6, l7] = self.canonical(&[l1, l2, l3, l4, l5, l6, l7]);
            roots.add(shoulder.tangent(|m| m.m23, |m| m.m13, l1));
            roots.add(shoulder.cosine(l2));
            roots.add(shoulder.tangent(|m| m.m32, |m| -m.m31, l3));
            roots.add(wrist.tangent(|m| m.m23, |m| m.m13, l5));
            roots.add(wrist.cosine(l6));
            roots.add(wrist.tangent(|m| m.m32, |m| -m.m31, l7));
        }
        roots
    }
}

/// Joins the allowed gaps between neighbouring angles (sorted, in [−π, π]).
fn between(roots: &[f64], allowed: impl Fn(f64) -> bool) -> ArmAngles {
    let mut found = ArmAngles::NONE;
    let (Some(&first), Some(&last)) = (roots.first(), roots.last()) else {
        if allowed(0.0) {
            found.push([-PI, PI]);
        }
        return found;
    };
    let mut open: Option<[f64; 2]> = None;
    for (&lower, &upper) in roots.iter().zip(roots.iter().skip(1)) {
        if upper - lower <= SAME {
            continue;
        }
        let inside = allowed(0.5 * (lower + upper));
        open = match (open, inside) {
            (Some([from, _]), true) => Some([from, upper]),
            (None, true) => Some([lower, upper]),
            (Some(closed), false) => {
                found.push(closed);
                None
            }
            (None, false) => None,
        };
    }
    // The gap through π continues the interval before it, and ends in the first of all intervals.
    if !allowed(0.5 * (last + first + TAU)) {
        if let Some(closed) = open {
            found.push(closed);
        }
        return found;
    }
    let from = open.map_or(last, |[from, _]| from);
    let continues = found
        .intervals
        .first_mut()
        .filter(|interval| found.count > 0 && interval[0] <= first + SAME);
    match continues {
        _ if open.is_some_and(|[from, _]| from <= first + SAME) => found.push([-PI, PI]),
        Some(interval) => {
            // It now starts before π and is therefore the last one in order.
            let upper = interval[1] + TAU;
            let count = found.count;
            if let Some(all) = found.intervals.get_mut(..count) {
                all.rotate_left(1);
                if let Some(place) = all.last_mut() {
                    *place = [from, upper];
                }
            }
        }
        None => found.push([from, first + TAU]),
    }
    found
}

#[cfg(test)]
mod tests;
