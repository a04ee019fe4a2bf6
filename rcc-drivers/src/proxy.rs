//! A fault proxy between a driver and its device: it loses, delays, doubles, swaps, cuts and corrupts what passes, drawn
//! from a seed, and counts what it did. For tests and simulators; a UDP proxy is pumped by its owner or by a thread of its
//! own, a TCP proxy has two threads a connection.
//!
//! The same seed and the same packets give the same faults in each direction, whatever the other direction does.

pub mod chance;
pub mod line;
pub mod tcp;
pub mod udp;

pub use chance::Chance;
pub use line::{Counts, Line, Rates};
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
fn lines(rates: Rates, seed: u64) -> [Line; 2] {
    let mut chance = Chance::new(seed);
    [
        Line::new(rates, chance.draw()),
        Line::new(rates, chance.draw()),
    ]
}
