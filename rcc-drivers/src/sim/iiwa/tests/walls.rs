//! The arm pressed against a virtual wall: measured force over deflection is the stiffness of the application, whatever the
//! overlay commands.
//! Runs in the test harness.

use super::*;
use crate::sim::arm::model::geometry;
use crate::sim::arm::wall_fixture::{
    JointLoad, assert_joint_stiffness, assert_stiffness, wall_behind,
};

/// Stiffness of each joint, N·m/rad.
const JOINT: Joints = [100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0];
/// Stiffness along the axes, N/m.
const ALONG: [f64; 3] = [500.0, 2000.0, 5000.0];

fn sprung(version: Version, overlay: OverlayMode, law: ControlLaw) -> Settings {
    let mut impedance = ImpedanceSettings::default_for(law);
    match law {
        ControlLaw::JointImpedance => impedance.stiffness = JOINT,
        _ => impedance.stiffness[..3].copy_from_slice(&ALONG),
    }
    Settings {
        law,
        impedance,
        ..settings(version, overlay)
    }
}

/// Returns a client whose arm a wall with its normal along `axis` has pressed for 3 s.
fn pressed(settings: Settings, axis: usize, change: impl Fn(&mut CommandData)) -> Client {
    let mut client = Client::commanding(settings);
    let wall: serde_json::Value = wall_behind(client.cabinet.robot.geometry.position, axis);
    client.ask(&wall.to_string());
    client.run(3000, change);
    assert!(client.cabinet.is_commanded(), "{:?}", client.cabinet.fault);
    client
}

/// Asserts the stiffness of each joint that the wall and the added torques (N·m) load, from the values on the wire; returns
/// the number of loaded joints.
fn assert_joints(client: &Client, added: &Joints) -> usize {
    let sent = client.seen.data.as_ref().expect("sent");
    let own = client.seen.interpolator.as_ref().expect("a motion");
    let of = |values: &Option<JointValues>| values.clone().expect("sent").value;
    assert_joint_stiffness(&JointLoad {
        external: &of(&sent.external_torque),
        added,
        measured: &of(&sent.measured_position),
        held: &of(&own.position),
        stiffness: &JOINT,
    })
}

#[test]
fn joints_show_their_stiffness_in_every_overlay_of_joint_impedance() {
    let rows = [
        (Version::V1_11, OverlayMode::Torque),
        (Version::V1_14, OverlayMode::Torque),
        (Version::V2_5, OverlayMode::Position),
        (Version::V2_7, OverlayMode::Torque),
        (Version::V2_7, OverlayMode::CartesianPose),
    ];
    for (version, overlay) in rows {
        for axis in 0..3 {
            let settings = sprung(version, overlay, ControlLaw::JointImpedance);
            let client = pressed(settings, axis, |_| {});
            let loaded = assert_joints(&client, &[0.0; JOINTS]);
            assert!(loaded > 0, "{version:?} {overlay:?} axis {axis}");
        }
    }
}

#[test]
fn added_torques_press_on_top_of_the_springs() {
    let added = [0.0, 3.0, 0.0, -2.0, 0.0, 1.0, 0.0];
    let settings = sprung(
        Version::V1_14,
        OverlayMode::Torque,
        ControlLaw::JointImpedance,
    );
    let client = pressed(settings, 2, |data| data.torque = Some(values(&added)));
    assert!(assert_joints(&client, &added) > 1);
}

/// Returns the deflection of the flange along an axis, m.
fn deflection(client: &Client, axis: usize) -> f64 {
    let model = client.cabinet.settings.arm.model();
    let held = geometry(model, &client.cabinet.interpolated).position[axis];
    client.cabinet.robot.geometry.position[axis] - held
}

#[test]
fn the_flange_shows_its_stiffness_in_every_overlay_of_cartesian_impedance() {
    let rows = [
        (Version::V1_11, OverlayMode::Wrench),
        (Version::V1_14, OverlayMode::Position),
        (Version::V2_5, OverlayMode::CartesianPose),
        (Version::V2_7, OverlayMode::Wrench),
    ];
    for (version, overlay) in rows {
        for (axis, chosen) in ALONG.into_iter().enumerate() {
            let settings = sprung(version, overlay, ControlLaw::CartesianImpedance);
            let client = pressed(settings, axis, |_| {});
            let force = client.cabinet.robot.wrench[axis];
            assert_stiffness(force, deflection(&client, axis), chosen);
            let sent = client.seen.data.as_ref().expect("sent");
            let told = sent.external_force.as_ref().map(|told| told.element[axis]);
            assert_eq!(told, (version == Version::V2_7).then_some(force));
        }
    }
}

#[test]
fn an_added_wrench_presses_on_top_of_the_springs() {
    let settings = sprung(
        Version::V2_7,
        OverlayMode::Wrench,
        ControlLaw::CartesianImpedance,
    );
    // At the start the flange points down: its z is opposite to that of the base.
    let client = pressed(settings, 2, |data| {
        data.wrench = Some(CartesianVector {
            element: vec![0.0, 0.0, 8.0, 0.0, 0.0, 0.0],
        });
    });
    let added = client.cabinet.robot.impedance.added[2];
    assert!((added + 8.0).abs() < 0.01, "{added}");
    let force = client.cabinet.robot.wrench[2] + added;
    assert_stiffness(force, deflection(&client, 2), ALONG[2]);
}
