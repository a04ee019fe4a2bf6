//! The simulated controller as a pure state machine: receives answers, advances one tick, returns the next measurement
//! datagram.
//! Runs in virtual time; the program's clock thread calls it in real time, tests as fast as they can.
//!
//! One cycle: a measurement datagram is sent, [`Krc::receive`] takes the answer, [`Krc::tick`] supervises it, runs the
//! KRL program, moves the arm, and builds the next datagram. What a real controller would not accept is not accepted, never
//! answered, counted by its cause, and told in the state (`last_refusal`).
//!
//! Variables that the simulated KRL program writes: `$FRI_TO_INT[1]` is −1 when it ends (KUKA's sample convention);
//! `$FRI_TO_INT[2]` is the code of the unacknowledged fault ([`KrcFault::code`]), or 0; and those of its handshake with the PC
//! ([`super::settings::KrlProgram`]).

use super::fault::{DatagramRefusal, KrcFault, MonitorReason};
use super::model::LWR_4_PLUS;
use super::settings::{KrlLoopback, Settings};
use super::statistics::KrcCounts;
use super::{JOINTS, Joints};
use crate::fri_lwr::wire::{CommandDatagram, KrlBlock, MSR_SIZE, Quality, flags};
use crate::sim::arm::impedance::{ControlLaw, ImpedanceSettings};
use crate::sim::quality::QualityMeter;
use crate::sim::simulated_robot::SimulatedRobot;
use crate::sim::trace::TraceRecord;

mod command_target;
mod set_point;

use set_point::SetPointMode;

/// Number of cycles in which the KRL program announces its end.
const CLOSING_CYCLES: u32 = 20;

/// A simulated controller with its arm.
#[derive(Clone, Debug)]
pub struct Krc {
    pub(super) settings: Settings,
    pub(super) robot: SimulatedRobot,
    pub(super) fault: Option<KrcFault>,
    /// Code of the fault that `$FRI_TO_INT[2]` was last set to.
    pub(super) told_fault: i32,
    pub(super) monitor_reason: Option<MonitorReason>,
    pub(super) counts: KrcCounts,
    pub(super) last_refusal: Option<DatagramRefusal>,
    pub(super) quality: QualityMeter<Quality>,
    pub(super) to_pc: KrlBlock,
    pub(super) from_pc: KrlBlock,
    /// Position of the controller's own interpolator, rad, without FRI's offset.
    pub(super) base: Joints,
    motion: SetPointMode,
    pub(super) wants_command: bool,
    answer: Option<(CommandDatagram, f64)>,
    pub(super) last_answer_sequence: Option<u16>,
    pub(super) closing_cycles: Option<u32>,
}

impl Krc {
    /// A controller whose KRL program has just opened the interface: monitor state, drives on, arm at rest.
    pub fn new(settings: Settings) -> Self {
        let period_s = settings.period_s;
        let impedance = ImpedanceSettings::default_for(settings.strategy);
        Self {
            robot: SimulatedRobot::new(&settings.robot, &LWR_4_PLUS, impedance, period_s),
            fault: None,
            told_fault: 0,
            monitor_reason: Some(MonitorReason::Answer),
            counts: KrcCounts::default(),
            last_refusal: None,
            quality: QualityMeter::new(settings.robot.quality, period_s),
            to_pc: KrlBlock::default(),
            from_pc: KrlBlock::default(),
            base: settings.robot.start,
            motion: SetPointMode::Hold,
            wants_command: false,
            answer: None,
            last_answer_sequence: None,
            closing_cycles: None,
            settings,
        }
    }

    /// Processes a datagram from the PC that arrived `delay_s` seconds after the last measurement datagram was sent.
    ///
    /// # Errors
    /// Returns why it is not taken; it is counted then.
    pub fn receive(&mut self, bytes: &[u8], delay_s: f64) -> Result<(), DatagramRefusal> {
        let result = self.take(bytes, delay_s);
        if let Err(refusal) = &result {
            self.counts.refuse(refusal);
            self.last_refusal = Some(*refusal);
        }
        result
    }

