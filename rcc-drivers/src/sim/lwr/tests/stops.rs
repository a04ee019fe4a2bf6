//! Exit from command state: faults, losses, requests, and the return.
//! Runs in the test harness.

use super::*;

#[test]
fn too_fast_a_command_brakes_and_names_the_joint() {
    let mut pc = Pc::moving(Settings::default(), 2.0);
    let next = pc.krc.robot.desired[3] + 0.003;
    pc.command_joint_4(next);
    assert_eq!(pc.state(), SessionState::Monitor);
    assert!(
        matches!(
            pc.krc.fault,
            Some(KrcFault::Stream(StreamFault::Velocity { joint: 3, .. }))
        ),
        "{:?}",
        pc.krc.fault
    );
    assert!(
        (pc.krc.robot.desired[3] - next).abs() > 0.5e-3,
        "the bad command is not executed"
    );
}

#[test]
fn five_missed_answers_are_bridged_with_the_last_velocity() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    let before = pc.krc.robot.desired[3];
    (0..5).for_each(|_| pc.miss());
    assert_eq!((pc.state(), pc.krc.fault), (SessionState::Command, None));
    assert!((pc.krc.robot.desired[3] - before - 5.0 * 0.5e-3).abs() < 1e-5);
    pc.command_joint_4(before + 6.0 * 0.5e-3);
    assert_eq!((pc.state(), pc.krc.fault), (SessionState::Command, None));
}

#[test]
fn the_sixth_missed_answer_brings_the_arm_to_rest_within_the_limits() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.krc.reset_statistics();
    (0..6).for_each(|_| pc.miss());
    assert_eq!(pc.state(), SessionState::Monitor);
    assert_eq!(pc.krc.fault, Some(KrcFault::Lost { misses: 6 }));
    (0..600).for_each(|_| pc.miss());
    assert!(pc.krc.is_at_rest());
    assert!(
        pc.krc.robot.arm.velocity_max[3] < 0.51,
        "{}",
        pc.krc.robot.arm.velocity_max[3]
    );
    assert!(
        pc.krc.robot.arm.acceleration_max[3] <= 8.0 + 1e-6,
        "{}",
        pc.krc.robot.arm.acceleration_max[3]
    );
}

#[test]
fn after_a_fault_the_script_acknowledges_when_the_arm_has_rested_and_the_pc_mirrors() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    (0..6).for_each(|_| pc.miss());
    let stopped = pc.krc.robot.tick;
    while pc.seen.power == 0 {
        pc.mirror_for(1);
        assert!(pc.krc.robot.tick < stopped + 2000);
    }
    assert!(pc.krc.robot.at_rest_for_s >= 0.5);
    let rest = pc.krc.robot.arm.position;
    pc.mirror_for(300);
    assert_eq!((pc.state(), pc.krc.fault), (SessionState::Command, None));
    assert!((0..JOINTS).all(|joint| (pc.krc.robot.arm.position[joint] - rest[joint]).abs() < 1e-4));
}

#[test]
fn a_fault_of_an_arm_that_has_long_rested_is_shown_for_its_time() {
    let mut pc = Pc::commanding(Settings::default());
    pc.mirror_for(1000);
    assert!(pc.krc.robot.at_rest_for_s > 0.5);
    let jump = pc.position()[3] + 0.1;
    pc.command_joint_4(jump);
    let mut shown = 0;
    while pc.seen.power == 0 {
        assert_eq!((pc.state(), pc.seen.error), (SessionState::Monitor, 1 << 3));
        pc.mirror_for(1);
        shown += 1;
        assert!(shown < 2000);
    }
    assert!(
        (495..505).contains(&shown),
        "acknowledged after {shown} cycles"
    );
    assert_eq!(pc.krc.counts.faults, 1);
}

