//! Joint torques of an arm: gravity on its links, friction, and an external wrench. Statics and friction only; the
//! torques that accelerate the links are left out. Pure functions; used on the caller's thread.
//!
//! Torques are those that loads exert on the joints, as an LWR reports them: positive turns the joint in its positive
//! direction. The arm's geometry comes from its Jacobian at 0, as a product of exponentials (Murray, Li and Sastry, "A
//! Mathematical Introduction to Robotic Manipulation", 1994, section 3.2), so that every kind of arm is covered.

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rcc_config::LinkDynamics;
use rcc_core::kinematics::Arm;
use rcc_core::message::Joints;
use rcc_core::pose::Pose;
use rcc_core::vector::{self, Vector};

use super::arguments::numbers;

/// Standard gravity, m/s² (CGPM 1901).
pub const GRAVITY: f64 = 9.806_65;
/// Velocity at which dry friction reaches 76 % (the hyperbolic tangent of 1) of its value, rad/s; smooths its sign.
const STICTION_RATE_RAD_S: f64 = 1e-3;

/// A load at the flange that the arm's controller does not know about, such as a part in its gripper.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FlangeLoad {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass, flange frame, m.
    pub centre_m: Vector,
}

impl FlangeLoad {
    /// Parses `KG` or `KG,X,Y,Z`, the mass and its centre in the flange frame (m); `None` if it is invalid.
    #[must_use]
    pub fn parse(text: &str) -> Option<FlangeLoad> {
        let (mass_kg, centre_m) = match numbers(text)?[..] {
            [mass_kg] => (mass_kg, [0.0; 3]),
            [mass_kg, x, y, z] => (mass_kg, [x, y, z]),
            _ => return None,
        };
        (mass_kg >= 0.0).then_some(FlangeLoad { mass_kg, centre_m })
    }

    /// Returns force (N) and torque (N·m) on the flange at `flange`, axes of the base; `gravity` is m/s², base frame.
    #[must_use]
    pub fn wrench(&self, flange: &Pose, gravity: Vector) -> [f64; 6] {
        let force = vector::scale(gravity, self.mass_kg);
        let [tx, ty, tz] = vector::cross(flange.rotate(self.centre_m), force);
        let [fx, fy, fz] = force;
        [fx, fy, fz, tx, ty, tz]
    }
}

/// Returns the gravity in the base frame of an arm that is mounted at `base` in the world, m/s².
#[must_use]
pub fn gravity_at(base: &Pose) -> Vector {
    base.inverse().rotate([0.0, 0.0, -GRAVITY])
}

/// Returns the joint torques of a wrench (N, N·m, base axes) on the flange, N·m: `Jᵀ F`.
#[must_use]
pub fn flange_torques(arm: &Arm, joints: &Joints, wrench: &[f64; 6]) -> Joints {
    let mut torques = [0.0; 8];
    for (row, force) in arm.jacobian(joints).iter().zip(wrench) {
        for (torque, element) in torques.iter_mut().zip(row) {
            *torque += element * force;
        }
    }
    torques
}

/// An axis of rotation while all joints are 0, base frame.
#[derive(Clone, Copy, Debug)]
struct JointAxis {
    direction: Unit<Vector3<f64>>,
    /// Any point of the axis, m.
    point: Point3<f64>,
}

impl JointAxis {
    /// Returns the motion of everything behind the joint when it turns by `angle` (rad).
    fn turned(&self, angle: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_axis_angle(&self.direction, angle);
        let shift = self.point.coords - turn * self.point.coords;
        Isometry3::from_parts(Translation3::from(shift), turn)
    }
}

/// Masses and friction of an arm.
#[derive(Clone, Debug)]
pub struct ArmDynamics {
    axes: Vec<JointAxis>,
    links: Vec<LinkDynamics>,
    /// Gravity in the base frame, m/s².
    gravity: Vector3<f64>,
}

