//! Computes the deadline of each cycle: either one period after the other by the executor's own clock, or at a fixed
//! offset after the packets of a device. Runs in the real-time thread, which takes the packets' time stamps from the
//! board that it latches anyway; tests run it in virtual time.
//!
//! There are two stages. The first is a second-order phase-locked loop (Gardner, *Phaselock Techniques*, chapter 4;
//! critically damped, with gains that decrease while it settles) that estimates the phase and the period of the
//! device's packets. The device counts its periods, lost packets included, so a gap causes no error. The second stage
//! moves the deadlines towards that phase by at most 1 % of a period in each cycle. Logical time is not affected: it
//! advances by exactly one period per cycle.

use rcc_core::message::{ClockState, ClockStatus};

/// Maximum deviation of one cycle's length from the period, as a fraction; two successive cycles differ by at most
/// twice as much.
const SLEW_MAX: f64 = 0.01;
/// Maximum accepted rate deviation of the device's clock, as a fraction; no quartz oscillator is worse.
const RATE_MAX: f64 = 0.002;
/// Fraction of a packet's phase error by which the estimate moves once it is settled: jitter of 200 µs moves it by 4
/// µs.
const GAIN: f64 = 0.02;
/// Fraction of the remaining phase error by which one cycle moves the deadline.
const PULL: f64 = 0.1;
/// Number of packets after which the estimate is used, and after which the clock may report `locked`.
const PACKETS_TO_FOLLOW: u32 = 16;
const PACKETS_TO_LOCK: u32 = 64;
/// Phase errors, as fractions of the period, below which the clock becomes locked and above which it loses the lock.
const LOCKED_WITHIN: f64 = 0.05;
const UNLOCKED_BEYOND: f64 = 0.2;
/// The device is lost after this time or this number of its periods without a packet, whichever is longer.
const SILENCE_MAX_NS: f64 = 100e6;
const SILENCE_MAX_PERIODS: f64 = 10.0;
/// A packet further from its expected arrival than this fraction of the device's period is an outlier and does not move
/// the estimate. This many outliers in a row mean that the device restarted, and the estimate starts again.
const OUTLIER_BEYOND: f64 = 0.3;
const OUTLIERS_MAX: u32 = 5;
/// Maximum gap between two packets, in device periods; a larger one restarts the estimate.
const GAP_MAX: u64 = 10_000;
/// Weight of a new value in the exponentially smoothed figures of the status.
const SMOOTHING: f64 = 1.0 / 64.0;

/// The device whose packets determine the cycle's phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FollowedDevice {
    /// Index of the device in the cell's configuration.
    pub device: u32,
    /// Offset from the arrival of a packet to the begin of a cycle, ns.
    pub offset_ns: u64,
}

/// The newest packet of the device, as its driver reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet {
    /// Number of device periods so far, lost packets included.
    pub periods: u64,
    /// Arrival time, CLOCK_MONOTONIC, ns.
    pub stamp_ns: u64,
    /// Nominal period of the device, ns.
    pub period_ns: u64,
}

/// Estimated phase of the device's packets; times are in ns since the clock's origin.
#[derive(Clone, Copy, Debug)]
struct Estimate {
    last: Packet,
    /// Estimated arrival time of the last packet.
    at_ns: f64,
    /// Number of packets in the estimate.
    packets: u32,
    outliers: u32,
}

/// Computes the executor's deadlines.
#[derive(Clone, Debug)]
pub struct Clock {
    period_ns: f64,
    follow: Option<FollowedDevice>,
    origin_ns: u64,
    deadline_ns: u64,
    /// Fraction of a nanosecond that the integer deadline lacks.
    fraction_ns: f64,
    estimate: Option<Estimate>,
    /// Rate of the device's clock relative to ours: one second of the device lasts 1 + `rate` of our seconds.
    rate: f64,
    state: ClockState,
    /// Phase error: from the deadline to where it should be, ns.
    distance_ns: f64,
    error_ns: f64,
    jitter_ns: f64,
    losses: u64,
}

impl Clock {
    /// Creates a clock whose first deadline is one period after `now_ns`.
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

    /// Returns the index of the followed device, if any.
    pub fn follows(&self) -> Option<u32> {
        self.follow.map(|follow| follow.device)
    }

    /// Returns the deadline at which the next cycle begins, CLOCK_MONOTONIC, ns.
    pub fn deadline_ns(&self) -> u64 {
        self.deadline_ns
    }

    /// Returns the clock's state for the status board.
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

    /// Processes the device's newest packet; call it once per cycle. `None` means that the device is lost.
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

    /// Moves the deadline to the next cycle and returns the number of skipped periods. Missed periods are skipped and
    /// counted, never caught up with.
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
        // Rounding may leave the deadline a nanosecond before the end of the cycle.
        self.deadline_ns = self.deadline_ns.max(ended_ns + 1);
        skipped as u64
    }

    fn move_deadline(&mut self, length_ns: f64) {
        let exact_ns = self.fraction_ns + length_ns;
        let whole_ns = exact_ns.floor();
        self.deadline_ns += whole_ns as u64;
        self.fraction_ns = exact_ns - whole_ns;
    }

    /// Returns the distance from the deadline to the nearest wanted begin of a cycle, ns; 0 while the estimate is not
    /// usable.
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
        // Signed, because a stamp may be older than the clock's origin.
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
        // A device that stood still for some periods may not have counted them. It continues in its old phase, so whole
        // periods are removed from the error.
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

    /// Restarts the estimate from this packet alone.
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

    /// Drops the estimate when no packet has arrived for too long; the executor's own clock is used from then on.
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

    /// Stops following the device: cycles have the configured period again and continue from the current deadline.
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
