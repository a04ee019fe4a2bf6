//! The simulated controller against a PC that lives in virtual time: a cycle is a step, nobody waits.
//! Runs in the test harness.

use super::control::Command;
use super::fault::Fault;
use super::krc::Krc;
use super::settings::{Acknowledge, Script, Settings, Wire};
use super::{JOINTS, Joints};
use crate::fri_lwr::wire::{CommandDatagram, MeasurementDatagram, Quality, SessionState, flags};

/// A PC that mirrors until told otherwise.
struct Pc {
    krc: Krc,
    seen: MeasurementDatagram,
    sequence: u16,
}

impl Pc {
    fn new(settings: Settings) -> Self {
        let mut krc = Krc::new(settings);
        let first = krc.tick(1).unwrap();
        Self {
            krc,
            seen: MeasurementDatagram::decode(&first).unwrap(),
            sequence: 0,
        }
    }

    /// The answer of a PC that mirrors and asks for command mode.
    fn mirror(&mut self) -> CommandDatagram {
        self.sequence = self.sequence.wrapping_add(1);
        let mut answer = CommandDatagram {
            send_sequence: self.sequence,
            reflected_sequence: self.seen.send_sequence,
            flags: flags::JOINT_POSITION,
            ..CommandDatagram::default()
        };
        answer.krl.integers[0] = 1;
        for joint in 0..JOINTS {
            answer.joint_position[joint] =
                self.seen.commanded_position[joint] + self.seen.commanded_position_offset[joint];
        }
        answer
    }

    /// One cycle with this answer.
    fn answer(&mut self, answer: &CommandDatagram) {
        self.krc.receive(&answer.encode(), 1e-4);
        self.go_on(1);
    }

    /// One cycle without an answer.
    fn miss(&mut self) {
        self.go_on(1);
    }

    fn go_on(&mut self, periods_max: u64) {
        if let Some(bytes) = self.krc.tick(periods_max) {
            self.seen = MeasurementDatagram::decode(&bytes).unwrap();
        }
    }

    fn mirror_for(&mut self, cycles: usize) {
        for _ in 0..cycles {
            let answer = self.mirror();
            self.answer(&answer);
        }
    }

    /// In command state, at rest, having mirrored once.
    fn commanding(settings: Settings) -> Self {
        let mut pc = Self::new(settings);
        pc.mirror_for(200);
        assert_eq!(pc.seen.state, SessionState::Command, "{:?}", pc.krc.waiting);
        pc
    }

    /// Where the controller is, as the PC knows it, rad.
    fn position(&self) -> Joints {
        std::array::from_fn(|joint| {
            f64::from(self.seen.commanded_position[joint])
                + f64::from(self.seen.commanded_position_offset[joint])
        })
    }

    /// One cycle with joint 4 commanded there.
    fn command_joint_4(&mut self, position: f64) {
        let mut answer = self.mirror();
        answer.joint_position[3] = position as f32;
        self.answer(&answer);
    }

    /// Commanding and moving joint 4 with `velocity`, reached smoothly.
    fn moving(settings: Settings, velocity: f64) -> Self {
        let mut pc = Self::commanding(settings);
        let (start, period_s) = (pc.position()[3], pc.krc.settings.period_s);
        let mut way = 0.0;
        for i in 0..400 {
            way += velocity * (f64::from(i) / 200.0).min(1.0) * period_s;
            pc.command_joint_4(start + way);
        }
        assert_eq!(pc.krc.fault, None);
        pc
    }

    fn obey(&mut self, line: &str) {
        let command: Command = serde_json::from_str(line).unwrap();
        self.krc.obey(command).unwrap();
    }

