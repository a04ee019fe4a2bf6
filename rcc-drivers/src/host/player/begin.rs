//! Who begins to command the joints, and whether that may be followed.
//! Pure; run by the host's thread after each exchange.

use rcc_core::guard::ViolationKind;

use super::super::blend::Blend;
use super::super::detour::Detour;
use super::super::pace::Pace;
use super::super::reason;
use super::super::track::TRACK_LENGTH;
use super::{Phase, Player};

impl Player {
    /// Looks through the new set-points for a net that begins to command; follows it as soon as its delay is over.
    pub(super) fn look_for_a_beginning(&mut self) {
        // Each round but the last refuses somebody, and there are no more of them than set-points.
        for _ in 0..TRACK_LENGTH {
            self.look_through();
            let Phase::Waiting { first } = self.phase else {
                return;
            };
            if self.track.newest().saturating_sub(first) < self.delay() {
                return;
            }
            self.begin(first);
        }
    }

    fn look_through(&mut self) {
        let may_begin = self.commandable && self.startable && self.live && !self.terminating;
        while self.cursor < self.track.newest() {
            if matches!(self.phase, Phase::Waiting { .. } | Phase::Following) {
                return;
            }
            self.cursor = (self.cursor + 1).max(self.track.oldest());
            let owner = match self.track.commanded(self.cursor) {
                Some(entry) if entry.owner != self.refused => entry.owner,
                _ => continue,
            };
            match self.phase {
                Phase::Holding if may_begin => self.phase = Phase::Waiting { first: self.cursor },
                _ => self.refuse(owner, reason::NOT_STARTABLE),
            }
        }
    }

    /// The first set-point is sent if it is where the arm is held.
    fn begin(&mut self, first: u64) {
        let Some(entry) = self.track.commanded(first).copied() else {
            self.phase = Phase::Holding;
            return self.refuse_the_newest(reason::SET_POINTS_LOST);
        };
        let hold = self.sent.position;
        // The second time for the history: the blend begins at the hold position.
        let checked = self
            .guard
            .first(&entry.position, &hold)
            .and_then(|()| self.guard.first(&hold, &hold))
            .and_then(|()| {
                let dt_s = self.track.period_ns() as f64 * 1e-9;
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
            self.phase = Phase::Holding;
            return self.refuse(entry.owner, why);
        }
        self.blend = Blend::new(&hold, &entry.position, &self.settings.limits);
        self.pace = Pace::EVEN;
        self.dwelling = false;
        self.direct = self.is_direct();
        self.detour = Detour::NONE;
        self.bridged = 0;
        (self.entry, self.fraction) = (first, 0.0);
        self.outputs = entry;
        if self.direct {
            self.go_to_the_newest();
        }
        self.reason = 0;
        self.violation = None;
        self.phase = Phase::Following;
    }

    /// A faster executor has written more than one set-point by now: the newest one of this net is that of this exchange.
    fn go_to_the_newest(&mut self) {
        for _ in 0..TRACK_LENGTH {
            let Some(entry) = self.track.commanded(self.entry + 1) else {
                return;
            };
            self.outputs = *entry;
            self.entry += 1;
        }
    }
}
