//! Impedance control of the simulated arm: springs and dampers towards the set-point against external forces.
//! Pure; run by the clock thread.
//!
//! The control laws are those of Schreiber, Stemmer, Bischoff (ICRA 2010 workshop):
//! `F = K (x_set − x) + D (ẋ_set − ẋ) + F_added` at the flange in base axes, or the same in each joint. Each axis and each joint moves a mass of its own
//! (our values: 5 kg, 0.2 kg m², 0.5 kg m²), so the damping is `2 ζ √(k m)`; gravity and friction are compensated, as
//! on the robot. At rest only the springs matter: the deflection is force divided by stiffness. In Cartesian impedance
//! control the redundancy follows the joint set-point. Integration is semi-implicit Euler with steps of at most 0.25
//! ms.

use super::arm::SimulatedArm;
use super::environment::Environment;
use super::fault::KrcFault;
use super::model::{Geometry, Matrix, geometry};
use super::settings::KrlStrategy;
use super::{JOINTS, Joints};
use crate::fri_lwr::wire::{CommandDatagram, flags};

/// Longest integration step, s.
const STEP_S: f64 = 0.25e-3;
/// Effective mass along an axis, about an axis, and of a joint; kg, kg m², kg m².
const MASS: [f64; 3] = [5.0, 0.2, 0.5];
/// Rate at which the redundancy follows the joint set-point, 1/s.
const REDUNDANCY_RATE: f64 = 20.0;
/// Below this manipulability (square root of the determinant of `J Jᵀ`) the inverse of the Jacobian is damped, up to
/// this λ² at a manipulability of 0, so that joint velocities stay bounded near singularities (Nakamura, Hanafusa,
/// 1986). The values are ours.
const MANIPULABILITY: f64 = 3e-3;
const DAMPING_SQUARED: f64 = 1e-3;
/// Ranges that FRI accepts: the greatest values of KRL according to users' scripts, N/m, N·m/rad, N·m/rad per joint. KRL
/// itself takes nothing below 0.01, but clients for torque control send 0.
const STIFFNESS: [[f64; 2]; 3] = [[0.0, 5000.0], [0.0, 300.0], [0.0, 2000.0]];
const RATIO: [f64; 2] = [0.0, 1.0];
/// Damping that remains without any spring or damping ratio, as the friction of a real arm does: N·s/m, N·m·s/rad,
/// N·m·s/rad per joint. The values are ours.
const FRICTION: [f64; 3] = [4.0, 0.2, 0.2];
/// Initial values of `$STIFFNESS`.
const USUAL: [f64; 3] = [2000.0, 200.0, 1000.0];
const USUAL_RATIO: f64 = 0.7;
/// Relative tolerance of the ranges for binary32.
const ROUNDING: f64 = 1e-6;
/// An axis or a joint slower than this is at rest, m/s or rad/s. The value is ours.
const REST: f64 = 1e-4;

/// A pose is reached within this distance along and about each axis, m and rad, after at most this number of steps.
const POSE_REACHED: f64 = 1e-8;
const NEWTON_STEPS: usize = 12;

/// One value per axis (six) or per joint (seven), depending on the strategy.
type Elements = [f64; JOINTS];

/// Commanded stiffness, damping and added forces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImpedanceSettings {
    /// N/m and N·m/rad for x y z rx ry rz, or N·m/rad per joint.
    pub stiffness: Elements,
    /// Damping ratio.
    pub damping: Elements,
    /// Added forces and torques, N and N·m.
    pub added: Elements,
}

/// Returns the index into the tables above: 0 along an axis, 1 about an axis, 2 for a joint.
fn kind(strategy: KrlStrategy, element: usize) -> usize {
    match strategy {
        KrlStrategy::JointImpedance => 2,
        _ => usize::from(element >= 3),
    }
}

/// Returns the number of elements.
fn count(strategy: KrlStrategy) -> usize {
    match strategy {
        KrlStrategy::Position => 0,
        KrlStrategy::CartesianImpedance => 6,
        KrlStrategy::JointImpedance => JOINTS,
    }
}

