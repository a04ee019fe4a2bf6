//! The driver in the conformance suite, with a robot at the other end of a socket that judges strictly.
//! Test code only; the test is the robot's clock.

use std::net::{SocketAddr, UdpSocket};

use rcc_config::DeviceConfig;
use rcc_core::message::{ANALOG_MAX, JOINTS_MAX, Joints};
use rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use serde_json::json;

use super::{FriIiwa, REASONS};
use crate::conformance::capture::Capture;
use crate::conformance::fault_path::PacketSource;
use crate::conformance::{ObservedOutputs, Peer, Subject, Transport, conformance};
use crate::driver::Inputs;
use crate::fri_iiwa::wire::schema::{
    Command, Connection, Header, Interpolator, IoValue, JointValues, MonitorData, Monitoring, Robot,
};
use crate::fri_iiwa::wire::{IoDirection, IoKind, JOINTS, MONITORING_ID, Version, decode, encode};
use crate::host::reason::Reason;

/// Answered cycles in monitoring until a motion begins, and in which the robot then wants to be mirrored.
const READY_CYCLES: u32 = 20;
const WAIT_CYCLES: u32 = 10;
/// Consecutive cycles without an answer that end the motion.
const MISSES_MAX: u32 = 10;
/// Largest deviation of a mirrored position, rad.
const MIRROR_RAD: f64 = 1e-3;

/// The address of a channel of the demo device on the station.
fn station_name(index: usize, kind: ChannelKind) -> String {
    format!("FRI.{kind:?}{index}")
}

