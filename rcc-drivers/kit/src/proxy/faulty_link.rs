//! One direction of a proxy: packets enter and leave with faults, in time steps that the owner counts.
//! Pure; run by the proxy's owner or thread.

use std::collections::VecDeque;

use super::random::SplitMix64;

/// Steps after which a packet that is to be overtaken is sent although no other packet has followed.
const OVERTAKEN_STEPS_MAX: u64 = 20;
/// Most bits that a corruption flips.
const FLIPPED_BITS_MAX: usize = 8;
/// Share of the corrupted packets in which all bytes are replaced.
const ALL_BYTES_SHARE: f64 = 0.1;

/// Probability of each fault per packet, 0 to 1. A packet has at most one fault, the first that is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FaultRates {
    /// The packet is lost; a stream is closed.
    pub lost: f64,
    /// The packet is delayed by 1 to `late_steps_max` steps, behind those that arrive meanwhile.
    pub late: f64,
    /// Longest delay, steps; 0 counts as 1.
    pub late_steps_max: u32,
    /// The packet arrives twice.
    pub duplicated: f64,
    /// The packet arrives after the next one.
    pub reordered: f64,
    /// The end of the packet is missing; a stream is then closed.
    pub truncated: f64,
    /// Some bits of the packet are flipped or, in one of ten corrupted packets, all bytes are replaced.
    pub corrupted: f64,
}

impl FaultRates {
    /// No faults.
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

/// Counters of packets, by fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
pub struct FaultCounts {
    /// Packets without a fault.
    pub passed: u64,
    /// Packets that were lost.
    pub lost: u64,
    /// Packets that were delayed.
    pub late: u64,
    /// Packets that were duplicated.
    pub duplicated: u64,
    /// Packets that were overtaken by the next one.
    pub reordered: u64,
    /// Packets that were truncated.
    pub truncated: u64,
    /// Packets that were corrupted.
    pub corrupted: u64,
}

impl FaultCounts {
    /// Returns the number of packets with a fault.
    #[must_use]
    pub fn faults(&self) -> u64 {
        self.lost + self.late + self.duplicated + self.reordered + self.truncated + self.corrupted
    }
}

/// The fault drawn for a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketFate {
    /// No fault.
    Passed,
    /// Lost.
    Lost,
    /// Delayed.
    Late,
    /// Sent twice.
    Duplicated,
    /// Sent after the next one.
    Reordered,
    /// Sent without its end.
    Truncated,
    /// Sent with other bits.
    Corrupted,
}

#[derive(Clone, Debug)]
struct HeldPacket {
    /// Step from which on the packet may be sent.
    due: u64,
    /// The packet waits to be overtaken by another one, at most until this step.
    overtaken_until: Option<u64>,
    bytes: Vec<u8>,
}

/// One direction of a fault proxy.
#[derive(Clone, Debug)]
pub struct FaultyLink {
    rates: FaultRates,
    chance: SplitMix64,
    counts: FaultCounts,
    held: VecDeque<HeldPacket>,
    step: u64,
}

impl FaultyLink {
    /// A link that has not forwarded any packet yet.
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

    /// Sets the fault rates for further packets; packets that are already queued keep their fate.
    pub fn set_rates(&mut self, rates: FaultRates) {
        self.rates = rates;
    }

    /// Returns the counters.
    #[must_use]
    pub fn counts(&self) -> FaultCounts {
        self.counts
    }

    /// Advances the time by one step.
    pub fn step(&mut self) {
        self.step += 1;
    }

    /// Drops the queued packets, as when a connection ends.
    pub fn forget(&mut self) {
        self.held.clear();
    }

    /// Queues a packet and draws its fate.
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

    /// Returns the next packet that is due.
    pub fn pop(&mut self) -> Option<Vec<u8>> {
        let step = self.step;
        let goes = |held: &HeldPacket| {
            held.due <= step && held.overtaken_until.is_none_or(|until| until <= step)
        };
        let place = self.held.iter().position(goes)?;
        self.held.remove(place).map(|held| held.bytes)
    }

    fn hold(&mut self, due: u64, overtaken_until: Option<u64>, bytes: Vec<u8>) {
        // The new packet overtakes those that wait for it; they are released behind it.
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
        // The number of draws per packet is constant, so that one rate does not affect the other faults.
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