impl ImpedanceSettings {
    /// Returns the initial values of `$STIFFNESS`, without an added force.
    pub fn default_for(strategy: KrlStrategy) -> Self {
        let of = |element| USUAL[kind(strategy, element)];
        Self {
            stiffness: std::array::from_fn(of),
            damping: [USUAL_RATIO; JOINTS],
            added: [0.0; JOINTS],
        }
    }

    /// Returns the settings of a command for this strategy: those fields that its flags select, and `$STIFFNESS` for the
    /// others.
    ///
    /// # Errors
    /// Returns a fault for the first element out of range.
    pub fn of(command: &CommandDatagram, strategy: KrlStrategy) -> Result<Self, KrcFault> {
        // KUKA's order is x y z A B C: A rotates about z, C about x.
        let six = |values: &[f32; 6]| -> Elements {
            let [x, y, z, a, b, c] = values.map(f64::from);
            [x, y, z, c, b, a, 0.0]
        };
        let (stiffness, damping, added) = match strategy {
            KrlStrategy::JointImpedance => (
                command.joint_stiffness.map(f64::from),
                command.joint_damping.map(f64::from),
                command.additional_joint_torque.map(f64::from),
            ),
            _ => (
                six(&command.cartesian_stiffness),
                six(&command.cartesian_damping),
                six(&command.additional_tcp_wrench),
            ),
        };
        let usual = Self::default_for(strategy);
        let (of_joints, selected) = (strategy == KrlStrategy::JointImpedance, |flag: u32| {
            command.flags & flag != 0
        });
        let picked = |joint: u32, cartesian: u32, commanded: Elements, usual: Elements| {
            let flag = if of_joints { joint } else { cartesian };
            if selected(flag) { commanded } else { usual }
        };
        let stiffness = picked(
            flags::JOINT_STIFFNESS,
            flags::CARTESIAN_STIFFNESS,
            stiffness,
            usual.stiffness,
        );
        let damping = picked(
            flags::JOINT_DAMPING,
            flags::CARTESIAN_DAMPING,
            damping,
            usual.damping,
        );
        let added = picked(flags::JOINT_TORQUE, flags::TCP_WRENCH, added, usual.added);
        for element in 0..count(strategy) {
            let rows = [
                (
                    "stiffness",
                    stiffness[element],
                    STIFFNESS[kind(strategy, element)],
                ),
                ("damping", damping[element], RATIO),
                (
                    "added force or torque",
                    added[element],
                    [-f64::MAX, f64::MAX],
                ),
            ];
            for (what, value, [least, greatest]) in rows {
                let room = 1.0 + ROUNDING;
                if !(value >= least / room && value <= greatest.min(f64::MAX / 2.0) * room) {
                    return Err(KrcFault::Impedance {
                        what,
                        element,
                        value,
                        least,
                        greatest,
                    });
                }
            }
        }
        Ok(Self {
            stiffness,
            damping,
            added,
        })
    }

    /// Returns the force or torque of an element; `deflection` and `rate` point towards the set-point.
    fn force(&self, strategy: KrlStrategy, element: usize, deflection: f64, rate: f64) -> f64 {
        let (k, mass) = (self.stiffness[element], MASS[kind(strategy, element)]);
        let damping = 2.0 * self.damping[element] * (k * mass).sqrt();
        let damping = damping.max(FRICTION[kind(strategy, element)]);
        k * deflection + damping * rate + self.added[element]
    }
}

impl KrlStrategy {
    /// Returns the strategy of a value of `$STIFFNESS.STRATEGY`.
    pub fn from_krl(number: i32) -> Option<Self> {
        match number {
            10 => Some(KrlStrategy::Position),
            20 => Some(KrlStrategy::CartesianImpedance),
            30 => Some(KrlStrategy::JointImpedance),
            _ => None,
        }
    }

    /// Returns all command flags that a controller reads in this strategy.
    pub fn flags(self) -> u32 {
        match self {
            KrlStrategy::Position => flags::JOINT_POSITION,
            KrlStrategy::CartesianImpedance => {
                flags::JOINT_POSITION
                    | flags::CARTESIAN_POSITION
                    | flags::TCP_WRENCH
                    | flags::CARTESIAN_STIFFNESS
                    | flags::CARTESIAN_DAMPING
            }
            KrlStrategy::JointImpedance => {
                flags::JOINT_POSITION
                    | flags::JOINT_TORQUE
                    | flags::JOINT_STIFFNESS
                    | flags::JOINT_DAMPING
            }
        }
    }
}

