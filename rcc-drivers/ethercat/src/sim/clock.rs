//! The distributed clock of one SubDevice (ETG.1000.4, section 6.5): its own oscillator, which deviates, the system time that it
//! shows, and the control loop that follows the system time of the reference clock.
//! Pure, in the line's time; called by the thread of the socket.

use std::time::Duration;

use super::registers::{self as register, Memory};

/// Time that a frame needs from one SubDevice to the next, ns.
const HOP_NS: i64 = 500;
/// Part of a difference that one comparison corrects.
const LOOP: i64 = 4;
/// Deviations of the oscillators, parts per million, by serial number.
const DRIFT_PPM: [i64; 5] = [0, 20, -15, 8, -30];

/// A clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// Local time at the time 0 of the line, ns.
    origin_ns: i64,
    drift_ppm: i64,
    /// Correction by the control loop, ns.
    correction_ns: i64,
    /// SubDevices before it, and behind it.
    place: [i64; 2],
    /// System time minus that of the reference clock in the last comparison, ns.
    difference_ns: i64,
}

impl Clock {
    /// A clock after power-on; clocks of other serial numbers run differently.
    #[must_use]
    pub fn new(serial: u32) -> Clock {
        let index = serial as usize % DRIFT_PPM.len();
        Clock {
            origin_ns: i64::from(serial) * 1_234_567_891,
            drift_ppm: DRIFT_PPM.get(index).copied().unwrap_or(0),
            correction_ns: 0,
            place: [0; 2],
            difference_ns: 0,
        }
    }

    /// Sets how many SubDevices are before it and behind it.
    pub fn set_place(&mut self, before: usize, behind: usize) {
        self.place = [before, behind].map(|count| i64::try_from(count).unwrap_or(0));
    }

    /// Returns the difference from the reference clock in the last comparison, ns.
    #[must_use]
    pub fn difference_ns(&self) -> i64 {
        self.difference_ns
    }

    /// Returns its local time when a frame that enters the line at `now` arrives, ns.
    fn local_ns(&self, now: Duration) -> i64 {
        let [before, _] = self.place;
        let now_ns = i64::try_from(now.as_nanos()).unwrap_or(i64::MAX / 2) + before * HOP_NS;
        let drift_ns = i128::from(now_ns) * i128::from(self.drift_ppm) / 1_000_000;
        let drift_ns = i64::try_from(drift_ns).unwrap_or(0);
        self.origin_ns + now_ns + drift_ns + self.correction_ns
    }

    /// Returns its system time when a frame that enters the line at `now` arrives, ns.
    fn system_ns(&self, memory: &Memory, now: Duration) -> i64 {
        let offset = memory.u64(register::DC_SYSTEM_TIME_OFFSET).cast_signed();
        self.local_ns(now).wrapping_add(offset)
    }

    /// Stores when the present frame passes its ports.
    pub fn latch(&self, memory: &mut Memory, now: Duration) {
        let [_, behind] = self.place;
        let entry = self.local_ns(now);
        // A port without a neighbour has no time.
        let back = if behind > 0 {
            entry + 2 * behind * HOP_NS
        } else {
            0
        };
        for (address, time) in [
            (register::DC_RECEIVE_TIMES, entry),
            (register::DC_RECEIVE_TIMES + 4, back),
        ] {
            memory.put(address, &(time as u32).to_le_bytes());
        }
        memory.put(register::DC_RECEIVE_TIME, &entry.to_le_bytes());
    }

    /// Forgets the last comparison: the system time is set anew.
    pub fn forget_difference(&mut self, memory: &mut Memory) {
        self.difference_ns = 0;
        memory.put(register::DC_DIFFERENCE, &[0; 4]);
    }

    /// Stores the system time, for a read.
    pub fn show(&self, memory: &mut Memory, now: Duration) {
        let time = self.system_ns(memory, now);
        memory.put(register::DC_SYSTEM_TIME, &time.to_le_bytes());
    }

    /// Compares the system time with that of the reference clock, which a frame has brought, and corrects a part of the difference.
    pub fn compare(&mut self, memory: &mut Memory, reference: u64, now: Duration) {
        let delay = i64::from(memory.u32(register::DC_DELAY));
        let wanted = reference.cast_signed().wrapping_add(delay);
        let difference = self.system_ns(memory, now).wrapping_sub(wanted);
        self.difference_ns = difference;
        // At least 1 ns, so that it comes to 0.
        let step = difference / LOOP + difference.signum() * i64::from(difference.abs() < LOOP);
        self.correction_ns = self.correction_ns.wrapping_sub(step);
        let amount = u32::try_from(difference.unsigned_abs()).unwrap_or(u32::MAX) & 0x7fff_ffff;
        // Bit 31: its own time is the smaller one.
        let shown = amount | u32::from(difference < 0) << 31;
        memory.put(register::DC_DIFFERENCE, &shown.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_that_deviate_follow_the_reference() {
        let mut memories = [Memory::default(), Memory::default()];
        let mut clocks = [Clock::new(1), Clock::new(2)];
        clocks[0].set_place(0, 1);
        clocks[1].set_place(1, 0);
        let mut now = Duration::from_secs(5);
        for (clock, memory) in clocks.iter().zip(&mut memories) {
            clock.latch(memory, now);
            // As a MainDevice does: the system time at the latch is 0 everywhere.
            let offset = -memory.u64(register::DC_RECEIVE_TIME).cast_signed();
            memory.put(register::DC_SYSTEM_TIME_OFFSET, &offset.to_le_bytes());
        }
        let round = memories[0].u32(register::DC_RECEIVE_TIMES + 4)
            - memories[0].u32(register::DC_RECEIVE_TIMES);
        assert_eq!(round, 1000, "there and back");
        memories[1].put(register::DC_DELAY, &(round / 2).to_le_bytes());
        for _ in 0..500 {
            now += Duration::from_millis(1);
            clocks[0].show(&mut memories[0], now);
            let reference = memories[0].u64(register::DC_SYSTEM_TIME);
            clocks[1].compare(&mut memories[1], reference, now);
        }
        // 35 ppm of 1 ms, of which a quarter is corrected each time.
        assert!(clocks[1].difference_ns().abs() <= 200, "{clocks:?}");
        let shown = memories[1].u32(register::DC_DIFFERENCE);
        assert_eq!(
            i64::from(shown & 0x7fff_ffff),
            clocks[1].difference_ns().abs()
        );
        clocks[1].forget_difference(&mut memories[1]);
        assert_eq!(memories[1].u32(register::DC_DIFFERENCE), 0);
    }
}