    fn state(&self) -> SessionState {
        self.seen.state
    }
}

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
        assert!(pc.krc.tick < 1000);
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
fn the_automatic_script_does_not_need_to_be_asked() {
    let mut pc = Pc::new(Settings {
        script: Script::Auto,
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
        let waiting = pc.krc.waiting.unwrap().to_string();
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
    let before = pc.krc.desired;
    let mut answer = pc.mirror();
    answer.joint_position[4] += 0.011;
    pc.answer(&answer);
    assert_eq!(pc.state(), SessionState::Monitor);
    assert!(matches!(pc.krc.fault, Some(Fault::Mirror { joint: 4, .. })));
    assert_eq!((pc.seen.power, pc.seen.error), (0, 1 << 4));
    assert_eq!(pc.krc.desired, before);
}

#[test]
fn the_arm_follows_what_is_commanded() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    let goal = pc.krc.desired[3] + 0.005;
    // a last step down to rest, then hold
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
fn too_fast_a_command_brakes_and_names_the_joint() {
    let mut pc = Pc::moving(Settings::default(), 2.0);
    let next = pc.krc.desired[3] + 0.003;
    pc.command_joint_4(next);
    assert_eq!(pc.state(), SessionState::Monitor);
    assert!(
        matches!(pc.krc.fault, Some(Fault::Velocity { joint: 3, .. })),
        "{:?}",
        pc.krc.fault
    );
    assert!(
        (pc.krc.desired[3] - next).abs() > 0.5e-3,
        "the bad command is not executed"
    );
}

#[test]
fn five_missed_answers_are_bridged_with_the_last_velocity() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    let before = pc.krc.desired[3];
    (0..5).for_each(|_| pc.miss());
    assert_eq!((pc.state(), pc.krc.fault), (SessionState::Command, None));
    assert!((pc.krc.desired[3] - before - 5.0 * 0.5e-3).abs() < 1e-5);
    pc.command_joint_4(before + 6.0 * 0.5e-3);
    assert_eq!((pc.state(), pc.krc.fault), (SessionState::Command, None));
}

#[test]
fn the_sixth_missed_answer_brings_the_arm_to_rest_within_the_limits() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.krc.reset_statistics();
    (0..6).for_each(|_| pc.miss());
    assert_eq!(pc.state(), SessionState::Monitor);
    assert_eq!(pc.krc.fault, Some(Fault::Lost { misses: 6 }));
    (0..600).for_each(|_| pc.miss());
    assert!(pc.krc.is_at_rest());
    assert!(
        pc.krc.arm.velocity_max[3] < 0.51,
        "{}",
        pc.krc.arm.velocity_max[3]
    );
    assert!(
        pc.krc.arm.acceleration_max[3] <= 8.0 + 1e-6,
        "{}",
        pc.krc.arm.acceleration_max[3]
    );
}

#[test]
fn after_a_fault_the_script_acknowledges_when_the_arm_has_rested_and_the_pc_mirrors() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    (0..6).for_each(|_| pc.miss());
    let stopped = pc.krc.tick;
    while pc.seen.power == 0 {
        pc.mirror_for(1);
        assert!(pc.krc.tick < stopped + 2000);
    }
    assert!(pc.krc.at_rest_for_s >= 0.5);
    let rest = pc.krc.arm.position;
    pc.mirror_for(300);
    assert_eq!((pc.state(), pc.krc.fault), (SessionState::Command, None));
    assert!((0..JOINTS).all(|joint| (pc.krc.arm.position[joint] - rest[joint]).abs() < 1e-4));
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
    assert!(pc.krc.obey(Command::Ack).is_err(), "the arm still moves");
    pc.mirror_for(2000);
    assert_eq!((pc.state(), pc.seen.power), (SessionState::Monitor, 0));
    pc.obey(r#"{"ack":null}"#);
    pc.mirror_for(2);
    assert_eq!(pc.state(), SessionState::Command);
}

#[test]
fn an_emergency_stop_is_never_acknowledged_by_the_script() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.obey(r#"{"estop":null}"#);
    pc.mirror_for(2000);
    assert_eq!(pc.krc.fault, Some(Fault::EmergencyStop));
    assert!(pc.krc.is_at_rest());
    pc.obey(r#"{"ack":null}"#);
    pc.mirror_for(2);
    assert_eq!(pc.state(), SessionState::Command);
}

#[test]
fn the_request_to_end_brings_a_moving_arm_to_rest_without_a_fault() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.krc.reset_statistics();
    let next = pc.krc.desired[3] + 0.5e-3;
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
    assert!(pc.krc.arm.acceleration_max[3] <= 8.0 + 1e-6);
}

