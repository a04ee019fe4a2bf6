//! Counters of the simulated controller, and its snapshot for the control port.
//! Plain data; written by the clock thread, converted to JSON by the control port's threads.

use super::Joints;
use super::fault::DatagramRefusal;
use crate::fri_lwr::wire::WireError;
use crate::sim::arm::dynamics::FlangeLoad;
use crate::sim::arm::environment::Wall;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::network::NetworkCounts;
use serde::Serialize;

/// Number of faults in the history.
pub const FAULTS_KEPT: usize = 16;

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

/// A fault in the history.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultRecord {
    /// Tick in which the fault was detected.
    pub tick: u64,
    /// Controller's time, s.
    pub time_s: f64,
    /// Code as in `$FRI_TO_INT[2]`.
    pub code: i32,
    /// Description with values.
    pub reason: String,
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
    /// Cycles since the start.
    pub tick: u64,
    /// Controller's time since the start, s.
    pub time_s: f64,
    /// Control strategy.
    pub strategy: ControlLaw,
    /// `monitor` or `command`.
    pub fri_state: &'static str,
    /// `unacceptable`, `bad`, `ok` or `perfect`.
    pub quality: &'static str,
    /// Why the controller stays in monitor state; null in command state.
    pub waiting_for: Option<String>,
    /// The unacknowledged fault.
    pub fault: Option<String>,
    /// The last faults, oldest first.
    pub faults: Vec<FaultRecord>,
    /// Why the last answer that was not taken was refused.
    pub last_refusal: Option<String>,
    /// The drives are on.
    pub drives_on: bool,
    /// The emergency stop is pressed.
    pub emergency_stop: bool,
    /// Measured joint positions, rad.
    pub q: Joints,
    /// Joint velocities, rad/s.
    pub velocity: Joints,
    /// Set-point of the joints, rad.
    pub q_cmd: Joints,
    /// Largest joint velocities of the arm since the last reset, rad/s.
    pub velocity_max: Joints,
    /// Largest joint accelerations of the arm since the last reset, rad/s².
    pub acceleration_max: Joints,
    /// Largest velocities of the commanded stream since the last reset or entry, rad/s.
    pub commanded_velocity_max: Joints,
    /// Largest accelerations of the commanded stream since the last reset or entry, rad/s².
    pub commanded_acceleration_max: Joints,
    /// Neither set-point nor arm moves.
    pub at_rest: bool,
    /// Time since the arm came to rest or, if it already rested, since the last fault, s.
    pub at_rest_for_s: f64,
    /// Flange in the base frame, m.
    pub flange_position: [f64; 3],
    /// Rotation flange → base, row by row.
    pub flange_rotation: [[f64; 3]; 3],
    /// Wrench on the flange, N and Nm, base axes, in the order fx fy fz tx ty tz.
    pub wrench: [f64; 6],
    /// The obstacle.
    pub wall: Option<Wall>,
    /// The load at the flange.
    pub load: Option<FlangeLoad>,
    /// Answered share of the last 100 cycles.
    pub answer_rate: f64,
    /// Mean delay of the answers, s.
    pub latency_s: f64,
    /// Standard deviation of that delay, s.
    pub jitter_s: f64,
    /// Counters.
    pub counts: KrcCounts,
    /// Counters of the simulated network faults.
    pub network: NetworkCounts,
    /// `$FRI_TO_…`, controller to PC.
    pub krl_to_pc: KrlVariables,
    /// `$FRI_FRM_…`, PC to controller; the last values while the PC is silent.
    pub krl_from_pc: KrlVariables,
}
