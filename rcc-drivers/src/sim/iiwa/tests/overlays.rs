//! Commands and required fields of each overlay, and the deflection of the arm.
//! Runs in the test harness.

use super::*;
use crate::sim::arm::model::geometry;
use crate::sim::iiwa::pose::to_wire;
use crate::sim::iiwa::settings::Selector;

const OVERLAYS: [OverlayMode; 4] = [
    OverlayMode::Position,
    OverlayMode::Wrench,
    OverlayMode::Torque,
    OverlayMode::CartesianPose,
];

/// Every overlay in every version that has it.
fn all() -> impl Iterator<Item = (Version, OverlayMode)> {
    let pairs = VERSIONS
        .into_iter()
        .flat_map(|version| OVERLAYS.map(|overlay| (version, overlay)));
    pairs.filter(|(version, overlay)| *overlay != OverlayMode::CartesianPose || version.is_second())
}

#[test]
fn every_overlay_of_every_version_is_entered_and_held() {
    for (version, overlay) in all() {
        let mut client = Client::commanding(settings(version, overlay));
        client.run(300, |_| {});
        assert!(client.cabinet.is_commanded(), "{version:?} {overlay:?}");
        let start = client.cabinet.settings.robot.start;
        for (now, start) in client.cabinet.robot.arm.position.into_iter().zip(start) {
            assert!((now - start).abs() < 1e-7, "{version:?} {overlay:?}");
        }
        let own = client
            .seen
            .interpolator
            .as_ref()
            .expect("while it commands");
        assert_eq!(own.tracking_performance, Some(1.0));
        assert_eq!(own.pose.is_some(), version.is_second());
        let data = client.seen.data.as_ref().expect("sent");
        assert_eq!(data.commanded_position.is_some(), !version.is_second());
        assert_eq!(data.external_force.is_some(), version == Version::V2_7);
        assert_eq!(data.redundancy.is_some(), version.is_second());
    }
}

#[test]
fn the_interpolated_position_stays_where_the_motion_began() {
    let mut client = Client::commanding(position(Version::V1_14));
    let start = client.cabinet.settings.robot.start;
    for step in 0..400 {
        client.run(1, |data| {
            let mut target = start;
            target[3] += 1e-4 * f64::from(step);
            data.position = Some(values(&target));
        });
    }
    let own = client
        .seen
        .interpolator
        .as_ref()
        .expect("while it commands");
    assert_eq!(own.position, Some(values(&start)));
    let data = client.seen.data.as_ref().expect("sent");
    let commanded = data.commanded_position.as_ref().expect("1.x").value[3];
    assert!((commanded - start[3] - 0.0399).abs() < 1e-9, "{commanded}");
    assert!(client.cabinet.robot.arm.position[3] > start[3] + 0.03);
}

#[test]
fn with_a_receive_multiplier_the_set_point_moves_in_every_period() {
    let mut client = Client::commanding(Settings {
        multiplier: 5,
        ..position(Version::V2_5)
    });
    let start = client.cabinet.settings.robot.start;
    let mut last = client.cabinet.robot.desired[0];
    let mut steps = Vec::new();
    for cycle in 0..200 {
        client.run(1, |data| {
            let mut target = start;
            target[0] += 2e-4 * f64::from(cycle);
            data.position = Some(values(&target));
        });
        steps.push(client.cabinet.robot.desired[0] - last);
        last = client.cabinet.robot.desired[0];
    }
    for step in &steps[20..] {
        assert!((step - 2e-4).abs() < 1e-9, "{step}");
    }
}

#[test]
fn a_pose_moves_the_arm_to_the_joints_that_have_it() {
    for version in [Version::V2_5, Version::V2_7] {
        let mut client = Client::commanding(settings(version, OverlayMode::CartesianPose));
        let model = client.cabinet.settings.arm.model();
        let mut target = client.cabinet.settings.robot.start;
        for _ in 0..300 {
            target[1] += 1e-4;
            target[2] -= 2e-4;
            client.run(1, |data| {
                data.pose = Some(to_wire(&geometry(model, &target)));
                data.redundancy.as_mut().expect("mirrored").value = Some(target[2]);
            });
        }
        for (now, target) in client.cabinet.robot.desired.into_iter().zip(target) {
            assert!((now - target).abs() < 1e-6, "{now} {target}");
        }
    }
}