impl ArmDynamics {
    /// Creates the model; `gravity` is m/s², base frame. `None` unless there is a link for each joint.
    #[must_use]
    pub fn new(arm: &Arm, links: &[LinkDynamics], gravity: Vector) -> Option<ArmDynamics> {
        if links.len() != arm.joints() {
            return None;
        }
        let zero = [0.0; 8];
        let jacobian = arm.jacobian(&zero);
        let flange = Vector3::from(arm.forward(&zero).position);
        let column =
            |joint: usize, rows: [usize; 3]| Vector3::from(rows.map(|row| jacobian[row][joint]));
        let axes = (0..arm.joints()).map(|joint| {
            let (linear, direction) = (column(joint, [0, 1, 2]), column(joint, [3, 4, 5]));
            // The column is z × (p − o), so that (p − o) without its part along z is the column × z.
            let point = flange - linear.cross(&direction);
            JointAxis {
                direction: Unit::new_normalize(direction),
                point: Point3::from(point),
            }
        });
        Some(ArmDynamics {
            axes: axes.collect(),
            links: links.to_vec(),
            gravity: Vector3::from(gravity),
        })
    }

    /// Returns the joint torques by the weight of the links at `joints` (rad), N·m.
    #[must_use]
    pub fn gravity_torques(&self, joints: &Joints) -> Joints {
        let mut torques = [0.0; 8];
        let mut before = Isometry3::identity();
        // Direction of each axis and a point on it, up to the current link.
        let mut turned: Vec<(Vector3<f64>, Point3<f64>)> = Vec::with_capacity(self.axes.len());
        for ((axis, link), angle) in self.axes.iter().zip(&self.links).zip(joints) {
            turned.push((before * axis.direction.into_inner(), before * axis.point));
            before *= axis.turned(*angle);
            let centre = before * Point3::from(link.centre_m);
            let weight = self.gravity * link.mass_kg;
            for (torque, (direction, point)) in torques.iter_mut().zip(&turned) {
                *torque += direction.dot(&(centre - point).cross(&weight));
            }
        }
        torques
    }

    /// Returns the joint torques by friction at `velocity` (rad/s), N·m; they oppose the motion.
    #[must_use]
    pub fn friction_torques(&self, velocity: &Joints) -> Joints {
        let mut torques = [0.0; 8];
        for ((torque, link), velocity) in torques.iter_mut().zip(&self.links).zip(velocity) {
            let dry = link.friction_nm * (velocity / STICTION_RATE_RAD_S).tanh();
            *torque = -dry - link.damping_nm_s_rad * velocity;
        }
        torques
    }