#[test]
fn wrong_datagrams_are_counted_and_change_nothing() {
    let mut pc = Pc::commanding(Settings::default());
    let good = pc.mirror();
    let good_bytes = good.encode();
    pc.krc.receive(&good_bytes[..375], 1e-4);
    let mut other_id = good_bytes;
    other_id[6] ^= 1;
    pc.krc.receive(&other_id, 1e-4);
    let late = CommandDatagram {
        reflected_sequence: good.reflected_sequence.wrapping_sub(1),
        ..good
    };
    pc.krc.receive(&late.encode(), 1e-4);
    let backward = CommandDatagram {
        send_sequence: good.send_sequence.wrapping_sub(9),
        ..good
    };
    pc.krc.receive(&backward.encode(), 1e-4);
    pc.krc.receive(&good_bytes, 1e-4);
    pc.krc.receive(&good_bytes, 1e-4);
    pc.krc.receive_foreign();
    pc.go_on(1);
    let counts = pc.krc.counts;
    assert_eq!(
        (
            counts.wrong_size,
            counts.wrong_identity,
            counts.late,
            counts.duplicate,
            counts.foreign
        ),
        (1, 1, 1, 2, 1)
    );
    assert_eq!(
        (pc.state(), pc.krc.fault, counts.missed),
        (SessionState::Command, None, 0)
    );
}

#[test]
fn a_command_that_is_no_number_is_dropped_while_monitoring_and_a_fault_while_commanding() {
    let mut pc = Pc::new(Settings::default());
    pc.command_joint_4(f64::NAN);
    assert_eq!((pc.krc.counts.not_finite, pc.krc.fault), (1, None));
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.command_joint_4(f64::INFINITY);
    assert_eq!(pc.krc.fault, Some(Fault::NotFinite { joint: 3 }));
}

#[test]
fn flags_that_change_while_commanding_are_a_fault() {
    let mut pc = Pc::commanding(Settings::default());
    let mut answer = pc.mirror();
    answer.flags |= flags::JOINT_STIFFNESS;
    pc.answer(&answer);
    assert!(matches!(
        pc.krc.fault,
        Some(Fault::Flags { have: 0x11, .. })
    ));
}

#[test]
fn a_pc_that_was_started_again_may_count_from_anew_while_monitoring() {
    let mut pc = Pc::new(Settings::default());
    pc.sequence = 40_000;
    pc.mirror_for(10);
    pc.sequence = 0;
    pc.mirror_for(10);
    assert_eq!(pc.krc.counts.answered, 20);
}

#[test]
fn the_counters_wrap_without_a_miss() {
    let mut pc = Pc::new(Settings::default());
    pc.sequence = 65_000;
    pc.mirror_for(66_000);
    assert_eq!((pc.krc.counts.missed, pc.krc.counts.faults), (0, 0));
    assert_eq!(pc.state(), SessionState::Command);
    assert_eq!(pc.seen.send_sequence, 66_001_u32 as u16);
    assert_eq!(pc.seen.reflected_sequence, pc.sequence);
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
    assert!(matches!(pc.krc.faults[0].code, 2), "{:?}", pc.krc.faults);
}

#[test]
fn a_stall_of_the_machine_is_neither_a_miss_nor_a_jump() {
    for passed in [1.0, 9.0] {
        let mut pc = Pc::moving(Settings::default(), 0.5);
        let mut next = pc.krc.desired[3] + passed * 0.5e-3;
        let answer = CommandDatagram {
            joint_position: {
                let mut q = pc.mirror().joint_position;
                q[3] = next as f32;
                q
            },
            ..pc.mirror()
        };
        pc.krc.receive(&answer.encode(), 1e-4);
        pc.go_on(9);
        for _ in 0..50 {
            next += 0.5e-3;
            pc.command_joint_4(next);
        }
        assert_eq!(
            (pc.krc.fault, pc.krc.counts.missed, pc.krc.counts.stalls),
            (None, 0, 1)
        );
        assert!((pc.krc.arm.velocity[3] - 0.5).abs() < 1e-3);
    }
}

