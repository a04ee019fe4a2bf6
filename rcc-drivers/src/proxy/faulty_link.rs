//! One direction of a proxy: packets go in, what is left of them comes out, in steps of time that the owner counts.
//! Pure; run by the proxy's owner or thread.

use std::collections::VecDeque;

use super::random::SplitMix64;

/// Steps after which a packet that was to be overtaken goes on although nothing came after it.
const OVERTAKEN_STEPS_MAX: u64 = 20;
/// Most bits that a corruption turns round.
const FLIPPED_BITS_MAX: usize = 8;
/// Part of the corrupted packets of which not a byte is left.
const ALL_BYTES_SHARE: f64 = 0.1;

/// How probable each fault is for one packet, 0 to 1. One packet has at most one of them, the first that happens.
#[derive(Clone, Copy, Debug, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FaultRates {
    /// It does not arrive; a stream is broken.
    pub lost: f64,
    /// It arrives 1 to `late_steps_max` steps later, behind what came meanwhile.
    pub late: f64,
    /// Longest delay, steps; 0 counts as 1.
    pub late_steps_max: u32,
    /// It arrives twice.
    pub duplicated: f64,
    /// It arrives behind the next one.
    pub reordered: f64,
    /// Its end is missing; a stream is then broken.
    pub truncated: f64,
    /// Some of its bits are turned round, or, of one in ten, all bytes are others.
    pub corrupted: f64,
}

impl FaultRates {
    /// Everything passes.
    pub const NONE: FaultRates = FaultRates {
        lost: 0.0,
        late: 0.0,
        late_steps_max: 0,
        duplicated: 0.0,
        reordered: 0.0,
        truncated: 0.0,
        corrupted: 0.0,
    };
}

/// What has been done so far, in packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
pub struct FaultCounts {
    /// As they came.
    pub passed: u64,
    /// Not at all.
    pub lost: u64,
    /// Later.
    pub late: u64,
    /// Twice.
    pub duplicated: u64,
    /// Behind the next one.
    pub reordered: u64,
    /// Without their end.
    pub truncated: u64,
    /// With other bits.
    pub corrupted: u64,
}

impl FaultCounts {
    /// All packets that had a fault.
    #[must_use]
    pub fn faults(&self) -> u64 {
        self.lost + self.late + self.duplicated + self.reordered + self.truncated + self.corrupted
    }
}

/// What became of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketFate {
    /// As it came.
    Passed,
    /// Not at all.
    Lost,
    /// Later.
    Late,
    /// Twice.
    Duplicated,
    /// Behind the next one.
    Reordered,
    /// Without its end.
    Truncated,
    /// With other bits.
    Corrupted,
}

#[derive(Clone, Debug)]
struct HeldPacket {
    /// Step from which on it may go.
    due: u64,
    /// Waits for one more packet, at most until then.
    overtaken_until: Option<u64>,
    bytes: Vec<u8>,
}

/// One direction.
#[derive(Clone, Debug)]
pub struct FaultyLink {
    rates: FaultRates,
    chance: SplitMix64,
    counts: FaultCounts,
    held: VecDeque<HeldPacket>,
    step: u64,
}

impl FaultyLink {
    /// A line that nothing has passed yet.
    #[must_use]
    pub fn new(rates: FaultRates, seed: u64) -> Self {
        Self {
            rates,
            chance: SplitMix64::new(seed),
            counts: FaultCounts::default(),
            held: VecDeque::new(),
            step: 0,
        }
    }

    /// From now on; what is held goes on as it was decided.
    pub fn set_rates(&mut self, rates: FaultRates) {
        self.rates = rates;
    }

    /// What has been done so far.
    #[must_use]
    pub fn counts(&self) -> FaultCounts {
        self.counts
    }

    /// Time goes on by one step.
    pub fn step(&mut self) {
        self.step += 1;
    }

    /// What is held back is forgotten, as when a connection ends.
    pub fn forget(&mut self) {
        self.held.clear();
    }

    /// Takes a packet in and decides what becomes of it.
    pub fn push(&mut self, packet: &[u8]) -> PacketFate {
        let fate = self.draw();
        let mut bytes = packet.to_vec();
        let mut due = self.step;
        let mut overtaken_until = None;
        match fate {
            PacketFate::Passed => self.counts.passed += 1,
            PacketFate::Lost => self.counts.lost += 1,
            PacketFate::Late => {
                self.counts.late += 1;
                due += 1 + self.chance.below(self.rates.late_steps_max as usize) as u64;
            }
            PacketFate::Duplicated => {
                self.counts.duplicated += 1;
                self.hold(due, None, bytes.clone());
            }
            PacketFate::Reordered => {
                self.counts.reordered += 1;
                overtaken_until = Some(self.step + OVERTAKEN_STEPS_MAX);
            }
            PacketFate::Truncated => {
                self.counts.truncated += 1;
                bytes.truncate(self.chance.below(packet.len()));
            }
            PacketFate::Corrupted => {
                self.counts.corrupted += 1;
                self.corrupt(&mut bytes);
            }
        }
        if fate != PacketFate::Lost {
            self.hold(due, overtaken_until, bytes);
        }
        fate
    }