    /// Returns the potential energy of the links, J.
    #[cfg(test)]
    fn potential_energy(&self, joints: &Joints) -> f64 {
        let mut before = Isometry3::identity();
        let mut energy = 0.0;
        for ((axis, link), angle) in self.axes.iter().zip(&self.links).zip(joints) {
            before *= axis.turned(*angle);
            let centre = before * Point3::from(link.centre_m);
            energy -= link.mass_kg * self.gravity.dot(&centre.coords);
        }
        energy
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use rcc_config::{CellConfig, RobotConfig};

    use super::*;

    const DOWN: Vector = [0.0, 0.0, -GRAVITY];
    const BENT: Joints = [0.3, -0.5, 0.2, 1.4, -0.6, 0.9, 0.4, 0.0];

    fn robot(name: &str) -> RobotConfig {
        let cells = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/cells");
        let mut cell = CellConfig::load_offline(&cells.join("demo.yaml")).expect("the demo");
        let lwr = cell.devices.remove(0).robot.expect("an arm");
        assert!(lwr.source.contains(name), "{}", lwr.source);
        lwr
    }

    fn point_mass(mass_kg: f64, centre_m: Vector) -> LinkDynamics {
        LinkDynamics {
            mass_kg,
            centre_m,
            friction_nm: 0.0,
            damping_nm_s_rad: 0.0,
        }
    }

    #[test]
    fn a_load_at_the_flange_of_a_level_arm_turns_joint_2_by_its_lever() {
        let arm = robot("lwr4plus").arm;
        // The arm is stretched forwards, level at the height of the shoulder: 0.4 + 0.39 + 0.078 m long. J2 turns
        // about -y, so that it is at -90°, and the weight of 2 kg turns it further.
        let level = [0.0, -90_f64.to_radians(), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let flange = arm.forward(&level);
        assert!((flange.position[0] - 0.868).abs() < 1e-12, "{flange:?}");
        let load = FlangeLoad {
            mass_kg: 2.0,
            centre_m: [0.0; 3],
        };
        let torques = flange_torques(&arm, &level, &load.wrench(&flange, DOWN));
        let expected = -2.0 * GRAVITY * 0.868;
        assert!((torques[1] - expected).abs() < 1e-9, "{torques:?}");
        // The elbow has the lever of forearm and flange, the wrist that of the flange; the others turn about the arm.
        assert!(
            (torques[3].abs() - 2.0 * GRAVITY * 0.468).abs() < 1e-9,
            "{torques:?}"
        );
        assert!(
            (torques[5].abs() - 2.0 * GRAVITY * 0.078).abs() < 1e-9,
            "{torques:?}"
        );
        for joint in [0, 2, 4, 6] {
            assert!(torques[joint].abs() < 1e-9, "{torques:?}");
        }
        // A load 0.1 m beyond the flange has a longer lever.
        let beyond = FlangeLoad {
            centre_m: [0.0, 0.0, 0.1],
            ..load
        };
        let torques = flange_torques(&arm, &level, &beyond.wrench(&flange, DOWN));
        assert!(
            (torques[1] + 2.0 * GRAVITY * 0.968).abs() < 1e-9,
            "{torques:?}"
        );
    }

    #[test]
    fn the_weight_of_a_point_mass_at_the_flange_is_the_transposed_jacobian_times_its_force() {
        let arm = robot("lwr4plus").arm;
        let at_flange = arm.forward(&[0.0; 8]).position;
        let mut links = vec![point_mass(0.0, [0.0; 3]); 7];
        links[6] = point_mass(3.0, at_flange);
        let dynamics = ArmDynamics::new(&arm, &links, DOWN).expect("a link for each joint");
        let torques = dynamics.gravity_torques(&BENT);
        let expected = flange_torques(&arm, &BENT, &[0.0, 0.0, -3.0 * GRAVITY, 0.0, 0.0, 0.0]);
        for joint in 0..7 {
            assert!(
                (torques[joint] - expected[joint]).abs() < 1e-9,
                "{torques:?} {expected:?}"
            );
        }
    }

    #[test]
    fn gravity_torques_are_the_negative_gradient_of_the_potential_energy() {
        let robot = robot("lwr4plus");
        let dynamics = ArmDynamics::new(&robot.arm, &robot.dynamics, DOWN).expect("its links");
        let torques = dynamics.gravity_torques(&BENT);
        for joint in 0..7 {
            let at = |by: f64| {
                let mut joints = BENT;
                joints[joint] += by;
                dynamics.potential_energy(&joints)
            };
            let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!(
                (torques[joint] + slope).abs() < 1e-6,
                "{joint}: {torques:?} {slope}"
            );
        }
        // Upright all joints carry their links without torque, but for the links' offsets from the axes.
        assert!(dynamics.gravity_torques(&[0.0; 8])[0].abs() < 1e-12);
    }

    #[test]
    fn friction_takes_energy_out_of_every_motion() {
        let robot = robot("lwr4plus");
        let dynamics = ArmDynamics::new(&robot.arm, &robot.dynamics, DOWN).expect("its links");
        assert_eq!(dynamics.friction_torques(&[0.0; 8]), [0.0; 8]);
        let velocity = [0.5, -0.5, 1e-4, -2.0, 1.0, -1.0, 3.0, 0.0];
        let torques = dynamics.friction_torques(&velocity);
        for joint in 0..7 {
            assert!(torques[joint] * velocity[joint] < 0.0, "{torques:?}");
        }
        // Far from rest: dry friction and damping.
        let first = robot.dynamics[0];
        let expected = -(first.friction_nm + first.damping_nm_s_rad * 0.5);
        assert!((torques[0] - expected).abs() < 1e-9, "{torques:?}");
    }

    #[test]
    fn an_arm_on_the_ceiling_feels_gravity_the_other_way_round() {
        let ceiling = Pose::from_xyz_rpy([0.0, 0.0, 3.0], [std::f64::consts::PI, 0.0, 0.0]);
        let [x, y, z] = gravity_at(&ceiling);
        assert!(x.abs() < 1e-12 && y.abs() < 1e-12 && (z - GRAVITY).abs() < 1e-12);
    }
}