impl SimulatedArm {
    /// Follows a set-point that moves at constant velocity from `from` to `to` (rad) in `step_s` seconds, under
    /// impedance control.
    pub fn step_impedance(
        &mut self,
        (from, to): (&Joints, &Joints),
        step_s: f64,
        (strategy, impedance): (KrlStrategy, &ImpedanceSettings),
        environment: &Environment,
    ) {
        let steps = (step_s / STEP_S).ceil().max(1.0);
        let dt_s = step_s / steps;
        let rate: Joints = std::array::from_fn(|joint| (to[joint] - from[joint]) / step_s);
        let before = self.velocity;
        for step in 1..=steps as u64 {
            let time_s = step as f64 * dt_s;
            let goal = std::array::from_fn(|joint| from[joint] + rate[joint] * time_s);
            match strategy {
                KrlStrategy::CartesianImpedance => {
                    self.step_axes(&goal, &rate, dt_s, impedance, environment)
                }
                _ => self.step_joints(&goal, &rate, dt_s, impedance, environment),
            }
        }
        let moved: Joints =
            std::array::from_fn(|joint| (self.velocity[joint] - before[joint]) / step_s);
        self.note(moved, rate.iter().all(|rate| *rate == 0.0), REST);
    }

    fn step_joints(
        &mut self,
        goal: &Joints,
        rate: &Joints,
        dt_s: f64,
        impedance: &ImpedanceSettings,
        environment: &Environment,
    ) {
        let here = geometry(&self.position);
        let outside = here.joint_torque(&environment.wrench(&here, &self.velocity));
        for joint in 0..JOINTS {
            let (off, slow) = (
                goal[joint] - self.position[joint],
                rate[joint] - self.velocity[joint],
            );
            let torque =
                impedance.force(KrlStrategy::JointImpedance, joint, off, slow) + outside[joint];
            self.velocity[joint] += torque / MASS[2] * dt_s;
            self.position[joint] += self.velocity[joint] * dt_s;
        }
    }

    fn step_axes(
        &mut self,
        goal: &Joints,
        rate: &Joints,
        dt_s: f64,
        impedance: &ImpedanceSettings,
        environment: &Environment,
    ) {
        let (here, there) = (geometry(&self.position), geometry(goal));
        let outside = environment.wrench(&here, &self.velocity);
        let off = deflection(&here, &there);
        let (has, wants) = (twist(&here, &self.velocity), twist(&there, rate));
        let wanted: [f64; 6] = std::array::from_fn(|axis| {
            let (strategy, slow) = (KrlStrategy::CartesianImpedance, wants[axis] - has[axis]);
            let force = impedance.force(strategy, axis, off[axis], slow) + outside[axis];
            has[axis] + force / MASS[kind(strategy, axis)] * dt_s
        });
        // The joint set-point determines what the pose leaves open.
        let aside: Joints = std::array::from_fn(|joint| {
            rate[joint] + REDUNDANCY_RATE * (goal[joint] - self.position[joint])
        });
        let of_aside = twist(&here, &aside);
        let rest = std::array::from_fn(|axis| wanted[axis] - of_aside[axis]);
        let through = here.joint_torque(&solved(&here, rest));
        for joint in 0..JOINTS {
            self.velocity[joint] = through[joint] + aside[joint];
            self.position[joint] += self.velocity[joint] * dt_s;
        }
    }
}

/// Returns the joint positions that have this pose, by the smallest joint steps from `from` (rad): Newton's method with
/// the pseudo-inverse of the Jacobian.
///
/// # Errors
/// Returns what is left to the pose if the steps do not converge: translation (m) and rotation vector (rad), base axes.
pub(super) fn nearest_joints(from: &Joints, pose: &Geometry) -> Result<Joints, [f64; 6]> {
    let (mut joints, mut here) = (*from, geometry(from));
    for _ in 0..NEWTON_STEPS {
        let off = deflection(&here, pose);
        if off.iter().all(|off| off.abs() <= POSE_REACHED) {
            return Ok(joints);
        }
        let step = here.joint_torque(&solved(&here, off));
        for (joint, step) in joints.iter_mut().zip(step) {
            *joint += step;
        }
        here = geometry(&joints);
    }
    Err(deflection(&here, pose))
}

