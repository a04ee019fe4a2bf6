//! A fault proxy between a driver and its device: it loses, delays, duplicates, reorders, truncates and corrupts
//! packets at random from a seed, and counts these faults.
//! For tests and simulators; a UDP proxy is pumped by its owner or by a thread of its own, a TCP proxy has two threads
//! per connection.
//!
//! The same seed and the same packets give the same faults in each direction, regardless of the other direction.

pub mod faulty_link;
pub mod random;
pub mod tcp;
pub mod udp;

pub use faulty_link::{FaultCounts, FaultRates, FaultyLink};
pub use random::SplitMix64;
pub use tcp::TcpProxy;
pub use udp::UdpProxy;

/// Direction of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the peer that sent or connected first to the target.
    Forth = 0,
    /// From the target back.
    Back = 1,
}

/// Returns the links of both directions, each with its own random numbers.
fn lines(rates: FaultRates, seed: u64) -> [FaultyLink; 2] {
    let mut chance = SplitMix64::new(seed);
    [
        FaultyLink::new(rates, chance.draw()),
        FaultyLink::new(rates, chance.draw()),
    ]
}
