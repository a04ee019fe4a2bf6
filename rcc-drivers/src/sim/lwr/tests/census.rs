//! Every state of the controller, every refusal of a datagram, every fault and every reason to stay in monitor state, in
//! lock-step.
//! Runs in the test harness.

use std::collections::BTreeSet;

use super::impedance::{SOFT, settings as soft};
use super::*;
use crate::fri_lwr::wire::WireError;
use crate::sim::census::{all, variants};
use crate::sim::lwr::fault::{DatagramRefusal, MirrorError};

variants!(REFUSALS, refusal_name, DatagramRefusal:
    DatagramRefusal::Wire(WireError::Size { .. }),
    DatagramRefusal::Wire(WireError::Identity { .. }),
    DatagramRefusal::Wire(WireError::PacketSize { .. }),
    DatagramRefusal::Wire(WireError::UnknownValue { .. }),
    DatagramRefusal::Late { .. },
    DatagramRefusal::Duplicate { .. },
    DatagramRefusal::NotFinite,
);

/// A command datagram has no field of an enumeration.
const NOT_OF_A_COMMAND: &str = "DatagramRefusal::Wire(WireError::UnknownValue { .. })";

variants!(FAULTS, fault_name, KrcFault:
    KrcFault::Lost { .. },
    KrcFault::Quality { .. },
    KrcFault::Mirror(MirrorError::Joint { .. }),
    KrcFault::Mirror(MirrorError::Pose { .. }),
    KrcFault::Stream(StreamFault::Position { .. }),
    KrcFault::Stream(StreamFault::Velocity { .. }),
    KrcFault::Stream(StreamFault::Acceleration { .. }),
    KrcFault::Stream(StreamFault::NotFinite { .. }),
    KrcFault::Flags { .. },
    KrcFault::EmergencyStop,
    KrcFault::DrivesOff,
    KrcFault::Impedance { .. },
    KrcFault::Pose { .. },
    KrcFault::Rotation,
    KrcFault::Unreachable { .. },
    KrcFault::Runaway(_),
    KrcFault::Added { .. },
);

variants!(WAITS, wait_name, MonitorReason:
    MonitorReason::Acknowledgement,
    MonitorReason::EmergencyStop,
    MonitorReason::Drives,
    MonitorReason::Rest,
    MonitorReason::Answer,
    MonitorReason::Quality { .. },
    MonitorReason::Flags { .. },
    MonitorReason::Mirror(MirrorError::Joint { .. }),
    MonitorReason::Mirror(MirrorError::Pose { .. }),
    MonitorReason::Request { .. },
    MonitorReason::Closing,
);

