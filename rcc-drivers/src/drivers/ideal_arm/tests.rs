//! The ideal arm: the conformance rules that need no wire, and its position after a command.
//! Test code only.

use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

use rcc_config::{DeviceConfig, OnRelease};
use rcc_core::message::{ANALOG_MAX, Joints};
use rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use serde_json::json;

use super::{IdealArm, REASONS, RELEASED};
use rcc_driver_kit::conformance;
use rcc_driver_kit::conformance::{ObservedOutputs, Peer, Subject, Transport, device, rules};
use rcc_driver_kit::driver::{Driver, Exchange, Inputs, Outputs};
use rcc_driver_kit::host::reason::Reason;

/// There is no other end of the wire: only the rules about the configuration apply.
struct Nobody(UdpSocket);

impl Peer for Nobody {
    fn before_receive(&mut self) {}
    fn after_exchange(&mut self) {}
    fn set_present(&mut self, _: bool) {}
}

fn arm() -> DeviceConfig {
    let safe = Some(OnRelease::Safe(0.0));
    let channels = [
        ("lamp", DigitalOutput, 1.into(), safe, None),
        (
            "clamp",
            DigitalOutput,
            2.into(),
            Some(OnRelease::Hold),
            None,
        ),
        ("clamped", DigitalInput, 2.into(), None, None),
        ("lamp_on", DigitalInput, 1.into(), None, None),
        ("speed", AnalogOutput, 1.into(), safe, Some([0.0, 0.5])),
        ("speed_is", AnalogInput, 1.into(), None, None),
    ];
    DeviceConfig {
        robot: rules::some_robot().robot,
        ..device(
            "ideal-arm",
            json!({"start": [0, "-30 deg", 0, 1.5, 0, "-60 deg", 0], "period": "1 ms"}),
            &channels,
        )
    }
}

impl Subject for Nobody {
    type Driver = IdealArm;
    const NAME: &'static str = "ideal-arm";
    const REASONS: &'static [Reason] = REASONS;
    const TRANSPORT: Transport = Transport::UdpFromDriver;
    const HAS_CHECKSUM: bool = true;
    const BAD_SETTINGS: &'static [(&'static str, &'static str)] = &[
        ("start", "[0, 0, 0]"),
        ("start", "[0, 9, 0, 0, 0, 0, 0]"),
        ("start", "[0, \"1 m\", 0, 0, 0, 0, 0]"),
        ("period", "\"0 ms\""),
    ];
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)] = &[
        (DigitalInput, "0"),
        (DigitalOutput, "65"),
        (AnalogOutput, "17"),
    ];

    fn start() -> Self {
        Nobody(UdpSocket::bind("127.0.0.1:0").expect("loopback"))
    }

    fn address(&self) -> SocketAddr {
        self.0.local_addr().expect("an address")
    }

    fn device(_: SocketAddr) -> DeviceConfig {
        arm()
    }

    fn outputs(&mut self) -> ObservedOutputs {
        ObservedOutputs {
            digital: 0,
            analog: [f64::NAN; ANALOG_MAX],
        }
    }
}

conformance!(tests of Nobody:
    opens_what_is_right,
    refuses_a_setting_that_it_does_not_have,
    refuses_each_setting_of_another_form,
    refuses_each_setting_out_of_range,
    says_which_setting_is_missing,
    refuses_each_channel_of_a_wrong_address,
    refuses_two_outputs_at_one_address,
);

fn exchange(driver: &mut IdealArm, outputs: &Outputs) -> (Exchange, Inputs) {
    let mut inputs = Inputs::NONE;
    let exchange = driver.receive(Duration::from_secs(1), &mut inputs);
    let exchange = exchange.unwrap();
    driver.send(outputs).unwrap();
    (exchange, inputs)
}

fn at(position: Joints) -> Outputs {
    Outputs {
        position,
        ..Outputs::NONE
    }
}

#[test]
fn it_begins_where_its_settings_say_and_is_then_where_it_was_told_to_be_in_the_period_before() {
    let mut driver = IdealArm::open(&arm()).unwrap();
    let start = [
        0.0,
        -30_f64.to_radians(),
        0.0,
        1.5,
        0.0,
        -60_f64.to_radians(),
        0.0,
        0.0,
    ];
    let told = start.map(|joint| joint + 1e-3);
    let (first, inputs) = exchange(&mut driver, &at(told));
    assert!(first.commandable && first.startable);
    assert_eq!((first.mirror, inputs.position), (start, start));
    let (second, inputs) = exchange(&mut driver, &at(told));
    assert_eq!((second.mirror, inputs.position), (told, told));
}

#[test]
fn without_a_start_each_joint_is_at_zero_or_as_near_to_it_as_it_can_be() {
    let mut device = arm();
    device.settings = json!({});
    let robot = device.robot.as_mut().unwrap();
    (robot.joints[1].lower_rad, robot.joints[2].upper_rad) = (0.25, -0.5);
    let mut driver = IdealArm::open(&device).unwrap();
    let (_, inputs) = exchange(&mut driver, &Outputs::NONE);
    assert_eq!(inputs.position, [0.0, 0.25, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
}

#[test]
fn outputs_are_wired_to_the_inputs_of_their_address() {
    let mut driver = IdealArm::open(&arm()).unwrap();
    let mut outputs = at([0.0; 8]);
    (outputs.digital, outputs.digital_set) = (0b10, 0b10);
    outputs.analog[0] = 0.25;
    let (_, inputs) = exchange(&mut driver, &outputs);
    assert_eq!((inputs.digital, inputs.digital_known), (0, 0b11));
    assert!(inputs.analog[0].is_nan(), "never told");
    let (_, inputs) = exchange(&mut driver, &at([0.0; 8]));
    // `clamped` is the first input, at address 2.
    assert_eq!((inputs.digital, inputs.analog[0]), (0b01, 0.25));
}

#[test]
fn once_released_it_stays_where_it_is() {
    let mut driver = IdealArm::open(&arm()).unwrap();
    exchange(&mut driver, &at([0.1; 8]));
    driver.release();
    let (exchange_, inputs) = exchange(&mut driver, &at([0.2; 8]));
    assert!(!exchange_.commandable && !exchange_.startable);
    assert_eq!(exchange_.reason, RELEASED);
    assert_eq!(inputs.position, [0.1; 8]);
    let (_, inputs) = exchange(&mut driver, &at([0.2; 8]));
    assert_eq!(inputs.position, [0.1; 8]);
}

#[test]
fn without_a_robot_it_is_refused() {
    let device = DeviceConfig {
        robot: None,
        ..arm()
    };
    let refusal = IdealArm::open(&device).unwrap_err().to_string();
    assert!(refusal.contains("robot"), "{refusal}");
}
