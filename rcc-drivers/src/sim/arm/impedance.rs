//! Impedance control of the simulated arm: springs and dampers towards the set-point against external forces.
//! Pure; run by the clock thread.
//!
//! The control laws are those of Schreiber, Stemmer, Bischoff (ICRA 2010 workshop):
//! `F = K (x_set − x) + D (ẋ_set − ẋ) + F_added` at the flange in base axes, or the same in each joint. Each axis and each joint moves a mass of its own
//! (our values: 5 kg, 0.2 kg m², 0.5 kg m²), so the damping is `2 ζ √(k m)`; gravity and friction are compensated, as
//! on the robot. At rest only the springs matter: the deflection is force divided by stiffness. In Cartesian impedance
//! control the redundancy follows the joint set-point. Integration is semi-implicit Euler with steps of at most 0.25
//! ms.

use super::environment::Environment;
use super::model::{ArmModel, Geometry, Matrix, geometry};
use super::simulated_arm::SimulatedArm;
use super::{JOINTS, Joints};

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
pub const STIFFNESS: [[f64; 2]; 3] = [[0.0, 5000.0], [0.0, 300.0], [0.0, 2000.0]];
/// Range of a damping ratio.
pub const RATIO: [f64; 2] = [0.0, 1.0];
/// Damping that remains without any spring or damping ratio, as the friction of a real arm does: N·s/m, N·m·s/rad,
/// N·m·s/rad per joint. The values are ours.
const FRICTION: [f64; 3] = [4.0, 0.2, 0.2];
/// Stiffness before anybody chooses one: the initial values of `$STIFFNESS`.
const USUAL: [f64; 3] = [2000.0, 200.0, 1000.0];
const USUAL_RATIO: f64 = 0.7;
/// An axis or a joint slower than this is at rest, m/s or rad/s. The value is ours.
const REST: f64 = 1e-4;

/// A pose is reached within this distance along and about each axis, m and rad, after at most this number of steps.
const POSE_REACHED: f64 = 1e-8;
const NEWTON_STEPS: usize = 12;

/// One value per axis (six) or per joint (seven), depending on the strategy.
type Elements = [f64; JOINTS];

/// How a controller moves the joints.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum ControlLaw {
    /// Joint position control.
    Position,
    /// Cartesian impedance control at the flange.
    CartesianImpedance,
    /// Joint impedance control.
    JointImpedance,
}

/// Law, springs and arm of one step of impedance control.
#[derive(Clone, Copy, Debug)]
pub struct ImpedanceControl<'a> {
    /// One of the two kinds of impedance.
    pub law: ControlLaw,
    /// Springs, dampers and added forces.
    pub settings: &'a ImpedanceSettings,
    /// Geometry of the arm.
    pub model: &'a ArmModel,
}

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
pub(in crate::sim) fn kind(strategy: ControlLaw, element: usize) -> usize {
    match strategy {
        ControlLaw::JointImpedance => 2,
        _ => usize::from(element >= 3),
    }
}

/// Returns the number of elements.
pub(in crate::sim) fn count(strategy: ControlLaw) -> usize {
    match strategy {
        ControlLaw::Position => 0,
        ControlLaw::CartesianImpedance => 6,
        ControlLaw::JointImpedance => JOINTS,
    }
}

impl ImpedanceSettings {
    /// Returns the stiffness and damping before anybody chooses one (`$STIFFNESS`), without an added force.
    pub fn default_for(strategy: ControlLaw) -> Self {
        let of = |element| USUAL[kind(strategy, element)];
        Self {
            stiffness: std::array::from_fn(of),
            damping: [USUAL_RATIO; JOINTS],
            added: [0.0; JOINTS],
        }
    }

    /// Returns the force or torque of an element; `deflection` and `rate` point towards the set-point.
    fn force(&self, strategy: ControlLaw, element: usize, deflection: f64, rate: f64) -> f64 {
        let (k, mass) = (self.stiffness[element], MASS[kind(strategy, element)]);
        let damping = 2.0 * self.damping[element] * (k * mass).sqrt();
        let damping = damping.max(FRICTION[kind(strategy, element)]);
        k * deflection + damping * rate + self.added[element]
    }
}

impl SimulatedArm {
    /// Follows a set-point that moves at constant velocity from `from` to `to` (rad) in `step_s` seconds, under
    /// impedance control.
    pub fn step_impedance(
        &mut self,
        (from, to): (&Joints, &Joints),
        step_s: f64,
        control: &ImpedanceControl<'_>,
        environment: &Environment,
    ) {
        let steps = (step_s / STEP_S).ceil().max(1.0);
        let dt_s = step_s / steps;
        let rate: Joints = std::array::from_fn(|joint| (to[joint] - from[joint]) / step_s);
        let before = self.velocity;
        for step in 1..=steps as u64 {
            let time_s = step as f64 * dt_s;
            let goal = std::array::from_fn(|joint| from[joint] + rate[joint] * time_s);
            match control.law {
                ControlLaw::CartesianImpedance => {
                    self.step_axes(&goal, &rate, dt_s, control, environment)
                }
                _ => self.step_joints(&goal, &rate, dt_s, control, environment),
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
        control: &ImpedanceControl<'_>,
        environment: &Environment,
    ) {
        let impedance = control.settings;
        let here = geometry(control.model, &self.position);
        let outside = here.joint_torque(&environment.wrench(&here, &self.velocity));
        for joint in 0..JOINTS {
            let (off, slow) = (
                goal[joint] - self.position[joint],
                rate[joint] - self.velocity[joint],
            );
            let torque =
                impedance.force(ControlLaw::JointImpedance, joint, off, slow) + outside[joint];
            self.velocity[joint] += torque / MASS[2] * dt_s;
            self.position[joint] += self.velocity[joint] * dt_s;
        }
    }

    fn step_axes(
        &mut self,
        goal: &Joints,
        rate: &Joints,
        dt_s: f64,
        control: &ImpedanceControl<'_>,
        environment: &Environment,
    ) {
        let (impedance, model) = (control.settings, control.model);
        let (here, there) = (geometry(model, &self.position), geometry(model, goal));
        let outside = environment.wrench(&here, &self.velocity);
        let off = deflection(&here, &there);
        let (has, wants) = (twist(&here, &self.velocity), twist(&there, rate));
        let wanted: [f64; 6] = std::array::from_fn(|axis| {
            let (strategy, slow) = (ControlLaw::CartesianImpedance, wants[axis] - has[axis]);
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
pub(in crate::sim) fn nearest_joints(
    model: &ArmModel,
    from: &Joints,
    pose: &Geometry,
) -> Result<Joints, [f64; 6]> {
    let (mut joints, mut here) = (*from, geometry(model, from));
    for _ in 0..NEWTON_STEPS {
        let off = deflection(&here, pose);
        if off.iter().all(|off| off.abs() <= POSE_REACHED) {
            return Ok(joints);
        }
        let step = here.joint_torque(&solved(&here, off));
        for (joint, step) in joints.iter_mut().zip(step) {
            *joint += step;
        }
        here = geometry(model, &joints);
    }
    Err(deflection(&here, pose))
}

/// Returns the linear and angular velocity of the flange, base axes.
pub(in crate::sim) fn twist(geometry: &Geometry, velocity: &Joints) -> [f64; 6] {
    std::array::from_fn(|row| {
        let pairs = geometry.jacobian[row].iter().zip(velocity);
        pairs.map(|(j, v)| j * v).sum()
    })
}

/// Returns the translation and the rotation vector from `here` to `there`, base axes.
pub(in crate::sim) fn deflection(here: &Geometry, there: &Geometry) -> [f64; 6] {
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