#[test]
fn a_wall_pushes_the_tool_and_is_sent_in_kukas_order() {
    let mut pc = Pc::new(Settings::default());
    let [x, y, z] = pc.krc.geometry.position;
    pc.obey(&format!(
        r#"{{"wall":{{"point":[{x},{y},{}],"normal":[0,0,1],"stiffness":5000}}}}"#,
        z + 0.002
    ));
    pc.mirror_for(1);
    assert!((pc.seen.external_tcp_wrench[2] - 10.0).abs() < 1e-3);
    pc.obey(r#"{"wall":null}"#);
    pc.obey(r#"{"wrench":{"force":[1,2,3],"torque":[4,5,6]}}"#);
    pc.mirror_for(1);
    assert_eq!(pc.seen.external_tcp_wrench, [1.0, 2.0, 3.0, 6.0, 5.0, 4.0]);
    let power: f64 = pc
        .krc
        .geometry
        .joint_torque(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])[0];
    assert!((f64::from(pc.seen.external_torque[0]) - power).abs() < 1e-5);
}

#[test]
fn krl_variables_are_latched_and_wired_back() {
    let wires = Settings {
        boolean_wires: vec![Wire { from: 1, to: 3 }],
        real_wires: vec![Wire { from: 16, to: 2 }],
        ..Settings::default()
    };
    let mut pc = Pc::new(wires);
    let mut answer = pc.mirror();
    answer.krl.set_boolean(1, true);
    answer.krl.reals[15] = 2.5;
    pc.answer(&answer);
    pc.miss();
    assert_eq!(
        (pc.seen.krl.boolean(3), pc.seen.krl.reals[1]),
        (Some(true), 2.5)
    );
    assert_eq!(pc.krc.from_pc.boolean(1), Some(true));
    pc.obey(r#"{"set_bool":{"number":5,"value":true}}"#);
    pc.mirror_for(1);
    assert_eq!(
        (pc.seen.krl.boolean(5), pc.seen.krl.boolean(3)),
        (Some(true), Some(false))
    );
}

#[test]
fn a_withheld_datagram_is_not_sent_and_its_answer_is_missed() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.obey(r#"{"freeze_ms":20}"#);
    let sent = pc.krc.counts.sent;
    (0..20).for_each(|_| pc.miss());
    assert_eq!((pc.krc.counts.sent, pc.krc.counts.withheld), (sent, 20));
    assert_eq!(pc.krc.fault, Some(Fault::Lost { misses: 6 }));
    pc.miss();
    assert_eq!(pc.krc.counts.sent, sent + 1);
}

#[test]
fn dropped_answers_count_as_missed() {
    let mut pc = Pc::new(Settings::default());
    pc.obey(r#"{"drop":{"percent":25}}"#);
    pc.mirror_for(4000);
    let counts = pc.krc.counts;
    assert_eq!(counts.dropped, counts.missed);
    assert!((800..1200).contains(&counts.dropped), "{}", counts.dropped);
}

#[test]
fn the_record_of_a_cycle_pairs_what_was_measured_with_the_answer_to_it() {
    let mut pc = Pc::commanding(Settings::default());
    let mut answer = pc.mirror();
    answer.krl.booleans = 0x21;
    let seen = pc.seen;
    pc.answer(&answer);
    let record = pc.krc.exchanged().unwrap();
    assert_eq!(
        (
            record.sequence,
            record.booleans,
            record.state,
            record.answered
        ),
        (seen.send_sequence, 0x21, 2, true)
    );
    assert_eq!(record.commanded, answer.joint_position);
    assert_eq!(record.measured.map(|q| q as f32), seen.measured_position);
    pc.miss();
    let record = pc.krc.exchanged().unwrap();
    assert!(!record.answered && record.commanded[0].is_nan() && record.booleans == 0x21);
}

#[test]
fn a_program_that_ends_says_so_and_closes() {
    let mut pc = Pc::commanding(Settings::default());
    pc.obey(r#"{"quit":null}"#);
    pc.mirror_for(1);
    assert_eq!(
        (pc.seen.krl.integers[0], pc.state()),
        (-1, SessionState::Monitor)
    );
    pc.mirror_for(30);
    assert!(pc.krc.is_closed());
}