    fn take(&mut self, bytes: &[u8], delay_s: f64) -> Result<(), DatagramRefusal> {
        let answer = CommandDatagram::decode(bytes)?;
        if self.robot.drops_answer() {
            self.counts.dropped += 1;
            return Ok(());
        }
        let (want, have) = (self.sequence(), answer.reflected_sequence);
        if have != want || self.robot.sent.is_none() {
            return Err(DatagramRefusal::Late { want, have });
        }
        // A restarted PC counts from the beginning, which does no harm in monitor state.
        let (last, own) = (self.last_answer_sequence, answer.send_sequence);
        let backward = last.is_some_and(|last| own.wrapping_sub(last).cast_signed() <= 0);
        if self.answer.is_some() || (backward && self.in_command_state()) {
            let last = self
                .answer
                .map_or(last, |(first, _)| Some(first.send_sequence));
            return Err(DatagramRefusal::Duplicate {
                last: last.unwrap_or(0),
                have: own,
            });
        }
        if !self.in_command_state() && !has_finite_position(&answer) {
            return Err(DatagramRefusal::NotFinite);
        }
        self.answer = Some((answer, delay_s));
        Ok(())
    }

    /// Counts a datagram from another address.
    pub fn receive_foreign(&mut self) {
        self.counts.foreign += 1;
    }

    /// Ends the cycle and starts the next; returns the next measurement datagram, or `None` while sending is suspended.
    ///
    /// `periods` is 1 or, after a stall of the machine, the number of periods that passed on its clock. In command
    /// state, the arm then continues its motion, as that of a real controller does, and the sequence numbers show the
    /// length of the stall; at most `STALL_PERIODS_MAX` additional periods are simulated.
    pub fn tick(&mut self, periods: u64) -> Option<[u8; MSR_SIZE]> {
        let answer = self.answer.take();
        if self.robot.sent.is_some() {
            self.count(answer.as_ref(), periods);
            self.robot.exchanged = self.robot.sent.map(|sent| self.pair(sent, answer.as_ref()));
        }
        let command = answer.map(|(command, _)| command);
        self.robot.from = self.robot.desired;
        let passed = self.move_set_point(command.as_ref(), periods);
        let gone_on = self.continue_through_stall(periods.saturating_sub(passed));
        let step_s = (passed + gone_on) as f64 * self.settings.period_s;
        self.robot.step(self.settings.strategy, &LWR_4_PLUS, step_s);
        self.robot.count_rest(self.is_at_rest(), step_s);
        self.supervise_arm();
        self.run_krl_program(command.as_ref());
        self.robot.tick += 1 + gone_on;
        self.robot.time_s += step_s;
        self.next_measurement()
    }

    /// Returns the datagrams of the cycle that the last tick has ended.
    pub fn exchanged(&self) -> Option<&TraceRecord> {
        self.robot.exchanged.as_ref()
    }

    /// Returns the sequence number of the last measurement datagram.
    pub fn sequence(&self) -> u16 {
        self.robot.tick as u16
    }

    /// Returns true if the KRL program has ended.
    pub fn is_closed(&self) -> bool {
        self.closing_cycles == Some(0)
    }

    /// Returns true in FRI's command state: the set-point is that of the PC.
    pub(super) fn in_command_state(&self) -> bool {
        matches!(self.motion, SetPointMode::Follow(_))
    }

    /// Returns true if neither the set-point nor the arm moves.
    pub fn is_at_rest(&self) -> bool {
        self.robot.arm.is_at_rest() && !matches!(self.motion, SetPointMode::Stop(_))
    }

    /// Returns true if the drives are switched on, without a fault or an emergency stop.
    pub fn drives_on(&self) -> bool {
        self.robot.drives_wanted && self.fault.is_none() && !self.robot.emergency_stop
    }

    /// Presses the emergency stop; `ack` releases it.
    pub(super) fn press_emergency_stop(&mut self) {
        self.robot.emergency_stop = true;
        self.fail(KrcFault::EmergencyStop);
    }

    /// Switches the drives on or off.
    pub(super) fn switch_drives(&mut self, on: bool) {
        self.robot.drives_wanted = on;
        if !on && self.in_command_state() {
            self.fail(KrcFault::DrivesOff);
        }
    }

    /// If the arm is at rest, releases the emergency stop and acknowledges the fault. Returns whether it is at rest.
    pub(super) fn acknowledge(&mut self) -> bool {
        if self.is_at_rest() {
            self.robot.emergency_stop = false;
            self.fault = None;
        }
        self.is_at_rest()
    }

