//! Answers in each overlay: joint positions, torques, wrenches and poses.

use rcc_core::impedance::{ControlMode, Impedance};
use rcc_core::kinematics::{Arm, SrsArm};
use rcc_core::pose::Pose;

use super::*;
use crate::fri_iiwa::wire::schema::{CartesianVector, CommandData, Transformation};

/// Returns a message of a motion that becomes active with the third one.
fn commanding(sequence: u32) -> Monitoring {
    let state = match sequence {
        ..3 => COMMANDING_WAIT,
        _ => COMMANDING_ACTIVE,
    };
    message(sequence, state)
}

/// Goes through the states of an overlay; returns the session, and the content of the last answer.
fn overlay(device: &DeviceConfig, mode: i32, outputs: &Outputs) -> (IiwaSession, CommandData) {
    let version = Version::V2_5;
    let mut session = session_of(device, version);
    let mut last = CommandData::default();
    for sequence in 1..=8 {
        let mut message = commanding(sequence);
        let own = message.interpolator.as_mut().expect("set above");
        own.command_mode = Some(mode);
        own.pose = Some(own_pose());
        own.redundancy = Some(Redundancy {
            strategy: Some(0),
            value: Some(OWN),
        });
        let bytes = encode(version, &message).expect("it fits");
        session.accept(&bytes).expect("a good message");
        let answer = session.answer(outputs).expect("it is answered");
        let answer: Command = decode(version, &answer).expect("its own bytes");
        last = answer.data.expect("sent");
        if sequence <= 5 {
            let zeros = |values: &[f64]| values.iter().all(|value| *value == 0.0);
            assert!(
                last.torque
                    .as_ref()
                    .is_none_or(|torque| zeros(&torque.value))
            );
            assert!(
                last.wrench
                    .as_ref()
                    .is_none_or(|wrench| zeros(&wrench.element))
            );
            assert!(last.pose.is_none() || last.pose == Some(own_pose()));
            let own = last.position.as_ref();
            assert!(own.is_none_or(|position| position.value == [OWN; JOINTS]));
        }
        session.exchange(&mut Inputs::NONE.clone());
    }
    (session, last)
}

/// A pose that the arm of the demo may have with a tool of some kind.
fn own_pose() -> Transformation {
    Transformation {
        name: Some(String::new()),
        element: vec![100.0, 200.0, 300.0, 1.0, 0.0, 0.0, 0.0],
        timestamp: None,
    }
}

/// The arm of the demo with the springs of an application.
fn sprung() -> DeviceConfig {
    let mut device = arm();
    let robot = device.robot.as_mut().expect("an arm");
    let limits = robot.impedance.as_mut().expect("an LWR has springs");
    limits.translation = [2000.0; 2];
    limits.rotation = [200.0; 2];
    limits.joint = [1000.0; 2];
    limits.damping = [0.7; 2];
    device
}

fn pressing(strategy: ControlMode) -> Outputs {
    Outputs {
        position: [0.3; JOINTS_MAX],
        impedance: Impedance {
            strategy: strategy as u64,
            added: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0],
            ..Impedance::NONE
        },
        ..Outputs::NONE
    }
}

#[test]
fn without_the_springs_of_the_application_torques_and_wrenches_are_zero() {
    for (mode, strategy) in [
        (2, ControlMode::CartesianImpedance),
        (3, ControlMode::JointImpedance),
    ] {
        let (mut session, last) = overlay(&arm(), mode, &pressing(strategy));
        assert_eq!(last.position.expect("required").value, [OWN; JOINTS]);
        let exchange = session.exchange(&mut Inputs::NONE.clone());
        assert_eq!((exchange.commandable, exchange.reason), (false, SPRINGS));
    }
}

