//! Counters of the simulated cabinet, and its snapshot for the control port.
//! Plain data; written by the clock thread, converted to JSON by the control port's threads.

use super::Joints;
use super::fault::AnswerRefusal;
use super::settings::{OverlayMode, Selector};
use super::station::SignalState;
use crate::fri_iiwa::wire::WireError;
use crate::sim::arm::dynamics::FlangeLoad;
use crate::sim::arm::environment::Wall;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::network::NetworkCounts;
use serde::Serialize;

/// Number of faults in the history.
pub const FAULTS_KEPT: usize = 16;

/// Datagrams and events since the start or the last `reset_statistics`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
pub struct CabinetCounts {
    /// Messages sent.
    pub sent: u64,
    /// Answers taken.
    pub answered: u64,
    /// Answers that were due and did not come.
    pub missed: u64,
    /// Longest run of missed answers while commands are executed.
    pub missed_in_a_row_max: u32,
    /// Answers not taken, for any of the reasons that follow.
    pub refused: u64,
    /// Answers that do not reflect the last message.
    pub late: u64,
    /// Answers whose counter does not increase, and further answers to one message.
    pub duplicate: u64,
    /// Answers before the receive multiplier asks for one.
    pub early: u64,
    /// Answers in IDLE.
    pub in_idle: u64,
    /// Datagrams with a wrong length, or with a frame where none belongs, or without one.
    pub wrong_frame: u64,
    /// Datagrams with a wrong CRC.
    pub wrong_checksum: u64,
    /// Messages with another identity.
    pub wrong_identity: u64,
    /// Other bytes that are no command message, or one without a required field.
    pub malformed: u64,
    /// Messages with fields that the version does not have.
    pub not_of_version: u64,
    /// Answers with values that are not finite, before commands are executed.
    pub not_finite: u64,
    /// Answers that write what is no output of the station.
    pub wrong_io: u64,
    /// Datagrams from another address than the client's.
    pub foreign: u64,
    /// Answers dropped on request.
    pub dropped: u64,
    /// Messages withheld on request.
    pub withheld: u64,
    /// Motions whose commands were executed.
    pub entries: u64,
    /// Motions ended by a fault.
    pub faults: u64,
    /// Stalls of the machine.
    pub stalls: u64,
    /// Periods skipped in stalls.
    pub skipped: u64,
}

impl CabinetCounts {
    /// Counts an answer that is not taken.
    pub fn refuse(&mut self, refusal: &AnswerRefusal) {
        self.refused += 1;
        let counter = match refusal {
            AnswerRefusal::Wire(
                WireError::OtherFrame(_) | WireError::Length { .. } | WireError::Size(_),
            ) => &mut self.wrong_frame,
            AnswerRefusal::Wire(WireError::Checksum { .. }) => &mut self.wrong_checksum,
            AnswerRefusal::Wire(WireError::Identity { .. }) => &mut self.wrong_identity,
            AnswerRefusal::Wire(_) => &mut self.malformed,
            AnswerRefusal::NotOfVersion(_) => &mut self.not_of_version,
            AnswerRefusal::Idle => &mut self.in_idle,
            AnswerRefusal::Late { .. } => &mut self.late,
            AnswerRefusal::Duplicate { .. } => &mut self.duplicate,
            AnswerRefusal::Early { .. } => &mut self.early,
            AnswerRefusal::NotFinite => &mut self.not_finite,
            AnswerRefusal::Io(_) => &mut self.wrong_io,
        };
        *counter += 1;
    }
}

/// A fault in the history.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultRecord {
    /// Tick in which the fault was detected.
    pub tick: u64,
    /// Cabinet's time, s.
    pub time_s: f64,
    /// Kind of the fault.
    pub code: i32,
    /// Description with values.
    pub reason: String,
}

/// The whole state at one moment, for the control port.
#[derive(Clone, Debug, Serialize)]
pub struct Snapshot {
    /// Cycles since the start.
    pub tick: u64,
    /// Cabinet's time since the start, s.
    pub time_s: f64,
    /// State of the session: `idle`, `monitoring-wait`, `monitoring-ready`, `commanding-wait`, `commanding-active`.
    pub session: &'static str,
    /// `poor`, `fair`, `good` or `excellent`.
    pub quality: &'static str,
    /// Controller of the joints.
    pub control: ControlLaw,
    /// Quantity that the overlay lets the client command.
    pub overlay: OverlayMode,
    /// Operating mode.
    pub operation: Selector,
    /// `normal`, `stop0`, `stop1` or `stop2`.
    pub safety: &'static str,
    /// `off`, `transitioning` or `active`.
    pub drives: &'static str,
    /// Why the session does not advance; null while commands are executed.
    pub waiting_for: Option<String>,
    /// The unacknowledged fault.
    pub fault: Option<String>,
    /// The last faults, oldest first.
    pub faults: Vec<FaultRecord>,
    /// Why the last answer that was not taken was refused.
    pub last_refusal: Option<String>,
    /// The drives are active.
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
    /// Largest velocities of the commanded stream since the last reset or motion, rad/s.
    pub commanded_velocity_max: Joints,
    /// Largest accelerations of the commanded stream since the last reset or motion, rad/s².
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
    /// Added by the client: joint torques, Nm, or a wrench in the order fx fy fz tx ty tz; 0 in other overlays.
    pub added: Joints,
    /// The obstacle.
    pub wall: Option<Wall>,
    /// The load at the flange.
    pub load: Option<FlangeLoad>,
    /// Share of the last 100 answers that came.
    pub answer_rate: f64,
    /// Mean delay of the answers, s.
    pub latency_s: f64,
    /// Standard deviation of that delay, s.
    pub jitter_s: f64,
    /// Counters.
    pub counts: CabinetCounts,
    /// Counters of the simulated network faults.
    pub network: NetworkCounts,
    /// Inputs and outputs of the station.
    pub io: Vec<SignalState>,
}
