//! The state machine row by row, and the motion of the axis.
//! Test code only.

use super::*;
use DriveState::{
    Fault, FaultReactionActive, OperationEnabled, QuickStopActive, ReadyToSwitchOn,
    SwitchOnDisabled, SwitchedOn,
};

const MS: Duration = Duration::from_millis(1);

fn settings() -> DriveSettings {
    DriveSettings {
        mode: CYCLIC_POSITION,
        following_window: 1000,
        following_timeout: 5 * MS,
        quick_stop_deceleration: 1_000_000,
        speed_max: 500_000,
        interpolation_s: 1e-3,
    }
}

/// An axis that is enabled, at 0.
fn enabled() -> Drive {
    let mut drive = Drive::new(0);
    for word in [0x06, 0x07, 0x0f] {
        drive.command(word, 0, &settings());
    }
    assert_eq!(drive.state(), OperationEnabled);
    drive
}

/// Moves the target by 100 counts in each of these milliseconds.
fn run(drive: &mut Drive, from: u32, until: u32) {
    for at in from..until {
        drive.command(0x0f, (at * 100) as i32, &settings());
        drive.advance(at * MS, &settings());
    }
}

#[test]
fn every_command_leads_where_cia_402_says() {
    for (from, word, to) in [
        (SwitchOnDisabled, 0x06, ReadyToSwitchOn),
        (SwitchOnDisabled, 0x0f, SwitchOnDisabled),
        (ReadyToSwitchOn, 0x07, SwitchedOn),
        (ReadyToSwitchOn, 0x0f, SwitchedOn),
        (ReadyToSwitchOn, 0x00, SwitchOnDisabled),
        (ReadyToSwitchOn, 0x02, SwitchOnDisabled),
        (SwitchedOn, 0x0f, OperationEnabled),
        (SwitchedOn, 0x06, ReadyToSwitchOn),
        (SwitchedOn, 0x02, SwitchOnDisabled),
        (OperationEnabled, 0x07, SwitchedOn),
        (OperationEnabled, 0x06, ReadyToSwitchOn),
        (OperationEnabled, 0x02, QuickStopActive),
        (OperationEnabled, 0x00, SwitchOnDisabled),
        (QuickStopActive, 0x0f, QuickStopActive),
        (QuickStopActive, 0x00, SwitchOnDisabled),
        (FaultReactionActive, 0x80, FaultReactionActive),
        (Fault, 0x0f, Fault),
        (Fault, 0x80, SwitchOnDisabled),
    ] {
        let mut drive = Drive {
            state: from,
            ..Drive::new(0)
        };
        drive.command(word, 0, &settings());
        assert_eq!(drive.state(), to, "{from:?}, {word:#04x}");
    }
}

#[test]
fn a_fault_is_reset_by_an_edge_only() {
    let mut drive = Drive::new(0);
    drive.command(0x80, 0, &settings());
    drive.fail(0x2310);
    drive.command(0x80, 0, &settings());
    assert_eq!((drive.state(), drive.error()), (Fault, 0x2310));
    drive.command(0x00, 0, &settings());
    drive.command(0x80, 0, &settings());
    assert_eq!((drive.state(), drive.error()), (SwitchOnDisabled, 0));
}

#[test]
fn only_cyclic_synchronous_position_is_enabled() {
    let other = DriveSettings {
        mode: 0,
        ..settings()
    };
    let mut drive = Drive::new(0);
    for word in [0x06, 0x07, 0x0f] {
        drive.command(word, 0, &other);
    }
    assert_eq!(drive.state(), SwitchedOn);
}

#[test]
fn the_axis_follows_its_target_at_a_bounded_speed() {
    let mut drive = enabled();
    run(&mut drive, 1, 100);
    assert_eq!(drive.position(), 9900);
    drive.command(0x0f, 10_700, &settings());
    drive.advance(100 * MS, &settings());
    assert_eq!(drive.position(), 10_400, "500 counts in 1 ms");
}

#[test]
fn a_quick_stop_brakes_by_its_ramp_and_switches_off() {
    let mut drive = enabled();
    run(&mut drive, 1, 100);
    drive.command(0x02, 9900, &settings());
    assert_eq!(drive.statusword() & 0x6f, 0x07);
    // 100,000 counts/s, 1,000,000 counts/s²: 0.1 s and 5000 counts.
    drive.advance(150 * MS, &settings());
    assert_eq!(drive.state(), QuickStopActive);
    drive.advance(300 * MS, &settings());
    assert_eq!(drive.state(), SwitchOnDisabled);
    assert!(
        (drive.position() - 14_900).abs() < 60,
        "{}",
        drive.position()
    );
}

#[test]
fn a_blocked_motor_is_a_fault_after_the_time_out() {
    let mut drive = enabled();
    drive.blocked = true;
    run(&mut drive, 1, 16);
    assert_eq!(drive.state(), OperationEnabled);
    run(&mut drive, 16, 20);
    assert_eq!((drive.state(), drive.error()), (Fault, error::FOLLOWING));
    assert_eq!(drive.statusword() & 0x204f, 0x2008);
}

#[test]
fn lost_communication_brakes_an_enabled_axis_and_is_a_fault() {
    let mut drive = enabled();
    run(&mut drive, 1, 100);
    drive.lose_communication();
    assert_eq!(drive.state(), FaultReactionActive);
    drive.advance(400 * MS, &settings());
    assert_eq!(
        (drive.state(), drive.error()),
        (Fault, error::COMMUNICATION)
    );
    let mut drive = Drive::new(0);
    drive.lose_communication();
    assert_eq!((drive.state(), drive.error()), (SwitchOnDisabled, 0));
}

/// Between two targets, too, the axis has the speed of the motion: time passes in parts of a millisecond.
#[test]
fn communication_lost_just_after_a_target_brakes_from_the_speed_of_the_motion() {
    let mut drive = enabled();
    run(&mut drive, 1, 100);
    drive.command(0x0f, 10_000, &settings());
    drive.advance(99 * MS + MS / 100, &settings());
    drive.lose_communication();
    drive.advance(400 * MS, &settings());
    assert_eq!(drive.state(), Fault);
    // 100,000 counts/s, 1,000,000 counts/s²: 5000 counts.
    let ramp = drive.position() - 9_901;
    assert!((ramp - 5000).abs() < 60, "{ramp}");
}

#[test]
fn safe_torque_off_prevents_switching_on() {
    let mut drive = enabled();
    drive.set_torque_off(true);
    drive.command(0x0f, 0, &settings());
    drive.command(0x06, 0, &settings());
    assert_eq!(drive.state(), SwitchOnDisabled);
    drive.set_torque_off(false);
    drive.command(0x06, 0, &settings());
    assert_eq!(drive.state(), ReadyToSwitchOn);
}