#[test]
fn torques_and_wrenches_deflect_the_springs() {
    let mut client = Client::commanding(settings(Version::V1_14, OverlayMode::Torque));
    let start = client.cabinet.settings.robot.start;
    client.run(3000, |data| {
        data.torque = Some(values(&[0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    });
    let off = client.cabinet.robot.arm.position[1] - start[1];
    assert!((off - 5.0 / 1000.0).abs() < 1e-6, "{off}");
    let mut client = Client::commanding(settings(Version::V2_7, OverlayMode::Wrench));
    let before = client.cabinet.robot.geometry;
    client.run(4000, |data| {
        data.wrench = Some(CartesianVector {
            element: vec![0.0, 0.0, 10.0, 0.0, 0.0, 0.0],
        });
    });
    // The axes are those of the flange.
    let moved = client.cabinet.robot.geometry.position;
    for (axis, moved) in moved.iter().enumerate() {
        let expected = 10.0 / 2000.0 * before.rotation[axis][2];
        let off = moved - before.position[axis];
        assert!((off - expected).abs() < 5e-5, "{axis}: {off} {expected}");
    }
    client.ask(r#"{"stop_motion":null}"#);
    client.run(5, |_| {});
    assert_eq!(client.cabinet.robot.impedance.added, [0.0; JOINTS]);
}

#[test]
fn what_an_overlay_needs_must_be_there_while_the_robot_synchronises_and_afterwards() {
    type Change = fn(&mut CommandData);
    let rows: [(OverlayMode, Change, i32); 9] = [
        (OverlayMode::Position, |data| data.position = None, 8),
        (OverlayMode::Wrench, |data| data.wrench = None, 8),
        (OverlayMode::Wrench, |data| data.position = None, 8),
        (OverlayMode::Torque, |data| data.torque = None, 8),
        (OverlayMode::CartesianPose, |data| data.pose = None, 8),
        (OverlayMode::Position, |data| first(data)[0] += 0.02, 3),
        (OverlayMode::Position, |data| first(data)[6] = f64::NAN, 7),
        (OverlayMode::CartesianPose, |data| pose(data)[2] += 2.0, 3),
        (OverlayMode::CartesianPose, |data| pose(data)[3] += 0.1, 12),
    ];
    for (overlay, change, code) in rows {
        let mut client = Client::new(settings(Version::V2_5, overlay));
        while client.session() != SessionState::CommandingWait {
            client.run(1, |_| {});
        }
        let mut command = client.mirror();
        change(command.data.as_mut().expect("an overlay"));
        match code {
            // Before commands are executed, such a datagram is not even taken.
            7 => assert!(!client.send(&command)),
            _ => {
                client.answer(&command);
                assert_eq!(client.fault_code(), Some(code), "{overlay:?}");
                assert_eq!(client.session(), SessionState::MonitoringWait);
            }
        }
        let mut client = Client::commanding(settings(Version::V2_5, overlay));
        client.run(1, change);
        let code = if code == 7 { 3 } else { code };
        assert_eq!(
            client.fault_code(),
            Some(code),
            "{:?}",
            client.cabinet.fault
        );
    }
}

fn first(data: &mut CommandData) -> &mut Vec<f64> {
    &mut data.position.as_mut().expect("mirrored").value
}

fn pose(data: &mut CommandData) -> &mut Vec<f64> {
    &mut data.pose.as_mut().expect("mirrored").element
}

/// Commands this once, after the entry; returns the code of the fault.
fn fault_of(settings: Settings, change: impl Fn(&mut CommandData)) -> Option<i32> {
    let mut client = Client::commanding(settings);
    client.run(20, |_| {});
    client.run(1, change);
    assert!(!client.cabinet.is_commanded());
    let text = client.cabinet.snapshot().robot.fault.expect("a fault");
    assert!(!text.is_empty());
    client.fault_code()
}

#[test]
fn every_limit_ends_the_motion_and_is_named() {
    let at = position(Version::V1_14);
    assert_eq!(fault_of(at.clone(), |data| first(data)[3] = -2.2), Some(4));
    assert_eq!(fault_of(at.clone(), |data| first(data)[0] += 0.01), Some(5));
    assert_eq!(fault_of(at.clone(), |data| first(data)[0] += 1e-3), Some(6));
    assert_eq!(fault_of(at, |data| first(data)[2] = f64::NAN), Some(7));
    let torque = settings(Version::V2_5, OverlayMode::Torque);
    let set =
        |value: f64| move |data: &mut CommandData| data.torque = Some(values(&[value; JOINTS]));
    assert_eq!(fault_of(torque.clone(), set(f64::NAN)), Some(7));
    assert_eq!(fault_of(torque.clone(), set(41.0)), Some(11));
    let wrench = settings(Version::V2_5, OverlayMode::Wrench);
    let not_finite = |data: &mut CommandData| {
        data.wrench = Some(CartesianVector {
            element: vec![f64::INFINITY; 6],
        });
    };
    assert_eq!(fault_of(wrench.clone(), not_finite), Some(7));
    // The lever to A2 is 0.55 m, and A2 has 176 N·m.
    let strong = |data: &mut CommandData| {
        data.wrench = Some(CartesianVector {
            element: vec![0.0, 0.0, 400.0, 0.0, 0.0, 0.0],
        });
    };
    assert_eq!(fault_of(wrench, strong), Some(11));
    let cartesian = settings(Version::V2_7, OverlayMode::CartesianPose);
    let far = |data: &mut CommandData| pose(data)[2] += 3000.0;
    assert_eq!(fault_of(cartesian.clone(), far), Some(12));
    let no_number = |data: &mut CommandData| pose(data)[0] = f64::NAN;
    assert_eq!(fault_of(cartesian, no_number), Some(7));
}

#[test]
fn torques_that_drive_the_arm_away_end_the_motion() {
    let mut soft = settings(Version::V2_5, OverlayMode::Torque);
    soft.impedance.stiffness = [0.0; JOINTS];
    let mut client = Client::commanding(soft);
    for _ in 0..3000 {
        client.run(1, |data| {
            data.torque = Some(values(&[0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0]))
        });
        if client.fault_code().is_some() {
            break;
        }
    }
    assert_eq!(client.fault_code(), Some(13));
}

#[test]
fn in_t1_the_flange_is_slow() {
    let run = |selector: Selector| {
        let mut client = Client::commanding(Settings {
            selector,
            ..position(Version::V1_14)
        });
        let start = client.cabinet.settings.robot.start;
        let mut at = start;
        let mut speed = 0.0_f64;
        for _ in 0..300 {
            speed = (speed + 4e-6).min(8e-4);
            at[0] += speed;
            client.run(1, |data| data.position = Some(values(&at)));
        }
        client.fault_code()
    };
    assert_eq!(run(Selector::T1), Some(14));
    assert_eq!(run(Selector::T2), None);
    assert_eq!(run(Selector::Aut), None);
}
