//! The set-point of the simulated cabinet: holds, synchronises with the client, follows its commands, or is brought to
//! rest.
//! Pure; run by the clock thread once per tick.

use super::Cabinet;
use crate::fri_iiwa::wire::schema::Command;
use crate::sim::arm::command_stream::CommandStream;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::arm::stop_ramp::StopRamp;
use crate::sim::iiwa::fault::CabinetFault;
use crate::sim::iiwa::{JOINTS, Joints};

/// Longest stall, in periods, through which the arm continues to move; in longer ones time stands still, because the client
/// may or may not have been stalled as well.
const STALL_PERIODS_MAX: u64 = 50;

/// Outcome of a cycle in which an answer may have been due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DueAnswer {
    /// It came.
    Answer,
    /// It was due and did not come.
    Miss,
    /// None was due.
    Nothing,
}

/// Source of the joint set-point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::sim::iiwa) enum Motion {
    /// No motion, at rest.
    Hold,
    /// COMMANDING_WAIT.
    Synchronise(Synchronisation),
    /// COMMANDING_ACTIVE.
    Follow(FollowedCommands),
    /// No motion, coming to rest.
    Stop(StopRamp),
}

/// How far the robot has synchronised with the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(in crate::sim::iiwa) struct Synchronisation {
    answers: u32,
    missed_in_a_row: u32,
}

/// The commands of one motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::sim::iiwa) struct FollowedCommands {
    pub(in crate::sim::iiwa) stream: CommandStream,
    /// Ticks until the set-point is at the last command: commands are interpolated until the next one is due.
    ticks_left: u32,
    mirror_checked: bool,
    missed_in_a_row: u32,
}

impl FollowedCommands {
    /// Returns true once the first command was at the interpolated position.
    pub(super) fn mirror_checked(&self) -> bool {
        self.mirror_checked
    }

    /// Returns the target of the last command, rad.
    pub(super) fn target(&self) -> Joints {
        self.stream.position()
    }
}

impl Cabinet {
    /// Advances the set-point; returns the number of periods that this took, which is 1 while commands are executed.
    pub(super) fn move_set_point(
        &mut self,
        command: Option<&Command>,
        due: DueAnswer,
        periods: u64,
    ) -> u64 {
        match self.motion {
            Motion::Hold => periods,
            Motion::Stop(mut brake) => {
                self.robot.desired = brake.advance(periods as f64 * self.settings.period_s());
                self.motion = Motion::Stop(brake);
                if brake.is_at_rest() && (self.robot.arm.is_at_rest() || !self.yields()) {
                    self.hold_here();
                }
                periods
            }
            Motion::Synchronise(progress) => {
                if let Err(fault) = self.synchronise(progress, command, due) {
                    self.fail(fault);
                }
                periods
            }
            Motion::Follow(commands) => {
                if let Err(fault) = self.follow_or_bridge(commands, command, due) {
                    self.fail(fault);
                    self.move_set_point(None, DueAnswer::Nothing, 1);
                }
                1
            }
        }
    }

    fn yields(&self) -> bool {
        self.settings.law != ControlLaw::Position
    }

    /// Ends a stop: the arm is held where it is, in position control.
    fn hold_here(&mut self) {
        if self.yields() {
            self.robot.desired = self.robot.arm.position;
            self.robot.arm.velocity = [0.0; JOINTS];
        }
        self.motion = Motion::Hold;
    }

    fn synchronise(
        &mut self,
        mut progress: Synchronisation,
        command: Option<&Command>,
        due: DueAnswer,
    ) -> Result<(), CabinetFault> {
        match (due, command) {
            (DueAnswer::Answer, Some(command)) => {
                self.check_mirrored(command)?;
                self.check_presence(command)?;
                progress.answers += 1;
                progress.missed_in_a_row = 0;
            }
            (DueAnswer::Miss, _) => {
                progress.missed_in_a_row += 1;
                self.check_misses(progress.missed_in_a_row)?;
            }
            _ => {}
        }
        self.motion = Motion::Synchronise(progress);
        if progress.answers >= self.settings.synchronising_answers {
            self.robot.last_stream =
                CommandStream::at_rest(self.robot.desired, self.settings.period_s());
            self.counts.entries += 1;
            self.motion = Motion::Follow(FollowedCommands {
                stream: self.robot.last_stream,
                ticks_left: 0,
                mirror_checked: false,
                missed_in_a_row: 0,
            });
        }
        Ok(())
    }

