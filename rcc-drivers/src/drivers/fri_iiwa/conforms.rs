//! The driver in the conformance suite, with the simulated cabinet at the other end of a socket.
//! Test code only; the test is the cabinet's clock.

use std::net::{SocketAddr, UdpSocket};

use rcc_config::DeviceConfig;
use rcc_core::message::{ANALOG_MAX, JOINTS_MAX, Joints};
use rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use serde_json::json;

use super::{FriIiwa, REASONS};
use crate::fri_iiwa::wire::schema::Command;
use crate::fri_iiwa::wire::{Version, decode};
use crate::sim::iiwa::cabinet::Cabinet;
use crate::sim::iiwa::settings::Settings as CabinetSettings;
use crate::sim::iiwa::station::SignalLoopback;
use crate::sim::lwr::settings::supervised_limits;
use crate::sim::robot_settings::RobotSettings;
use rcc_driver_kit::conformance;
use rcc_driver_kit::conformance::capture::Capture;
use rcc_driver_kit::conformance::fault_path::PacketSource;
use rcc_driver_kit::conformance::{ObservedOutputs, Peer, Subject, Transport};
use rcc_driver_kit::driver::Inputs;
use rcc_driver_kit::host::reason::Reason;

/// The cabinet and the driver speak 1.15.
const VERSION: Version = Version::V1_14;

/// Faults of the simulated cabinet that losses on the wire cause: missed answers, connection quality.
const OF_THE_WIRE: [i32; 2] = [1, 2];
/// A released driver sends no position any more, which ends the motion: FRI has no other word for it.
const RELEASED: i32 = 8;

/// The address of a channel of the demo device on the station.
fn station_name(index: usize, kind: ChannelKind) -> String {
    format!("FRI.{kind:?}{index}")
}

/// Returns the arm of the demo cell as an iiwa that speaks this version, with listening address `at`.
fn iiwa(at: SocketAddr) -> DeviceConfig {
    let mut device = rcc_driver_kit::conformance::rules::some_robot();
    device.driver = rcc_config::DriverConfig::Name("fri-iiwa".to_owned());
    device.settings = json!({"listen": at.to_string(), "version": "1.15"});
    for kind in [DigitalInput, DigitalOutput, AnalogInput, AnalogOutput] {
        let channels = device
            .channels
            .iter_mut()
            .filter(|channel| channel.kind == kind);
        for (index, channel) in channels.enumerate() {
            channel.address = station_name(index, kind).into();
        }
    }
    device
}

/// Returns the signals of the station for the demo device's channels, and the first output of each kind looped back to the
/// first input.
pub(super) fn cabinet(version: Version) -> Cabinet {
    let device = iiwa(([127, 0, 0, 1], 0).into());
    let signals = device.channels.iter().map(|channel| {
        let kind = match channel.kind {
            AnalogInput | AnalogOutput => "analog",
            _ => "boolean",
        };
        let direction = match channel.kind {
            DigitalOutput | AnalogOutput => "output",
            _ => "input",
        };
        let name = channel.address.as_str().expect("a name");
        let text = format!("{name}={kind}:{direction}");
        text.parse().expect("a signal")
    });
    let loopback = |output, input| SignalLoopback {
        output: station_name(0, output),
        input: station_name(0, input),
    };
    Cabinet::new(CabinetSettings {
        version,
        signals: signals.collect(),
        loopbacks: vec![
            loopback(DigitalOutput, DigitalInput),
            loopback(AnalogOutput, AnalogInput),
        ],
        // The demo's arm is an LWR.
        robot: RobotSettings::within(supervised_limits()),
        ..CabinetSettings::default()
    })
}

/// The simulated cabinet at the other end of the wire, each message a step of 1 ms.
struct Controller {
    cabinet: Cabinet,
    socket: UdpSocket,
    driver: Option<SocketAddr>,
    present: bool,
    /// Commands were executed in the last cycle.
    commands: bool,
    /// Counter of the last answer that was taken.
    answered: Option<u32>,
    protocol_violations: Vec<String>,
}

impl Controller {
    /// While commands are executed, the cabinet takes no answer with an older counter, such as a restarted driver's.
    fn takes(&self, answer: &Command) -> bool {
        let header = answer.header.expect("checked when it was read");
        let own = header.sequence.unwrap_or(0);
        let backward = self
            .answered
            .is_some_and(|last| own.wrapping_sub(last).cast_signed() <= 0);
        header.reflected == Some(self.cabinet.sequence()) && !(backward && self.commands)
    }
}

