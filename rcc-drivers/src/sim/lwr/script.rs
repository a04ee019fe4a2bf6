//! The KRL program on the simulated controller: when command state begins and ends, who acknowledges a fault.
//! Pure; the clock thread runs it once a tick.

use super::fault::{Fault, Waiting};
use super::krc::Krc;
use super::settings::{Acknowledge, Script};
use crate::fri_lwr::wire::{CommandDatagram, Quality};

impl Krc {
    /// One pass of the program: what the PC asks for, what ends, what may begin.
    pub(super) fn run_script(&mut self, command: Option<&CommandDatagram>) {
        if let (Some(command), Script::FirstApp) = (command, self.settings.script) {
            match command.krl.integers[0] {
                1 | 10 => self.wants_command = true,
                0 | 2 => self.wants_command = false,
                _ => {}
            }
        }
        if self.settings.script == Script::Auto {
            self.wants_command = true;
        }
        if let Some(cycles) = &mut self.farewell {
            self.wants_command = false;
            *cycles = cycles.saturating_sub(1);
        }
        if self.command_state {
            if self.quality.quality() == Quality::Unacceptable {
                self.fail(Fault::Quality {
                    answered: self.quality.figures().answered,
                });
            } else if !self.wants_command {
                self.stop();
            }
            self.waiting = self.waits_for(command).filter(|_| !self.command_state);
            return;
        }
        self.acknowledge_by_script(command);
        self.waiting = self.waits_for(command);
        if self.waiting.is_none() {
            self.enter_command_state();
        }
    }

    fn acknowledge_by_script(&mut self, command: Option<&CommandDatagram>) {
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

    fn waits_for(&self, command: Option<&CommandDatagram>) -> Option<Waiting> {
        let quality = self.quality.quality();
        match command {
            _ if self.farewell.is_some() => Some(Waiting::Closing),
            _ if self.emergency_stop => Some(Waiting::EmergencyStop),
            _ if self.fault.is_some() => Some(Waiting::Acknowledgement),
            _ if !self.drives_wanted => Some(Waiting::Drives),
            _ if !self.is_at_rest() => Some(Waiting::Rest),
            None => Some(Waiting::Answer),
            _ if quality < Quality::Ok => Some(Waiting::Quality(quality)),
            Some(command) if !self.wants_command => Some(Waiting::Request(command.krl.integers[0])),
            Some(command) if command.flags != self.settings.strategy.flags() => {
                Some(Waiting::Flags {
                    want: self.settings.strategy.flags(),
                    have: command.flags,
                })
            }
            Some(command) => self
                .not_mirrored(command)
                .map(|(joint, value)| Waiting::Mirror {
                    joint,
                    value,
                    own: self.desired[joint],
                }),
        }
    }
}
