//! Tests the clock against devices with drift, jitter, lost packets and stalls, in virtual time.

use super::*;

const MS: u64 = 1_000_000;
const OFFSET_NS: u64 = 200_000;

/// Simulates a device with its driver, and an executor that always wakes on time.
struct ClockTest {
    clock: Clock,
    period_ns: u64,
    /// Nominal period of the device, ns; the real one is longer by `drift_ppm`.
    device_ns: u64,
    drift_ppm: f64,
    jitter_ns: f64,
    /// Arrival time of the first packet, ns.
    phase_ns: f64,
    /// Number of packets the device has sent.
    periods: u64,
    newest: Option<Packet>,
    /// Returns whether a packet, given by its number, reaches the driver.
    arrives: fn(u64) -> bool,
    random: u64,
    /// Begin of each cycle, ns.
    begins_ns: Vec<u64>,
    /// Age of the newest packet at the begin of each cycle, ns.
    ages_ns: Vec<u64>,
}

impl ClockTest {
    fn new(period_ns: u64, device_ns: u64, phase_ns: u64) -> ClockTest {
        let follow = FollowedDevice {
            device: 0,
            offset_ns: OFFSET_NS,
        };
        let now_ns = 5_000 * MS;
        ClockTest {
            clock: Clock::new(period_ns, Some(follow), now_ns),
            period_ns,
            device_ns,
            drift_ppm: 0.0,
            jitter_ns: 0.0,
            phase_ns: (now_ns + phase_ns) as f64,
            periods: 0,
            newest: None,
            arrives: |_| true,
            random: 1,
            begins_ns: Vec::new(),
            ages_ns: Vec::new(),
        }
    }