    /// The next packet that goes on now.
    pub fn pop(&mut self) -> Option<Vec<u8>> {
        let step = self.step;
        let goes = |held: &HeldPacket| {
            held.due <= step && held.overtaken_until.is_none_or(|until| until <= step)
        };
        let place = self.held.iter().position(goes)?;
        self.held.remove(place).map(|held| held.bytes)
    }

    fn hold(&mut self, due: u64, overtaken_until: Option<u64>, bytes: Vec<u8>) {
        // The new one overtakes those that wait for it: they are free, and behind it.
        let waiting = |held: &HeldPacket| held.overtaken_until.is_some();
        let place = self
            .held
            .iter()
            .position(waiting)
            .unwrap_or(self.held.len());
        for held in &mut self.held {
            held.overtaken_until = None;
        }
        let held = HeldPacket {
            due,
            overtaken_until,
            bytes,
        };
        self.held.insert(place, held);
    }

    fn draw(&mut self) -> PacketFate {
        // Always as many draws a packet, so that one rate does not change what the others do.
        let rows = [
            (self.rates.lost, PacketFate::Lost),
            (self.rates.late, PacketFate::Late),
            (self.rates.duplicated, PacketFate::Duplicated),
            (self.rates.reordered, PacketFate::Reordered),
            (self.rates.truncated, PacketFate::Truncated),
            (self.rates.corrupted, PacketFate::Corrupted),
        ];
        let drawn = rows.map(|(rate, fate)| self.chance.chance(rate).then_some(fate));
        drawn
            .into_iter()
            .flatten()
            .next()
            .unwrap_or(PacketFate::Passed)
    }

    fn corrupt(&mut self, bytes: &mut [u8]) {
        if self.chance.chance(ALL_BYTES_SHARE) {
            for byte in bytes {
                *byte = self.chance.draw() as u8;
            }
            return;
        }
        let size = bytes.len();
        for _ in 0..=self.chance.below(FLIPPED_BITS_MAX) {
            if let Some(byte) = bytes.get_mut(self.chance.below(size)) {
                *byte ^= 1 << self.chance.below(8);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(rates: FaultRates, packets: u8) -> (Vec<Vec<u8>>, FaultCounts) {
        let mut line = FaultyLink::new(rates, 7);
        let mut out = Vec::new();
        for packet in 0..packets {
            line.step();
            line.push(&[packet; 8]);
            out.extend(std::iter::from_fn(|| line.pop()));
        }
        for _ in 0..100 {
            line.step();
            out.extend(std::iter::from_fn(|| line.pop()));
        }
        (out, line.counts())
    }

    #[test]
    fn without_faults_everything_passes_as_it_came() {
        let (out, counts) = through(FaultRates::NONE, 50);
        assert_eq!(out, (0..50).map(|n| vec![n; 8]).collect::<Vec<_>>());
        assert_eq!((counts.passed, counts.faults()), (50, 0));
    }

    #[test]
    fn the_same_seed_gives_the_same_faults() {
        let rates = FaultRates {
            lost: 0.2,
            late: 0.2,
            late_steps_max: 5,
            duplicated: 0.2,
            reordered: 0.2,
            truncated: 0.2,
            corrupted: 0.2,
        };
        assert_eq!(through(rates, 200), through(rates, 200));
        let counts = through(rates, 200).1;
        let each = [
            counts.lost,
            counts.late,
            counts.duplicated,
            counts.reordered,
            counts.truncated,
            counts.corrupted,
        ];
        assert!(each.iter().all(|count| *count > 0), "{counts:?}");
    }

    #[test]
    fn each_fault_does_what_it_says() {
        let one = |rates| through(rates, 3).0;
        let sure = 1.0;
        assert_eq!(
            one(FaultRates {
                lost: sure,
                ..FaultRates::NONE
            })
            .len(),
            0
        );
        assert_eq!(
            one(FaultRates {
                duplicated: sure,
                ..FaultRates::NONE
            })
            .len(),
            6
        );
        let cut = one(FaultRates {
            truncated: sure,
            ..FaultRates::NONE
        });
        assert!(cut.len() == 3 && cut.iter().all(|packet| packet.len() < 8));
        let other = one(FaultRates {
            corrupted: sure,
            ..FaultRates::NONE
        });
        assert!(
            other
                .iter()
                .zip(0..)
                .all(|(packet, n)| *packet != vec![n; 8])
        );
    }

    #[test]
    fn a_packet_is_overtaken_by_the_next_one() {
        let mut line = FaultyLink::new(
            FaultRates {
                reordered: 1.0,
                ..FaultRates::NONE
            },
            1,
        );
        line.push(&[1]);
        line.set_rates(FaultRates::NONE);
        assert_eq!(line.pop(), None);
        line.push(&[2]);
        assert_eq!((line.pop(), line.pop()), (Some(vec![2]), Some(vec![1])));
    }
}
