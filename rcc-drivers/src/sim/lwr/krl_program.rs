//! The KRL program of the simulated controller: entry into and exit from command state, acknowledgement of faults.
//! Pure; run by the clock thread once per tick.

use super::fault::{KrcFault, MonitorReason};
use super::krc::Krc;
use super::settings::{Acknowledge, KrlProgram};
use crate::fri_lwr::wire::{CommandDatagram, Quality};

impl Krc {
    /// Runs one pass of the program: requests of the PC, exit from and entry into command state.
    pub(super) fn run_krl_program(&mut self, command: Option<&CommandDatagram>) {
        if let (Some(command), KrlProgram::FirstApp) = (command, self.settings.script) {
            match command.krl.integers[0] {
                1 | 10 => self.wants_command = true,
                0 | 2 => self.wants_command = false,
                _ => {}
            }
        }
        if self.settings.script == KrlProgram::Auto {
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

    fn acknowledge_by_program(&mut self, command: Option<&CommandDatagram>) {
        let rested = self.at_rest_for_s >= self.settings.acknowledge_after_s;
        let mirrors = command.is_some_and(|command| self.not_mirrored(command).is_none());
        if self.settings.acknowledge == Acknowledge::Auto
            && !self.emergency_stop
            && rested
            && mirrors
        {
            self.fault = None;
        }
    }

    fn monitor_reason(&self, command: Option<&CommandDatagram>) -> Option<MonitorReason> {
        let quality = self.quality.quality();
        match command {
            _ if self.closing_cycles.is_some() => Some(MonitorReason::Closing),
            _ if self.emergency_stop => Some(MonitorReason::EmergencyStop),
            _ if self.fault.is_some() => Some(MonitorReason::Acknowledgement),
            _ if !self.drives_wanted => Some(MonitorReason::Drives),
            _ if !self.is_at_rest() => Some(MonitorReason::Rest),
            None => Some(MonitorReason::Answer),
            _ if quality < Quality::Ok => Some(MonitorReason::Quality(quality)),
            Some(command) if !self.wants_command => {
                Some(MonitorReason::Request(command.krl.integers[0]))
            }
            Some(command) if !self.reads(command.flags) => Some(MonitorReason::Flags {
                allowed: self.settings.strategy.flags(),
                have: command.flags,
            }),
            Some(command) => self.not_mirrored(command).map(MonitorReason::Mirror),
        }
    }
}
