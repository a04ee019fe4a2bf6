//! Counters of the simulated cabinet, and its snapshot for the control port.
//! Plain data; written by the clock thread, converted to JSON by the control port's threads.

use super::Joints;
use super::fault::AnswerRefusal;
use super::settings::{OverlayMode, Selector};
use super::station::SignalState;
use crate::fri_iiwa::wire::WireError;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::robot_snapshot::RobotSnapshot;
use serde::Serialize;

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
    /// Answers refused, for any of the reasons that follow.
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
    /// Other bytes that are not a command message, and command messages without a required field.
    pub malformed: u64,
    /// Messages with fields that the version does not have.
    pub not_of_version: u64,
    /// Answers with values that are not finite, before commands are executed.
    pub not_finite: u64,
    /// Answers that write a signal which is not an output of the station.
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

/// The whole state at one moment, for the control port.
#[derive(Clone, Debug, Serialize)]
pub struct Snapshot {
    /// The state that every simulated robot reports.
    #[serde(flatten)]
    pub robot: RobotSnapshot,
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
    /// Added by the client: joint torques, Nm, or a wrench in the order fx fy fz tx ty tz; 0 in other overlays.
    pub added: Joints,
    /// Counters.
    pub counts: CabinetCounts,
    /// Inputs and outputs of the station.
    pub io: Vec<SignalState>,
}
