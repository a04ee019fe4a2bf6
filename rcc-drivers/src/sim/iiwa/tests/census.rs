//! Every transition of the session, every refusal of an answer, every fault and every reason to wait, in lock-step: the match of
//! each list is exhaustive, so that a variant without a case does not compile, and one that no case provokes fails.
//! Runs in the test harness.

use std::collections::BTreeSet;

use super::*;
use crate::fri_iiwa::wire::schema::{IoValue, MessageEnd};
use crate::fri_iiwa::wire::{DATAGRAM_MAX, WireError};
use crate::sim::arm::command_stream::StreamFault;
use crate::sim::census::{all, variants};
use crate::sim::iiwa::fault::AnswerRefusal;
use crate::sim::iiwa::settings::{MotionStart, Selector};

variants!(REFUSALS, refusal_name, AnswerRefusal:
    AnswerRefusal::Wire(WireError::Size(_)),
    AnswerRefusal::Wire(WireError::OtherFrame(_)),
    AnswerRefusal::Wire(WireError::Length { .. }),
    AnswerRefusal::Wire(WireError::Checksum { .. }),
    AnswerRefusal::Wire(WireError::Schema(_)),
    AnswerRefusal::Wire(WireError::Identity { .. }),
    AnswerRefusal::Wire(WireError::Missing(_)),
    AnswerRefusal::Wire(WireError::Count { .. }),
    AnswerRefusal::NotOfVersion(_),
    AnswerRefusal::Idle,
    AnswerRefusal::Late { .. },
    AnswerRefusal::Duplicate { .. },
    AnswerRefusal::Early { .. },
    AnswerRefusal::NotFinite,
    AnswerRefusal::Io(_),
);

variants!(FAULTS, fault_name, CabinetFault:
    CabinetFault::Lost { .. },
    CabinetFault::Quality { .. },
    CabinetFault::Missing { .. },
    CabinetFault::Mirror { .. },
    CabinetFault::MirrorPose { .. },
    CabinetFault::Stream(StreamFault::Position { .. }),
    CabinetFault::Stream(StreamFault::Velocity { .. }),
    CabinetFault::Stream(StreamFault::Acceleration { .. }),
    CabinetFault::Stream(StreamFault::NotFinite { .. }),
    CabinetFault::NotFinite { .. },
    CabinetFault::Rotation(_),
    CabinetFault::Unreachable { .. },
    CabinetFault::Torque { .. },
    CabinetFault::Runaway(_),
    CabinetFault::ReducedSpeed(_),
    CabinetFault::Safety(_),
    CabinetFault::DrivesOff,
    CabinetFault::OperatingMode,
);

variants!(WAITS, wait_name, WaitReason:
    WaitReason::Closed,
    WaitReason::Answer,
    WaitReason::Quality(_),
    WaitReason::Acknowledgement,
    WaitReason::Safety,
    WaitReason::Drives,
    WaitReason::Rest,
    WaitReason::Period(_),
    WaitReason::Motion,
    WaitReason::Synchronising,
);

/// Returns a mirroring answer with this change, as bytes.
fn changed(client: &mut Client, change: impl Fn(&mut Command)) -> Vec<u8> {
    let mut command = client.mirror();
    change(&mut command);
    encode(client.version(), &command).expect("it fits")
}

fn with_data(client: &mut Client, change: impl Fn(&mut CommandData)) -> Vec<u8> {
    changed(client, |command| {
        change(command.data.get_or_insert_default());
    })
}

