//! Weight and inertia of the arm's links, friction, and a load at the flange, for the joint torques and the mass matrix that
//! the simulated controller sends. The torques are statics and friction only: those that accelerate the links are left out,
//! and no weight moves the arm.
//! Pure functions; run by the clock thread.

use super::model::{ArmModel, Geometry, LinkFrame, Matrix, cross, link_frames};
use super::{JOINTS, Joints};

/// Standard gravity, m/s² (CGPM 1901).
pub const GRAVITY: f64 = 9.806_65;
/// Velocity at which dry friction reaches 76 % (the hyperbolic tangent of 1) of its value, rad/s.
const STICTION_RATE: f64 = 1e-3;

/// A load at the flange that the controller does not know about, such as a part in a gripper.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
#[serde(deny_unknown_fields)]
pub struct FlangeLoad {
    /// kg.
    pub mass: f64,
    /// Centre of mass, flange frame, m.
    #[serde(default)]
    pub centre: [f64; 3],
}

/// Why a load is invalid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "invalid load: write KG or KG,X,Y,Z, a mass of 0 or more and its centre in the flange frame, m"
)]
pub struct LoadError;

impl FlangeLoad {
    /// Returns the load if it is possible.
    ///
    /// # Errors
    /// Returns an error for a negative mass or numbers that are not finite.
    pub fn checked(self) -> Result<Self, LoadError> {
        let is_finite = self.centre.iter().all(|part| part.is_finite());
        (self.mass.is_finite() && self.mass >= 0.0 && is_finite)
            .then_some(self)
            .ok_or(LoadError)
    }

    /// Returns the wrench of its weight on the flange: force N and torque Nm, base axes.
    pub fn wrench(&self, geometry: &Geometry) -> [f64; 6] {
        let weight = -self.mass * GRAVITY;
        let [x, y, _] = rotated(&geometry.rotation, &self.centre);
        [0.0, 0.0, weight, y * weight, -x * weight, 0.0]
    }
}

impl std::str::FromStr for FlangeLoad {
    type Err = LoadError;

    fn from_str(text: &str) -> Result<Self, LoadError> {
        let numbers: Result<Vec<f64>, _> =
            text.split(',').map(|part| part.trim().parse()).collect();
        let (mass, centre) = match numbers.map_err(|_| LoadError)?[..] {
            [mass] => (mass, [0.0; 3]),
            [mass, x, y, z] => (mass, [x, y, z]),
            _ => return Err(LoadError),
        };
        Self { mass, centre }.checked()
    }
}

/// Returns the joint torques by the weight of the links at `q` (rad), Nm; positive turns a joint in its direction.
pub fn gravity_torque(model: &ArmModel, q: &Joints) -> Joints {
    let here = link_frames(model, q);
    let mut torques = [0.0; JOINTS];
    for (link, centre) in centres(model, &here).into_iter().enumerate() {
        let weight = -model.mass[link] * GRAVITY;
        for (torque, frame) in torques.iter_mut().zip(&here).take(link + 1) {
            let lever = difference(&centre, &frame.origin);
            // axis · (lever × [0, 0, weight])
            *torque += weight * (frame.axis[0] * lever[1] - frame.axis[1] * lever[0]);
        }
    }
    torques
}

/// Returns the mass matrix at `q` (rad), kg m²: `Σ m Jvᵀ Jv + I Jωᵀ Jω` over the links. Approximate, as the masses are.
pub fn mass_matrix(model: &ArmModel, q: &Joints) -> [Joints; JOINTS] {
    let here = link_frames(model, q);
    let mut matrix = [[0.0; JOINTS]; JOINTS];
    for (link, centre) in centres(model, &here).into_iter().enumerate() {
        let mass = model.mass[link];
        let inertia = 0.4 * mass * model.radius.powi(2);
        let moves = |joint: &LinkFrame| cross(&joint.axis, &difference(&centre, &joint.origin));
        for (row, one) in here.iter().enumerate().take(link + 1) {
            for (column, other) in here.iter().enumerate().take(link + 1) {
                matrix[row][column] +=
                    mass * dot(&moves(one), &moves(other)) + inertia * dot(&one.axis, &other.axis);
            }
        }
    }
    matrix
}

/// Returns the centre of mass of each link, base frame, m.
fn centres(model: &ArmModel, here: &[LinkFrame; JOINTS]) -> [[f64; 3]; JOINTS] {
    let upright = link_frames(model, &[0.0; JOINTS]);
    std::array::from_fn(|link| {
        // The centre in the link's own frame, and from there to where the link is.
        let local = back(
            &upright[link].rotation,
            &difference(&model.centre[link], &upright[link].position),
        );
        let turned = rotated(&here[link].rotation, &local);
        std::array::from_fn(|i| here[link].position[i] + turned[i])
    })
}

/// Returns the joint torques by friction, Nm; they oppose the velocities (rad/s).
pub fn friction_torque(model: &ArmModel, velocity: &Joints) -> Joints {
    std::array::from_fn(|joint| {
        let rate = velocity[joint];
        -model.friction[joint] * (rate / STICTION_RATE).tanh() - model.damping[joint] * rate
    })
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn difference(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn rotated(m: &Matrix, v: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|row| (0..3).map(|i| m[row][i] * v[i]).sum())
}

/// Rotates by the inverse.
fn back(m: &Matrix, v: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|column| (0..3).map(|i| m[i][column] * v[i]).sum())
}

#[cfg(test)]
mod tests {
    use super::super::model::geometry;
    use super::*;
    use crate::sim::lwr::model::LWR_4_PLUS as MODEL;

    const BENT: Joints = [0.3, -0.5, 0.2, 1.4, -0.6, 0.9, 0.4];

