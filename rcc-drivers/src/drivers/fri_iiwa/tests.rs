//! The dialogue without a socket: what is answered in which state, version by version.

mod overlays;
mod walls;

use rcc_config::DeviceConfig;
use rcc_core::message::JOINTS_MAX;
use rcc_core::primitive::ChannelKind;

use super::session::{IiwaSession, SessionSettings};
use super::*;
use crate::fri_iiwa::wire::schema::{
    Command, Connection, Header, Interpolator, JointValues, MonitorData, Monitoring, Redundancy,
    Robot,
};
use crate::fri_iiwa::wire::{COMMAND_ID, JOINTS, MONITORING_ID, decode, encode};

const OWN: f64 = 0.25;
const VERSIONS: [Version; 4] = [Version::V1_11, Version::V1_14, Version::V2_5, Version::V2_7];
/// Session states as on the wire.
const IDLE_STATE: i32 = 0;
const MONITORING_READY: i32 = 2;
const COMMANDING_WAIT: i32 = 3;
const COMMANDING_ACTIVE: i32 = 4;

fn arm() -> DeviceConfig {
    let mut device = rcc_driver_kit::conformance::rules::some_robot();
    device.channels.clear();
    device
}

fn session(version: Version) -> IiwaSession {
    session_of(&arm(), version)
}

fn session_of(device: &DeviceConfig, version: Version) -> IiwaSession {
    let quality_min = Quality::Good;
    let settings = SessionSettings {
        version,
        quality_min,
    };
    IiwaSession::new(device, settings).expect("an arm with 7 joints")
}

fn all(value: f64) -> Option<JointValues> {
    Some(JointValues {
        value: vec![value; JOINTS],
    })
}

fn message(sequence: u32, session: i32) -> Monitoring {
    Monitoring {
        header: Some(Header {
            identifier: Some(MONITORING_ID),
            sequence: Some(sequence),
            reflected: Some(0),
        }),
        robot: Some(Robot {
            joints: Some(7),
            safety: Some(0),
            drives: vec![2; JOINTS],
            operation: Some(2),
            control: Some(0),
        }),
        data: Some(MonitorData {
            measured_position: all(0.2),
            commanded_position: all(OWN),
            ..MonitorData::default()
        }),
        connection: Some(Connection {
            session: Some(session),
            quality: Some(3),
            send_period_ms: Some(5),
            receive_multiplier: Some(1),
        }),
        interpolator: (session >= COMMANDING_WAIT).then(|| Interpolator {
            position: all(OWN),
            command_mode: Some(1),
            overlay: Some(1),
            ..Interpolator::default()
        }),
        ..Monitoring::default()
    }
}

/// Accepts a message and returns the answer to it, with 0.3 rad as the set-point of all joints.
fn answer(session: &mut IiwaSession, version: Version, message: &Monitoring) -> Option<Command> {
    let bytes = encode(version, message).expect("it fits");
    session.accept(&bytes).expect("a good message");
    let outputs = Outputs {
        position: [0.3; JOINTS_MAX],
        ..Outputs::NONE
    };
    let bytes = session.answer(&outputs)?;
    Some(decode(version, &bytes).expect("its own bytes"))
}

fn position(command: &Command) -> Option<f64> {
    let values = &command.data.as_ref()?.position.as_ref()?.value;
    assert_eq!(values.len(), JOINTS);
    values.first().copied()
}

/// Goes through the states; returns the positions of the answers.
fn positions(version: Version, states: &[i32]) -> Vec<Option<f64>> {
    let mut session = session(version);
    let numbered = states.iter().zip(1..);
    let answers = numbered.map(|(state, sequence)| {
        let command = answer(&mut session, version, &message(sequence, *state));
        position(&command.expect("each message is answered"))
    });
    answers.collect()
}

#[test]
fn all_versions_mirror_until_commands_have_been_executed_for_three_cycles() {
    for version in VERSIONS {
        let states = [2, 3, 3, 4, 4, 4, 4, 4];
        // Before a motion, 1.x repeats the commanded position, 2.x answers with a header alone.
        let first = (!version.is_second()).then_some(OWN);
        let own = Some(OWN);
        let expected = [first, own, own, own, own, own, Some(0.3), Some(0.3)];
        assert_eq!(positions(version, &states), expected, "{version:?}");
    }
}

#[test]
fn a_closed_session_is_never_answered() {
    for version in VERSIONS {
        let mut session = session(version);
        let nothing = answer(&mut session, version, &message(1, IDLE_STATE));
        assert_eq!(nothing, None, "{version:?}");
        let exchange = session.exchange(&mut Inputs::NONE.clone());
        assert_eq!((exchange.commandable, exchange.reason), (false, IDLE));
    }
}

#[test]
fn counters_begin_at_0_and_reflect_the_robots() {
    let version = Version::V2_7;
    let mut session = session(version);
    for (sequence, own) in [(u32::MAX, 0), (0, 1), (1, 2)] {
        let command = answer(&mut session, version, &message(sequence, MONITORING_READY));
        let header = command
            .and_then(|command| command.header)
            .expect("required");
        let expected = (Some(COMMAND_ID), Some(own), Some(sequence));
        assert_eq!(
            (header.identifier, header.sequence, header.reflected),
            expected
        );
    }
}

#[test]
fn the_receive_multiplier_counts_messages_that_arrived() {
    let version = Version::V1_14;
    let mut session = session(version);
    let mut answered = Vec::new();
    // Message 5 is lost.
    for sequence in [1, 2, 3, 4, 6, 7, 8, 9] {
        let mut message = message(sequence, MONITORING_READY);
        let connection = message.connection.as_mut().expect("set above");
        connection.receive_multiplier = Some(3);
        if answer(&mut session, version, &message).is_some() {
            answered.push(sequence);
        }
    }
    assert_eq!(answered, [3, 7]);
}

