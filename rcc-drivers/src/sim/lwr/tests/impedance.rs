//! Impedance control seen from a client: flags, entry, ranges, measured values.
//! Runs in the test harness.

use super::*;
use crate::sim::lwr::impedance::ImpedanceSettings;
use crate::sim::lwr::settings::KrlStrategy;

fn settings(strategy: KrlStrategy) -> Settings {
    Settings {
        strategy,
        ..Settings::default()
    }
}

impl Pc {
    /// As [`Pc::mirror`], with all fields of the strategy.
    fn soft(&mut self) -> CommandDatagram {
        let strategy = self.krc.settings.strategy;
        let usual = ImpedanceSettings::default_for(strategy);
        let narrow = |value: f64| value as f32;
        let [x, y, z, a, b, c, _] = usual.stiffness.map(narrow);
        CommandDatagram {
            flags: strategy.flags(),
            cartesian_position: self.seen.commanded_pose,
            cartesian_stiffness: [x, y, z, a, b, c],
            cartesian_damping: [0.7; 6],
            joint_stiffness: [1000.0; JOINTS],
            joint_damping: [0.7; JOINTS],
            ..self.mirror()
        }
    }

    fn soft_for(&mut self, cycles: usize, change: impl Fn(&mut CommandDatagram)) {
        for _ in 0..cycles {
            let mut answer = self.soft();
            change(&mut answer);
            self.answer(&answer);
        }
    }

    fn soft_commanding(strategy: KrlStrategy) -> Self {
        let mut pc = Self::new(settings(strategy));
        pc.soft_for(200, |_| {});
        assert_eq!(
            pc.seen.state,
            SessionState::Command,
            "{:?}",
            pc.krc.monitor_reason
        );
        pc
    }
}

const SOFT: [KrlStrategy; 2] = [KrlStrategy::CartesianImpedance, KrlStrategy::JointImpedance];

#[test]
fn the_strategy_is_reported_and_its_flags_are_required() {
    for (strategy, number) in SOFT.into_iter().zip([2, 3]) {
        let pc = Pc::soft_commanding(strategy);
        assert_eq!(pc.seen.control as u16, number);
        let mut pc = Pc::new(settings(strategy));
        pc.mirror_for(300);
        assert_eq!(pc.state(), SessionState::Monitor);
        let waiting = pc.krc.monitor_reason.expect("flags").to_string();
        assert!(waiting.contains("command flags are 0x0001"), "{waiting}");
        let mut pc = Pc::soft_commanding(strategy);
        pc.soft_for(1, |answer| answer.flags = flags::JOINT_POSITION);
        assert_eq!(pc.krc.fault.map(|fault| fault.code()), Some(8));
    }
}

#[test]
fn a_stiffness_or_damping_outside_the_krl_range_is_a_fault() {
    type Change = fn(&mut CommandDatagram);
    let bad: [(KrlStrategy, Change); 7] = [
        (SOFT[0], |answer| answer.cartesian_stiffness[2] = 5001.0),
        (SOFT[0], |answer| answer.cartesian_stiffness[3] = 301.0),
        (SOFT[0], |answer| answer.cartesian_stiffness[0] = 0.0),
        (SOFT[0], |answer| answer.cartesian_damping[5] = 1.1),
        (SOFT[0], |answer| answer.additional_tcp_wrench[1] = f32::NAN),
        (SOFT[1], |answer| answer.joint_stiffness[6] = 2001.0),
        (SOFT[1], |answer| answer.joint_damping[0] = 0.05),
    ];
    for (strategy, change) in bad {
        let mut pc = Pc::soft_commanding(strategy);
        pc.soft_for(1, change);
        assert_eq!(pc.krc.fault.map(|fault| fault.code()), Some(11));
    }
}

#[test]
fn a_pose_that_does_not_match_the_joint_positions_is_a_fault() {
    for element in [3, 7, 11] {
        let mut pc = Pc::soft_commanding(KrlStrategy::CartesianImpedance);
        pc.soft_for(1, |answer| answer.cartesian_position[element] += 0.1);
        assert_eq!(
            pc.krc.fault.map(|fault| fault.code()),
            Some(12),
            "{element}"
        );
    }
}

#[test]
fn an_added_force_at_the_entry_is_a_fault() {
    for strategy in SOFT {
        let mut pc = Pc::new(settings(strategy));
        pc.soft_for(200, |answer| {
            answer.additional_tcp_wrench[2] = 1.5;
            answer.additional_joint_torque[2] = 1.5;
        });
        assert!(pc.krc.faults.iter().any(|fault| fault.code == 13));
    }
}

#[test]
fn the_arm_yields_and_the_commanded_position_is_reported_unchanged() {
    let mut pc = Pc::soft_commanding(KrlStrategy::CartesianImpedance);
    let pose = pc.seen.measured_pose;
    pc.execute(r#"{"wrench":{"force":[0,10,0],"torque":[0,0,0]}}"#);
    pc.soft_for(3000, |answer| answer.cartesian_stiffness[1] = 500.0);
    assert_eq!(pc.krc.fault, None);
    let (measured, commanded) = (pc.seen.measured_pose, pc.seen.commanded_pose);
    assert!((measured[7] - pose[7] - 0.02).abs() < 1e-5);
    assert_eq!(commanded[7], pose[7]);
    // After the end of the program, $STIFFNESS applies: 10 N over 2000 N/m.
    pc.soft_for(3000, |answer| {
        answer.cartesian_stiffness[1] = 500.0;
        answer.krl.integers[0] = 2;
    });
    assert_eq!(pc.state(), SessionState::Monitor);
    assert!((pc.seen.measured_pose[7] - pose[7] - 0.005).abs() < 1e-5);
}
