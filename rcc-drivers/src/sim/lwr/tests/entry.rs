//! Entry into command state, and following afterwards.
//! Runs in the test harness.

use super::*;
use crate::sim::lwr::fault::MirrorError;

#[test]
fn the_controller_speaks_first_and_is_in_monitor_state() {
    let pc = Pc::new(Settings::default());
    assert_eq!(
        (pc.seen.send_sequence, pc.seen.state),
        (1, SessionState::Monitor)
    );
    assert_eq!(pc.seen.quality, Quality::Unacceptable);
    assert_eq!(pc.seen.power, 0x7f);
}

#[test]
fn command_state_begins_only_when_the_quality_is_ok() {
    let mut pc = Pc::new(Settings::default());
    while pc.state() == SessionState::Monitor {
        assert!(pc.krc.robot.tick < 1000);
        pc.mirror_for(1);
    }
    assert!(pc.seen.quality >= Quality::Ok);
    assert_eq!(pc.seen.commanded_position_offset, [0.0; JOINTS]);
}

#[test]
fn command_state_is_not_entered_unless_the_pc_asks_for_it() {
    for (integer, entered) in [(0, false), (2, false), (7, false), (1, true), (10, true)] {
        let mut pc = Pc::new(Settings::default());
        for _ in 0..300 {
            let mut answer = pc.mirror();
            answer.krl.integers[0] = integer;
            pc.answer(&answer);
        }
        assert_eq!(pc.state() == SessionState::Command, entered, "{integer}");
    }
}

#[test]
fn the_automatic_program_needs_no_request() {
    let mut pc = Pc::new(Settings {
        script: KrlProgram::Auto,
        ..Settings::default()
    });
    for _ in 0..300 {
        let mut answer = pc.mirror();
        answer.krl.integers[0] = 0;
        pc.answer(&answer);
    }
    assert_eq!(pc.state(), SessionState::Command);
}

#[test]
fn command_state_is_not_entered_without_mirroring_flags_or_drives() {
    let refused = |change: fn(&mut CommandDatagram), before: fn(&mut Pc), reason: &str| {
        let mut pc = Pc::new(Settings::default());
        before(&mut pc);
        for _ in 0..400 {
            let mut answer = pc.mirror();
            change(&mut answer);
            pc.answer(&answer);
            assert_eq!(pc.state(), SessionState::Monitor);
        }
        let waiting = pc.krc.monitor_reason.unwrap().to_string();
        assert!(waiting.contains(reason), "{waiting}");
    };
    refused(|answer| answer.joint_position[2] += 0.02, |_| {}, "joint 3");
    refused(|answer| answer.flags = 0, |_| {}, "flags");
    refused(|_| {}, |pc| pc.krc.switch_drives(false), "drives");
    refused(|_| {}, |pc| pc.krc.press_emergency_stop(), "emergency");
}

#[test]
fn a_first_command_elsewhere_brakes_and_leaves_command_state() {
    let mut pc = Pc::new(Settings::default());
    while pc.state() == SessionState::Monitor {
        pc.mirror_for(1);
    }
    let before = pc.krc.robot.desired;
    let mut answer = pc.mirror();
    answer.joint_position[4] += 0.011;
    pc.answer(&answer);
    assert_eq!(pc.state(), SessionState::Monitor);
    assert!(matches!(
        pc.krc.fault,
        Some(KrcFault::Mirror(MirrorError::Joint { joint: 4, .. }))
    ));
    assert_eq!((pc.seen.power, pc.seen.error), (0, 1 << 4));
    assert_eq!(pc.krc.robot.desired, before);
}

#[test]
fn the_arm_follows_what_is_commanded() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    let goal = pc.krc.robot.desired[3] + 0.005;
    // A last step down to rest, then hold.
    for i in 1..=20 {
        let x = f64::from(i) / 20.0;
        pc.command_joint_4(goal - 0.005 + 0.01 * (x - 0.5 * x * x));
    }
    for _ in 0..500 {
        pc.command_joint_4(goal);
    }
    assert_eq!((pc.state(), pc.krc.fault), (SessionState::Command, None));
    assert!((f64::from(pc.seen.measured_position[3]) - goal).abs() < 1e-6);
    assert!(pc.krc.is_at_rest());
}

#[test]
fn a_restarted_pc_may_restart_its_counter_in_monitor_state() {
    let mut pc = Pc::new(Settings::default());
    pc.sequence = 40_000;
    pc.mirror_for(10);
    pc.sequence = 0;
    pc.mirror_for(10);
    assert_eq!(pc.krc.counts.answered, 20);
}