#[test]
fn every_refusal_is_provoked_counted_and_told_and_the_next_answer_is_taken() {
    type Provoke = fn(&mut Client) -> Vec<u8>;
    use Version::{V1_11, V1_14, V2_7};
    let rows: [(Version, Provoke); 15] = [
        (V1_14, |_| vec![0; DATAGRAM_MAX + 1]),
        (V1_14, |client| {
            encode(V2_7, &client.mirror()).expect("it fits")
        }),
        (V2_7, |client| [changed(client, |_| {}), vec![0]].concat()),
        (V2_7, |client| {
            let mut bytes = changed(client, |_| {});
            bytes[6] ^= 1;
            bytes
        }),
        (V1_14, |_| vec![0xff; 9]),
        (V1_14, |client| {
            changed(client, |command| {
                command.header.as_mut().expect("set").identifier = Some(1);
            })
        }),
        (V1_14, |client| {
            changed(client, |command| {
                command.header.as_mut().expect("set").reflected = None;
            })
        }),
        (V1_14, |client| {
            let six = JointValues {
                value: vec![0.0; 6],
            };
            with_data(client, |data| data.position = Some(six.clone()))
        }),
        (V2_7, |client| {
            changed(client, |command| command.end = Some(MessageEnd::default()))
        }),
        (V1_14, |client| {
            client.ask(r#"{"session":{"open":false}}"#);
            client.next();
            changed(client, |_| {})
        }),
        (V1_14, |client| {
            changed(client, |command| {
                let header = command.header.as_mut().expect("set");
                header.reflected = header.reflected.map(|last| last.wrapping_sub(1));
            })
        }),
        (V1_11, |client| {
            let good = client.mirror();
            assert!(client.send(&good));
            encode(V1_11, &good).expect("it fits")
        }),
        (V2_7, |client| {
            client.cabinet.settings.multiplier = 4;
            changed(client, |_| {})
        }),
        (V1_14, |client| {
            with_data(client, |data| {
                data.position = Some(values(&[f64::NAN; JOINTS]));
            })
        }),
        (V1_14, |client| {
            with_data(client, |data| {
                data.io = vec![IoValue {
                    name: Some("S.none".to_owned()),
                    kind: Some(0),
                    direction: Some(1),
                    digital: Some(1),
                    analog: None,
                }];
            })
        }),
    ];
    let mut seen = BTreeSet::new();
    for (version, provoke) in rows {
        let mut client = Client::new(position(version));
        client.run(5, |_| {});
        let bytes = provoke(&mut client);
        let refusal = client.cabinet.receive(&bytes, 1e-4).expect_err("refused");
        assert_eq!(client.cabinet.counts.refused, 1, "{refusal}");
        assert_eq!(client.cabinet.last_refusal, Some(refusal.clone()));
        seen.insert(refusal_name(&refusal));
        let answered = client.cabinet.counts.answered;
        if client.session() == SessionState::Idle {
            client.ask(r#"{"session":{"open":true}}"#);
        }
        client.next();
        client.run(20, |_| {});
        assert!(client.cabinet.counts.answered > answered, "{refusal}");
    }
    assert_eq!(seen, all(REFUSALS));
}

fn joints(data: &mut CommandData) -> &mut Vec<f64> {
    &mut data.position.as_mut().expect("mirrored").value
}

fn pose(data: &mut CommandData) -> &mut Vec<f64> {
    &mut data.pose.as_mut().expect("mirrored").element
}

#[test]
fn every_fault_is_provoked_and_told() {
    use OverlayMode::{CartesianPose, Position, Torque};
    type Provoke = fn(&mut Client);
    let at = position(Version::V1_14);
    let of = |overlay| settings(Version::V2_5, overlay);
    let mut limp = of(Torque);
    limp.impedance.stiffness = [0.0; JOINTS];
    let mut patient = at.clone();
    patient.robot.bridged_misses = 50;
    let slow = Settings {
        selector: Selector::T1,
        ..at.clone()
    };
    let rows: [(Settings, Provoke); 18] = [
        (at.clone(), |client| (0..6).for_each(|_| client.next())),
        (patient, |client| (0..8).for_each(|_| client.next())),
        (of(Position), |client| {
            client.run(1, |data| data.position = None)
        }),
        (at.clone(), |client| {
            client.run(1, |data| joints(data)[0] += 0.02)
        }),
        (of(CartesianPose), |client| {
            client.run(1, |data| pose(data)[2] += 2.0)
        }),
        (at.clone(), |client| {
            client.run(20, |_| {});
            client.run(1, |data| joints(data)[3] = -2.2);
        }),
        (at.clone(), |client| {
            client.run(20, |_| {});
            client.run(1, |data| joints(data)[0] += 0.01);
        }),
        (at.clone(), |client| {
            client.run(20, |_| {});
            client.run(1, |data| joints(data)[0] += 1e-3);
        }),
        (at.clone(), |client| {
            client.run(20, |_| {});
            client.run(1, |data| joints(data)[2] = f64::NAN);
        }),
        (of(Torque), |client| {
            client.run(1, |data| data.torque = Some(values(&[f64::NAN; JOINTS])));
        }),
        (of(CartesianPose), |client| {
            client.run(1, |data| pose(data)[3] += 0.1)
        }),
        (of(CartesianPose), |client| {
            client.run(20, |_| {});
            client.run(1, |data| pose(data)[2] += 3000.0);
        }),
        (of(Torque), |client| {
            client.run(1, |data| data.torque = Some(values(&[41.0; JOINTS])));
        }),
        (limp, |client| {
            while client.fault_code().is_none() {
                assert!(client.cabinet.sequence() < 4000);
                let push = [0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0];
                client.run(1, |data| data.torque = Some(values(&push)));
            }
        }),
        (slow, |client| {
            let (mut at, mut speed) = (client.cabinet.settings.robot.start, 0.0_f64);
            while client.fault_code().is_none() {
                assert!(client.cabinet.sequence() < 4000);
                speed = (speed + 4e-6).min(8e-4);
                at[0] += speed;
                client.run(1, |data| data.position = Some(values(&at)));
            }
        }),
        (at.clone(), |client| client.ask(r#"{"estop":null}"#)),
        (at.clone(), |client| {
            client.ask(r#"{"drives":{"on":false}}"#)
        }),
        (at, |client| client.ask(r#"{"mode":"t1"}"#)),
    ];
    let mut seen = BTreeSet::new();
    for (settings, provoke) in rows {
        let mut client = Client::commanding(settings);
        provoke(&mut client);
        let fault = client.cabinet.fault.expect("a fault");
        seen.insert(fault_name(&fault));
        assert!(!client.cabinet.is_commanded(), "{fault}");
        let told = client.cabinet.snapshot().robot.faults;
        assert_eq!(told.last().map(|told| told.code), Some(fault.code()));
    }
    assert_eq!(seen, all(FAULTS));
}

fn manual() -> Client {
    Client::new(Settings {
        motion: MotionStart::Manual,
        ..position(Version::V2_7)
    })
}

fn synchronising() -> Client {
    let mut client = Client::new(position(Version::V2_7));
    while client.session() != SessionState::CommandingWait {
        client.run(1, |_| {});
    }
    client
}

const CLOSE: &str = r#"{"session":{"open":false}}"#;
const STOP: &str = r#"{"stop_motion":null}"#;

/// Clients that together have been everywhere.
fn visitors() -> Vec<Client> {
    let mut through = Client::commanding(position(Version::V2_7));
    for _ in 0..=through.cabinet.settings.robot.bridged_misses {
        through.next();
    }
    through.run(700, |_| {});
    through.ask(STOP);
    through.run(20, |_| {});
    through.ask(CLOSE);
    (0..10).for_each(|_| through.next());
    through.ask(r#"{"session":{"open":true}}"#);
    through.next();
    through.run(200, |_| {});
    let mut degraded = manual();
    degraded.run(300, |_| {});
    (0..7).for_each(|_| degraded.next());
    let mut closed_at_once = manual();
    // Nobody answers the first message.
    closed_at_once.next();
    closed_at_once.run(2, |_| {});
    closed_at_once.ask(CLOSE);
    closed_at_once.next();
    let mut not_mirrored = synchronising();
    let mut command = not_mirrored.mirror();
    joints(command.data.as_mut().expect("an overlay"))[0] += 0.02;
    not_mirrored.answer(&command);
    let [mut stopped, mut closed] = [synchronising(), synchronising()];
    stopped.ask(STOP);
    stopped.run(2, |_| {});
    closed.ask(CLOSE);
    closed.next();
    let mut cut = Client::commanding(position(Version::V2_7));
    cut.ask(CLOSE);
    cut.next();
    let mut estop = Client::commanding(position(Version::V2_7));
    estop.ask(r#"{"estop":null}"#);
    estop.run(600, |_| {});
    estop.ask(r#"{"ack":null}"#);
    estop.run(600, |_| {});
    let mut rare = Client::new(Settings {
        period_ms: 11,
        ..position(Version::V2_7)
    });
    rare.run(300, |_| {});
    vec![
        through,
        degraded,
        closed_at_once,
        not_mirrored,
        stopped,
        closed,
        cut,
        estop,
        rare,
        moved(),
    ]
}

/// A client that was moving when the cabinet's network lost it, and that mirrors while the arm comes to rest.
fn moved() -> Client {
    let mut client = Client::commanding(position(Version::V2_7));
    let (mut at, mut speed) = (client.cabinet.settings.robot.start, 0.0_f64);
    for _ in 0..300 {
        speed = (speed + 4e-6).min(4e-4);
        at[0] += speed;
        client.run(1, |data| data.position = Some(values(&at)));
    }
    client.ask(STOP);
    client.run(5, |_| {});
    client
}

#[test]
fn every_transition_of_the_session_is_visited_and_no_other() {
    use SessionState::{CommandingActive, CommandingWait, Idle, MonitoringReady, MonitoringWait};
    let visitors = visitors();
    let pairs = visitors.iter().flat_map(|client| {
        let states = client.states.windows(2);
        states.map(|pair| (pair[0] as i32, pair[1] as i32))
    });
    let visited: BTreeSet<(i32, i32)> = pairs.collect();
    let possible = [
        (Idle, MonitoringWait),
        (MonitoringWait, Idle),
        (MonitoringWait, MonitoringReady),
        (MonitoringWait, CommandingWait),
        (MonitoringReady, Idle),
        (MonitoringReady, MonitoringWait),
        (MonitoringReady, CommandingWait),
        (CommandingWait, Idle),
        (CommandingWait, MonitoringWait),
        (CommandingWait, MonitoringReady),
        (CommandingWait, CommandingActive),
        (CommandingActive, Idle),
        (CommandingActive, MonitoringWait),
        (CommandingActive, MonitoringReady),
    ];
    let possible = possible.map(|(from, to)| (from as i32, to as i32));
    assert_eq!(visited, possible.into_iter().collect());
}

#[test]
fn every_reason_to_wait_is_told() {
    let visitors = visitors();
    let reasons = visitors.iter().flat_map(|client| &client.waits);
    let told: BTreeSet<&str> = reasons.map(wait_name).collect();
    assert_eq!(told, all(WAITS));
}