    /// Returns a pseudo-random number, uniform in -1..1 (Knuth's MMIX generator).
    fn random(&mut self) -> f64 {
        self.random = self
            .random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.random >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn next_packet_ns(&self) -> f64 {
        self.phase_ns + self.periods as f64 * self.device_ns as f64 * (1.0 + self.drift_ppm * 1e-6)
    }

    /// Runs one cycle, which ends 10 µs after its deadline.
    fn step(&mut self) -> u64 {
        let now_ns = self.clock.deadline_ns();
        while self.next_packet_ns() + self.jitter_ns <= now_ns as f64 {
            let late_ns = self.jitter_ns * self.random();
            let stamp_ns = (self.next_packet_ns() + late_ns) as u64;
            self.periods += 1;
            if (self.arrives)(self.periods) {
                self.newest = Some(Packet {
                    periods: self.periods,
                    stamp_ns,
                    period_ns: self.device_ns,
                });
            }
        }
        // The executor also ignores a board that is older than 50 ms.
        let newest = self
            .newest
            .filter(|packet| now_ns - packet.stamp_ns < 50 * MS);
        self.clock.observe(now_ns, newest);
        let skipped = self.clock.advance(now_ns + 10_000);
        self.begins_ns.push(now_ns);
        self.ages_ns.push(
            self.newest
                .map_or(u64::MAX, |packet| now_ns - packet.stamp_ns),
        );
        skipped
    }

    fn steps(&mut self, count: usize) {
        (0..count).for_each(|_| assert_eq!(self.step(), 0));
        let period = self.period_ns as f64;
        for pair in self.begins_ns.windows(2) {
            let length = (pair[1] - pair[0]) as f64;
            assert!(
                (length - period).abs() <= SLEW_MAX * period + 1.0,
                "a cycle of {length} ns"
            );
        }
    }

    fn state(&self) -> ClockState {
        self.clock.state
    }

    /// Returns the largest phase error of the last `cycles` cycles, ns; valid for packets without jitter.
    fn worst_ns(&self, cycles: usize) -> f64 {
        let real_ns = self.device_ns as f64 * (1.0 + self.drift_ppm * 1e-6);
        let step_ns = real_ns / (self.device_ns as f64 / self.period_ns as f64).round();
        let last = self.begins_ns.iter().rev().take(cycles);
        let away = last.map(|begin| {
            let away = *begin as f64 - self.phase_ns - OFFSET_NS as f64;
            (away - step_ns * (away / step_ns).round()).abs()
        });
        away.fold(0.0, f64::max)
    }
}

#[test]
fn without_a_device_every_period_is_the_configured_one() {
    let mut clock = Clock::new(MS, None, 7);
    for cycle in 1..1000 {
        assert_eq!(clock.deadline_ns(), 7 + cycle * MS);
        clock.observe(clock.deadline_ns(), None);
        assert_eq!(clock.advance(clock.deadline_ns() + 5), 0);
    }
    assert_eq!(clock.status().state, ClockState::Own as u32);
}

#[test]
fn missed_periods_are_skipped_and_counted() {
    for (ended_ns, skipped, next_ns) in [
        (1_500, 0, 2_000),
        (1_999, 0, 2_000),
        (2_000, 1, 3_000),
        (5_200, 4, 6_000),
    ] {
        let mut clock = Clock::new(1_000, None, 0);
        assert_eq!(clock.advance(ended_ns), skipped, "{ended_ns}");
        assert_eq!(clock.deadline_ns(), next_ns);
    }
}

#[test]
fn locks_from_any_phase() {
    for phase in 0..20 {
        let mut test = ClockTest::new(MS, MS, phase * MS / 20);
        test.steps(300);
        assert_eq!(test.state(), ClockState::Locked, "phase {phase}");
        assert!(
            test.worst_ns(100) < 2_000.0,
            "phase {phase}: {}",
            test.worst_ns(100)
        );
        for age in &test.ages_ns[200..] {
            assert!(
                age.abs_diff(OFFSET_NS) < 2_000,
                "phase {phase}: used after {age} ns"
            );
        }
    }
}

#[test]
fn follows_a_clock_that_is_100_ppm_off_either_way() {
    for drift_ppm in [-100.0, 100.0] {
        let mut test = ClockTest::new(MS, MS, 300_000);
        test.drift_ppm = drift_ppm;
        test.steps(3_000);
        assert_eq!(test.state(), ClockState::Locked);
        assert!(test.worst_ns(1000) < 1_000.0, "{}", test.worst_ns(1000));
        let status = test.clock.status();
        assert!(
            (status.rate_ppm - drift_ppm).abs() < 2.0,
            "{}",
            status.rate_ppm
        );
        assert!((status.device_period_ns - 1e6 * (1.0 + drift_ppm * 1e-6)).abs() < 2.0);
    }
}

#[test]
fn jitter_of_200_us_does_not_reach_the_cycle() {
    let mut test = ClockTest::new(MS, MS, 700_000);
    (test.jitter_ns, test.drift_ppm) = (200_000.0, 50.0);
    test.steps(2_000);
    test.steps(20_000);
    assert_eq!(
        (test.state(), test.clock.status().losses),
        (ClockState::Locked, 0)
    );
    assert!(
        test.worst_ns(20_000) < 60_000.0,
        "{}",
        test.worst_ns(20_000)
    );
    let jitter_ns = test.clock.status().jitter_ns;
    assert!((60_000.0..140_000.0).contains(&jitter_ns), "{jitter_ns}");
}

#[test]
fn lost_packets_cause_no_phase_error() {
    let mut test = ClockTest::new(MS, MS, 400_000);
    test.drift_ppm = 80.0;
    test.arrives = |packet| packet % 3 != 0 && packet % 7 > 2;
    test.steps(3_000);
    assert_eq!(test.state(), ClockState::Locked);
    assert!(test.worst_ns(1000) < 2_000.0, "{}", test.worst_ns(1000));
}

#[test]
fn a_device_that_stood_still_and_did_not_count_it_is_not_lost() {
    let mut test = ClockTest::new(MS, MS, 500_000);
    test.steps(1_000);
    test.phase_ns += 17e6;
    test.steps(1_000);
    assert_eq!(
        (test.state(), test.clock.status().losses),
        (ClockState::Locked, 0)
    );
    assert!(test.worst_ns(1_000) < 1_000.0, "{}", test.worst_ns(1_000));
}

#[test]
fn a_stall_of_50_ms_is_bridged() {
    let mut test = ClockTest::new(MS, MS, 100_000);
    test.drift_ppm = -60.0;
    test.arrives = |packet| !(5_000..5_050).contains(&packet);
    test.steps(6_000);
    assert_eq!(
        (test.state(), test.clock.status().losses),
        (ClockState::Locked, 0)
    );
    assert!(test.worst_ns(2_000) < 2_000.0, "{}", test.worst_ns(2_000));
}

#[test]
fn a_device_of_a_multiple_of_the_period_is_followed_cycle_by_cycle() {
    for (period_ns, device_ns) in [
        (MS, 4 * MS),
        (MS / 8, MS),
        (20 * MS, 20 * MS),
        (MS, 20 * MS),
    ] {
        let mut test = ClockTest::new(period_ns, device_ns, 350_000);
        (test.drift_ppm, test.jitter_ns) = (70.0, 20_000.0);
        test.steps(600 * (device_ns / period_ns) as usize + 2_000);
        assert_eq!(test.state(), ClockState::Locked, "{period_ns} {device_ns}");
        assert!(
            test.worst_ns(100) < 10_000.0,
            "{period_ns}: {}",
            test.worst_ns(100)
        );
    }
}

#[test]
fn jitter_beyond_the_period_does_not_confuse_a_slow_device() {
    let mut test = ClockTest::new(MS / 8, MS, 10_000);
    test.jitter_ns = 150_000.0;
    test.steps(40_000);
    assert_eq!(
        (test.state(), test.clock.status().losses),
        (ClockState::Locked, 0)
    );
    assert!(
        test.worst_ns(10_000) < 40_000.0,
        "{}",
        test.worst_ns(10_000)
    );
}

#[test]
fn without_its_device_the_clock_keeps_its_own_period_and_locks_again_later() {
    let mut test = ClockTest::new(MS, MS, 100_000);
    test.drift_ppm = 90.0;
    test.arrives = |packet| !(2_000..4_000).contains(&packet);
    test.steps(3_000);
    assert_eq!(
        (test.state(), test.clock.status().losses),
        (ClockState::Searching, 1)
    );
    let lengths = test.begins_ns[2_500..]
        .windows(2)
        .map(|pair| pair[1] - pair[0]);
    assert!(
        lengths.into_iter().all(|length| length == MS),
        "its own period, exactly"
    );
    test.steps(3_000);
    assert_eq!(test.state(), ClockState::Locked);
    assert!(test.worst_ns(500) < 2_000.0, "{}", test.worst_ns(500));
}

#[test]
fn a_device_that_restarts_with_another_phase_is_locked_again() {
    let mut test = ClockTest::new(MS, MS, 0);
    test.steps(1_000);
    test.phase_ns += 400_000.0;
    test.steps(40);
    test.periods = 0;
    test.phase_ns = *test.begins_ns.last().unwrap() as f64 + 130_000.0;
    test.steps(400);
    assert_eq!(test.state(), ClockState::Locked);
    assert!(test.worst_ns(100) < 2_000.0, "{}", test.worst_ns(100));
}

#[test]
fn a_device_whose_period_is_not_a_multiple_is_not_followed() {
    for device_ns in [1_500_000, 500_000, 1_100_000] {
        let mut test = ClockTest::new(MS, device_ns, 0);
        test.steps(500);
        assert_eq!(test.state(), ClockState::Unfit, "{device_ns}");
        assert!(
            test.begins_ns
                .windows(2)
                .all(|pair| pair[1] - pair[0] == MS)
        );
    }
}

#[test]
fn a_late_cycle_keeps_the_phase() {
    let mut test = ClockTest::new(MS, MS, 620_000);
    test.steps(500);
    let before_ns = test.clock.deadline_ns();
    assert_eq!(test.clock.advance(before_ns + 3 * MS + 5_000), 3);
    let away = test.clock.deadline_ns() as f64 - before_ns as f64 - 4e6;
    assert!(away.abs() < 100.0, "{away}");
    test.begins_ns.clear();
    test.steps(100);
    assert_eq!(test.state(), ClockState::Locked);
    assert!(test.worst_ns(100) < 2_000.0, "{}", test.worst_ns(100));
}