    fn check_misses(&mut self, misses: u32) -> Result<(), CabinetFault> {
        self.counts.missed_in_a_row_max = self.counts.missed_in_a_row_max.max(misses);
        match misses > self.settings.robot.bridged_misses {
            true => Err(CabinetFault::Lost { misses }),
            false => Ok(()),
        }
    }

    fn follow_or_bridge(
        &mut self,
        mut commands: FollowedCommands,
        command: Option<&Command>,
        due: DueAnswer,
    ) -> Result<(), CabinetFault> {
        match (due, command) {
            (DueAnswer::Answer, Some(command)) => {
                if !commands.mirror_checked {
                    self.check_mirrored(command)?;
                }
                let target = self.target(command)?;
                let added = self.added(command)?;
                commands
                    .stream
                    .accept(&target, &self.settings.stream_rules())?;
                self.check_speed(&target, &commands.stream.velocity())?;
                self.robot.impedance.added = added;
                commands.ticks_left = self.settings.multiplier;
                commands.mirror_checked = true;
                commands.missed_in_a_row = 0;
            }
            (due, _) => {
                commands.stream.extrapolate(self.settings.period_s());
                if due == DueAnswer::Miss {
                    commands.missed_in_a_row += 1;
                    self.motion = Motion::Follow(commands);
                    self.check_misses(commands.missed_in_a_row)?;
                }
            }
        }
        self.advance(&mut commands);
        self.robot.last_stream = commands.stream;
        self.motion = Motion::Follow(commands);
        Ok(())
    }

    /// Moves the set-point by one period: to the target, or on with the last velocity.
    fn advance(&mut self, commands: &mut FollowedCommands) {
        let (velocity, period_s) = (commands.stream.velocity(), self.settings.period_s());
        let (target, left) = (commands.target(), f64::from(commands.ticks_left));
        for (joint, desired) in self.robot.desired.iter_mut().enumerate() {
            *desired = match commands.ticks_left {
                0 => *desired + velocity[joint] * period_s,
                1 => target[joint],
                _ => *desired + (target[joint] - *desired) / left,
            };
        }
        commands.ticks_left = commands.ticks_left.saturating_sub(1);
    }

    /// Continues through a stall with the last velocity; no answers are missed, because none were requested. Returns
    /// the number of periods simulated, 0 while no commands are executed.
    pub(super) fn continue_through_stall(&mut self, periods: u64) -> u64 {
        let Motion::Follow(mut commands) = self.motion else {
            return 0;
        };
        let periods = periods.min(STALL_PERIODS_MAX);
        for _ in 0..periods {
            commands.stream.extrapolate(self.settings.period_s());
            self.advance(&mut commands);
        }
        self.robot.last_stream = commands.stream;
        self.motion = Motion::Follow(commands);
        periods
    }

    /// Starts a position hold with an overlay where the arm is held.
    pub(in crate::sim::iiwa) fn start_motion(&mut self) {
        self.interpolated = self.robot.desired;
        self.robot.impedance = self.settings.impedance;
        self.motion = Motion::Synchronise(Synchronisation::default());
    }

    /// Ends the motion and brings a moving set-point to rest. An arm that yields is stopped where it is, not where its
    /// springs pull it.
    pub(super) fn end_motion(&mut self) {
        let brake = |position, velocity| {
            let (deceleration, jerk) = (
                self.settings.robot.brake_deceleration,
                self.settings.robot.brake_jerk,
            );
            Motion::Stop(StopRamp::new(position, velocity, deceleration, jerk))
        };
        let yields = self.yields();
        let stopping = match self.motion {
            Motion::Synchronise(_) if !yields => Motion::Hold,
            Motion::Follow(commands) if !yields => {
                brake(self.robot.desired, commands.stream.velocity())
            }
            Motion::Synchronise(_) | Motion::Follow(_) => {
                brake(self.robot.arm.position, self.robot.arm.velocity)
            }
            motion => motion,
        };
        if yields && self.has_motion() {
            (self.robot.desired, self.robot.from) =
                (self.robot.arm.position, self.robot.arm.position);
        }
        self.robot.impedance.added = [0.0; JOINTS];
        self.motion = stopping;
    }
}
