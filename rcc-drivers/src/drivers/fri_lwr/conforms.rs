//! The driver in the conformance suite, with the simulated controller at the other end of a socket.
//! Test code only; the test is the controller's clock.

use std::net::{SocketAddr, UdpSocket};

use rcc_config::DeviceConfig;
use rcc_core::message::{ANALOG_MAX, JOINTS_MAX, Joints};
use rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use serde_json::json;

use super::{FriLwr, REASONS};
use crate::fri_lwr::wire::{CommandDatagram, MeasurementDatagram, SessionState};
use crate::sim::lwr::krc::Krc;
use crate::sim::lwr::settings::{KrlLoopback, Settings as KrcSettings};
use rcc_driver_kit::conformance;
use rcc_driver_kit::conformance::capture::Capture;
use rcc_driver_kit::conformance::fault_path::PacketSource;
use rcc_driver_kit::conformance::{ObservedOutputs, Peer, Subject, Transport};
use rcc_driver_kit::driver::Inputs;
use rcc_driver_kit::host::reason::Reason;

/// Faults of the simulated controller that losses on the wire cause: missed answers, connection quality.
const OF_THE_WIRE: [i32; 2] = [1, 2];

/// Returns the LWR of the demo cell, listening at `at`.
pub(super) fn lwr(at: SocketAddr) -> DeviceConfig {
    DeviceConfig {
        settings: json!({"listen": at.to_string()}),
        ..rcc_driver_kit::conformance::rules::some_robot()
    }
}

/// Returns a controller with output 1 of each type looped back to input 1.
pub(super) fn krc() -> Krc {
    Krc::new(KrcSettings {
        boolean_wires: vec![KrlLoopback { from: 1, to: 1 }],
        real_wires: vec![KrlLoopback { from: 1, to: 1 }],
        ..KrcSettings::default()
    })
}

struct Controller {
    krc: Krc,
    socket: UdpSocket,
    driver: Option<SocketAddr>,
    present: bool,
    /// The last datagram sent was in command state.
    commands: bool,
    /// `send_sequence` of the last answer that was accepted.
    answered: Option<u16>,
    protocol_violations: Vec<String>,
}

impl Controller {
    /// In command state, the controller accepts no answer with an older sequence number, such as a restarted driver's.
    fn takes(&self, answer: &CommandDatagram) -> bool {
        let backward = self
            .answered
            .is_some_and(|last| answer.send_sequence.wrapping_sub(last).cast_signed() <= 0);
        answer.reflected_sequence == self.krc.sequence() && !(backward && self.commands)
    }
}

impl Peer for Controller {
    fn before_receive(&mut self) {
        let Some(bytes) = self.krc.tick(1) else {
            return;
        };
        let state = MeasurementDatagram::decode(&bytes).map(|measured| measured.state);
        let commands = state == Ok(SessionState::Command);
        if self.commands && !commands {
            let faults = self.krc.snapshot().robot.faults;
            let ours = faults
                .into_iter()
                .filter(|fault| !OF_THE_WIRE.contains(&fault.code));
            self.protocol_violations = ours.map(|fault| fault.reason).collect();
        }
        self.commands = commands;
        if let Some(driver) = self.driver.filter(|_| self.present) {
            self.socket.send_to(&bytes, driver).expect("loopback");
        }
    }

    fn after_exchange(&mut self) {
        let mut bytes = [0; 512];
        while let Ok((size, _)) = self.socket.recv_from(&mut bytes) {
            let taken = CommandDatagram::decode(&bytes[..size]);
            if let Some(answer) = taken.ok().filter(|answer| self.takes(answer)) {
                self.answered = Some(answer.send_sequence);
            }
            // The result is ignored: the suite also sends datagrams that must be refused, and checks their effect.
            let _ = self.krc.receive(&bytes[..size], 1e-4);
        }
    }

    fn set_present(&mut self, present: bool) {
        self.present = present;
    }
}

impl Subject for Controller {
    type Driver = FriLwr;
    const NAME: &'static str = "fri-lwr";
    const REASONS: &'static [Reason] = REASONS;
    const TRANSPORT: Transport = Transport::UdpFromDevice;
    const HAS_CHECKSUM: bool = false;
    const BAD_SETTINGS: &'static [(&'static str, &'static str)] = &[
        ("listen", "\"127.0.0.1\""),
        ("listen", "\"localhost:1\""),
        ("listen", "\"127.0.0.1:65536\""),
        ("peer", "\"192.168.0.20:0\""),
        ("krl", "\"last-app\""),
        ("quality_min", "\"unacceptable\""),
        ("quality_min", "3"),
        ("strategy", "\"torque\""),
        ("header", "\"none\""),
        ("period_tolerance", "-0.1"),
        ("period_tolerance", "1"),
    ];
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)] = &[
        (DigitalInput, "0"),
        (DigitalInput, "17"),
        (DigitalOutput, "0"),
        (DigitalOutput, "17"),
        (AnalogInput, "17"),
        (AnalogInput, "\"int 17\""),
        (AnalogInput, "\"gravity 8\""),
        (AnalogInput, "\"jacobian w 1\""),
        (AnalogOutput, "17"),
        (AnalogOutput, "\"gravity 1\""),
    ];

    fn start() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback");
        socket.set_nonblocking(true).expect("a socket");
        Self {
            krc: krc(),
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
        lwr(at)
    }

    fn outputs(&mut self) -> ObservedOutputs {
        let krl = self.krc.snapshot().krl_from_pc;
        // The demo's outputs have the KRL numbers 1, 2, 3 and 1.
        let digital = krl.booleans.iter().zip(0..3);
        let digital = digital.fold(0, |bits, (on, bit)| bits | u64::from(*on) << bit);
        let mut analog = [f64::NAN; ANALOG_MAX];
        analog[0] = f64::from(krl.reals[0]);
        ObservedOutputs { digital, analog }
    }

    fn followed(&self, packet: &[u8]) -> Option<Joints> {
        let answer = CommandDatagram::decode(packet).ok()?;
        let follows = self.commands && self.takes(&answer);
        let mut joints = [0.0; JOINTS_MAX];
        for (place, value) in joints.iter_mut().zip(answer.joint_position) {
            *place = f64::from(value);
        }
        follows.then_some(joints)
    }

    fn protocol_violations(&self) -> Vec<String> {
        self.protocol_violations.clone()
    }

    /// Returns one captured datagram in command state; the expected numbers were read from its bytes with Python's
    /// `struct`.
    fn capture() -> Option<Capture> {
        let bytes = include_bytes!("../../../../tests/data/fri/cap_lwr.msr");
        Some(Capture {
            device: lwr,
            packets: vec![(PacketSource::Device, bytes.to_vec())],
            exchanges: 1,
            check: |inputs: &[Inputs]| {
                let [j2, j4, j6] = [
                    0.534_557_819_366_455_1,
                    1.581_755_399_703_979_5,
                    -0.774_439_156_055_450_4,
                ];
                let other = 0.010_959_012_433_886_528;
                assert_eq!(
                    inputs[0].position,
                    [other, j2, other, j4, other, j6, other, 0.0]
                );
                assert_eq!(inputs[0].torque, [0.0; JOINTS_MAX]);
                assert_eq!((inputs[0].digital, inputs[0].digital_known), (0, 0b111));
            },
        })
    }
}

conformance!(arm: Controller);