#[test]
fn with_manual_acknowledgement_only_the_control_port_ends_a_fault() {
    let mut pc = Pc::moving(
        Settings {
            acknowledge: Acknowledge::Manual,
            ..Settings::default()
        },
        0.5,
    );
    (0..6).for_each(|_| pc.miss());
    assert!(
        pc.krc.execute(KrcCommand::Ack).is_err(),
        "the arm still moves"
    );
    pc.mirror_for(2000);
    assert_eq!((pc.state(), pc.seen.power), (SessionState::Monitor, 0));
    pc.execute(r#"{"ack":null}"#);
    pc.mirror_for(2);
    assert_eq!(pc.state(), SessionState::Command);
}

#[test]
fn an_emergency_stop_is_never_acknowledged_by_the_script() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.execute(r#"{"estop":null}"#);
    pc.mirror_for(2000);
    assert_eq!(pc.krc.fault, Some(KrcFault::EmergencyStop));
    assert!(pc.krc.is_at_rest());
    pc.execute(r#"{"ack":null}"#);
    pc.mirror_for(2);
    assert_eq!(pc.state(), SessionState::Command);
}

#[test]
fn the_request_to_end_brings_a_moving_arm_to_rest_without_a_fault() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.krc.reset_statistics();
    let next = pc.krc.robot.desired[3] + 0.5e-3;
    for cycle in 0..600 {
        let mut answer = pc.mirror();
        answer.krl.integers[0] = 2;
        if cycle == 0 {
            answer.joint_position[3] = next as f32;
        }
        pc.answer(&answer);
        assert_eq!((pc.state(), pc.seen.power), (SessionState::Monitor, 0x7f));
    }
    assert!(pc.krc.is_at_rest() && pc.krc.fault.is_none());
    assert!(pc.krc.robot.arm.acceleration_max[3] <= 8.0 + 1e-6);
}

#[test]
fn a_command_that_is_not_finite_is_dropped_in_monitor_state_and_a_fault_in_command_state() {
    let mut pc = Pc::new(Settings::default());
    let mut answer = pc.mirror();
    answer.joint_position[3] = f32::NAN;
    assert!(pc.krc.receive(&answer.encode(), 1e-4).is_err());
    assert_eq!((pc.krc.counts.not_finite, pc.krc.fault), (1, None));
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.command_joint_4(f64::INFINITY);
    assert_eq!(
        pc.krc.fault,
        Some(KrcFault::Stream(StreamFault::NotFinite { joint: 3 }))
    );
}

#[test]
fn flags_that_change_while_commanding_are_a_fault() {
    let mut pc = Pc::commanding(Settings::default());
    let mut answer = pc.mirror();
    answer.flags |= flags::JOINT_STIFFNESS;
    pc.answer(&answer);
    assert!(matches!(
        pc.krc.fault,
        Some(KrcFault::Flags { have: 0x11, .. })
    ));
}

#[test]
fn quality_that_becomes_unacceptable_ends_command_state() {
    let mut pc = Pc::commanding(Settings::default());
    for i in 0..200 {
        if i % 3 == 0 {
            pc.miss()
        } else {
            pc.mirror_for(1)
        }
    }
    assert!(
        matches!(pc.krc.robot.faults[0].code, 2),
        "{:?}",
        pc.krc.robot.faults
    );
}

#[test]
fn a_stall_of_the_machine_is_neither_a_miss_nor_a_jump_and_its_length_is_visible() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    let mut next = pc.krc.robot.desired[3] + 0.5e-3;
    let answer = CommandDatagram {
        joint_position: {
            let mut q = pc.mirror().joint_position;
            q[3] = next as f32;
            q
        },
        ..pc.mirror()
    };
    assert_eq!(pc.krc.receive(&answer.encode(), 1e-4), Ok(()));
    let before = pc.krc.sequence();
    pc.continue_through_stall(9);
    assert_eq!(pc.krc.sequence(), before + 9);
    // The same number of periods has passed for the PC.
    next += 8.0 * 0.5e-3;
    for _ in 0..50 {
        next += 0.5e-3;
        pc.command_joint_4(next);
    }
    assert_eq!(
        (pc.krc.fault, pc.krc.counts.missed, pc.krc.counts.stalls),
        (None, 0, 1)
    );
    assert!((pc.krc.robot.arm.velocity[3] - 0.5).abs() < 1e-3);
}

#[test]
fn in_a_long_stall_time_stands_still() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    let before = pc.krc.sequence();
    pc.continue_through_stall(5000);
    assert_eq!(pc.krc.sequence(), before + 51);
}