#[test]
fn every_refusal_is_provoked_counted_and_told_and_the_next_answer_is_taken() {
    type Provoke = fn(&mut Pc) -> Vec<u8>;
    let rows: [Provoke; 7] = [
        |pc| pc.mirror().encode()[..375].to_vec(),
        |pc| changed_byte(pc, 6),
        |pc| changed_byte(pc, 4),
        |pc| {
            let late = CommandDatagram {
                reflected_sequence: pc.seen.send_sequence.wrapping_sub(1),
                ..pc.mirror()
            };
            late.encode().to_vec()
        },
        |pc| {
            let good = pc.mirror().encode();
            assert_eq!(pc.krc.receive(&good, 1e-4), Ok(()));
            good.to_vec()
        },
        |pc| {
            // Its counter goes back in command state.
            pc.mirror_for(200);
            assert_eq!(pc.state(), SessionState::Command);
            let back = CommandDatagram {
                send_sequence: pc.sequence.wrapping_sub(7),
                ..pc.mirror()
            };
            back.encode().to_vec()
        },
        |pc| {
            let mut answer = pc.mirror();
            answer.joint_position[6] = f32::INFINITY;
            answer.encode().to_vec()
        },
    ];
    let mut seen = BTreeSet::from([NOT_OF_A_COMMAND]);
    for provoke in rows {
        let mut pc = Pc::new(Settings::default());
        pc.mirror_for(5);
        let bytes = provoke(&mut pc);
        let refusal = pc.krc.receive(&bytes, 1e-4).expect_err("refused");
        assert_eq!(pc.krc.counts.refused, 1, "{refusal}");
        let told = pc.krc.snapshot().robot.last_refusal;
        assert_eq!(told, Some(refusal.to_string()));
        seen.insert(refusal_name(&refusal));
        pc.miss();
        let answered = pc.krc.counts.answered;
        pc.mirror_for(20);
        assert_eq!(pc.krc.counts.answered, answered + 20, "{refusal}");
        assert_eq!((pc.krc.fault, pc.krc.counts.refused), (None, 1));
        pc.execute(r#"{"reset_statistics":null}"#);
        assert_eq!(pc.krc.snapshot().robot.last_refusal, None);
    }
    assert_eq!(seen, all(REFUSALS));
}

fn changed_byte(pc: &mut Pc, offset: usize) -> Vec<u8> {
    let mut bytes = pc.mirror().encode().to_vec();
    bytes[offset] ^= 1;
    bytes
}

/// Returns a PC that has just entered command state, with these flags, and whose first command is still to come.
fn entering(settings: Settings, flags: u32) -> Pc {
    let mut pc = Pc::new(settings);
    while pc.state() == SessionState::Monitor {
        assert!(pc.krc.robot.tick < 1000, "{:?}", pc.krc.monitor_reason);
        pc.soft_for(1, |answer| answer.flags = flags);
    }
    pc
}

/// Flags of a Cartesian client that commands no joint positions.
const POSE_ALONE: u32 = 0x3500;

fn one(change: fn(&mut CommandDatagram)) -> impl Fn(&mut Pc) {
    move |pc| {
        let mut answer = pc.mirror();
        change(&mut answer);
        pc.answer(&answer);
    }
}

fn one_soft(change: fn(&mut CommandDatagram)) -> impl Fn(&mut Pc) {
    move |pc| pc.soft_for(1, change)
}

/// A client in command state, and what it then does.
type Case = (Pc, Box<dyn Fn(&mut Pc)>);

fn cases() -> Vec<Case> {
    let at = || Pc::commanding(Settings::default());
    let [cartesian, joint] = SOFT.map(|law| move || Pc::soft_commanding(law));
    let mut patient = Settings::default();
    patient.robot.bridged_misses = 200;
    let pose = || entering(soft(SOFT[0]), POSE_ALONE);
    let miss: fn(&mut Pc) = |pc| {
        while pc.krc.fault.is_none() {
            assert!(pc.krc.robot.tick < 1000);
            pc.miss();
        }
    };
    let limp: fn(&mut Pc) = |pc| {
        while pc.krc.fault.is_none() {
            assert!(pc.krc.robot.tick < 5000);
            pc.soft_for(1, |answer| {
                answer.joint_stiffness = [0.0; JOINTS];
                answer.joint_damping = [0.0; JOINTS];
                answer.additional_joint_torque[6] = 5.0;
            });
        }
    };
    vec![
        (at(), Box::new(miss)),
        (Pc::commanding(patient), Box::new(miss)),
        (
            entering(Settings::default(), flags::JOINT_POSITION),
            Box::new(one(|answer| answer.joint_position[2] += 0.02)),
        ),
        (
            pose(),
            Box::new(one_soft(|answer| {
                answer.flags = POSE_ALONE;
                answer.cartesian_position[7] += 0.002;
            })),
        ),
        (
            at(),
            Box::new(one(|answer| answer.joint_position[3] = -2.2)),
        ),
        (
            at(),
            Box::new(one(|answer| answer.joint_position[0] += 0.01)),
        ),
        (
            at(),
            Box::new(one(|answer| answer.joint_position[0] += 1e-3)),
        ),
        (
            at(),
            Box::new(one(|answer| answer.joint_position[2] = f32::NAN)),
        ),
        (
            at(),
            Box::new(one(|answer| answer.flags |= flags::JOINT_TORQUE)),
        ),
        (at(), Box::new(|pc| pc.execute(r#"{"estop":null}"#))),
        (
            at(),
            Box::new(|pc| pc.execute(r#"{"drives":{"on":false}}"#)),
        ),
        (
            cartesian(),
            Box::new(one_soft(|answer| answer.cartesian_stiffness[2] = 5001.0)),
        ),
        (
            cartesian(),
            Box::new(one_soft(|answer| answer.cartesian_position[7] += 0.1)),
        ),
        (
            cartesian(),
            Box::new(one_soft(|answer| answer.cartesian_position[0] *= 1.01)),
        ),
        (
            pose(),
            Box::new(|pc| {
                pc.soft_for(1, |answer| answer.flags = POSE_ALONE);
                pc.soft_for(1, |answer| {
                    answer.flags = POSE_ALONE;
                    answer.cartesian_position[7] += 5.0;
                });
            }),
        ),
        (joint(), Box::new(limp)),
        (
            entering(soft(SOFT[1]), SOFT[1].flags()),
            Box::new(one_soft(|answer| answer.additional_joint_torque[1] = 1.5)),
        ),
    ]
}

#[test]
fn every_fault_is_provoked_and_told() {
    let mut seen = BTreeSet::new();
    for (mut pc, provoke) in cases() {
        provoke(&mut pc);
        let fault = pc.krc.fault.expect("a fault");
        seen.insert(fault_name(&fault));
        assert!(!pc.krc.in_command_state() && !pc.krc.drives_on(), "{fault}");
        let told = pc.krc.snapshot().robot.faults;
        let (code, reason) = (fault.code(), fault.to_string());
        let last = told.last().expect("it is told");
        assert_eq!((last.code, &last.reason), (code, &reason));
        // The KRL program tells the PC.
        pc.miss();
        assert_eq!((pc.seen.krl.integers[1], pc.seen.power), (code, 0));
    }
    assert_eq!(seen, all(FAULTS));
}

/// PCs that together have been everywhere.
fn visitors() -> Vec<Pc> {
    let mut through = Pc::moving(Settings::default(), 0.5);
    (0..6).for_each(|_| through.miss());
    // The fault is acknowledged, and command state entered again.
    through.mirror_for(1500);
    assert_eq!(through.state(), SessionState::Command);
    through.execute(r#"{"quit":null}"#);
    through.mirror_for(10);
    let mut ended = Pc::moving(Settings::default(), 0.5);
    for _ in 0..600 {
        let mut answer = ended.mirror();
        answer.krl.integers[0] = 2;
        ended.answer(&answer);
    }
    let mut estop = Pc::commanding(Settings::default());
    estop.execute(r#"{"estop":null}"#);
    estop.mirror_for(100);
    let mut off = Pc::new(Settings::default());
    off.execute(r#"{"drives":{"on":false}}"#);
    off.mirror_for(200);
    let mut silent = Pc::new(Settings::default());
    (0..5).for_each(|_| silent.miss());
    let mut flagged = Pc::new(Settings::default());
    flagged.soft_for(200, |answer| answer.flags = 0x0500);
    let mut elsewhere = Pc::new(Settings::default());
    elsewhere.soft_for(200, |answer| answer.joint_position[5] += 0.02);
    let mut pose = Pc::new(soft(SOFT[0]));
    pose.soft_for(200, |answer| answer.cartesian_position[7] += 0.002);
    // An arm that is pushed in monitor state yields, and comes to rest again.
    let mut pushed = Pc::new(soft(SOFT[0]));
    pushed.execute(r#"{"wrench":{"force":[0,20,0],"torque":[0,0,0]}}"#);
    pushed.soft_for(3000, |answer| answer.krl.integers[0] = 2);
    vec![
        through, ended, estop, off, silent, flagged, elsewhere, pose, pushed,
    ]
}

#[test]
fn every_transition_is_visited_and_no_other() {
    let visitors = visitors();
    let pairs = visitors.iter().flat_map(|pc| pc.phases.windows(2));
    let visited: BTreeSet<(Phase, Phase)> = pairs.map(|pair| (pair[0], pair[1])).collect();
    let possible = [
        (Phase::Rest, Phase::Command),
        (Phase::Command, Phase::Rest),
        (Phase::Command, Phase::Moving),
        (Phase::Moving, Phase::Rest),
        (Phase::Rest, Phase::Moving),
    ];
    assert_eq!(visited, possible.into_iter().collect());
}

#[test]
fn every_reason_to_stay_in_monitor_state_is_told() {
    let visitors = visitors();
    let reasons = visitors.iter().flat_map(|pc| &pc.waits);
    let told: BTreeSet<&str> = reasons.map(wait_name).collect();
    assert_eq!(told, all(WAITS));
}
