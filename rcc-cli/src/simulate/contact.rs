//! Forces on the flange of an arm in virtual time, and the torques that its joints measure: a wall, a scripted wrench, a
//! load, the weight of the links, and friction. Runs on the caller's thread.

use rcc_config::DeviceConfig;
use rcc_core::impedance::{ControlMode, Impedance};
use rcc_core::kinematics::Arm;
use rcc_core::message::{Joints, Measurement};
use rcc_core::vector::{self, Vector};

use super::arguments::{IDEAL_ARM, value_of};
use super::dynamics::{ArmDynamics, FlangeLoad, flange_torques, gravity_at};
use super::wall::ElasticWall;

/// Masses and friction of an arm.
#[derive(Clone, Debug)]
enum ArmMasses {
    /// The robot's file does not give them: measured torques are null.
    Unknown,
    /// It has none, like the arm of the driver `ideal-arm`.
    None,
    Known(ArmDynamics),
}

/// Surroundings and masses of an arm.
#[derive(Clone, Debug)]
pub struct FlangeContact {
    arm: Arm,
    /// Wall that the flange may touch.
    pub wall: Option<ElasticWall>,
    /// Wrench that something else exerts on the flange: N and N·m, base axes.
    pub pushed: [f64; 6],
    /// Load that the controller does not know about.
    pub load: Option<FlangeLoad>,
    masses: ArmMasses,
    /// Gravity in the base frame, m/s².
    gravity: Vector,
    /// Joint positions in the previous cycle, rad.
    last: Option<Joints>,
}

impl FlangeContact {
    /// Creates what the arguments of a device's simulator describe; `None` without an arm.
    #[must_use]
    pub fn of(config: &DeviceConfig, arguments: &[&str]) -> Option<FlangeContact> {
        let robot = config.robot.as_ref()?;
        let gravity = gravity_at(&config.base);
        let load = value_of(arguments, "--load=").and_then(FlangeLoad::parse);
        Some(FlangeContact {
            arm: robot.arm,
            wall: ElasticWall::of(arguments),
            pushed: [0.0; 6],
            load,
            masses: match ArmDynamics::new(&robot.arm, &robot.dynamics, gravity) {
                _ if config.driver.is(IDEAL_ARM) => ArmMasses::None,
                Some(dynamics) => ArmMasses::Known(dynamics),
                None => ArmMasses::Unknown,
            },
            gravity,
            last: None,
        })
    }

    /// Writes wrench and torques at the measured position, one period after the last call.
    pub fn measure(&mut self, impedance: &Impedance, m: &mut Measurement) {
        let period_s = m.period_ns as f64 / 1e9;
        let joints = m.position;
        let flange = self.arm.forward(&joints);
        let mut wrench = self.pushed;
        if let Some(load) = &self.load {
            add(&mut wrench, &load.wrench(&flange, self.gravity));
        }
        if let Some(wall) = &mut self.wall {
            let springs = springs(&self.arm, &joints, impedance, wall.normal(), &wrench);
            let [fx, fy, fz] = match springs {
                None => wall.force(flange.position, period_s),
                Some(FlangeCompliance { compliance, shift }) => {
                    let unpressed = vector::add(flange.position, shift);
                    wall.force_of_springs(unpressed, compliance)
                }
            };
            add(&mut wrench, &[fx, fy, fz, 0.0, 0.0, 0.0]);
        }
        m.wrench = wrench;
        m.external_torque = flange_torques(&self.arm, &joints, &wrench);
        let last = self.last.replace(joints).unwrap_or(joints);
        m.torque = match &self.masses {
            ArmMasses::Unknown => unknown(self.arm.joints()),
            ArmMasses::None => m.external_torque,
            ArmMasses::Known(dynamics) => {
                let mut velocity = [0.0; 8];
                for ((rate, now), last) in velocity.iter_mut().zip(joints).zip(last) {
                    *rate = (now - last) / period_s;
                }
                let mut torques = m.external_torque;
                add(&mut torques, &dynamics.gravity_torques(&joints));
                add(&mut torques, &dynamics.friction_torques(&velocity));
                torques
            }
        };
    }
}

fn add<const N: usize>(sum: &mut [f64; N], more: &[f64; N]) {
    for (sum, more) in sum.iter_mut().zip(more) {
        *sum += more;
    }
}

/// Returns null for each joint.
fn unknown(joints: usize) -> Joints {
    std::array::from_fn(|joint| if joint < joints { f64::NAN } else { 0.0 })
}

/// Compliance of a flange on springs.
struct FlangeCompliance {
    /// Compliance along a direction, m/N.
    compliance: f64,
    /// Displacement by added forces, m, base axes.
    shift: Vector,
}

/// Returns the compliance of the flange along `normal` for an arm at `joints` (rad) on which `wrench` acts; `None` in
/// position control.
fn springs(
    arm: &Arm,
    joints: &Joints,
    impedance: &Impedance,
    normal: Vector,
    wrench: &[f64; 6],
) -> Option<FlangeCompliance> {
    // Displacement of the flange per displacement of each spring, and the force on that spring.
    let rows: Vec<(Vector, f64)> = match ControlMode::from_number(impedance.strategy)? {
        ControlMode::Position => return None,
        ControlMode::CartesianImpedance => {
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            axes.into_iter().zip(*wrench).collect()
        }
        ControlMode::JointImpedance => {
            let jacobian = arm.jacobian(joints);
            let torques = flange_torques(arm, joints, wrench);
            let column = |joint: usize| [0, 1, 2].map(|row| jacobian[row][joint]);
            (0..arm.joints()).map(column).zip(torques).collect()
        }
    };
    let mut yielding = FlangeCompliance {
        compliance: 0.0,
        shift: [0.0; 3],
    };
    for (element, (column, force)) in rows.into_iter().enumerate() {
        let k = impedance.stiffness[element];
        let along = vector::dot(normal, column).powi(2);
        if k == 0.0 {
            // No spring, so no position of rest: the flange yields to a wall without force, and forces do not shift it.
            yielding.compliance += if along > 0.0 { f64::INFINITY } else { 0.0 };
            continue;
        }
        yielding.compliance += along / k;
        let moved = vector::scale(column, (impedance.added[element] + force) / k);
        yielding.shift = vector::add(yielding.shift, moved);
    }
    Some(yielding)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_without_a_spring_yields_to_a_wall_and_is_not_shifted_by_forces() {
        let arm = rcc_testing::arms::lwr().arm.expect("kinematics");
        let mut impedance = Impedance {
            strategy: ControlMode::CartesianImpedance as u64,
            stiffness: [500.0; rcc_core::message::JOINTS_MAX],
            ..Impedance::NONE
        };
        impedance.stiffness[2] = 0.0;
        let wrench = [5.0, 0.0, 5.0, 0.0, 0.0, 0.0];
        let of = |normal| springs(&arm, &[0.0; 8], &impedance, normal, &wrench);
        let along = of([0.0, 0.0, 1.0]).expect("springs");
        assert_eq!(
            (along.compliance, along.shift),
            (f64::INFINITY, [0.01, 0.0, 0.0])
        );
        let across = of([1.0, 0.0, 0.0]).expect("springs");
        assert_eq!(across.compliance, 1.0 / 500.0);
    }
}