impl Peer for Controller {
    fn before_receive(&mut self) {
        let Some(bytes) = self.cabinet.tick(1) else {
            return;
        };
        let commands = self.cabinet.is_commanded();
        if self.commands && !commands {
            let faults = self.cabinet.snapshot().robot.faults.into_iter();
            let ours =
                faults.filter(|fault| !OF_THE_WIRE.contains(&fault.code) && fault.code != RELEASED);
            self.protocol_violations = ours.map(|fault| fault.reason).collect();
        }
        self.commands = commands;
        if let Some(driver) = self.driver.filter(|_| self.present) {
            self.socket.send_to(&bytes, driver).expect("loopback");
        }
    }

    fn after_exchange(&mut self) {
        let mut bytes = [0; 1500];
        while let Ok((size, _)) = self.socket.recv_from(&mut bytes) {
            let taken = decode::<Command>(VERSION, &bytes[..size]);
            if let Some(answer) = taken.ok().filter(|answer| self.takes(answer)) {
                self.answered = answer.header.and_then(|header| header.sequence);
            }
            // The result is ignored: the cabinet counts the messages that it refuses.
            let _ = self.cabinet.receive(&bytes[..size], 1e-4);
        }
    }

    fn set_present(&mut self, present: bool) {
        self.present = present;
    }
}

impl Subject for Controller {
    type Driver = FriIiwa;
    const NAME: &'static str = "fri-iiwa";
    const REASONS: &'static [Reason] = REASONS;
    const TRANSPORT: Transport = Transport::UdpFromDevice;
    const HAS_CHECKSUM: bool = false;
    const BAD_SETTINGS: &'static [(&'static str, &'static str)] = &[
        ("listen", "\"127.0.0.1\""),
        ("listen", "\"localhost:1\""),
        ("peer", "\"192.170.10.2:0\""),
        ("version", "\"3.0\""),
        ("version", "2.7"),
        ("quality_min", "\"fair\""),
    ];
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)] = &[
        (DigitalInput, "1"),
        (DigitalOutput, "\"\""),
        (AnalogInput, "{}"),
        (
            AnalogOutput,
            "\"a name of the station that is longer than the sixty-three bytes it may have\"",
        ),
    ];

    fn start() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback");
        socket.set_nonblocking(true).expect("a socket");
        Self {
            cabinet: cabinet(VERSION),
            socket,
            driver: None,
            present: true,
            commands: false,
            answered: None,
            protocol_violations: Vec::new(),
        }
    }

    fn address(&self) -> SocketAddr {
        self.socket.local_addr().expect("an address")
    }

    fn set_driver_address(&mut self, driver: SocketAddr) {
        self.driver = Some(driver);
    }

    fn device(at: SocketAddr) -> DeviceConfig {
        iiwa(at)
    }

    fn outputs(&mut self) -> ObservedOutputs {
        let io = self.cabinet.snapshot().io;
        let of = |kind: ChannelKind, index: usize| {
            let name = station_name(index, kind);
            let found = io.iter().find(|signal| signal.name == name);
            found.map(|signal| signal.value)
        };
        let digital = (0..3).filter_map(|index| Some((index, of(DigitalOutput, index)?)));
        let digital = digital.fold(0, |bits, (index, value)| {
            bits | u64::from(value != 0.0) << index
        });
        let mut analog = [f64::NAN; ANALOG_MAX];
        analog[0] = of(AnalogOutput, 0).unwrap_or(f64::NAN);
        ObservedOutputs { digital, analog }
    }

    fn followed(&self, packet: &[u8]) -> Option<Joints> {
        let command: Command = decode(VERSION, packet).ok()?;
        let follows = self.commands && self.takes(&command);
        let position = command.data?.position?.value;
        let mut joints = [0.0; JOINTS_MAX];
        for (place, value) in joints.iter_mut().zip(position) {
            *place = value;
        }
        follows.then_some(joints)
    }

    fn protocol_violations(&self) -> Vec<String> {
        self.protocol_violations.clone()
    }

    /// Returns one captured message while commands are executed; the expected numbers were read from its bytes.
    fn capture() -> Option<Capture> {
        let bytes = include_bytes!("../../../../tests/data/fri/cap_v1_15.mon");
        Some(Capture {
            device: iiwa,
            packets: vec![(PacketSource::Device, bytes.to_vec())],
            exchanges: 1,
            check: |inputs: &[Inputs]| {
                let quarter = std::f64::consts::FRAC_PI_2;
                let position = inputs[0].position;
                assert_eq!(
                    [position[0], position[1], position[5]],
                    [quarter, 0.0, -quarter]
                );
                assert_eq!((inputs[0].torque[1], inputs[0].torque[5]), (0.1, 0.5));
                assert!(
                    inputs[0].wrench.iter().all(|value| value.is_nan()),
                    "not in 1.15"
                );
                assert_eq!(inputs[0].digital_known, 0, "it lists nothing");
            },
        })
    }
}

conformance!(arm: Controller);
