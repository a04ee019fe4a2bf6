//! The simulated cabinet as a pure state machine: receives answers, advances one tick, returns the next message.
//! Runs in virtual time; the program's clock thread calls it in real time, tests as fast as they can.
//!
//! One cycle: a message is sent, [`Cabinet::receive`] takes the answer, [`Cabinet::tick`] supervises it, runs the
//! application, moves the arm, and builds the next message. What a real controller would not accept is not accepted, never
//! answered, counted by its cause, and told in the state (`last_refusal`).

use super::fault::{AnswerRefusal, CabinetFault, WaitReason};
use super::settings::{ControlSettings, Settings};
use super::station::Station;
use super::statistics::CabinetCounts;
use super::{JOINTS, Joints};
use crate::fri_iiwa::wire::schema::Command;
use crate::fri_iiwa::wire::{DriveState, Quality, SafetyState, SessionState, decode};
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::quality::QualityMeter;
use crate::sim::simulated_robot::SimulatedRobot;
use crate::sim::trace::TraceRecord;

mod command_target;
mod set_point;

use set_point::DueAnswer;
pub(super) use set_point::Motion;

/// Messages in IDLE with which a session ends.
const FINAL_MESSAGES: u32 = 3;
/// Messages in IDLE before the program ends.
const CLOSING_MESSAGES: u32 = 20;
/// Messages in MONITORING_WAIT after a motion was aborted. The value is ours.
const ABORTED_MESSAGES: u32 = 10;

/// A simulated cabinet with its arm.
#[derive(Clone, Debug)]
pub struct Cabinet {
    pub(super) settings: Settings,
    pub(super) robot: SimulatedRobot,
    pub(super) session_open: bool,
    /// Messages in IDLE that are still sent.
    final_messages: u32,
    pub(super) closing: bool,
    /// Messages for which the session stays in MONITORING_WAIT.
    pub(super) aborted_for: u32,
    pub(super) motion_wanted: bool,
    pub(super) drives: DriveState,
    /// When the drives will be active, s.
    pub(super) drives_active_at_s: f64,
    pub(super) safety: SafetyState,
    pub(super) fault: Option<CabinetFault>,
    pub(super) wait_reason: Option<WaitReason>,
    pub(super) counts: CabinetCounts,
    pub(super) last_refusal: Option<AnswerRefusal>,
    pub(super) quality: QualityMeter<Quality>,
    pub(super) station: Station,
    /// Set-point of the motion itself, a position hold, without what the client commands, rad.
    pub(super) interpolated: Joints,
    pub(super) motion: Motion,
    answer: Option<(Command, f64)>,
    pub(super) last_answer: Option<u32>,
    /// Messages since the last answer that was taken.
    messages_since_answer: u32,
    /// Messages since the last answer was taken or missed.
    messages_since_due: u32,
}