    #[test]
    fn links_and_friction_are_those_of_the_robots_file() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/cells/demo.yaml");
        let cell = rcc_config::CellConfig::load_offline(path.as_ref()).expect("the demo");
        let robot = cell.devices[0].robot.as_ref().expect("an arm");
        assert_eq!(robot.dynamics.len(), JOINTS);
        for (joint, link) in robot.dynamics.iter().enumerate() {
            let ours = (
                MODEL.mass[joint],
                MODEL.centre[joint],
                MODEL.friction[joint],
                MODEL.damping[joint],
            );
            let theirs = (
                link.mass_kg,
                link.centre_m,
                link.friction_nm,
                link.damping_nm_s_rad,
            );
            assert_eq!(ours, theirs, "J{}", joint + 1);
        }
    }

    #[test]
    fn weight_turns_a_level_arm_by_the_levers_of_its_links() {
        // Level forwards: each centre is as far in front of the shoulder as it was above it, and offsets along y stay.
        let level = [0.0, -90_f64.to_radians(), 0.0, 0.0, 0.0, 0.0, 0.0];
        let torques = gravity_torque(&MODEL, &level);
        let from_shoulder: f64 = (1..JOINTS)
            .map(|link| MODEL.mass[link] * GRAVITY * (MODEL.centre[link][2] - 0.3105))
            .sum();
        assert!((torques[1] + from_shoulder).abs() < 1e-9, "{torques:?}");
        let wrist = 0.2 * GRAVITY * (1.163 - 1.1005 + 0.078);
        assert!((torques[5].abs() - wrist).abs() < 1e-9, "{torques:?}");
        assert!(torques[0].abs() < 1e-9, "{torques:?}");
    }

    #[test]
    fn weight_stores_what_lifting_takes() {
        // Along a closed path the work of the weights is 0.
        let steps = 20_000;
        let at = |step: usize| -> Joints {
            let angle = std::f64::consts::TAU * step as f64 / steps as f64;
            std::array::from_fn(|joint| BENT[joint] + 0.5 * (angle + joint as f64).sin())
        };
        let work: f64 = (0..steps)
            .map(|step| {
                let (from, to) = (at(step), at(step + 1));
                let middle = std::array::from_fn(|joint| 0.5 * (from[joint] + to[joint]));
                let torques = gravity_torque(&MODEL, &middle);
                (0..JOINTS)
                    .map(|joint| torques[joint] * (to[joint] - from[joint]))
                    .sum::<f64>()
            })
            .sum();
        assert!(work.abs() < 1e-6, "{work} J");
    }

    #[test]
    fn the_mass_matrix_is_that_of_the_kinetic_energy() {
        let rate: Joints = [0.3, -0.7, 1.1, 0.4, -0.9, 0.6, -1.3];
        let matrix = mass_matrix(&MODEL, &BENT);
        let row = |i: usize| (0..JOINTS).map(|j| matrix[i][j] * rate[j]).sum::<f64>();
        let of_matrix = 0.5 * (0..JOINTS).map(|i| rate[i] * row(i)).sum::<f64>();
        // The same from differences of positions and rotations, without a Jacobian.
        let step_s = 1e-6;
        let at = |time_s: f64| -> [LinkFrame; JOINTS] {
            link_frames(
                &MODEL,
                &std::array::from_fn(|joint| BENT[joint] + rate[joint] * time_s),
            )
        };
        let (before, after) = (at(-step_s), at(step_s));
        let (from, to) = (centres(&MODEL, &before), centres(&MODEL, &after));
        let energy: f64 = (0..JOINTS)
            .map(|link| {
                let v = difference(&to[link], &from[link]).map(|way| way / (2.0 * step_s));
                // |Ṙ|² / 2 is ω².
                let (r, s) = (&before[link].rotation, &after[link].rotation);
                let turned = r.as_flattened().iter().zip(s.as_flattened());
                let squared: f64 = turned.map(|(r, s)| (s - r).powi(2)).sum();
                let omega_squared = 0.5 * squared / (2.0 * step_s).powi(2);
                let inertia = 0.4 * MODEL.mass[link] * MODEL.radius.powi(2);
                0.5 * (MODEL.mass[link] * dot(&v, &v) + inertia * omega_squared)
            })
            .sum();
        assert!((of_matrix - energy).abs() < 1e-6, "{of_matrix} {energy}");
        let transposed: [Joints; JOINTS] =
            std::array::from_fn(|i| std::array::from_fn(|j| matrix[j][i]));
        assert_eq!(matrix, transposed);
        assert!((0..JOINTS).all(|joint| matrix[joint][joint] > 0.0));
    }

    #[test]
    fn a_load_hangs_on_the_flange() {
        let here = geometry(&MODEL, &BENT);
        let load: FlangeLoad = "2,0,0,0.1".parse().expect("a load");
        let wrench = load.wrench(&here);
        assert_eq!(wrench[2], -2.0 * GRAVITY);
        // The same torques as those of the weight at a flange that is 0.1 m longer: Jᵀ f.
        let mut lever = [0.0; 3];
        for (row, part) in lever.iter_mut().enumerate() {
            *part = 0.1 * here.rotation[row][2];
        }
        let torques = here.joint_torque(&wrench);
        for joint in 0..JOINTS {
            let [_, _, vz, wx, wy, _] = here.jacobian.map(|row| row[joint]);
            let up = vz + wx * lever[1] - wy * lever[0];
            assert!(
                (torques[joint] - up * wrench[2]).abs() < 1e-9,
                "{torques:?}"
            );
        }
        for text in ["", "-1", "1,2", "nan"] {
            assert!(text.parse::<FlangeLoad>().is_err(), "{text}");
        }
    }
}
