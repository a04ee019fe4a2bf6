//! When the next cycle begins: every period of the executor's own clock, or a fixed time after a device's packets.
//! Pure, in virtual time in its tests; run by the real-time thread, which reads the packets' stamps from the board that it
//! latches anyway.
//!
//! Two stages. The first estimates when the device's packets come and how long its period really is (a phase-locked loop
//! of second order, Gardner, *Phaselock Techniques*, chapter 4, critically damped, with gains that shrink while it
//! settles); lost packets are counted by the device, so a gap is no error. The second moves the deadlines there, by at most
//! 1 % of a period in each cycle. Logical time does not know of it: it has one period for each cycle.

use rcc_core::message::{ClockState, ClockStatus};

/// Largest deviation of one cycle's length from the period: neighbours differ by at most twice as much.
const SLEW_MAX: f64 = 0.01;
/// Largest deviation of the device's clock that is believed: no quartz is worse.
const RATE_MAX: f64 = 0.002;
/// Part of a packet's deviation that moves the estimate, once settled: jitter of 200 µs moves it by 4 µs.
const GAIN: f64 = 0.02;
/// Part of the distance that a deadline is moved by in a cycle.
const PULL: f64 = 0.1;
/// Packets after which the estimate is used, and after which it is settled.
const PACKETS_TO_FOLLOW: u32 = 16;
const PACKETS_TO_LOCK: u32 = 64;
/// A deadline within this part of the period counts as locked, one beyond that part as lost.
const LOCKED_WITHIN: f64 = 0.05;
const UNLOCKED_BEYOND: f64 = 0.2;
/// Without packets for this time, or for so many periods, the device is lost.
const SILENCE_MAX_NS: f64 = 100e6;
const SILENCE_MAX_PERIODS: f64 = 10.0;
/// A packet further from where it should be, in periods of the device, says nothing; so many in a row say that the device
/// began anew.
const OUTLIER_BEYOND: f64 = 0.3;
const OUTLIERS_MAX: u32 = 5;
/// More periods than this between two packets are a new beginning, too.
const GAP_MAX: u64 = 10_000;
/// How fast the reported figures follow.
const SMOOTHING: f64 = 1.0 / 64.0;

/// A device that the clock follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FollowedDevice {
    /// Index of the device.
    pub device: u32,
    /// How long after a packet of the device a cycle begins, ns.
    pub offset_ns: u64,
}

/// The newest packet of the device, as its driver tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet {
    /// Periods of the device so far, lost packets included.
    pub periods: u64,
    /// CLOCK_MONOTONIC at which it came.
    pub stamp_ns: u64,
    /// Period of the device, nominal.
    pub period_ns: u64,
}

/// Where the device's packets are, in ns since the clock's origin.
#[derive(Clone, Copy, Debug)]
struct Estimate {
    last: Packet,
    /// When the last packet should have come.
    at_ns: f64,
    /// Packets that it is made of.
    packets: u32,
    outliers: u32,
}

/// The executor's deadlines.
#[derive(Clone, Debug)]
pub struct Clock {
    period_ns: f64,
    follow: Option<FollowedDevice>,
    origin_ns: u64,
    deadline_ns: u64,
    /// What the deadline would have beyond whole ns.
    fraction_ns: f64,
    estimate: Option<Estimate>,
    /// The device's clock against ours: one of its seconds has 1 + rate of ours.
    rate: f64,
    state: ClockState,
    /// From where the deadline is to where it should be.
    distance_ns: f64,
    error_ns: f64,
    jitter_ns: f64,
    losses: u64,
}

impl Clock {
    /// A clock whose first deadline is a period from now.
    pub fn new(period_ns: u64, follow: Option<FollowedDevice>, now_ns: u64) -> Clock {
        Clock {
            period_ns: period_ns.max(1) as f64,
            follow,
            origin_ns: now_ns,
            deadline_ns: now_ns + period_ns,
            fraction_ns: 0.0,
            estimate: None,
            rate: 0.0,
            state: match follow {
                Some(_) => ClockState::Searching,
                None => ClockState::Own,
            },
            distance_ns: 0.0,
            error_ns: 0.0,
            jitter_ns: 0.0,
            losses: 0,
        }
    }

