//! Impedance control of the simulated arm against statics and the theory of second-order systems.
//! Runs in the test harness.

use super::*;
use crate::sim::arm::environment::Wall;
use crate::sim::lwr::model::{LWR_4_PLUS, geometry};
use crate::sim::lwr::settings::Settings;

const CARTESIAN: ControlLaw = ControlLaw::CartesianImpedance;
const JOINT: ControlLaw = ControlLaw::JointImpedance;

fn start() -> Joints {
    Settings::default().robot.start
}

fn control(law: ControlLaw, settings: &ImpedanceSettings) -> ImpedanceControl<'_> {
    ImpedanceControl {
        law,
        settings,
        model: &LWR_4_PLUS,
    }
}

/// Returns the arm after `time_s` with a set-point that stays at the start.
fn settled(
    strategy: ControlLaw,
    impedance: &ImpedanceSettings,
    around: &Environment,
    time_s: f64,
) -> SimulatedArm {
    let (goal, mut arm) = (start(), SimulatedArm::new(start(), 80.0));
    for _ in 0..(time_s * 1e3) as usize {
        arm.step_impedance((&goal, &goal), 1e-3, &control(strategy, impedance), around);
    }
    assert!(arm.is_at_rest(), "{:?}", arm.velocity);
    arm
}

fn soft(strategy: ControlLaw) -> ImpedanceSettings {
    ImpedanceSettings {
        stiffness: std::array::from_fn(|element| [400.0, 60.0, 150.0][kind(strategy, element)]),
        ..ImpedanceSettings::default_for(strategy)
    }
}

fn pushed(wrench: [f64; 6]) -> Environment {
    Environment {
        injected: wrench,
        ..Environment::default()
    }
}

#[test]
fn the_flange_gives_way_by_force_over_stiffness_along_and_about_each_axis() {
    for axis in 0..6 {
        let impedance = soft(CARTESIAN);
        let mut wrench = [0.0; 6];
        wrench[axis] = [8.0, 3.0][usize::from(axis >= 3)];
        let arm = settled(CARTESIAN, &impedance, &pushed(wrench), 4.0);
        let off = deflection(&geometry(&start()), &geometry(&arm.position));
        for (other, off) in off.into_iter().enumerate() {
            let expected = wrench[other] / impedance.stiffness[other];
            assert!(
                (off - expected).abs() < 2e-6,
                "{axis} {other}: {off} {expected}"
            );
        }
    }
}

#[test]
fn an_added_force_deflects_like_an_external_force() {
    for strategy in [CARTESIAN, JOINT] {
        let mut impedance = soft(strategy);
        impedance.added[1] = 6.0;
        let arm = settled(strategy, &impedance, &pushed([0.0; 6]), 4.0);
        let off = match strategy {
            JOINT => arm.position[1] - start()[1],
            _ => deflection(&geometry(&start()), &geometry(&arm.position))[1],
        };
        let expected = 6.0 / impedance.stiffness[1];
        assert!((off - expected).abs() < 2e-6, "{off} {expected}");
    }
}

#[test]
fn each_joint_gives_way_by_its_torque_over_its_stiffness() {
    let impedance = soft(JOINT);
    let wrench = [5.0, -3.0, 8.0, 0.5, 0.2, -0.4];
    let arm = settled(JOINT, &impedance, &pushed(wrench), 4.0);
    let torque = geometry(&arm.position).joint_torque(&wrench);
    for (joint, torque) in torque.into_iter().enumerate() {
        let off = arm.position[joint] - start()[joint];
        let expected = torque / impedance.stiffness[joint];
        assert!((off - expected).abs() < 2e-6, "{joint}: {off} {expected}");
    }
}

