//! The driver with two drives in the conformance suite: the rules of joints that are moved by drives. What the drives are told is
//! tested in `axes`, and in a cell by the suite `ethercat_drives`.
//! Test code only.

use std::net::SocketAddr;

use rcc_driver_kit::conformance;
use rcc_driver_kit::conformance::{ObservedOutputs, Peer, Subject, Transport};
use rcc_driver_kit::driver::{Driver, DriverError};
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::{DeviceConfig, OnRelease, RobotConfig};
use rcc_driver_kit::rcc_core::primitive::ChannelKind;
use serde_json::{Value, json};

use super::{Ethercat, NAME, REASONS, SimulatedLine};
use crate::terminals::MODELS;

/// The line of the other subject, with two drives behind it.
struct DriveLine(SimulatedLine);

impl Peer for DriveLine {
    fn before_receive(&mut self) {}

    fn after_exchange(&mut self) {}

    fn set_present(&mut self, present: bool) {
        self.0.set_present(present);
    }
}

fn robot() -> RobotConfig {
    let text = include_str!("../../../../template/robot.yaml");
    RobotConfig::parse(text, "robot.yaml").unwrap_or_else(|faults| panic!("{faults}"))
}

fn axes() -> Value {
    let axis = |terminal: &str| {
        json!({"terminal": terminal, "counts_per_rad": 1e6, "following_window": "0.1 rad",
               "following_timeout": "1 s"})
    };
    json!({"turn": axis("turner"), "tilt": axis("tilter")})
}

impl Subject for DriveLine {
    type Driver = Ethercat;
    const NAME: &'static str = NAME;
    const REASONS: &'static [Reason] = REASONS;
    const TRANSPORT: Transport = Transport::UdpFromDriver;
    const HAS_CHECKSUM: bool = false;
    const CAN_BE_REPLAYED: bool = false;
    const BAD_SETTINGS: &'static [(&'static str, &'static str)] = &[
        ("axes", "{}"),
        ("axes", "{\"lift\": {}}"),
        ("axes", "{\"turn\": 1, \"tilt\": 2}"),
        ("period", "\"1.5 us\""),
    ];
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)] = &[
        (ChannelKind::DigitalOutput, "\"axes enabled\""),
        (ChannelKind::DigitalOutput, "\"turner bit 0\""),
        (ChannelKind::AnalogOutput, "\"tilter byte 2 i32\""),
    ];

    fn start() -> Self {
        DriveLine(SimulatedLine::of(MODELS.iter().chain(MODELS.last())))
    }

    fn address(&self) -> SocketAddr {
        self.0.address
    }

    fn device(at: SocketAddr) -> DeviceConfig {
        let mut device = SimulatedLine::device(at);
        let terminals = &mut device.settings["terminals"];
        terminals["turner"] = json!({"position": 5, "type": "CiA402"});
        terminals["tilter"] = json!({"position": 6, "type": "CiA402"});
        device.settings["axes"] = axes();
        // The rules are away for longer than one second.
        device.settings["watchdog"] = json!("6 s");
        device.robot = Some(robot());
        device
    }

    fn outputs(&mut self) -> ObservedOutputs {
        self.0.outputs()
    }
}

conformance!(drives: DriveLine);

fn refusal(change: impl FnOnce(&mut DeviceConfig)) -> DriverError {
    let mut device = DriveLine::device(([127, 0, 0, 1], 9).into());
    change(&mut device);
    Ethercat::open(&device).expect_err("a mistake")
}