#[test]
fn with_its_springs_torques_and_wrenches_are_commanded_beside_the_position() {
    let (mut session, last) = overlay(&sprung(), 3, &pressing(ControlMode::JointImpedance));
    let exchange = session.exchange(&mut Inputs::NONE.clone());
    assert_eq!(
        (exchange.startable, exchange.strategy),
        (true, ControlMode::JointImpedance)
    );
    assert_eq!(last.position.expect("required").value, [0.3; JOINTS]);
    let torque = last.torque.expect("the overlay's");
    assert_eq!(torque.value, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    let (mut session, last) = overlay(&sprung(), 2, &pressing(ControlMode::CartesianImpedance));
    let exchange = session.exchange(&mut Inputs::NONE.clone());
    let strategy = ControlMode::CartesianImpedance;
    assert_eq!((exchange.startable, exchange.strategy), (true, strategy));
    // KUKA turns about z first.
    // The demo's arm has joints that turn as an LWR's: its axes x and y are opposite to those of an iiwa.
    let wrench = last.wrench.expect("the overlay's").element;
    assert_eq!(wrench, [-1.0, -2.0, 3.0, 6.0, -5.0, -4.0]);
    // Added torques of joint impedance are not sent in the wrench overlay.
    let (_, last) = overlay(&sprung(), 2, &pressing(ControlMode::JointImpedance));
    assert_eq!(last.wrench.expect("the overlay's").element, [0.0; 6]);
}

#[test]
fn an_overlay_of_a_pose_gets_the_pose_of_the_commanded_joints() {
    let (mut session, last) = overlay(&arm(), 4, &pressing(ControlMode::Position));
    let exchange = session.exchange(&mut Inputs::NONE.clone());
    assert_eq!(
        (exchange.startable, exchange.strategy),
        (true, ControlMode::Position)
    );
    assert_eq!(last.position, None);
    assert_eq!(last.redundancy.and_then(|found| found.value), Some(0.3));
    // In the robot's own base A2, A4 and A6 turn in the other direction.
    let Some(Arm::Srs(described)) = arm().model().arm else {
        panic!("an arm with seven joints");
    };
    let signs = [1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0];
    let arm = Arm::Srs(SrsArm { signs, ..described });
    let own = arm.forward(&[OWN; JOINTS_MAX]);
    let held = Pose {
        position: [0.1, 0.2, 0.3],
        orientation: [0.0, 0.0, 0.0, 1.0],
    };
    let tool = own.inverse().compose(&held);
    let expected = arm.forward(&[0.3; JOINTS_MAX]).compose(&tool);
    let sent = last.pose.expect("the overlay's").element;
    for (axis, metres) in expected.position.into_iter().enumerate() {
        assert!((sent[axis] - metres * 1e3).abs() < 1e-9, "{sent:?}");
    }
    let [i, j, k, w] = expected.orientation;
    for (sent, part) in sent[3..].iter().zip([w, i, j, k]) {
        assert!((sent - part).abs() < 1e-12);
    }
}

#[test]
fn an_overlay_of_a_pose_without_a_pose_cannot_be_commanded() {
    let mut session = session(Version::V2_7);
    for sequence in 1..=8 {
        let mut message = commanding(sequence);
        message
            .interpolator
            .as_mut()
            .expect("set above")
            .command_mode = Some(4);
        answer(&mut session, Version::V2_7, &message).expect("it is answered");
    }
    let exchange = session.exchange(&mut Inputs::NONE.clone());
    assert_eq!(
        (exchange.commandable, exchange.reason),
        (false, COMMAND_MODE)
    );
}

#[test]
fn a_measured_wrench_is_told_in_the_axes_of_the_robots_file() {
    let mut session = session(Version::V2_7);
    let mut message = message(1, MONITORING_READY);
    message.data.as_mut().expect("set above").external_force = Some(CartesianVector {
        element: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
    });
    session
        .accept(&encode(Version::V2_7, &message).expect("it fits"))
        .expect("a good message");
    let mut inputs = Inputs::NONE;
    session.exchange(&mut inputs);
    assert_eq!(inputs.wrench, [-1.0, -2.0, 3.0, -6.0, -5.0, 4.0]);
}
