//! The KRL program of the simulated controller: entry into and exit from command state, acknowledgement of faults.
//! Pure; run by the clock thread once per tick.

use super::fault::{KrcFault, MonitorReason};
use super::krc::Krc;
use super::settings::{Acknowledge, KrlProgram};
use super::{JOINTS, Joints};
use crate::fri_lwr::wire::{CommandDatagram, Quality};
use crate::sim::arm::impedance::{ControlLaw, ImpedanceSettings};

/// Integers with which a PC and a KRL program agree on command mode. Variables are counted from 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Handshake {
    /// Number of `$FRI_FRM_INT` that requests and ends command mode.
    request: usize,
    start: &'static [i32],
    stop: &'static [i32],
    /// The values of `start` in words.
    asks: &'static str,
    /// Number of `$FRI_FRM_INT` that chooses the strategy.
    strategy: usize,
    /// Number of `$FRI_TO_INT` with which the program answers, its value in monitor and in command state.
    answer: Option<(usize, [i32; 2])>,
}

impl KrlProgram {
    fn handshake(self) -> Option<Handshake> {
        Some(match self {
            KrlProgram::FirstApp => Handshake {
                request: 1,
                start: &[1, 10],
                stop: &[0, 2],
                asks: "1 or 10",
                strategy: 2,
                answer: None,
            },
            KrlProgram::Stanford => Handshake {
                request: 16,
                start: &[10],
                stop: &[20],
                asks: "10",
                strategy: 15,
                answer: Some((16, [10, 10])),
            },
            KrlProgram::Centro => Handshake {
                request: 2,
                start: &[1],
                stop: &[0],
                asks: "1",
                strategy: 1,
                answer: Some((2, [0, 1])),
            },
            KrlProgram::Auto => return None,
        })
    }
}

impl Krc {
    /// Runs one pass of the program: requests of the PC, exit from and entry into command state.
    pub(super) fn run_krl_program(&mut self, command: Option<&CommandDatagram>) {
        let handshake = self.settings.script.handshake();
        if let (Some(command), Some(handshake)) = (command, handshake) {
            self.read_request(&command.krl.integers, &handshake);
        }
        if handshake.is_none() {
            self.wants_command = true;
        }
        if let Some(cycles) = &mut self.closing_cycles {
            self.wants_command = false;
            *cycles = cycles.saturating_sub(1);
        }
        if self.in_command_state() {
            if self.quality.quality() == Quality::Unacceptable {
                self.fail(KrcFault::Quality {
                    answered: self.quality.figures().answered,
                });
            } else if !self.wants_command {
                self.stop();
            }
            self.monitor_reason = self
                .monitor_reason(command)
                .filter(|_| !self.in_command_state());
            return;
        }
        self.acknowledge_by_program(command);
        self.monitor_reason = self.monitor_reason(command);
        if let (None, Some(command)) = (self.monitor_reason, command) {
            self.enter_command_state(command.flags);
        }
    }

    fn read_request(&mut self, integers: &[i32; 16], handshake: &Handshake) {
        let integer = |number: usize| integers.get(number - 1).copied().unwrap_or(0);
        let request = integer(handshake.request);
        if handshake.start.contains(&request) {
            self.wants_command = true;
        } else if handshake.stop.contains(&request) {
            self.wants_command = false;
        }
        let chosen = ControlLaw::from_krl(integer(handshake.strategy));
        if let Some(strategy) = chosen.filter(|strategy| *strategy != self.settings.strategy) {
            self.choose_strategy(strategy);
        }
    }

    /// Changes the strategy if the arm rests in monitor state; returns whether it is now the wanted one. The set-point is
    /// where the arm is, which may have yielded.
    pub(super) fn choose_strategy(&mut self, strategy: ControlLaw) -> bool {
        if self.in_command_state() || !self.is_at_rest() {
            return strategy == self.settings.strategy;
        }
        self.settings.strategy = strategy;
        self.robot.impedance = ImpedanceSettings::default_for(strategy);
        let here: Joints = self.robot.arm.position;
        (self.robot.desired, self.base) = (here, here);
        self.robot.arm.velocity = [0.0; JOINTS];
        true
    }

    /// Writes the variables of the KRL program. A number that nothing here writes keeps what `set_int` gave it.
    pub(super) fn write_krl_variables(&mut self) {
        let handshake = self.settings.script.handshake();
        if let Some((number, values)) = handshake.and_then(|handshake| handshake.answer) {
            let value = values[usize::from(self.in_command_state())];
            if let Some(place) = self.to_pc.integers.get_mut(number - 1) {
                *place = value;
            }
        }
        if self.closing_cycles.is_some() {
            self.to_pc.integers[0] = -1;
        }
        let code = self.fault.map_or(0, |fault| fault.code());
        if code != self.told_fault && self.settings.script != KrlProgram::Centro {
            self.to_pc.integers[1] = code;
        }
        self.told_fault = code;
    }

    fn acknowledge_by_program(&mut self, command: Option<&CommandDatagram>) {
        let rested = self.robot.at_rest_for_s >= self.settings.robot.acknowledge_after_s;
        let mirrors = command.is_some_and(|command| self.not_mirrored(command).is_none());
        if self.settings.acknowledge == Acknowledge::Auto
            && !self.robot.emergency_stop
            && rested
            && mirrors
        {
            self.fault = None;
        }
    }

    fn monitor_reason(&self, command: Option<&CommandDatagram>) -> Option<MonitorReason> {
        let (quality, least) = (self.quality.quality(), self.settings.entry_quality.least());
        match command {
            _ if self.closing_cycles.is_some() => Some(MonitorReason::Closing),
            _ if self.robot.emergency_stop => Some(MonitorReason::EmergencyStop),
            _ if self.fault.is_some() => Some(MonitorReason::Acknowledgement),
            _ if !self.robot.drives_wanted => Some(MonitorReason::Drives),
            _ if !self.is_at_rest() => Some(MonitorReason::Rest),
            None => Some(MonitorReason::Answer),
            _ if quality < least => Some(MonitorReason::Quality {
                have: quality,
                least,
            }),
            Some(command) if !self.wants_command => Some(self.missing_request(command)),
            Some(command) if !self.reads(command.flags) => Some(MonitorReason::Flags {
                allowed: self.settings.strategy.flags(),
                have: command.flags,
            }),
            Some(command) => self.not_mirrored(command).map(MonitorReason::Mirror),
        }
    }

    fn missing_request(&self, command: &CommandDatagram) -> MonitorReason {
        let handshake = self.settings.script.handshake();
        let (number, asks) = handshake.map_or((1, "1"), |row| (row.request, row.asks));
        MonitorReason::Request {
            number,
            value: command.krl.integers.get(number - 1).copied().unwrap_or(0),
            asks,
        }
    }
}