/// Returns the linear and angular velocity of the flange, base axes.
fn twist(geometry: &Geometry, velocity: &Joints) -> [f64; 6] {
    std::array::from_fn(|row| {
        let pairs = geometry.jacobian[row].iter().zip(velocity);
        pairs.map(|(j, v)| j * v).sum()
    })
}

/// Returns the translation and the rotation vector from `here` to `there`, base axes.
pub(super) fn deflection(here: &Geometry, there: &Geometry) -> [f64; 6] {
    let turn = rotation_vector(&here.rotation, &there.rotation);
    std::array::from_fn(|axis| match axis {
        0..3 => there.position[axis] - here.position[axis],
        _ => turn[axis - 3],
    })
}

/// Returns axis times angle of `to fromᵀ`; the angle is less than π.
fn rotation_vector(from: &Matrix, to: &Matrix) -> [f64; 3] {
    let element =
        |row: usize, column: usize| -> f64 { (0..3).map(|i| to[row][i] * from[column][i]).sum() };
    let trace = element(0, 0) + element(1, 1) + element(2, 2);
    let twice_sine = [
        element(2, 1) - element(1, 2),
        element(0, 2) - element(2, 0),
        element(1, 0) - element(0, 1),
    ];
    let sine = 0.5 * twice_sine.iter().map(|s| s * s).sum::<f64>().sqrt();
    let angle = sine.atan2(0.5 * (trace - 1.0));
    let factor = if sine > 1e-9 { 0.5 * angle / sine } else { 0.5 };
    twice_sine.map(|s| s * factor)
}

/// Solves `J Jᵀ y = x`, so that `Jᵀ y` is the smallest joint velocity for the twist `x`; damped near singularities.
fn solved(geometry: &Geometry, x: [f64; 6]) -> [f64; 6] {
    let (exact, determinant) = eliminated(geometry, x, 0.0);
    let part = determinant.max(0.0).sqrt() / MANIPULABILITY;
    if part >= 1.0 {
        return exact;
    }
    let (damped, _) = eliminated(geometry, x, DAMPING_SQUARED * (1.0 - part).powi(2));
    damped
}

/// Solves `(J Jᵀ + λ² I) y = x` by Gaussian elimination with pivoting; returns `y` and the determinant.
fn eliminated(geometry: &Geometry, x: [f64; 6], damping_squared: f64) -> ([f64; 6], f64) {
    let jacobian = &geometry.jacobian;
    let mut rows: [[f64; 7]; 6] = std::array::from_fn(|row| {
        std::array::from_fn(|column| match column {
            6 => x[row],
            _ => {
                let pairs = jacobian[row].iter().zip(&jacobian[column]);
                let product: f64 = pairs.map(|(a, b)| a * b).sum();
                product + if row == column { damping_squared } else { 0.0 }
            }
        })
    });
    let mut determinant = 1.0;
    for pivot in 0..6 {
        let size = |row: &usize| rows[*row][pivot].abs();
        let largest = (pivot..6).max_by(|a, b| size(a).total_cmp(&size(b)));
        let largest = largest.unwrap_or(pivot);
        rows.swap(pivot, largest);
        determinant *= if largest == pivot { 1.0 } else { -1.0 } * rows[pivot][pivot];
        let (above, below) = rows.split_at_mut(pivot + 1);
        let top = above[pivot];
        for row in below {
            let factor = row[pivot] / top[pivot];
            for (value, from) in row.iter_mut().zip(top).skip(pivot) {
                *value -= factor * from;
            }
        }
    }
    let mut y = [0.0; 6];
    for row in (0..6).rev() {
        let known: f64 = (row + 1..6)
            .map(|column| rows[row][column] * y[column])
            .sum();
        y[row] = (rows[row][6] - known) / rows[row][row];
    }
    (y, determinant)
}

#[cfg(test)]
mod tests;