#[test]
fn against_a_wall_two_springs_share_the_depth() {
    let (impedance, here) = (soft(CARTESIAN), geometry(&start()).position);
    let (depth, stiffness) = (0.01, 30_000.0);
    let wall = Wall {
        point: [here[0], here[1], here[2] + depth],
        normal: [0.0, 0.0, 1.0],
        stiffness,
        damping: 50.0,
    };
    let around = Environment {
        wall: Some(wall),
        ..Environment::default()
    };
    let arm = settled(CARTESIAN, &impedance, &around, 4.0);
    let force = around.wrench(&geometry(&arm.position), &[0.0; JOINTS])[2];
    let both = 1.0 / (1.0 / impedance.stiffness[2] + 1.0 / stiffness);
    assert!((force - both * depth).abs() < 1e-3, "{force}");
}

/// Returns the relative overshoot of joint 1 from an initial deflection of 0.01 rad.
fn overshoot(ratio: f64) -> f64 {
    let impedance = ImpedanceSettings {
        damping: [ratio; JOINTS],
        ..soft(JOINT)
    };
    let (goal, mut arm) = (start(), SimulatedArm::new(start(), 80.0));
    arm.position[0] += 0.01;
    let mut beyond = 0.0_f64;
    for _ in 0..2000 {
        let law = control(JOINT, &impedance);
        arm.step_impedance((&goal, &goal), 1e-3, &law, &pushed([0.0; 6]));
        beyond = beyond.max(goal[0] - arm.position[0]);
    }
    beyond / 0.01
}

#[test]
fn the_overshoot_follows_the_damping_ratio() {
    for ratio in [0.1, 0.3, 0.7] {
        let expected = (-std::f64::consts::PI * ratio / f64::sqrt(1.0 - ratio * ratio)).exp();
        let swung = overshoot(ratio);
        assert!(
            (swung - expected).abs() < 0.01,
            "{ratio}: {swung} {expected}"
        );
    }
    assert!(overshoot(1.0) < 1e-3);
}

#[test]
fn a_set_point_at_constant_velocity_is_followed_without_lag() {
    for strategy in [CARTESIAN, JOINT] {
        let (impedance, mut arm) = (soft(strategy), SimulatedArm::new(start(), 80.0));
        let at =
            |time_s: f64| -> Joints { std::array::from_fn(|joint| start()[joint] + 0.1 * time_s) };
        for i in 0..3000 {
            let (from, to) = (f64::from(i) * 1e-3, f64::from(i + 1) * 1e-3);
            let goal = (&at(from), &at(to));
            let law = control(strategy, &impedance);
            arm.step_impedance(goal, 1e-3, &law, &pushed([0.0; 6]));
        }
        for (now, wanted) in arm.position.iter().zip(at(3.0)) {
            assert!((now - wanted).abs() < 1e-3, "{strategy:?}: {now} {wanted}");
        }
        assert!(!arm.is_at_rest());
    }
}

#[test]
fn joint_velocities_stay_bounded_at_a_singularity() {
    // The stretched arm, pushed along its axis and sideways.
    let (goal, mut arm) = ([0.0; JOINTS], SimulatedArm::new([0.0; JOINTS], 80.0));
    let around = pushed([5.0, 3.0, -20.0, 0.0, 0.0, 0.0]);
    for _ in 0..2000 {
        let impedance = soft(CARTESIAN);
        let law = control(CARTESIAN, &impedance);
        arm.step_impedance((&goal, &goal), 1e-3, &law, &around);
        assert!(arm.position.iter().all(|q| q.is_finite()));
    }
    assert!(
        arm.velocity_max.iter().all(|v| *v < 3.0),
        "{:?}",
        arm.velocity_max
    );
}

#[test]
fn the_vector_of_a_rotation_turns_back_by_its_angle() {
    for joint in 0..JOINTS {
        for angle in [1e-12, 1e-3, 0.5, -2.5, 3.1] {
            let mut turned = start();
            turned[joint] += angle;
            let (here, there) = (geometry(&start()), geometry(&turned));
            let [.., rx, ry, rz] = deflection(&here, &there);
            let axis = [3, 4, 5].map(|row| here.jacobian[row][joint]);
            for (found, axis) in [rx, ry, rz].into_iter().zip(axis) {
                assert!((found - axis * angle).abs() < 1e-9, "{joint} {angle}");
            }
        }
    }
}