/// Returns the arm of the demo cell as an iiwa that speaks this version, with listening address `at`.
fn iiwa(at: SocketAddr) -> DeviceConfig {
    let mut device = crate::conformance::rules::some_robot();
    device.driver = "fri-iiwa".to_owned();
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

/// A robot that speaks 1.15, each message a step of 1 ms.
struct TestRobot {
    socket: UdpSocket,
    driver: Option<SocketAddr>,
    present: bool,
    sequence: u32,
    /// Counter of the last answer.
    reflected: u32,
    /// As on the wire: 1 to 4.
    session: i32,
    /// Answered cycles in this state.
    cycles: u32,
    misses: u32,
    answered: bool,
    position: Joints,
    /// Where the motion began, and where it is interpolated to: what the client commands is not part of it.
    start: Joints,
    io: Vec<IoValue>,
    protocol_violations: Vec<String>,
}

fn values(joints: &Joints) -> Option<JointValues> {
    let value = joints.iter().take(JOINTS).copied().collect();
    Some(JointValues { value })
}

impl TestRobot {
    fn message(&self) -> Monitoring {
        Monitoring {
            header: Some(Header {
                identifier: Some(MONITORING_ID),
                sequence: Some(self.sequence),
                reflected: Some(self.reflected),
            }),
            robot: Some(Robot {
                joints: Some(7),
                safety: Some(0),
                drives: vec![2; JOINTS],
                operation: Some(2),
                control: Some(0),
            }),
            data: Some(MonitorData {
                measured_position: values(&self.position),
                measured_torque: values(&[0.0; JOINTS_MAX]),
                commanded_position: values(&self.position),
                external_torque: values(&[0.0; JOINTS_MAX]),
                io: self.io.clone(),
                ..MonitorData::default()
            }),
            connection: Some(Connection {
                session: Some(self.session),
                quality: Some(if self.session == 1 { 1 } else { 3 }),
                send_period_ms: Some(1),
                receive_multiplier: Some(1),
            }),
            interpolator: (self.session >= 3).then(|| Interpolator {
                position: values(&self.start),
                command_mode: Some(1),
                overlay: Some(1),
                ..Interpolator::default()
            }),
            ..Monitoring::default()
        }
    }

    fn enter(&mut self, session: i32) {
        (self.session, self.cycles) = (session, 0);
        if session == 3 {
            self.start = self.position;
        }
    }

    /// Judges the cycle that ends: states rise with answers and fall without.
    fn step(&mut self) {
        if !self.answered {
            self.misses += 1;
            if self.misses > MISSES_MAX && self.session > 1 {
                self.enter(1);
            }
            return;
        }
        self.misses = 0;
        self.cycles += 1;
        match self.session {
            1 if self.cycles >= READY_CYCLES => self.enter(2),
            2 if self.cycles >= READY_CYCLES => self.enter(3),
            3 if self.cycles >= WAIT_CYCLES => self.enter(4),
            _ => {}
        }
    }

    /// Connects the first output of a kind with the first input.
    fn loop_back(&mut self, output: ChannelKind, input: ChannelKind) {
        let of = |kind| Some(station_name(0, kind));
        let written = self.io.iter().find(|io| io.name == of(output)).cloned();
        let read = self.io.iter_mut().find(|io| io.name == of(input));
        if let (Some(written), Some(read)) = (written, read) {
            (read.digital, read.analog) = (written.digital, written.analog);
        }
    }

    fn take(&mut self, command: &Command) {
        let header = command.header.expect("checked when it was read");
        if header.reflected != Some(self.sequence) {
            return;
        }
        self.answered = true;
        self.reflected = header.sequence.unwrap_or(0);
        let data = command.data.as_ref();
        for written in data.map_or(&[][..], |data| &data.io) {
            let listed = self.io.iter_mut().find(|io| io.name == written.name);
            match listed.filter(|io| io.direction == written.direction && io.kind == written.kind) {
                Some(io) => (io.digital, io.analog) = (written.digital, written.analog),
                None => self.protocol_violations.push(format!("wrote {written:?}")),
            }
        }
        self.loop_back(DigitalOutput, DigitalInput);
        self.loop_back(AnalogOutput, AnalogInput);
        if self.session < 3 {
            return;
        }
        let Some(position) = data.and_then(|data| data.position.as_ref()) else {
            // Without a position the motion ends, as it does when the driver ends.
            return self.enter(1);
        };
        let asked: Joints =
            std::array::from_fn(|joint| position.value.get(joint).copied().unwrap_or(0.0));
        let pairs = asked.iter().zip(self.start);
        let mirrors = pairs
            .into_iter()
            .all(|(asked, own)| (asked - own).abs() <= MIRROR_RAD);
        if self.session == 3 && !mirrors {
            self.protocol_violations
                .push(format!("not mirrored: {asked:?}"));
        }
        if self.session == 4 {
            self.position = asked;
        }
    }
}

impl Peer for TestRobot {
    fn before_receive(&mut self) {
        self.step();
        self.answered = false;
        self.sequence = self.sequence.wrapping_add(1);
        let bytes = encode(Version::V1_14, &self.message()).expect("it fits");
        if let Some(driver) = self.driver.filter(|_| self.present) {
            self.socket.send_to(&bytes, driver).expect("loopback");
        }
    }

    fn after_exchange(&mut self) {
        let mut bytes = [0; 1500];
        while let Ok((size, _)) = self.socket.recv_from(&mut bytes) {
            if let Ok(command) = decode::<Command>(Version::V1_14, &bytes[..size]) {
                self.take(&command);
            }
        }
    }

    fn set_present(&mut self, present: bool) {
        self.present = present;
    }
}

impl Subject for TestRobot {
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
        let device = iiwa(([127, 0, 0, 1], 0).into());
        let io = device.channels.iter().map(|channel| {
            let analog = matches!(channel.kind, AnalogInput | AnalogOutput);
            let output = matches!(channel.kind, DigitalOutput | AnalogOutput);
            let kind = if analog {
                IoKind::Analog
            } else {
                IoKind::Boolean
            };
            let direction = if output {
                IoDirection::Output
            } else {
                IoDirection::Input
            };
            IoValue {
                name: channel.address.as_str().map(str::to_owned),
                kind: Some(kind as i32),
                direction: Some(direction as i32),
                digital: (!analog).then_some(0),
                analog: analog.then_some(0.0),
            }
        });
        Self {
            socket,
            driver: None,
            present: true,
            sequence: 0,
            reflected: 0,
            session: 1,
            cycles: 0,
            misses: 0,
            answered: false,
            position: [0.0; JOINTS_MAX],
            start: [0.0; JOINTS_MAX],
            io: io.collect(),
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
        let of = |kind: ChannelKind, index: usize| {
            let name = Some(station_name(index, kind));
            self.io.iter().find(|io| io.name == name)
        };
        let digital = (0..3).filter_map(|index| Some((index, of(DigitalOutput, index)?.digital?)));
        let digital = digital.fold(0, |bits, (index, value)| bits | value << index);
        let mut analog = [f64::NAN; ANALOG_MAX];
        analog[0] = of(AnalogOutput, 0)
            .and_then(|io| io.analog)
            .unwrap_or(f64::NAN);
        ObservedOutputs { digital, analog }
    }

    fn followed(&self, packet: &[u8]) -> Option<Joints> {
        let command: Command = decode(Version::V1_14, packet).ok()?;
        let current = command.header?.reflected == Some(self.sequence);
        let position = command.data?.position?.value;
        let mut joints = [0.0; JOINTS_MAX];
        for (place, value) in joints.iter_mut().zip(position) {
            *place = value;
        }
        (current && self.session == 4).then_some(joints)
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

conformance!(arm: TestRobot);
