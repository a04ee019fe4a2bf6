//! States of the session, quality, receive multiplier, and every answer that is not taken.
//! Runs in the test harness.

use super::*;
use crate::fri_iiwa::wire::schema::{IoValue, MessageEnd, Redundancy, Transformation};
use crate::fri_iiwa::wire::{IoDirection, IoKind, Quality};
use crate::sim::iiwa::settings::MotionStart;

#[test]
fn every_state_is_visited_upwards_and_downwards_in_every_version() {
    use SessionState::{CommandingActive, CommandingWait, Idle, MonitoringReady, MonitoringWait};
    for version in VERSIONS {
        let mut client = Client::commanding(position(version));
        client.run(20, |_| {});
        // A missing answer too many, and the application begins again.
        for _ in 0..=client.cabinet.settings.robot.bridged_misses {
            client.next();
        }
        client.run(700, |_| {});
        client.ask(r#"{"stop_motion":null}"#);
        client.run(20, |_| {});
        client.ask(r#"{"session":{"open":false}}"#);
        (0..10).for_each(|_| client.next());
        client.ask(r#"{"session":{"open":true}}"#);
        client.next();
        client.run(200, |_| {});
        let expected = [
            MonitoringWait,
            // Quality is good as soon as the motion may start.
            CommandingWait,
            CommandingActive,
            MonitoringWait,
            MonitoringReady,
            CommandingWait,
            CommandingActive,
            MonitoringReady,
            Idle,
            MonitoringWait,
            MonitoringReady,
        ];
        assert_eq!(client.states, expected, "{version:?}");
    }
}

#[test]
fn a_closed_session_sends_some_last_messages_and_then_nothing() {
    let mut client = Client::commanding(position(Version::V1_14));
    client.ask(r#"{"session":{"open":false}}"#);
    let messages: Vec<bool> = (0..6).map(|_| client.cabinet.tick(1).is_some()).collect();
    assert_eq!(messages, [true, true, true, false, false, false]);
    assert!(!client.cabinet.is_closed());
    client.ask(r#"{"quit":null}"#);
    let last = (0..100)
        .filter(|_| client.cabinet.tick(1).is_some())
        .count();
    assert!(last == 20 && client.cabinet.is_closed(), "{last}");
}

#[test]
fn quality_falls_at_once_and_rises_after_it_has_held() {
    let mut client = Client::new(Settings {
        motion: MotionStart::Manual,
        ..position(Version::V2_5)
    });
    client.run(300, |_| {});
    assert_eq!(client.cabinet.quality.quality(), Quality::Excellent);
    (0..7).for_each(|_| client.next());
    assert_eq!(client.cabinet.quality.quality(), Quality::Fair);
    assert_eq!(client.session(), SessionState::MonitoringWait);
    client.run(99, |_| {});
    assert_eq!(client.session(), SessionState::MonitoringWait);
    client.run(80, |_| {});
    assert_eq!(client.session(), SessionState::MonitoringReady);
    assert_eq!(
        client.cabinet.snapshot().robot.waiting_for.as_deref(),
        Some("the application has not started a motion: send `start_motion`")
    );
    client.ask(r#"{"start_motion":null}"#);
    client.run(50, |_| {});
    assert_eq!(client.session(), SessionState::CommandingActive);
}

#[test]
fn bad_quality_ends_a_motion() {
    let mut patient = position(Version::V1_14);
    patient.robot.bridged_misses = 50;
    let mut client = Client::commanding(patient);
    (0..8).for_each(|_| client.next());
    assert_eq!(client.fault_code(), Some(2), "{:?}", client.cabinet.fault);
    assert_eq!(client.session(), SessionState::MonitoringWait);
}

#[test]
fn commanding_needs_an_answer_every_ten_milliseconds() {
    for (period_ms, multiplier, commands) in [(1, 10, true), (5, 2, true), (10, 1, true)] {
        let allowed = Settings {
            period_ms,
            multiplier,
            ..position(Version::V1_14)
        };
        let client = Client::commanding(allowed);
        assert_eq!(client.cabinet.is_commanded(), commands);
    }
    for (period_ms, multiplier) in [(1, 11), (5, 3), (11, 1)] {
        let mut client = Client::new(Settings {
            period_ms,
            multiplier,
            ..position(Version::V1_14)
        });
        client.run(300 * multiplier, |_| {});
        assert_eq!(client.session(), SessionState::MonitoringReady);
        let waiting = client
            .cabinet
            .snapshot()
            .robot
            .waiting_for
            .expect("a reason");
        assert!(waiting.contains("10 ms at most"), "{waiting}");
    }
}

#[test]
fn an_answer_before_the_multiplier_asks_for_one_is_not_taken_and_a_lost_message_shifts_the_phase() {
    let mut client = Client::commanding(Settings {
        multiplier: 4,
        ..position(Version::V2_7)
    });
    while client.received != 2 {
        client.run(1, |_| {});
    }
    let early = client.mirror();
    assert!(!client.send(&early));
    assert_eq!(client.cabinet.counts.early, 1);
    client.received = 2;
    // The client did not get a message: it answers one message later from now on.
    client.cabinet.tick(1);
    client.run(400, |_| {});
    assert!(client.cabinet.is_commanded(), "{:?}", client.cabinet.fault);
    assert_eq!(client.cabinet.counts.missed, 1);
}

/// One answer, changed; returns the number of refused answers by cause.
fn refused(settings: Settings, change: impl Fn(&mut Command)) -> (Client, bool) {
    let mut client = Client::new(settings);
    client.run(5, |_| {});
    let mut command = client.mirror();
    change(&mut command);
    let taken = client.send(&command);
    (client, taken)
}

fn with_data(change: impl Fn(&mut CommandData)) -> impl Fn(&mut Command) {
    move |command| change(command.data.get_or_insert_default())
}

#[test]
fn a_field_that_the_version_does_not_have_is_refused() {
    let pose = |elements: usize| Transformation {
        name: Some("frame".to_owned()),
        element: vec![1.0; elements],
        timestamp: None,
    };
    let written = IoValue {
        name: Some("A.b".to_owned()),
        kind: Some(0),
        direction: Some(1),
        digital: Some(1),
        analog: None,
    };
    let count = |version, change: &dyn Fn(&mut Command)| {
        let (client, taken) = refused(position(version), change);
        assert!(!taken);
        client.cabinet.counts.not_of_version
    };
    let io = with_data(|data| data.io = vec![written.clone()]);
    assert_eq!(count(Version::V1_11, &io), 1);
    let poses = with_data(|data| data.pose = Some(pose(7)));
    assert_eq!(count(Version::V1_14, &poses), 1);
    let redundancy = with_data(|data| data.redundancy = Some(Redundancy::default()));
    assert_eq!(count(Version::V1_14, &redundancy), 1);
    let end = |command: &mut Command| command.end = Some(MessageEnd::default());
    assert_eq!(count(Version::V2_7, &end), 1);
    for (version, elements) in [(Version::V1_14, 7), (Version::V2_5, 12)] {
        let frames = with_data(|data| data.transformations = vec![pose(elements)]);
        assert_eq!(count(version, &frames), 1);
    }
    // The other version has it.
    for (version, elements) in [(Version::V1_14, 12), (Version::V2_5, 7)] {
        let frames = with_data(|data| data.transformations = vec![pose(elements)]);
        assert!(refused(position(version), frames).1);
    }
    let end = |command: &mut Command| command.end = Some(MessageEnd::default());
    assert!(refused(position(Version::V2_5), end).1);
}

#[test]
fn wrong_bytes_are_counted_by_their_cause_and_never_answered() {
    for version in VERSIONS {
        let mut client = Client::new(position(version));
        let good = encode(version, &client.mirror()).expect("it fits");
        let other = if version.is_framed() {
            Version::V2_5
        } else {
            Version::V2_7
        };
        let framed_otherwise = encode(other, &client.mirror()).expect("it fits");
        let mut of_a_robot = client.mirror();
        of_a_robot.header.as_mut().expect("set").identifier = Some(1);
        let of_a_robot = encode(version, &of_a_robot).expect("it fits");
        let mut headless = client.mirror();
        headless.header.as_mut().expect("set").reflected = None;
        let headless = encode(version, &headless).expect("it fits");
        let mut short = client.mirror();
        let six = JointValues {
            value: vec![0.0; 6],
        };
        short.data.get_or_insert_default().position = Some(six);
        let short = encode(version, &short).expect("it fits");
        for bytes in [
            &framed_otherwise,
            &of_a_robot,
            &headless,
            &short,
            &vec![0xff; 9],
        ] {
            assert!(client.cabinet.receive(bytes, 1e-4).is_err());
        }
        if version.is_framed() {
            let mut corrupted = good.clone();
            corrupted[6] ^= 1;
            assert!(client.cabinet.receive(&corrupted, 1e-4).is_err());
            let mut longer = good.clone();
            longer.push(0);
            assert!(client.cabinet.receive(&longer, 1e-4).is_err());
        }
        let counts = client.cabinet.counts;
        assert_eq!(counts.wrong_identity, 1, "{counts:?}");
        assert!(counts.wrong_frame >= 1, "{counts:?}");
        assert!(counts.malformed >= 2 || version.is_framed(), "{counts:?}");
        assert_eq!(counts.wrong_checksum, u64::from(version.is_framed()));
        assert!(client.cabinet.last_refusal.is_some());
        client.next();
        assert_eq!(
            client.seen.header.and_then(|header| header.reflected),
            Some(0)
        );
        assert_eq!(client.cabinet.counts.answered, 0);
    }
}

#[test]
fn late_duplicate_and_backward_answers_are_not_taken() {
    let mut client = Client::commanding(position(Version::V1_14));
    let mut late = client.mirror();
    let header = late.header.as_mut().expect("set");
    header.reflected = header.reflected.map(|reflected| reflected.wrapping_sub(1));
    assert!(!client.send(&late));
    let good = client.mirror();
    assert!(client.send(&good) && !client.send(&good));
    client.next();
    let mut backward = client.mirror();
    backward.header.as_mut().expect("set").sequence = Some(1);
    assert!(!client.send(&backward));
    client.cabinet.receive_foreign();
    let counts = client.cabinet.counts;
    assert_eq!((counts.late, counts.duplicate, counts.foreign), (1, 2, 1));
    // While nothing is commanded, a restarted client may count from 0.
    client.ask(r#"{"stop_motion":null}"#);
    client.run(5, |_| {});
    client.sequence = u32::MAX;
    let restarted = client.mirror();
    assert!(client.send(&restarted));
}

#[test]
fn an_answer_in_idle_is_not_taken() {
    let mut client = Client::new(position(Version::V1_14));
    client.ask(r#"{"session":{"open":false}}"#);
    client.next();
    let answer = client.mirror();
    assert!(!client.send(&answer));
    assert_eq!(client.cabinet.counts.in_idle, 1);
    assert_eq!(client.cabinet.snapshot().session, "idle");
}

#[test]
fn values_that_are_not_finite_are_dropped_before_commands_are_executed() {
    let nan = with_data(|data| data.position = Some(values(&[f64::NAN; JOINTS])));
    let (client, taken) = refused(position(Version::V1_14), nan);
    assert!(!taken && client.cabinet.counts.not_finite == 1);
}

#[test]
fn outputs_are_latched_in_every_state_and_listed_in_the_next_message() {
    let signals = [
        "S.out=boolean:output",
        "S.in=boolean:input",
        "S.n=digital:output",
        "S.a=analog:output",
    ];
    let mut client = Client::new(Settings {
        signals: signals
            .iter()
            .map(|text| text.parse().expect(text))
            .collect(),
        loopbacks: vec!["S.out=S.in".parse().expect("a loopback")],
        ..position(Version::V2_7)
    });
    let write = |name: &str, kind: IoKind, digital: Option<u64>, analog: Option<f64>| IoValue {
        name: Some(name.to_owned()),
        kind: Some(kind as i32),
        direction: Some(IoDirection::Output as i32),
        digital,
        analog,
    };
    let mut command = client.mirror();
    command.data.get_or_insert_default().io = vec![
        write("S.out", IoKind::Boolean, Some(1), None),
        write("S.n", IoKind::Digital, Some(77), None),
        write("S.a", IoKind::Analog, None, Some(-2.5)),
    ];
    client.answer(&command);
    // Values stay when nothing is written.
    client.run(3, |_| {});
    let listed = &client.seen.data.as_ref().expect("sent").io;
    let digital: Vec<_> = listed.iter().map(|io| io.digital).collect();
    assert_eq!(digital, [Some(1), Some(1), Some(77), None]);
    assert_eq!(listed[3].analog, Some(-2.5));
    for wrong in [
        write("S.in", IoKind::Boolean, Some(1), None),
        write("S.none", IoKind::Boolean, Some(1), None),
        write("S.out", IoKind::Boolean, Some(2), None),
        write("S.out", IoKind::Analog, None, Some(1.0)),
        write("S.a", IoKind::Analog, None, None),
    ] {
        let mut command = client.mirror();
        command.data.get_or_insert_default().io = vec![wrong];
        assert!(!client.send(&command));
        client.next();
    }
    assert_eq!(client.cabinet.counts.wrong_io, 5);
    client.ask(r#"{"set_io":{"name":"S.in","value":0}}"#);
    assert_eq!(client.cabinet.snapshot().io[1].value, 0.0);
}
