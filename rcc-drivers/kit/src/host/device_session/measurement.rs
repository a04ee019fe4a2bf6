//! The measurement board of a device: the part that comes from the device, and the part that says what the session
//! does.
//! Pure; run by the host's thread.

use rcc_core::message::{DeviceState, MAGIC, Measurement};

use super::phase::SessionPhase;
use super::{DeviceSession, Shutdown};
use crate::driver::{Exchange, Inputs};
use crate::host::reason;

impl DeviceSession {
    /// Updates the part of the measurement that comes from the device.
    pub(super) fn update_inputs(&mut self, now_ns: u64, inputs: &Inputs, exchange: &Exchange) {
        let periods = self
            .measurement
            .periods
            .saturating_add(exchange.ticks.max(1));
        self.measurement = Measurement {
            magic: MAGIC,
            sequence: self.measurement.sequence + 1,
            stamp_ns: now_ns,
            periods,
            period_ns: exchange.period_ns,
            quality_permille: exchange.quality_permille,
            strategy: exchange.strategy as u64,
            position: inputs.position,
            torque: inputs.torque,
            external_torque: inputs.external_torque,
            wrench: inputs.wrench,
            digital: inputs.digital,
            digital_known: inputs.digital_known,
            analog: inputs.analog,
            late: exchange.late,
            refused: exchange.refused,
            ..self.measurement
        };
    }

    /// Updates the part of the measurement that says what the session does.
    pub(super) fn update_state(&mut self, exchange: &Exchange) {
        let range = match self.out_of_range() {
            0 => 0,
            _ => reason::ANALOG_RANGE,
        };
        let state = self.state();
        // Once the device is ready again, the reason of an earlier stop no longer applies.
        let history = match state {
            DeviceState::Ready | DeviceState::Commanded => 0,
            _ => self.reason(),
        };
        // Has priority: nothing done at the device can remedy it.
        let executor_incompatible = match self.executor_incompatible {
            true => reason::OTHER_CONFIGURATION,
            false => 0,
        };
        let reasons = [executor_incompatible, exchange.reason, history, range];
        let outputs = self.output_release.values();
        self.measurement = Measurement {
            state: state as u32,
            reason: reasons.into_iter().find(|reason| *reason != 0).unwrap_or(0),
            hold: self.position,
            digital_out: outputs.digital,
            digital_out_known: outputs.digital_set,
            analog_out: outputs.analog,
            executor: self.feed.executor(),
            played_ns: self.played_ns(),
            settled_ns: self.settled_ns(),
            margin: self.margin(),
            starved: self.counts.starved,
            ..self.measurement
        };
    }

    /// Returns the state for the executor.
    pub(super) fn state(&self) -> DeviceState {
        match self.phase {
            SessionPhase::Offline => DeviceState::Offline,
            SessionPhase::Stopping(_) => DeviceState::Stopping,
            SessionPhase::Waiting { .. } | SessionPhase::Following(_) => DeviceState::Commanded,
            SessionPhase::Holding if self.may_begin() && self.feed.idle_set_point().is_some() => {
                DeviceState::Ready
            }
            SessionPhase::Holding | SessionPhase::Mirroring => DeviceState::Online,
        }
    }

    /// Returns why the device is not ready, or why it stopped or refused a net last; 0 = none.
    pub(super) fn reason(&self) -> u32 {
        match self.reason {
            _ if self.shutdown != Shutdown::NotRequested => reason::TERMINATING,
            0 if !self.feed.is_live() => reason::NO_EXECUTOR,
            reason => reason,
        }
    }

    /// Returns the logical time of the last set-point played, ns; 0 before the first.
    fn played_ns(&self) -> u64 {
        let buffer = &self.feed.buffer;
        let between = self.played.fraction * buffer.period_ns() as f64;
        buffer
            .at(self.played.cycle)
            .map_or(0, |entry| entry.logical_ns.saturating_add(between as u64))
    }

    /// Returns the logical time up to which everything has been played and the arm is at rest, ns; otherwise 0.
    pub(super) fn settled_ns(&self) -> u64 {
        let is_checked = self.feed.cursor == self.feed.buffer.newest();
        match self.feed.idle_set_point() {
            Some(newest) if is_checked && !self.phase.is_engaged() => newest.logical_ns,
            _ => 0,
        }
    }

    /// Returns the number of set-points left to play.
    pub(super) fn margin(&self) -> u64 {
        match &self.phase {
            SessionPhase::Following(playback) => {
                let newest = self.feed.buffer.newest();
                newest.saturating_sub(playback.pointer().cycle)
            }
            _ => 0,
        }
    }
}
