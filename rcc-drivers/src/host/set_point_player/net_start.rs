//! Decides which net may start commanding the joints.
//! Pure; run by the host's thread after each exchange.

use rcc_core::guard::ViolationKind;

use super::super::playback_rate::PlaybackRate;
use super::super::reason;
use super::super::set_point_buffer::BUFFER_LENGTH;
use super::super::start_blend::StartBlend;
use super::super::tracking_offset::TrackingOffset;
use super::{PlayerPhase, SetPointPlayer};

impl SetPointPlayer {
    /// Searches the new set-points for a net that starts commanding; follows it once its delay has passed.
    pub(super) fn accept_new_net(&mut self) {
        // Each round except the last refuses one owner, and there are at most as many as set-points.
        for _ in 0..BUFFER_LENGTH {
            self.scan_set_points();
            let PlayerPhase::Waiting { first } = self.phase else {
                return;
            };
            if self.buffer.newest().saturating_sub(first) < self.delay() {
                return;
            }
            self.begin(first);
        }
    }

    fn scan_set_points(&mut self) {
        let may_begin =
            self.commandable && self.startable && self.executor_live && !self.terminating;
        while self.cursor < self.buffer.newest() {
            if matches!(
                self.phase,
                PlayerPhase::Waiting { .. } | PlayerPhase::Following
            ) {
                return;
            }
            self.cursor = (self.cursor + 1).max(self.buffer.oldest());
            let owner = match self.buffer.commanded(self.cursor) {
                Some(entry) if entry.owner != self.refused_owner => entry.owner,
                _ => continue,
            };
            match self.phase {
                PlayerPhase::Holding if may_begin => {
                    self.phase = PlayerPhase::Waiting { first: self.cursor }
                }
                _ => self.refuse(owner, reason::NOT_STARTABLE),
            }
        }
    }

    /// Starts following a net if its first set-point is at the hold position, within the tolerance.
    fn begin(&mut self, first: u64) {
        let Some(entry) = self.buffer.commanded(first).copied() else {
            self.phase = PlayerPhase::Holding;
            return self.refuse_newest_owner(reason::SET_POINTS_LOST);
        };
        let hold = self.sent.position;
        // The second call sets the guard's history: the blend starts at the hold position.
        let checked = self
            .guard
            .first(&entry.position, &hold)
            .and_then(|()| self.guard.first(&hold, &hold))
            .and_then(|()| {
                let dt_s = self.buffer.period_ns() as f64 * 1e-9;
                self.guard
                    .check_impedance(&entry.impedance, self.strategy, dt_s)
            });
        if let Err(violation) = checked {
            let why = match violation.kind {
                ViolationKind::Strategy => reason::STRATEGY,
                _ => reason::FIRST_SET_POINT,
            };
            self.counts.violations += 1;
            self.violation = Some(violation);
            self.phase = PlayerPhase::Holding;
            return self.refuse(entry.owner, why);
        }
        self.start_blend = StartBlend::new(&hold, &entry.position, &self.settings.limits);
        self.playback_rate = PlaybackRate::NOMINAL;
        self.dwelling = false;
        self.lockstep = self.is_lockstep();
        self.tracking_offset = TrackingOffset::NONE;
        self.bridged = 0;
        (self.pointer, self.pointer_fraction) = (first, 0.0);
        self.outputs = entry;
        if self.lockstep {
            self.skip_to_newest();
        }
        self.reason = 0;
        self.violation = None;
        self.phase = PlayerPhase::Following;
    }

    /// A faster executor has already written several set-points: this exchange plays the newest one of the net.
    fn skip_to_newest(&mut self) {
        for _ in 0..BUFFER_LENGTH {
            let Some(entry) = self.buffer.commanded(self.pointer + 1) else {
                return;
            };
            self.outputs = *entry;
            self.pointer += 1;
        }
    }
}