impl Cabinet {
    /// A cabinet whose application has just opened the session: drives active, arm at rest.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        let period_s = settings.period_s();
        let model = settings.arm.model();
        Self {
            robot: SimulatedRobot::new(&settings.robot, model, settings.impedance, period_s),
            session_open: true,
            final_messages: 0,
            closing: false,
            aborted_for: 0,
            motion_wanted: settings.motion == super::settings::MotionStart::Auto,
            drives: DriveState::Active,
            drives_active_at_s: 0.0,
            safety: SafetyState::Normal,
            fault: None,
            wait_reason: Some(WaitReason::Answer),
            counts: CabinetCounts::default(),
            last_refusal: None,
            quality: QualityMeter::new(settings.robot.quality, period_s),
            station: Station::new(settings.signals.clone(), settings.loopbacks.clone()),
            interpolated: settings.robot.start,
            motion: Motion::Hold,
            answer: None,
            last_answer: None,
            messages_since_answer: 0,
            messages_since_due: 0,
            settings,
        }
    }

    /// Processes a datagram from the client that arrived `delay_s` seconds after the last message was sent.
    ///
    /// # Errors
    /// Returns why it is not taken; it is counted then.
    pub fn receive(&mut self, bytes: &[u8], delay_s: f64) -> Result<(), AnswerRefusal> {
        let result = self.take(bytes, delay_s);
        if let Err(refusal) = &result {
            self.counts.refuse(refusal);
            self.last_refusal = Some(refusal.clone());
        }
        result
    }

    fn take(&mut self, bytes: &[u8], delay_s: f64) -> Result<(), AnswerRefusal> {
        let command: Command = decode(self.settings.version, bytes)?;
        if self.session() == SessionState::Idle {
            return Err(AnswerRefusal::Idle);
        }
        if self.robot.drops_answer() {
            self.counts.dropped += 1;
            return Ok(());
        }
        let header = command.header.unwrap_or_default();
        let (have, own) = (header.reflected.unwrap_or(0), header.sequence.unwrap_or(0));
        let want = self.sequence();
        if have != want || self.robot.sent.is_none() {
            return Err(AnswerRefusal::Late { want, have });
        }
        // A restarted client counts from the beginning, which does no harm while nothing is commanded.
        let last = self.last_answer.unwrap_or(0);
        let backward = self.last_answer.is_some() && own.wrapping_sub(last).cast_signed() <= 0;
        if self.answer.is_some() || (backward && self.has_motion()) {
            return Err(AnswerRefusal::Duplicate { last, have: own });
        }
        let (after, multiplier) = (self.messages_since_answer, self.settings.multiplier);
        if after < multiplier {
            return Err(AnswerRefusal::Early { after, multiplier });
        }
        self.check_version(&command)?;
        if !self.is_commanded() && !is_finite(&command) {
            return Err(AnswerRefusal::NotFinite);
        }
        let written = command.data.as_ref().map_or(&[][..], |data| &data.io);
        self.station.check(written)?;
        self.answer = Some((command, delay_s));
        Ok(())
    }

    fn check_version(&self, command: &Command) -> Result<(), AnswerRefusal> {
        let version = self.settings.version;
        if version.is_framed() && command.end.is_some() {
            return Err(AnswerRefusal::NotOfVersion("endOfMessageData"));
        }
        let Some(data) = &command.data else {
            return Ok(());
        };
        let length = version.transformation_elements();
        let mut transformations = data.transformations.iter().chain(&data.pose);
        let rows = [
            ("writeIORequest", !version.has_io() && !data.io.is_empty()),
            ("cartesianPose", !version.is_second() && data.pose.is_some()),
            (
                "redundancyInformation",
                !version.is_second() && data.redundancy.is_some(),
            ),
            (
                "transformation of another length",
                transformations.any(|one| one.element.len() != length),
            ),
        ];
        match rows.into_iter().find(|row| row.1) {
            None => Ok(()),
            Some((field, _)) => Err(AnswerRefusal::NotOfVersion(field)),
        }
    }

    /// Counts a datagram from another address.
    pub fn receive_foreign(&mut self) {
        self.counts.foreign += 1;
    }

    /// Ends the cycle and starts the next; returns the next message, or `None` while none is sent.
    ///
    /// `periods` is 1 or, after a stall of the machine, the number of periods that passed on its clock. While commands are
    /// executed, the arm then continues its motion, as that of a real controller does, and the counters show the length of
    /// the stall.
    pub fn tick(&mut self, periods: u64) -> Option<Vec<u8>> {
        let answer = self.answer.take();
        let due = self.count(answer.as_ref(), periods);
        if let Some(sent) = self.robot.sent {
            self.robot.exchanged = Some(pair(sent, answer.as_ref(), self.station.bits()));
        }
        let command = answer.map(|(command, _)| command);
        self.robot.from = self.robot.desired;
        let passed = self.move_set_point(command.as_ref(), due, periods);
        let gone_on = self.continue_through_stall(periods.saturating_sub(passed));
        let step_s = (passed + gone_on) as f64 * self.settings.period_s();
        let model = self.settings.arm.model();
        self.robot.step(self.law(), model, step_s);
        self.robot.count_rest(self.is_at_rest(), step_s);
        self.supervise_arm();
        self.run_application();
        self.robot.tick += 1 + gone_on;
        self.robot.time_s += step_s;
        self.next_message()
    }

    /// Returns the datagrams of the cycle that the last tick has ended.
    #[must_use]
    pub fn exchanged(&self) -> Option<&TraceRecord> {
        self.robot.exchanged.as_ref()
    }

    /// Returns the counter of the last message.
    #[must_use]
    pub fn sequence(&self) -> u32 {
        self.robot.tick as u32
    }

    /// Returns the state of the session.
    #[must_use]
    pub fn session(&self) -> SessionState {
        match self.motion {
            _ if !self.session_open => SessionState::Idle,
            Motion::Synchronise(_) => SessionState::CommandingWait,
            Motion::Follow(_) => SessionState::CommandingActive,
            _ if self.aborted_for > 0 || self.quality.quality() < Quality::Good => {
                SessionState::MonitoringWait
            }
            _ => SessionState::MonitoringReady,
        }
    }

    /// Returns true if the program has ended.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.closing && self.final_messages == 0
    }

    /// Returns true while the client's commands are executed.
    #[must_use]
    pub fn is_commanded(&self) -> bool {
        matches!(self.motion, Motion::Follow(_))
    }

    /// Returns true while a motion with an overlay runs.
    pub(super) fn has_motion(&self) -> bool {
        matches!(self.motion, Motion::Follow(_) | Motion::Synchronise(_))
    }

    /// Returns true if neither the set-point nor the arm moves.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.robot.arm.is_at_rest() && !matches!(self.motion, Motion::Stop(_))
    }

    /// Returns the control law: that of the motion, and position control without one.
    #[must_use]
    pub fn law(&self) -> ControlLaw {
        match self.motion {
            Motion::Hold => ControlLaw::Position,
            _ => self.settings.law,
        }
    }

    /// Chooses control law and overlay of the next motion.
    pub(super) fn choose(&mut self, control: ControlSettings) {
        self.settings.law = control.law;
        self.settings.overlay = control.overlay;
        self.settings.impedance = control.impedance;
        self.robot.impedance = control.impedance;
    }

    /// Opens the session, if it is closed.
    pub(super) fn open_session(&mut self) {
        if self.session_open || self.closing {
            return;
        }
        self.session_open = true;
        self.quality = QualityMeter::new(self.settings.robot.quality, self.settings.period_s());
        (self.last_answer, self.robot.sent, self.answer) = (None, None, None);
        (self.messages_since_answer, self.messages_since_due) = (0, 0);
    }

    /// Closes the session: its motion ends, and some messages say so.
    pub(super) fn close_session(&mut self) {
        self.stop();
        if self.session_open {
            self.session_open = false;
            self.final_messages = FINAL_MESSAGES;
        }
    }

    /// Ends the program: it closes the session for some messages; then [`Cabinet::is_closed`] is true.
    pub(super) fn close(&mut self) {
        if !self.closing {
            self.close_session();
            self.closing = true;
            self.final_messages = CLOSING_MESSAGES;
        }
    }

    pub(super) fn reset_statistics(&mut self) {
        self.counts = CabinetCounts::default();
        self.last_refusal = None;
        self.robot.reset_statistics();
        if let Motion::Follow(commands) = &mut self.motion {
            commands.stream.reset_extremes();
        }
    }

    /// Counts the answer, or that one was missed: one is due after as many messages as the receive multiplier says.
    fn count(&mut self, answer: Option<&(Command, f64)>, periods: u64) -> DueAnswer {
        self.counts.stalls += u64::from(periods > 1);
        self.counts.skipped += periods.saturating_sub(1);
        if self.robot.sent.is_none() || !self.session_open {
            return DueAnswer::Nothing;
        }
        self.messages_since_due += 1;
        if let Some((command, delay_s)) = answer {
            (self.messages_since_due, self.messages_since_answer) = (0, 0);
            self.quality.record(Some(*delay_s));
            self.counts.answered += 1;
            self.last_answer = command.header.and_then(|header| header.sequence);
            let written = command.data.as_ref().map_or(&[][..], |data| &data.io);
            self.station.write(written);
            return DueAnswer::Answer;
        }
        if self.messages_since_due < self.settings.multiplier {
            return DueAnswer::Nothing;
        }
        self.messages_since_due = 0;
        self.quality.record(None);
        self.counts.missed += 1;
        DueAnswer::Miss
    }

    /// Ends the motion with a fault; the first cause is kept.
    pub(super) fn fail(&mut self, fault: CabinetFault) {
        self.robot.at_rest_for_s = 0.0;
        if self.fault.is_none() {
            self.fault = Some(fault);
            self.counts.faults += 1;
            self.robot.remember(fault.code(), fault.to_string());
        }
        self.aborted_for = ABORTED_MESSAGES;
        if self.settings.motion == super::settings::MotionStart::Manual {
            self.motion_wanted = false;
        }
        self.end_motion();
    }

    /// Ends the motion, if there is one, without a fault.
    pub(super) fn stop(&mut self) {
        self.end_motion();
    }

    /// Stops an arm that yields if it leaves its range or exceeds the supervised velocities, which only springs and forces
    /// can bring about.
    fn supervise_arm(&mut self) {
        if self.settings.law == ControlLaw::Position || !self.is_commanded() {
            return;
        }
        let limits = &self.settings.robot.limits;
        if let Some(runaway) = self.robot.runaway(limits, 1.0) {
            self.fail(CabinetFault::Runaway(runaway));
        }
    }

    fn next_message(&mut self) -> Option<Vec<u8>> {
        self.aborted_for = self.aborted_for.saturating_sub(1);
        if !self.session_open {
            if self.final_messages == 0 {
                self.robot.sent = None;
                return None;
            }
            self.final_messages -= 1;
        }
        self.messages_since_answer = self.messages_since_answer.saturating_add(1);
        let (state, quality) = (self.session() as u16, self.quality.quality() as u16);
        self.robot.sent = Some(self.robot.trace_record(self.sequence(), state, quality));
        if self.robot.withholds() {
            self.counts.withheld += 1;
            return None;
        }
        self.counts.sent += 1;
        // A message with at most ten signals is smaller than the greatest datagram.
        crate::fri_iiwa::wire::encode(self.settings.version, &self.message()).ok()
    }
}

fn pair(sent: TraceRecord, answer: Option<&(Command, f64)>, booleans: u16) -> TraceRecord {
    let position = answer
        .and_then(|(command, _)| command.data.as_ref())
        .and_then(|data| data.position.as_ref())
        .and_then(|position| position.value.as_slice().try_into().ok());
    TraceRecord {
        answered: answer.is_some(),
        commanded: position.unwrap_or([f64::NAN; JOINTS]),
        booleans,
        ..sent
    }
}

fn is_finite(command: &Command) -> bool {
    let Some(data) = &command.data else {
        return true;
    };
    let joints = [&data.position, &data.torque].into_iter().flatten();
    let joints = joints.flat_map(|joints| &joints.value);
    let wrench = data.wrench.iter().flat_map(|wrench| &wrench.element);
    let pose = data.pose.iter().flat_map(|pose| &pose.element);
    let redundancy = data.redundancy.and_then(|redundancy| redundancy.value);
    let mut values = joints.chain(wrench).chain(pose).copied().chain(redundancy);
    values.all(f64::is_finite)
}