    /// The device that it follows.
    pub fn follows(&self) -> Option<u32> {
        self.follow.map(|follow| follow.device)
    }

    /// When this cycle begins, CLOCK_MONOTONIC.
    pub fn deadline_ns(&self) -> u64 {
        self.deadline_ns
    }

    /// For the status board.
    pub fn status(&self) -> ClockStatus {
        let device = self.follow.map_or(u32::MAX, |follow| follow.device);
        let nominal_ns = self
            .estimate
            .map_or(0.0, |estimate| estimate.last.period_ns as f64);
        ClockStatus {
            state: self.state as u32,
            device,
            error_ns: self.error_ns,
            jitter_ns: self.jitter_ns,
            device_period_ns: nominal_ns * (1.0 + self.rate),
            rate_ppm: self.rate * 1e6,
            losses: self.losses,
        }
    }

    /// In each cycle: the newest packet of the device, `None` if the device is lost.
    pub fn observe(&mut self, now_ns: u64, packet: Option<Packet>) {
        if self.follow.is_none() {
            return;
        }
        let news = packet.filter(|packet| {
            let known = self.estimate.as_ref();
            known.is_none_or(|known| known.last.stamp_ns != packet.stamp_ns)
        });
        match news {
            Some(packet) => self.track_packet(packet),
            None => self.check_silence(now_ns),
        }
        self.update_state();
    }

    /// The cycle has ended: the next deadline. Missed periods are skipped and counted, never caught up.
    pub fn advance(&mut self, ended_ns: u64) -> u64 {
        let length_ns = self.period_ns * (1.0 + self.rate);
        self.distance_ns = self.distance(length_ns);
        let slew_ns = SLEW_MAX * self.period_ns;
        let longer_ns = length_ns - self.period_ns + PULL * self.distance_ns;
        self.move_deadline(self.period_ns + longer_ns.clamp(-slew_ns, slew_ns));
        if ended_ns < self.deadline_ns {
            return 0;
        }
        let behind_ns = (ended_ns - self.deadline_ns) as f64;
        let skipped = (behind_ns / length_ns).floor() + 1.0;
        self.move_deadline(skipped * length_ns);
        // Rounding may leave it a nanosecond short.
        self.deadline_ns = self.deadline_ns.max(ended_ns + 1);
        skipped as u64
    }

    fn move_deadline(&mut self, length_ns: f64) {
        let exact_ns = self.fraction_ns + length_ns;
        let whole_ns = exact_ns.floor();
        self.deadline_ns += whole_ns as u64;
        self.fraction_ns = exact_ns - whole_ns;
    }

    /// From the deadline to the nearest time at which a cycle should begin; 0 while nobody knows.
    fn distance(&self, length_ns: f64) -> f64 {
        let (Some(follow), Some(estimate)) = (self.follow, self.estimate) else {
            return 0.0;
        };
        if estimate.packets < PACKETS_TO_FOLLOW {
            return 0.0;
        }
        let wanted_ns = estimate.at_ns + follow.offset_ns as f64;
        let away_ns = wanted_ns - self.since_origin(self.deadline_ns) - self.fraction_ns;
        away_ns - length_ns * (away_ns / length_ns).round()
    }

    fn since_origin(&self, time_ns: u64) -> f64 {
        // Signed: a stamp may be older than the clock.
        time_ns.wrapping_sub(self.origin_ns).cast_signed() as f64
    }

