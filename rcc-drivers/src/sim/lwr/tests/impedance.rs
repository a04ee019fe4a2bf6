//! Impedance control seen from a client: flags, entry, ranges, measured values.
//! Runs in the test harness.

use super::*;
use crate::sim::arm::impedance::ImpedanceSettings;

pub(super) fn settings(strategy: ControlLaw) -> Settings {
    Settings {
        strategy,
        ..Settings::default()
    }
}

impl Pc {
    /// As [`Pc::mirror`], with all fields of the strategy.
    pub(super) fn soft(&mut self) -> CommandDatagram {
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

    pub(super) fn soft_for(&mut self, cycles: usize, change: impl Fn(&mut CommandDatagram)) {
        for _ in 0..cycles {
            let mut answer = self.soft();
            change(&mut answer);
            self.answer(&answer);
        }
    }

    pub(super) fn soft_commanding(strategy: ControlLaw) -> Self {
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

pub(super) const SOFT: [ControlLaw; 2] =
    [ControlLaw::CartesianImpedance, ControlLaw::JointImpedance];

#[test]
fn the_strategy_is_reported_and_its_flags_stay_as_they_were_at_the_entry() {
    for (strategy, number) in SOFT.into_iter().zip([2, 3]) {
        let pc = Pc::soft_commanding(strategy);
        assert_eq!(pc.seen.control as u16, number);
        let mut pc = Pc::soft_commanding(strategy);
        pc.soft_for(1, |answer| answer.flags = flags::JOINT_POSITION);
        assert_eq!(pc.krc.fault.map(|fault| fault.code()), Some(8));
    }
}

/// Clients that take part of a strategy: KUKA's second sample, the Stanford library's Cartesian mode, the predecessor of this
/// project, and torques or springs alone.
const SUBSETS: [(ControlLaw, u32); 8] = [
    (SOFT[0], 0x0000),
    (SOFT[1], 0x0001),
    (SOFT[0], 0x0500),
    (SOFT[0], 0x3500),
    (SOFT[0], 0x3001),
    (SOFT[0], 0x0001),
    (SOFT[1], 0x0015),
    (SOFT[1], 0x0034),
];

#[test]
fn a_subset_of_the_flags_is_taken_and_the_rest_is_the_controllers_own() {
    for (strategy, subset) in SUBSETS {
        let mut pc = Pc::new(settings(strategy));
        // Fields that the flags do not select are not read: NaN there is accepted.
        let unread = |answer: &mut CommandDatagram| {
            answer.flags = subset;
            let unselected = |flag: u32| subset & flag == 0;
            if unselected(flags::JOINT_POSITION) {
                answer.joint_position = [f32::NAN; JOINTS];
            }
            if unselected(flags::CARTESIAN_POSITION) {
                answer.cartesian_position = [7.0; 12];
            }
            if unselected(flags::JOINT_STIFFNESS) {
                answer.joint_stiffness = [-1.0; JOINTS];
            }
            if unselected(flags::CARTESIAN_STIFFNESS) {
                answer.cartesian_stiffness = [f32::INFINITY; 6];
            }
            if unselected(flags::JOINT_DAMPING) {
                answer.joint_damping = [9.0; JOINTS];
            }
            if unselected(flags::CARTESIAN_DAMPING) {
                answer.cartesian_damping = [9.0; 6];
            }
        };
        pc.soft_for(400, unread);
        let reason = pc.krc.monitor_reason;
        assert_eq!(
            pc.state(),
            SessionState::Command,
            "{subset:#06x} {reason:?}"
        );
        assert_eq!(pc.krc.fault, None, "{subset:#06x}");
        let usual = ImpedanceSettings::default_for(strategy);
        assert_eq!(pc.krc.robot.impedance.stiffness[0], usual.stiffness[0]);
        assert!((pc.krc.robot.impedance.damping[5] - usual.damping[5]).abs() < 1e-6);
    }
}

#[test]
fn no_flags_and_flags_of_another_strategy_are_waited_for() {
    let foreign = [
        (ControlLaw::Position, 0),
        (SOFT[0], 0x0011),
        (SOFT[1], 0x0101),
        (ControlLaw::Position, 0x0003),
        (ControlLaw::Position, 0x0005),
    ];
    for (strategy, subset) in foreign {
        let mut pc = Pc::new(settings(strategy));
        pc.soft_for(300, |answer| answer.flags = subset);
        assert_eq!(pc.state(), SessionState::Monitor);
        let waiting = pc.krc.monitor_reason.expect("flags").to_string();
        let words = format!("command flags are {subset:#06x}");
        assert!(waiting.contains(&words), "{waiting}");
    }
}

#[test]
fn a_pose_alone_moves_the_flange_and_must_be_mirrored_and_within_reach() {
    let subset = 0x3500;
    let mut pc = Pc::new(settings(SOFT[0]));
    pc.soft_for(300, |answer| {
        answer.flags = subset;
        answer.cartesian_position[7] += 0.002;
    });
    assert_eq!(pc.state(), SessionState::Monitor);
    let waiting = pc.krc.monitor_reason.expect("a mirror").to_string();
    assert!(waiting.contains("pose is 0.002"), "{waiting}");
    pc.soft_for(200, |answer| answer.flags = subset);
    assert_eq!(pc.state(), SessionState::Command);
    let start = pc.seen.commanded_pose;
    let moved = |answer: &mut CommandDatagram, way: f32| {
        answer.flags = subset;
        answer.cartesian_position = start;
        answer.cartesian_position[7] += way;
    };
    for step in 1..=400_u16 {
        let part = f32::from(step) / 400.0;
        let smooth = part * part * (3.0 - 2.0 * part);
        pc.soft_for(1, |answer| moved(answer, 0.02 * smooth));
    }
    pc.soft_for(1500, |answer| moved(answer, 0.02));
    assert_eq!(pc.krc.fault, None);
    let off = pc.seen.measured_pose[7] - start[7];
    assert!((off - 0.02).abs() < 1e-5, "{off}");
    let turned = pc.seen.measured_pose[0] - start[0];
    assert!(turned.abs() < 1e-5, "the orientation stays: {turned}");
    pc.soft_for(1, |answer| moved(answer, 5.0));
    assert!(
        matches!(pc.krc.fault, Some(KrcFault::Unreachable { .. })),
        "{:?}",
        pc.krc.fault
    );
}

#[test]
fn a_rotation_that_is_none_is_a_fault() {
    let mut pc = Pc::soft_commanding(SOFT[0]);
    pc.soft_for(1, |answer| answer.cartesian_position[0] *= 1.01);
    assert_eq!(pc.krc.fault, Some(KrcFault::Rotation));
}

#[test]
fn without_stiffness_and_damping_a_torque_moves_the_arm_until_it_would_run_away() {
    let mut pc = Pc::new(settings(SOFT[1]));
    let limp = |answer: &mut CommandDatagram| {
        answer.joint_stiffness = [0.0; JOINTS];
        answer.joint_damping = [0.0; JOINTS];
    };
    pc.soft_for(300, limp);
    assert_eq!(pc.state(), SessionState::Command);
    let before = pc.krc.robot.arm.position;
    pc.soft_for(500, limp);
    let drift = (0..JOINTS).map(|joint| (pc.krc.robot.arm.position[joint] - before[joint]).abs());
    assert!(drift.fold(0.0, f64::max) < 1e-6, "no force, no motion");
    pc.soft_for(200, |answer| {
        limp(answer);
        answer.additional_joint_torque[6] = 0.2;
    });
    let moved = pc.krc.robot.arm.position[6] - before[6];
    assert!(moved > 1e-3 && pc.krc.fault.is_none(), "{moved}");
    pc.soft_for(3000, |answer| {
        limp(answer);
        answer.additional_joint_torque[6] = 5.0;
    });
    let faults: Vec<i32> = pc.krc.robot.faults.iter().map(|fault| fault.code).collect();
    assert_eq!(faults.first(), Some(&14), "{:?}", pc.krc.robot.faults);
    // The brakes hold the arm where it is: its springs do not pull it back to where it was commanded.
    assert!((pc.krc.robot.arm.position[6] - before[6]).abs() > 0.1);
}

#[test]
fn a_stiffness_or_damping_outside_the_krl_range_is_a_fault() {
    type Change = fn(&mut CommandDatagram);
    let bad: [(ControlLaw, Change); 7] = [
        (SOFT[0], |answer| answer.cartesian_stiffness[2] = 5001.0),
        (SOFT[0], |answer| answer.cartesian_stiffness[3] = 301.0),
        (SOFT[0], |answer| answer.cartesian_stiffness[0] = -1.0),
        (SOFT[0], |answer| answer.cartesian_damping[5] = 1.1),
        (SOFT[0], |answer| answer.additional_tcp_wrench[1] = f32::NAN),
        (SOFT[1], |answer| answer.joint_stiffness[6] = 2001.0),
        (SOFT[1], |answer| answer.joint_damping[0] = -0.05),
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
        let mut pc = Pc::soft_commanding(ControlLaw::CartesianImpedance);
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
        assert!(pc.krc.robot.faults.iter().any(|fault| fault.code == 13));
    }
}

#[test]
fn the_arm_yields_and_the_commanded_position_is_reported_unchanged() {
    let mut pc = Pc::soft_commanding(ControlLaw::CartesianImpedance);
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
