//! Counters of the simulated controller, and its snapshot for the control port.
//! Plain data; written by the clock thread, converted to JSON by the control port's threads.

use super::fault::DatagramRefusal;
use crate::fri_lwr::wire::WireError;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::robot_snapshot::RobotSnapshot;
use serde::Serialize;

/// Datagrams and events since the start or the last `reset_statistics`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
pub struct KrcCounts {
    /// Measurement datagrams sent.
    pub sent: u64,
    /// Cycles with a valid answer.
    pub answered: u64,
    /// Cycles without a valid answer.
    pub missed: u64,
    /// Longest run of cycles without a valid answer while commanding.
    pub missed_in_a_row_max: u32,
    /// Answers not taken, for any of the reasons that follow.
    pub refused: u64,
    /// Answers that did not reflect the sequence number of the last datagram.
    pub late: u64,
    /// Further answers to the last datagram, and answers with a decreasing sequence number in command state.
    pub duplicate: u64,
    /// Datagrams of a wrong size.
    pub wrong_size: u64,
    /// Datagrams with a wrong identity or `packetSize`.
    pub wrong_identity: u64,
    /// Answers with a selected position that is not finite, in monitor state.
    pub not_finite: u64,
    /// Datagrams from another address than the PC's.
    pub foreign: u64,
    /// Answers dropped on request.
    pub dropped: u64,
    /// Cycles whose datagram was withheld on request.
    pub withheld: u64,
    /// Number of stalls, in which the machine let the clock sleep for more than a period.
    pub stalls: u64,
    /// Number of ticks skipped in stalls.
    pub skipped: u64,
    /// Entries into command state.
    pub entries: u64,
    /// Faults.
    pub faults: u64,
}

impl KrcCounts {
    /// Counts an answer that is not taken.
    pub fn refuse(&mut self, refusal: &DatagramRefusal) {
        self.refused += 1;
        let counter = match refusal {
            DatagramRefusal::Wire(WireError::Size { .. }) => &mut self.wrong_size,
            DatagramRefusal::Wire(_) => &mut self.wrong_identity,
            DatagramRefusal::Late { .. } => &mut self.late,
            DatagramRefusal::Duplicate { .. } => &mut self.duplicate,
            DatagramRefusal::NotFinite => &mut self.not_finite,
        };
        *counter += 1;
    }
}

/// KRL variables of one direction.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KrlVariables {
    /// Number 1 first.
    pub booleans: [bool; 16],
    /// Number 1 first.
    pub reals: [f32; 16],
    /// Number 1 first.
    pub integers: [i32; 16],
}

/// The whole state at one moment, for the control port.
#[derive(Clone, Debug, Serialize)]
pub struct Snapshot {
    /// The state that every simulated robot reports.
    #[serde(flatten)]
    pub robot: RobotSnapshot,
    /// Control strategy.
    pub strategy: ControlLaw,
    /// `monitor` or `command`.
    pub fri_state: &'static str,
    /// `unacceptable`, `bad`, `ok` or `perfect`.
    pub quality: &'static str,
    /// Counters.
    pub counts: KrcCounts,
    /// `$FRI_TO_…`, controller to PC.
    pub krl_to_pc: KrlVariables,
    /// `$FRI_FRM_…`, PC to controller; the last values while the PC is silent.
    pub krl_from_pc: KrlVariables,
}
