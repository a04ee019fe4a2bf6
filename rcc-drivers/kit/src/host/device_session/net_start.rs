//! Decides which net may start commanding the device.
//! Pure; run by the host's thread in each exchange.

use rcc_core::guard::ViolationKind;

use super::phase::SessionPhase;
use super::playback::{Playback, PlaybackContext};
use super::{DeviceSession, Shutdown};
use crate::driver::Exchange;
use crate::host::reason;
use crate::host::set_point_buffer::BUFFER_LENGTH;

impl DeviceSession {
    /// Searches the new set-points for a net that starts commanding; follows it once its delay has passed.
    pub(super) fn accept_new_net(&mut self, exchange: &Exchange) {
        // Each round except the last refuses one owner, and there are at most as many as set-points.
        for _ in 0..BUFFER_LENGTH {
            self.scan_set_points();
            let SessionPhase::Waiting { first } = self.phase else {
                return;
            };
            let buffer = &self.feed.buffer;
            if buffer.newest().saturating_sub(first) < self.settings.delay(buffer, exchange) {
                return;
            }
            self.begin(first, exchange);
        }
    }

    /// Returns true if a net may start commanding the device, as far as its phase allows it.
    pub(super) fn may_begin(&self) -> bool {
        self.startable && self.feed.is_live() && self.shutdown == Shutdown::NotRequested
    }

    fn scan_set_points(&mut self) {
        while !matches!(
            self.phase,
            SessionPhase::Waiting { .. } | SessionPhase::Following(_)
        ) {
            let Some(owner) = self.feed.next_owner() else {
                return;
            };
            match self.phase {
                SessionPhase::Holding if self.may_begin() => {
                    let first = self.feed.cursor;
                    self.phase = SessionPhase::Waiting { first };
                }
                _ => self.refuse(owner, reason::NOT_STARTABLE),
            }
        }
    }

    /// Starts following a net if its first set-point is at the hold position, within the tolerance.
    fn begin(&mut self, first: u64, exchange: &Exchange) {
        self.phase = SessionPhase::Holding;
        let Some(entry) = self.feed.buffer.commanded(first) else {
            return self.refuse_newest_owner(reason::SET_POINTS_LOST);
        };
        let mut context = PlaybackContext {
            settings: &self.settings,
            buffer: &self.feed.buffer,
            exchange,
            outputs: &mut self.outputs,
            counts: &mut self.counts,
        };
        match Playback::start((first, entry), &self.position, &mut context) {
            Ok(playback) => {
                self.played = playback.pointer();
                self.reason = 0;
                self.violation = None;
                self.phase = SessionPhase::Following(playback);
            }
            Err(violation) => {
                let why = match violation.kind {
                    ViolationKind::Strategy => reason::STRATEGY,
                    _ => reason::FIRST_SET_POINT,
                };
                let owner = entry.owner;
                self.count_violation(violation);
                self.refuse(owner, why);
            }
        }
    }
}