#[test]
fn in_the_middle_of_a_motion_that_it_did_not_begin_it_answers_nothing() {
    for version in VERSIONS {
        let mut session = session(version);
        for sequence in 1..=10 {
            let message = message(sequence, COMMANDING_ACTIVE);
            assert_eq!(answer(&mut session, version, &message), None);
            let exchange = session.exchange(&mut Inputs::NONE.clone());
            assert_eq!((exchange.commandable, exchange.reason), (false, REJOINED));
        }
        let end = encode(version, &message(11, 1)).expect("it fits");
        assert!(
            session.accept(&end).is_err(),
            "one message alone does not end a motion"
        );
        assert!(answer(&mut session, version, &message(12, 1)).is_some());
    }
}

#[test]
fn the_end_of_a_motion_needs_two_messages() {
    let version = Version::V1_14;
    let mut session = session(version);
    for (state, sequence) in [3, 3, 4, 4, 4, 4].into_iter().zip(1..) {
        answer(&mut session, version, &message(sequence, state));
    }
    assert!(session.exchange(&mut Inputs::NONE.clone()).commandable);
    let bytes = |sequence| encode(version, &message(sequence, 1)).expect("it fits");
    let implausibility = session.accept(&bytes(7)).expect_err("one message alone");
    assert_eq!(implausibility.to_string(), "the session state changed");
    session.accept(&bytes(8)).expect("it is confirmed");
    let exchange = session.exchange(&mut Inputs::NONE.clone());
    assert_eq!((exchange.commandable, exchange.reason), (false, MONITORING));
}

#[test]
fn values_of_the_robot_are_channels() {
    let rows = [
        ("interpolated 3", OWN),
        ("commanded 7", OWN),
        ("session", 4.0),
        ("quality", 3.0),
        ("safety", 0.0),
        ("operation", 2.0),
        ("control", 0.0),
        ("command mode", 1.0),
        ("drives", 2.0),
        ("send period", 0.005),
        ("receive multiplier", 1.0),
        ("redundancy", 0.125),
        ("commanded torque 1", f64::NAN),
        ("tracking", f64::NAN),
    ];
    let mut device = arm();
    let channel = |(index, address): (usize, &str), kind| rcc_config::ChannelConfig {
        name: format!("value_{index}"),
        kind,
        index: index as u32,
        address: address.into(),
        unit: rcc_core::unit::Unit::ONE,
        scale: 1.0,
        offset: 0.0,
        range: None,
        on_release: None,
    };
    let analog = rows.iter().map(|row| row.0).enumerate();
    device
        .channels
        .extend(analog.map(|row| channel(row, ChannelKind::AnalogInput)));
    let conditions = ["commanding", "drives active", "safety normal"];
    let digital = conditions.into_iter().enumerate();
    device
        .channels
        .extend(digital.map(|row| channel(row, ChannelKind::DigitalInput)));
    let settings = SessionSettings {
        version: Version::V2_5,
        quality_min: Quality::Good,
    };
    let mut session = IiwaSession::new(&device, settings).expect("all are known");
    let mut message = message(1, COMMANDING_ACTIVE);
    message.data.as_mut().expect("set above").redundancy = Some(Redundancy {
        strategy: Some(0),
        value: Some(0.125),
    });
    session
        .accept(&encode(Version::V2_5, &message).expect("it fits"))
        .expect("a good message");
    let mut inputs = Inputs::NONE;
    session.exchange(&mut inputs);
    for ((address, expected), found) in rows.into_iter().zip(inputs.analog) {
        let same = found == expected || (found.is_nan() && expected.is_nan());
        assert!(same, "{address}: {found}");
    }
    assert_eq!((inputs.digital, inputs.digital_known), (0b111, 0b111));
    assert_eq!(session.missing_io(), None);
    for wrong in [
        "interpolated 0",
        "interpolated 8",
        "interpolated",
        "speed 1",
    ] {
        let mut device = arm();
        device
            .channels
            .push(channel((0, wrong), ChannelKind::AnalogInput));
        assert!(IiwaSession::new(&device, settings).is_err(), "{wrong}");
    }
}

#[test]
fn released_it_sends_no_position_any_more() {
    let version = Version::V1_14;
    let mut session = session(version);
    for (state, sequence) in [3, 3, 4, 4, 4, 4].into_iter().zip(1..) {
        answer(&mut session, version, &message(sequence, state));
    }
    session.release();
    let last = answer(&mut session, version, &message(7, COMMANDING_ACTIVE));
    assert_eq!(last.and_then(|command| position(&command)), None);
    let next = answer(&mut session, version, &message(8, COMMANDING_ACTIVE));
    assert_eq!(next, None);
}

#[test]
fn values_that_are_not_finite_or_missing_are_refused_by_name() {
    let good = || message(1, COMMANDING_WAIT);
    let data = |change: fn(&mut MonitorData)| {
        let mut message = good();
        change(message.data.as_mut().expect("set above"));
        message
    };
    let rows = [
        (
            data(|data| data.measured_position = all(f64::NAN)),
            "not finite",
        ),
        (
            data(|data| data.measured_position = None),
            "measured position is missing",
        ),
        (
            data(|data| data.external_torque = all(f64::INFINITY)),
            "not finite",
        ),
        (
            Monitoring {
                interpolator: None,
                ..good()
            },
            "interpolated position is missing",
        ),
        (message(1, 5), "unknown session state"),
    ];
    for (message, words) in rows {
        let bytes = encode(Version::V1_14, &message).expect("it fits");
        let refusal = session(Version::V1_14).accept(&bytes).expect_err(words);
        assert!(refusal.to_string().contains(words), "{refusal}");
    }
}
