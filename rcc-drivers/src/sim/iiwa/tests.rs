//! The simulated cabinet against a client in virtual time, one step per cycle.
//! Runs in the test harness.

mod census;
mod exchange;
mod overlays;
mod stops;
mod walls;

use super::cabinet::Cabinet;
use super::control::CabinetRequest;
use super::fault::{CabinetFault, WaitReason};
use super::settings::{OverlayMode, Settings};
use super::{JOINTS, Joints};
use crate::fri_iiwa::wire::schema::{
    CartesianVector, Command, CommandData, Header, JointValues, Monitoring,
};
use crate::fri_iiwa::wire::{COMMAND_ID, SessionState, Version, decode, encode};
use crate::sim::arm::impedance::{ControlLaw, ImpedanceSettings};

const VERSIONS: [Version; 4] = [Version::V1_11, Version::V1_14, Version::V2_5, Version::V2_7];

/// A client that mirrors unless told otherwise.
struct Client {
    cabinet: Cabinet,
    seen: Monitoring,
    sequence: u32,
    /// Messages since the last answer.
    received: u32,
    /// Every state of the session, in the order in which they were seen.
    states: Vec<SessionState>,
    /// Every reason to wait that was told.
    waits: Vec<WaitReason>,
}

impl Client {
    fn new(settings: Settings) -> Self {
        let version = settings.version;
        let mut cabinet = Cabinet::new(settings);
        let first = cabinet.tick(1).expect("a message");
        Self {
            cabinet,
            seen: decode(version, &first).expect("a message"),
            sequence: u32::MAX,
            received: 1,
            states: Vec::new(),
            waits: Vec::new(),
        }
    }

    fn version(&self) -> Version {
        self.cabinet.settings.version
    }

    fn session(&self) -> SessionState {
        self.cabinet.session()
    }

    /// Returns the answer of a client that mirrors, with all fields that the overlay wants.
    fn mirror(&mut self) -> Command {
        self.sequence = self.sequence.wrapping_add(1);
        let header = Header {
            identifier: Some(COMMAND_ID),
            sequence: Some(self.sequence),
            reflected: self.seen.header.and_then(|header| header.sequence),
        };
        let own = self.seen.interpolator.as_ref();
        let data = own.map(|own| {
            let pose = own.command_mode == Some(4);
            CommandData {
                position: own.position.clone().filter(|_| !pose),
                pose: own.pose.clone().filter(|_| pose),
                redundancy: own.redundancy.filter(|_| pose),
                wrench: (own.command_mode == Some(2)).then(|| CartesianVector {
                    element: vec![0.0; 6],
                }),
                torque: (own.command_mode == Some(3)).then(|| values(&[0.0; JOINTS])),
                ..CommandData::default()
            }
        });
        Command {
            header: Some(header),
            data,
            end: None,
        }
    }

    fn send(&mut self, command: &Command) -> bool {
        let bytes = encode(self.version(), command).expect("it fits");
        self.received = 0;
        self.cabinet.receive(&bytes, 1e-4).is_ok()
    }

    /// Ends the cycle.
    fn next(&mut self) {
        if let Some(bytes) = self.cabinet.tick(1) {
            self.seen = decode(self.version(), &bytes).expect("its own bytes");
            self.received += 1;
        }
        let session = self.session();
        if self.states.last() != Some(&session) {
            self.states.push(session);
        }
        if let Some(reason) = self.cabinet.wait_reason
            && self.waits.last() != Some(&reason)
        {
            self.waits.push(reason);
        }
    }

    /// Runs one cycle with this answer.
    fn answer(&mut self, command: &Command) {
        assert!(self.send(command), "{:?}", self.cabinet.last_refusal);
        self.next();
    }

    /// Mirrors for some cycles, changed by `change` in the overlay.
    fn run(&mut self, cycles: u32, change: impl Fn(&mut CommandData)) {
        for _ in 0..cycles {
            if self.received >= self.cabinet.settings.multiplier {
                let mut command = self.mirror();
                if self.session() == SessionState::CommandingActive {
                    change(command.data.as_mut().expect("an overlay"));
                }
                self.answer(&command);
            } else {
                self.next();
            }
        }
    }

    /// A client whose commands are executed.
    fn commanding(settings: Settings) -> Self {
        let mut client = Self::new(settings);
        let enough = 300 * client.cabinet.settings.multiplier;
        for _ in 0..enough {
            client.run(1, |_| {});
            if client.session() == SessionState::CommandingActive {
                return client;
            }
        }
        panic!("{:?}", client.cabinet.snapshot());
    }

    fn ask(&mut self, line: &str) {
        let request: CabinetRequest = serde_json::from_str(line).expect(line);
        let answer = self.cabinet.execute(request);
        answer.unwrap_or_else(|error| panic!("{line}: {error}"));
    }

    fn fault_code(&self) -> Option<i32> {
        self.cabinet.fault.map(|fault| fault.code())
    }
}

fn values(joints: &Joints) -> JointValues {
    JointValues {
        value: joints.to_vec(),
    }
}

fn settings(version: Version, overlay: OverlayMode) -> Settings {
    let law = overlay.needed_law().unwrap_or(ControlLaw::Position);
    Settings {
        version,
        overlay,
        law,
        impedance: ImpedanceSettings::default_for(law),
        ..Settings::default()
    }
}

fn position(version: Version) -> Settings {
    settings(version, OverlayMode::Position)
}
