//! Faults, brakes, the safety controller, drives, and how a motion begins again.
//! Runs in the test harness.

use super::*;
use crate::sim::iiwa::settings::MotionStart;

/// Moves A1 for some cycles with about 0.4 rad/s.
fn moving(settings: Settings) -> Client {
    let mut client = Client::commanding(settings);
    let start = client.cabinet.settings.robot.start;
    let mut at = start;
    let mut speed = 0.0_f64;
    for _ in 0..300 {
        speed = (speed + 4e-6).min(4e-4);
        at[0] += speed;
        client.run(1, |data| data.position = Some(values(&at)));
    }
    assert!(client.cabinet.robot.arm.velocity[0] > 0.3);
    client
}

fn rests(client: &mut Client) -> u32 {
    (0..2000)
        .find(|_| {
            client.run(1, |_| {});
            client.cabinet.is_at_rest()
        })
        .expect("it comes to rest")
}

#[test]
fn missed_answers_are_bridged_with_the_last_velocity_and_one_more_stops_the_arm() {
    let mut client = moving(position(Version::V2_7));
    let before = client.cabinet.robot.desired[0];
    for missed in 1..=5 {
        client.next();
        let on = before + 4e-4 * f64::from(missed);
        assert!((client.cabinet.robot.desired[0] - on).abs() < 1e-9);
    }
    client.next();
    assert_eq!(client.fault_code(), Some(1));
    assert_eq!(client.session(), SessionState::MonitoringWait);
    rests(&mut client);
    assert!(client.cabinet.robot.arm.acceleration_max[0] < 40.0);
    // The application begins again after half a second.
    client.run(700, |_| {});
    assert_eq!(client.fault_code(), None);
    assert_eq!(client.session(), SessionState::CommandingActive);
}

#[test]
fn a_stall_of_the_machine_is_no_missed_answer() {
    let mut client = moving(position(Version::V1_14));
    let (missed, sequence) = (client.cabinet.counts.missed, client.cabinet.sequence());
    let before = client.cabinet.robot.desired[0];
    let answer = client.mirror();
    let mut answer = answer;
    let mut at = client.cabinet.robot.desired;
    at[0] += 4e-4;
    answer.data.as_mut().expect("an overlay").position = Some(values(&at));
    assert!(client.send(&answer));
    client.cabinet.tick(8);
    assert_eq!(client.cabinet.sequence(), sequence + 8);
    assert_eq!(client.cabinet.counts.missed, missed);
    assert!((client.cabinet.robot.desired[0] - before - 8.0 * 4e-4).abs() < 1e-9);
    assert_eq!(
        (client.cabinet.counts.stalls, client.cabinet.counts.skipped),
        (1, 7)
    );
}