    /// Ends the KRL program: it stops the arm and announces its end for some cycles; then [`Krc::is_closed`] is true.
    pub(super) fn close(&mut self) {
        self.closing_cycles.get_or_insert(CLOSING_CYCLES);
    }

    pub(super) fn reset_statistics(&mut self) {
        self.counts = KrcCounts::default();
        self.last_refusal = None;
        self.robot.reset_statistics();
        if let SetPointMode::Follow(commands) = &mut self.motion {
            commands.stream.reset_extremes();
        }
    }

    fn count(&mut self, answer: Option<&(CommandDatagram, f64)>, periods: u64) {
        self.counts.stalls += u64::from(periods > 1);
        self.counts.skipped += periods.saturating_sub(1);
        self.quality.record(answer.map(|&(_, delay_s)| delay_s));
        let Some((answer, _)) = answer else {
            self.counts.missed += 1;
            return;
        };
        self.counts.answered += 1;
        self.last_answer_sequence = Some(answer.send_sequence);
        self.from_pc = answer.krl;
        for &KrlLoopback { from, to } in &self.settings.boolean_wires {
            if let Some(value) = self.from_pc.boolean(from) {
                self.to_pc.set_boolean(to, value);
            }
        }
        for &KrlLoopback { from, to } in &self.settings.real_wires {
            if let (Some(&value), Some(place)) = (
                self.from_pc.reals.get(from.wrapping_sub(1)),
                self.to_pc.reals.get_mut(to.wrapping_sub(1)),
            ) {
                *place = value;
            }
        }
    }

    fn pair(&self, sent: TraceRecord, answer: Option<&(CommandDatagram, f64)>) -> TraceRecord {
        TraceRecord {
            answered: answer.is_some(),
            commanded: answer.map_or([f64::NAN; JOINTS], |(answer, _)| {
                answer.joint_position.map(f64::from)
            }),
            booleans: self.from_pc.booleans,
            ..sent
        }
    }

    /// Stops with a fault: brakes, switches the drives off, and enters monitor state; the first cause is kept.
    ///
    /// The time at rest is reset, so that a fault of an arm that has rested for long is shown for as long as any other
    /// before the KRL program acknowledges it.
    pub(super) fn fail(&mut self, fault: KrcFault) {
        self.robot.at_rest_for_s = 0.0;
        if self.fault.is_none() {
            self.fault = Some(fault);
            self.counts.faults += 1;
            self.robot.remember(fault.code(), fault.to_string());
        }
        self.robot.impedance = ImpedanceSettings::default_for(self.settings.strategy);
        self.close_brakes();
    }

    /// Stops an arm that yields if it leaves its range or exceeds the supervised velocities, which only the commanded
    /// springs and forces can bring about.
    fn supervise_arm(&mut self) {
        if self.settings.strategy == ControlLaw::Position || !self.in_command_state() {
            return;
        }
        let limits = &self.settings.robot.limits;
        if let Some(runaway) = self.robot.runaway(limits, self.settings.safety_limits) {
            self.fail(KrcFault::Runaway(runaway));
        }
    }

    /// Enters monitor state; a moving set-point is brought to rest.
    pub(super) fn stop(&mut self) {
        self.robot.impedance = ImpedanceSettings::default_for(self.settings.strategy);
        self.brake();
    }

    fn next_measurement(&mut self) -> Option<[u8; MSR_SIZE]> {
        if !self.in_command_state() {
            // FRI's offset becomes part of the controller's own position, so that a mirroring PC sees no jump.
            self.base = self.robot.desired;
        }
        self.write_krl_variables();
        let datagram = self.datagram();
        self.robot.sent = Some(self.robot.trace_record(
            u32::from(datagram.send_sequence),
            datagram.state as u16,
            datagram.quality as u16,
        ));
        if self.robot.withholds() {
            self.counts.withheld += 1;
            return None;
        }
        self.counts.sent += 1;
        Some(datagram.encode())
    }
}

/// Returns false if a position that the command's flags select is NaN or infinite.
fn has_finite_position(command: &CommandDatagram) -> bool {
    let selected = |flag| command.flags & flag != 0;
    let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
    (!selected(flags::JOINT_POSITION) || finite(&command.joint_position))
        && (!selected(flags::CARTESIAN_POSITION) || finite(&command.cartesian_position))
}
