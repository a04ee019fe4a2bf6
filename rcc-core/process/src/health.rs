//! The health report of a program to its supervisor. Plain data.

/// State of a program at one moment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HealthReport {
    /// Changes while the program does its work: cycles, exchanges, iterations of a loop. Without a change no heartbeat
    /// is sent.
    pub progress: u64,
    /// One line for people.
    pub status: String,
}