#[test]
fn an_emergency_stop_needs_a_person_and_the_drives_need_time() {
    let mut client = moving(position(Version::V1_14));
    client.ask(r#"{"estop":null}"#);
    client.run(1, |_| {});
    let robot = client.seen.robot.as_ref().expect("sent");
    // A stop 1: the drives brake, and are switched off at rest.
    assert_eq!((robot.safety, robot.drives[0]), (Some(2), 2));
    let moving: Result<CabinetRequest, _> = serde_json::from_str(r#"{"ack":null}"#);
    let refused = client.cabinet.execute(moving.expect("a request"));
    let refused = refused.map(|_| ()).expect_err("it moves");
    assert!(refused.to_string().contains("still moving"), "{refused}");
    rests(&mut client);
    client.run(2000, |_| {});
    let robot = client.seen.robot.clone().expect("sent");
    assert_eq!((robot.safety, robot.drives[6]), (Some(2), 0));
    assert_eq!(client.fault_code(), Some(9));
    client.ask(r#"{"ack":null}"#);
    client.run(1, |_| {});
    assert_eq!(
        client.seen.robot.as_ref().map(|robot| robot.drives[0]),
        Some(1)
    );
    client.run(310, |_| {});
    assert_eq!(
        client.seen.robot.as_ref().map(|robot| robot.drives[0]),
        Some(2)
    );
    client.run(50, |_| {});
    assert_eq!(client.session(), SessionState::CommandingActive);
}

#[test]
fn every_safety_stop_ends_the_motion_and_shows() {
    for (word, number, off) in [("stop0", 1, true), ("stop1", 2, true), ("stop2", 3, false)] {
        let mut client = moving(position(Version::V2_5));
        client.ask(&format!("{{\"safety\":\"{word}\"}}"));
        client.run(1, |_| {});
        rests(&mut client);
        client.run(5, |_| {});
        let robot = client.seen.robot.clone().expect("sent");
        assert_eq!(robot.safety, Some(number));
        assert_eq!(robot.drives[0] == 0, off, "{word}");
        assert_eq!(client.cabinet.snapshot().safety, word);
        client.ask(r#"{"safety":"normal"}"#);
        client.run(1200, |_| {});
        assert_eq!(client.session(), SessionState::CommandingActive, "{word}");
    }
}

#[test]
fn drives_mode_and_the_application_end_a_motion() {
    for (line, code) in [
        (r#"{"drives":{"on":false}}"#, Some(10)),
        (r#"{"mode":"t1"}"#, Some(15)),
        (r#"{"stop_motion":null}"#, None),
        (r#"{"session":{"open":false}}"#, None),
    ] {
        let mut client = moving(position(Version::V2_7));
        client.ask(line);
        client.next();
        assert_eq!(client.fault_code(), code, "{line}");
        assert!(!client.cabinet.is_commanded());
        (0..1000).for_each(|_| client.next());
        assert!(client.cabinet.is_at_rest(), "{line}");
    }
}

#[test]
fn without_the_application_a_motion_begins_at_a_request_only() {
    let mut client = Client::new(Settings {
        motion: MotionStart::Manual,
        ..position(Version::V1_11)
    });
    client.run(500, |_| {});
    assert_eq!(client.session(), SessionState::MonitoringReady);
    client.ask(r#"{"motion":{"control":"joint-impedance","overlay":"torque","stiffness":[50,50,50,50,50,50,50]}}"#);
    client.ask(r#"{"start_motion":null}"#);
    client.run(100, |_| {});
    assert_eq!(client.session(), SessionState::CommandingActive);
    assert_eq!(client.cabinet.robot.impedance.stiffness[0], 50.0);
    let busy: Result<CabinetRequest, _> =
        serde_json::from_str(r#"{"motion":{"control":"position","overlay":"position"}}"#);
    assert!(client.cabinet.execute(busy.expect("a request")).is_err());
    client.run(1, |data| data.torque = None);
    client.run(2000, |_| {});
    assert_eq!(client.session(), SessionState::MonitoringReady);
    assert_eq!(client.fault_code(), Some(8));
    assert_eq!(client.cabinet.snapshot().robot.faults.len(), 1);
    client.ask(r#"{"start_motion":null}"#);
    client.run(100, |_| {});
    assert_eq!(client.session(), SessionState::CommandingActive);
}

#[test]
fn answers_are_dropped_and_messages_withheld_on_request() {
    let mut client = Client::commanding(position(Version::V1_14));
    client.ask(r#"{"drop":{"percent":100}}"#);
    client.run(2, |_| {});
    assert_eq!(client.cabinet.counts.dropped, 2);
    client.ask(r#"{"clear":null}"#);
    client.ask(r#"{"freeze_ms":4}"#);
    let messages = (0..6).filter(|_| client.cabinet.tick(1).is_some()).count();
    assert_eq!((messages, client.cabinet.counts.withheld), (2, 4));
    client.ask(r#"{"reset_statistics":null}"#);
    assert_eq!(client.cabinet.counts, Default::default());
}

#[test]
fn a_fault_code_is_that_of_its_cause() {
    let fault = CabinetFault::Missing {
        field: "jointTorque",
    };
    assert_eq!(fault.code(), 8);
    assert!(fault.to_string().contains("`jointTorque`"));
}
