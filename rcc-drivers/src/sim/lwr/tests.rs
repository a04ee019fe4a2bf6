//! The simulated controller against a PC in virtual time, one step per cycle.
//! Runs in the test harness.

mod census;
mod entry;
mod exchange;
mod handshake;
mod impedance;
mod stops;

use super::control::KrcCommand;
use super::fault::{KrcFault, MonitorReason};
use super::krc::Krc;
use super::settings::{Acknowledge, KrlLoopback, KrlProgram, Settings};
use super::{JOINTS, Joints};
use crate::fri_lwr::wire::{CommandDatagram, MeasurementDatagram, Quality, SessionState, flags};
use crate::sim::arm::command_stream::StreamFault;
use crate::sim::arm::impedance::ControlLaw;

/// A PC that mirrors unless told otherwise.
struct Pc {
    krc: Krc,
    seen: MeasurementDatagram,
    sequence: u16,
    /// Every state of the controller, in the order in which they were seen.
    phases: Vec<Phase>,
    /// Every reason to stay in monitor state that was told.
    waits: Vec<MonitorReason>,
}

/// State of the interface, and of the arm in monitor state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    /// Monitor state, the arm at rest.
    Rest,
    /// Command state.
    Command,
    /// Monitor state, the arm is brought to rest, or yields to a force.
    Moving,
}

impl Pc {
    fn new(settings: Settings) -> Self {
        let mut krc = Krc::new(settings);
        let first = krc.tick(1).unwrap();
        Self {
            krc,
            seen: MeasurementDatagram::decode(&first).unwrap(),
            sequence: 0,
            phases: Vec::new(),
            waits: Vec::new(),
        }
    }

    /// Returns the answer of a PC that mirrors and requests command mode.
    fn mirror(&mut self) -> CommandDatagram {
        self.sequence = self.sequence.wrapping_add(1);
        let mut answer = CommandDatagram {
            send_sequence: self.sequence,
            reflected_sequence: self.seen.send_sequence,
            flags: flags::JOINT_POSITION,
            ..CommandDatagram::default()
        };
        answer.krl.integers[0] = 1;
        for joint in 0..JOINTS {
            answer.joint_position[joint] =
                self.seen.commanded_position[joint] + self.seen.commanded_position_offset[joint];
        }
        answer
    }

    /// Runs one cycle with this answer.
    fn answer(&mut self, answer: &CommandDatagram) {
        let taken = self.krc.receive(&answer.encode(), 1e-4);
        assert_eq!(taken, Ok(()));
        self.continue_through_stall(1);
    }

    /// Runs one cycle without an answer.
    fn miss(&mut self) {
        self.continue_through_stall(1);
    }

    fn continue_through_stall(&mut self, periods_max: u64) {
        if let Some(bytes) = self.krc.tick(periods_max) {
            self.seen = MeasurementDatagram::decode(&bytes).unwrap();
        }
        let phase = match (self.krc.in_command_state(), self.krc.is_at_rest()) {
            (true, _) => Phase::Command,
            (false, true) => Phase::Rest,
            (false, false) => Phase::Moving,
        };
        if self.phases.last() != Some(&phase) {
            self.phases.push(phase);
        }
        if let Some(reason) = self.krc.monitor_reason
            && self.waits.last() != Some(&reason)
        {
            self.waits.push(reason);
        }
    }

    fn mirror_for(&mut self, cycles: usize) {
        for _ in 0..cycles {
            let answer = self.mirror();
            self.answer(&answer);
        }
    }

    /// Returns a PC in command state and at rest, having mirrored once.
    fn commanding(settings: Settings) -> Self {
        let mut pc = Self::new(settings);
        pc.mirror_for(200);
        assert_eq!(
            pc.seen.state,
            SessionState::Command,
            "{:?}",
            pc.krc.monitor_reason
        );
        pc
    }

    /// Returns the controller's position as the PC knows it, rad.
    fn position(&self) -> Joints {
        std::array::from_fn(|joint| {
            f64::from(self.seen.commanded_position[joint])
                + f64::from(self.seen.commanded_position_offset[joint])
        })
    }

    /// Runs one cycle with joint 4 commanded to `position`.
    fn command_joint_4(&mut self, position: f64) {
        let mut answer = self.mirror();
        answer.joint_position[3] = position as f32;
        self.answer(&answer);
    }

    /// Returns a PC in command state that moves joint 4 with `velocity`, reached smoothly.
    fn moving(settings: Settings, velocity: f64) -> Self {
        let mut pc = Self::commanding(settings);
        let (start, period_s) = (pc.position()[3], pc.krc.settings.period_s);
        let mut way = 0.0;
        for i in 0..400 {
            way += velocity * (f64::from(i) / 200.0).min(1.0) * period_s;
            pc.command_joint_4(start + way);
        }
        assert_eq!(pc.krc.fault, None);
        pc
    }

    fn execute(&mut self, line: &str) {
        let command: KrcCommand = serde_json::from_str(line).unwrap();
        self.krc.execute(command).unwrap();
    }

    fn state(&self) -> SessionState {
        self.seen.state
    }
}
