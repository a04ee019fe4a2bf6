//! The arm in C in the conformance suite, with the simulated controller of the template at the other end of a socket.
//! Test code only; the test is the clock of the controller.

use std::net::{SocketAddr, UdpSocket};

use line_drivers::simulated_arm::SimulatedArm;
use rcc_driver_kit::conformance;
use rcc_driver_kit::conformance::{ObservedOutputs, Peer, Subject, Transport, device, rules};
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::{DeviceConfig, OnRelease};
use rcc_driver_kit::rcc_core::message::{ANALOG_MAX, JOINTS_MAX, Joints};
use rcc_driver_kit::rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use rcc_driver_kit::serde_json::json;

use super::example;
use crate::c_driver::{CDriver, DriverTable};
use crate::ffi::Description;
use crate::reasons::OWN_REASONS;

#[derive(Debug)]
enum LineArm {}

impl DriverTable for LineArm {
    fn description() -> Option<&'static Description> {
        Some(example("line_arm"))
    }
}

/// Where the arm begins, rad.
const START: [f64; 7] = [0.0, -0.5, 0.0, 1.5, 0.0, -1.0, 0.0];

/// The controller; each of its lines is a step of 1 ms.
struct Controller {
    arm: SimulatedArm,
    socket: UdpSocket,
    driver: Option<SocketAddr>,
    present: bool,
}

impl Peer for Controller {
    fn before_receive(&mut self) {
        let line = self.arm.tick();
        if let Some(driver) = self.driver.filter(|_| self.present) {
            let sent = self.socket.send_to(line.as_bytes(), driver);
            sent.expect("loopback");
        }
    }

    fn after_exchange(&mut self) {
        let mut bytes = [0; 1500];
        while let Ok((size, _)) = self.socket.recv_from(&mut bytes) {
            self.arm.take(&bytes[..size]);
        }
    }

    fn set_present(&mut self, present: bool) {
        self.present = present;
    }
}

impl Subject for Controller {
    type Driver = CDriver<LineArm>;
    const NAME: &'static str = "c-line-arm";
    const REASONS: &'static [Reason] = OWN_REASONS;
    const TRANSPORT: Transport = Transport::UdpFromDevice;
    const HAS_CHECKSUM: bool = true;
    const BAD_SETTINGS: &'static [(&'static str, &'static str)] = &[
        ("listen", "\"127.0.0.1\""),
        ("period", "\"0 ms\""),
        ("period", "4"),
    ];
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)] =
        &[(DigitalInput, "0"), (AnalogOutput, "17")];

    fn start() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback");
        socket.set_nonblocking(true).expect("a socket");
        Self {
            arm: SimulatedArm::new(&START),
            socket,
            driver: None,
            present: true,
        }
    }

    fn address(&self) -> SocketAddr {
        self.socket.local_addr().expect("an address")
    }

    fn set_driver_address(&mut self, driver: SocketAddr) {
        self.driver = Some(driver);
    }

    fn device(at: SocketAddr) -> DeviceConfig {
        let safe = Some(OnRelease::Safe(0.0));
        let hold = Some(OnRelease::Hold);
        let rows = [
            ("lamp", DigitalOutput, 1.into(), safe, None),
            ("clamp", DigitalOutput, 2.into(), hold, None),
            ("lamp_on", DigitalInput, 1.into(), None, None),
            ("speed", AnalogOutput, 1.into(), safe, Some([0.0, 0.5])),
            ("speed_is", AnalogInput, 1.into(), None, None),
        ];
        let settings = json!({"listen": at.to_string(), "period": "1 ms"});
        DeviceConfig {
            robot: rules::some_robot().robot,
            ..device("c-line-arm", settings, &rows)
        }
    }

    fn outputs(&mut self) -> ObservedOutputs {
        let outputs = self.arm.outputs();
        let bit = |name: &str| u64::from(outputs.get(name).is_some_and(|value| *value != 0.0));
        let mut analog = [f64::NAN; ANALOG_MAX];
        analog[0] = outputs.get("a1").copied().unwrap_or(f64::NAN);
        ObservedOutputs {
            digital: bit("d1") | bit("d2") << 1,
            analog,
        }
    }

    fn followed(&self, packet: &[u8]) -> Option<Joints> {
        let set_points = self.arm.set_points(packet)?;
        let mut joints = [0.0; JOINTS_MAX];
        joints[..set_points.len()].copy_from_slice(&set_points);
        self.arm.follows().then_some(joints)
    }
}

conformance!(arm: Controller);