    fn track_packet(&mut self, packet: Packet) {
        let periods = packet.period_ns as f64 / self.period_ns;
        let fits = periods >= 0.999 && (periods - periods.round()).abs() <= 1e-3 * periods;
        let before = self.estimate.filter(|before| {
            let gap = packet.periods.wrapping_sub(before.last.periods);
            (1..=GAP_MAX).contains(&gap) && before.last.period_ns == packet.period_ns
        });
        let Some(before) = before.filter(|_| fits) else {
            self.restart_estimate(packet, fits);
            return;
        };
        let nominal_ns = packet.period_ns as f64;
        let gap = (packet.periods - before.last.periods) as f64;
        let expected_ns = before.at_ns + gap * nominal_ns * (1.0 + self.rate);
        // A device that stood still for some periods need not have counted them: it goes on in its old rhythm.
        let real_ns = nominal_ns * (1.0 + self.rate);
        let error_ns = self.since_origin(packet.stamp_ns) - expected_ns;
        let expected_ns = expected_ns + real_ns * (error_ns / real_ns).round();
        let error_ns = self.since_origin(packet.stamp_ns) - expected_ns;
        let is_outlier = error_ns.abs() > OUTLIER_BEYOND * nominal_ns;
        if is_outlier && before.outliers + 1 >= OUTLIERS_MAX {
            self.restart_estimate(packet, fits);
            return;
        }
        let packets = before.packets.saturating_add(1);
        let gain = GAIN.max(1.0 / f64::from(packets));
        if packets > PACKETS_TO_FOLLOW && !is_outlier {
            let rate = self.rate + 0.25 * gain * gain * error_ns / (nominal_ns * gap);
            self.rate = rate.clamp(-RATE_MAX, RATE_MAX);
        }
        let moved_ns = if is_outlier { 0.0 } else { gain * error_ns };
        self.estimate = Some(Estimate {
            last: packet,
            at_ns: expected_ns + moved_ns,
            packets,
            outliers: if is_outlier { before.outliers + 1 } else { 0 },
        });
        self.error_ns += SMOOTHING * (error_ns + self.distance_ns - self.error_ns);
        self.jitter_ns += SMOOTHING * (error_ns.abs() - self.jitter_ns);
    }

    /// Nothing is known but this packet.
    fn restart_estimate(&mut self, packet: Packet, fits: bool) {
        self.release_lock(if fits {
            ClockState::Searching
        } else {
            ClockState::Unfit
        });
        self.estimate = Some(Estimate {
            last: packet,
            at_ns: self.since_origin(packet.stamp_ns),
            packets: u32::from(fits),
            outliers: 0,
        });
    }

    /// No news: after a while the device is lost, and its own clock is what is left.
    fn check_silence(&mut self, now_ns: u64) {
        let Some(estimate) = self.estimate else {
            return;
        };
        let silent_ns = self.since_origin(now_ns) - self.since_origin(estimate.last.stamp_ns);
        let periods_ns = SILENCE_MAX_PERIODS * estimate.last.period_ns as f64;
        if silent_ns > periods_ns.max(SILENCE_MAX_NS) {
            self.release_lock(ClockState::Searching);
        }
    }

    /// On its own from here, with the period of the configuration; the deadlines go on from where they are.
    fn release_lock(&mut self, state: ClockState) {
        self.losses += u64::from(self.state == ClockState::Locked);
        self.state = state;
        self.estimate = None;
        (self.rate, self.error_ns, self.jitter_ns) = (0.0, 0.0, 0.0);
    }

    fn update_state(&mut self) {
        let packets = self.estimate.map_or(0, |estimate| estimate.packets);
        let away = self.distance_ns.abs() / self.period_ns;
        self.state = match self.state {
            ClockState::Searching if packets >= PACKETS_TO_LOCK && away <= LOCKED_WITHIN => {
                ClockState::Locked
            }
            ClockState::Locked if away > UNLOCKED_BEYOND => {
                self.losses += 1;
                ClockState::Searching
            }
            state => state,
        };
    }
}

#[cfg(test)]
mod tests;
