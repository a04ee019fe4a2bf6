//! A fault proxy between a driver and its device: it loses, delays, doubles, swaps, cuts and corrupts what passes, drawn
//! from a seed, and counts what it did. For tests and simulators; a UDP proxy is pumped by its owner or by a thread of its
//! own, a TCP proxy has two threads a connection.
//!
//! The same seed and the same packets give the same faults in each direction, whatever the other direction does.

pub mod faulty_link;
pub mod random;
pub mod tcp;
pub mod udp;

pub use faulty_link::{FaultCounts, FaultRates, FaultyLink};
pub use random::SplitMix64;
pub use tcp::TcpProxy;
pub use udp::UdpProxy;

/// Who sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From who sent first, or connected, to the target.
    Forth = 0,
    /// From the target back.
    Back = 1,
}

/// The two lines of a proxy, each with chances of its own.
fn lines(rates: FaultRates, seed: u64) -> [FaultyLink; 2] {
    let mut chance = SplitMix64::new(seed);
    [
        FaultyLink::new(rates, chance.draw()),
        FaultyLink::new(rates, chance.draw()),
    ]
}