#[test]
fn every_mistake_of_an_axis_is_told_with_its_key() {
    for (key, value, words) in [
        ("terminal", json!("nobody"), "invalid value"),
        ("terminal", json!("in"), "no drive"),
        ("terminal", json!("tilter"), "already that of"),
        ("counts_per_rad", json!(0), "invalid value"),
        ("counts_per_rad", json!(1e10), "more counts than 32 bits"),
        ("following_window", Value::Null, "invalid value"),
        ("following_window", json!("0 rad"), "invalid value"),
        ("following_window", json!("1 m"), "invalid value"),
        (
            "following_window",
            json!("0.0000004 rad"),
            "holds 1 to 4294967294 counts",
        ),
        (
            "following_window",
            json!("4294.967295 rad"),
            "holds 1 to 4294967294 counts",
        ),
        ("following_timeout", json!("0 ms"), "invalid value"),
        ("zero", json!(1), "invalid value"),
        ("statusword", json!(-1), "invalid value"),
        ("homing", json!(1), "unknown key"),
    ] {
        let error = refusal(|device| device.settings["axes"]["turn"][key] = value.clone());
        let words_of = error.to_string();
        // Two axes with one terminal: the second one is named.
        let joint = if words == "already that of" {
            "tilt"
        } else {
            "turn"
        };
        let path = format!("devices.device.settings.axes.{joint}.{key}: ");
        assert!(words_of.starts_with(&path), "{key} {value}: {words_of}");
        assert!(words_of.contains(words), "{key} {value}: {words_of}");
    }
    let error = refusal(|device| {
        let axes = device.settings["axes"].as_object_mut().expect("a table");
        axes.remove("tilt");
    });
    let words = "devices.device.settings.axes.tilt: is missing";
    assert!(error.to_string().starts_with(words), "{error}");
}

/// Opens a device whose first joint has this resolution, counts/rad, and this acceleration, rad/s².
fn with_acceleration(counts_per_rad: f64, acceleration: f64) -> Result<(), String> {
    let mut device = DriveLine::device(([127, 0, 0, 1], 9).into());
    device.settings["axes"]["turn"]["counts_per_rad"] = json!(counts_per_rad);
    let joint = &mut device.robot.as_mut().expect("a robot").joints[0];
    joint.acceleration_rad_s2 = acceleration;
    Ethercat::open(&device)
        .map(drop)
        .map_err(|error| error.to_string())
}

#[test]
fn a_quick_stop_that_the_drive_cannot_hold_is_refused_and_not_made_gentler() {
    // An encoder of 24 bits behind a gear of 160:1: 4.27e8 counts/rad.
    let resolution = f64::from(1 << 24) * 160.0 / std::f64::consts::TAU;
    for (counts_per_rad, acceleration) in [(resolution, 15.0), (-resolution, 15.0), (1e6, 4e-7)] {
        let error = with_acceleration(counts_per_rad, acceleration).expect_err("refused");
        let path = "devices.device.settings.axes.turn.counts_per_rad: ";
        assert!(error.starts_with(path), "{error}");
        assert!(
            error.contains("0x6085") && error.contains("acceleration of the joint in the robot"),
            "{error}"
        );
    }
    for (counts_per_rad, acceleration) in [(resolution, 10.0), (-resolution, 10.0), (1e6, 1e-6)] {
        with_acceleration(counts_per_rad, acceleration).unwrap_or_else(|error| panic!("{error}"));
    }
}

#[test]
fn the_output_that_permits_the_drives_cannot_hold() {
    let permits = |on_release| {
        move |device: &mut DeviceConfig| {
            let lamp = &mut device.channels[0];
            (lamp.address, lamp.on_release) = (json!("axes enable"), on_release);
        }
    };
    let error = refusal(permits(Some(OnRelease::Hold))).to_string();
    assert!(error.contains("stay enabled"), "{error}");
    let error = refusal(permits(Some(OnRelease::Safe(1.0)))).to_string();
    assert!(error.contains("{safe: false}"), "{error}");
    let error = refusal(|device| {
        permits(Some(OnRelease::Safe(0.0)))(device);
        device.channels[1].address = json!("axes enable");
        device.channels[1].on_release = Some(OnRelease::Safe(0.0));
    });
    assert!(error.to_string().contains("already the address"), "{error}");
}
