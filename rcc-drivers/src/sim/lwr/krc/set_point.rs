//! The set-point of the simulated controller: holds, follows the commands of the PC, or is brought to rest.
//! Pure; run by the clock thread once per tick.

use super::Krc;
use crate::fri_lwr::wire::CommandDatagram;
use crate::sim::arm::command_stream::CommandStream;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::arm::stop_ramp::StopRamp;
use crate::sim::lwr::Joints;
use crate::sim::lwr::fault::KrcFault;

/// Longest stall, in periods, through which the arm continues to move; in longer ones time stands still, because the PC
/// may or may not have been stalled as well.
const STALL_PERIODS_MAX: u64 = 50;

/// Source of the joint set-point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SetPointMode {
    /// Monitor state, at rest.
    Hold,
    /// Command state.
    Follow(FollowedCommands),
    /// Monitor state, coming to rest.
    Stop(StopRamp),
}

/// The commands of one stay in command state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FollowedCommands {
    pub(super) stream: CommandStream,
    /// The flags with which command state was entered: they may change in monitor state only.
    flags: u32,
    /// The first command was at the controller's position.
    mirror_checked: bool,
    missed_in_a_row: u32,
}

impl Krc {
    /// Advances the set-point; returns the number of periods that this took, which is 1 in command state.
    pub(super) fn move_set_point(
        &mut self,
        command: Option<&CommandDatagram>,
        periods: u64,
    ) -> u64 {
        match (self.motion, command) {
            (SetPointMode::Hold, _) => periods,
            (SetPointMode::Stop(mut brake), _) => {
                self.robot.desired = brake.advance(periods as f64 * self.settings.period_s);
                self.motion = if brake.is_at_rest() {
                    SetPointMode::Hold
                } else {
                    SetPointMode::Stop(brake)
                };
                periods
            }
            (SetPointMode::Follow(commands), Some(command)) => match self.follow(commands, command)
            {
                Ok(()) => 1,
                Err(fault) => {
                    self.fail(fault);
                    self.move_set_point(None, 1)
                }
            },
            (SetPointMode::Follow(commands), None) => {
                self.bridge_missed_answer(commands);
                1
            }
        }
    }

    fn follow(
        &mut self,
        FollowedCommands {
            mut stream,
            flags,
            mirror_checked,
            ..
        }: FollowedCommands,
        command: &CommandDatagram,
    ) -> Result<(), KrcFault> {
        if command.flags != flags {
            return Err(KrcFault::Flags {
                want: flags,
                have: command.flags,
            });
        }
        if !mirror_checked && let Some(error) = self.not_mirrored(command) {
            return Err(KrcFault::Mirror(error));
        }
        let target = self.target(command)?;
        let impedance = self.impedance_of(command, !mirror_checked)?;
        stream.accept(&target, &self.settings.stream_rules())?;
        self.robot.impedance = impedance;
        self.robot.desired = target;
        self.robot.last_stream = stream;
        self.motion = SetPointMode::Follow(FollowedCommands {
            stream,
            flags,
            mirror_checked: true,
            missed_in_a_row: 0,
        });
        Ok(())
    }

    /// Continues through a stall with the last velocity; no answers are missed, because none were requested. Returns
    /// the number of periods simulated, 0 outside command state.
    pub(super) fn continue_through_stall(&mut self, periods: u64) -> u64 {
        let SetPointMode::Follow(mut commands) = self.motion else {
            return 0;
        };
        let periods = periods.min(STALL_PERIODS_MAX);
        for _ in 0..periods {
            self.robot.desired = commands.stream.extrapolate(self.settings.period_s);
        }
        self.robot.last_stream = commands.stream;
        self.motion = SetPointMode::Follow(commands);
        periods
    }

    /// Continues with the last velocity, or stops after too many missed answers.
    fn bridge_missed_answer(&mut self, mut commands: FollowedCommands) {
        commands.missed_in_a_row += 1;
        let misses = commands.missed_in_a_row;
        self.counts.missed_in_a_row_max = self.counts.missed_in_a_row_max.max(misses);
        if misses > self.settings.robot.bridged_misses {
            self.fail(KrcFault::Lost { misses });
            self.move_set_point(None, 1);
            return;
        }
        self.robot.desired = commands.stream.extrapolate(self.settings.period_s);
        self.robot.last_stream = commands.stream;
        self.motion = SetPointMode::Follow(commands);
    }

    /// Enters command state with these command flags: the set-point is that of the PC from now on.
    pub(in crate::sim::lwr) fn enter_command_state(&mut self, flags: u32) {
        self.base = self.robot.desired;
        self.robot.last_stream = CommandStream::at_rest(self.robot.desired, self.settings.period_s);
        self.motion = SetPointMode::Follow(FollowedCommands {
            stream: self.robot.last_stream,
            flags,
            mirror_checked: false,
            missed_in_a_row: 0,
        });
        self.counts.entries += 1;
    }

    /// Brings the set-point to rest if it follows commands.
    pub(super) fn brake(&mut self) {
        if let SetPointMode::Follow(commands) = self.motion {
            self.brake_from(self.robot.desired, commands.stream.velocity());
        }
    }

    /// Closes the brakes of an arm that follows commands. An arm that yields is stopped where it is, not where its springs
    /// pull it.
    pub(super) fn close_brakes(&mut self) {
        if self.settings.strategy == ControlLaw::Position {
            return self.brake();
        }
        if self.in_command_state() {
            (self.robot.desired, self.robot.from) =
                (self.robot.arm.position, self.robot.arm.position);
            self.brake_from(self.robot.arm.position, self.robot.arm.velocity);
        }
    }

    fn brake_from(&mut self, position: Joints, velocity: Joints) {
        let (deceleration, jerk) = (
            self.settings.robot.brake_deceleration,
            self.settings.robot.brake_jerk,
        );
        self.motion = SetPointMode::Stop(StopRamp::new(position, velocity, deceleration, jerk));
    }
}
