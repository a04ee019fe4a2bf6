//! The set-point of the simulated controller: holds, follows the commands of the PC, or is brought to rest.
//! Pure; run by the clock thread once per tick.

use super::Krc;
use crate::fri_lwr::wire::CommandDatagram;
use crate::sim::lwr::command_stream::CommandStream;
use crate::sim::lwr::fault::KrcFault;
use crate::sim::lwr::impedance::{ImpedanceSettings, deflection};
use crate::sim::lwr::model::{geometry, geometry_of};
use crate::sim::lwr::settings::KrlStrategy;
use crate::sim::lwr::stop_ramp::StopRamp;
use crate::sim::lwr::{JOINTS, Joints};

/// Longest stall, in periods, through which the arm continues to move; in longer ones time stands still, because the PC
/// may or may not have been stalled as well.
const STALL_PERIODS_MAX: u64 = 50;

/// Largest added force or torque at the entry into command state, N or N·m: users report that a real controller refuses
/// more than 1 N·m.
const ENTRY_ADDED_MAX: f64 = 1.0;
/// Tolerance between the commanded pose and that of the commanded joint positions, m and rad. The values are ours.
const POSE_TOLERANCE: (f64, f64) = (1e-3, 0.01);

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
                self.desired = brake.advance(periods as f64 * self.settings.period_s);
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
            mirror_checked,
            ..
        }: FollowedCommands,
        command: &CommandDatagram,
    ) -> Result<(), KrcFault> {
        let strategy = self.settings.strategy;
        if command.flags != strategy.flags() {
            return Err(KrcFault::Flags {
                want: strategy.flags(),
                have: command.flags,
            });
        }
        if !mirror_checked && let Some((joint, value)) = self.not_mirrored(command) {
            let (own, tolerance) = (self.desired[joint], self.settings.mirror_tolerance_rad);
            return Err(KrcFault::Mirror {
                joint,
                value,
                own,
                tolerance,
            });
        }
        let target = command.joint_position.map(f64::from);
        let impedance = self.impedance_of(command, &target, !mirror_checked)?;
        stream.accept(&target, &self.settings)?;
        self.impedance = impedance;
        self.desired = target;
        self.last_stream = stream;
        self.motion = SetPointMode::Follow(FollowedCommands {
            stream,
            mirror_checked: true,
            missed_in_a_row: 0,
        });
        Ok(())
    }

    /// Returns the impedance of a command, after checking that its pose matches its joint positions; `is_first` for the
    /// first command after the entry into command state.
    fn impedance_of(
        &self,
        command: &CommandDatagram,
        target: &Joints,
        is_first: bool,
    ) -> Result<ImpedanceSettings, KrcFault> {
        let strategy = self.settings.strategy;
        if strategy == KrlStrategy::Position {
            return Ok(self.impedance);
        }
        let impedance = ImpedanceSettings::of(command, strategy)?;
        let value = impedance
            .added
            .iter()
            .fold(0.0_f64, |most, value| most.max(value.abs()));
        if is_first && value > ENTRY_ADDED_MAX {
            return Err(KrcFault::Added { value });
        }
        if strategy == KrlStrategy::CartesianImpedance {
            let commanded = geometry_of(&command.cartesian_position);
            let [x, y, z, rx, ry, rz] = deflection(&geometry(target), &commanded);
            let length = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
            let (distance, angle) = (length([x, y, z]), length([rx, ry, rz]));
            let (most, turn) = POSE_TOLERANCE;
            if !(distance <= most && angle <= turn) {
                return Err(KrcFault::Pose { distance, angle });
            }
        }
        Ok(impedance)
    }

    /// Continues through a stall with the last velocity; no answers are missed, because none were requested. Returns
    /// the number of periods simulated, 0 outside command state.
    pub(super) fn continue_through_stall(&mut self, periods: u64) -> u64 {
        let SetPointMode::Follow(mut commands) = self.motion else {
            return 0;
        };
        let periods = periods.min(STALL_PERIODS_MAX);
        for _ in 0..periods {
            self.desired = commands.stream.extrapolate(self.settings.period_s);
        }
        self.last_stream = commands.stream;
        self.motion = SetPointMode::Follow(commands);
        periods
    }

    /// Continues with the last velocity, or stops after too many missed answers.
    fn bridge_missed_answer(&mut self, mut commands: FollowedCommands) {
        commands.missed_in_a_row += 1;
        let misses = commands.missed_in_a_row;
        self.counts.missed_in_a_row_max = self.counts.missed_in_a_row_max.max(misses);
        if misses > self.settings.bridged_misses {
            self.fail(KrcFault::Lost { misses });
            self.move_set_point(None, 1);
            return;
        }
        self.desired = commands.stream.extrapolate(self.settings.period_s);
        self.last_stream = commands.stream;
        self.motion = SetPointMode::Follow(commands);
    }

    /// Enters command state: the set-point is that of the PC from now on.
    pub(in crate::sim::lwr) fn enter_command_state(&mut self) {
        self.base = self.desired;
        self.last_stream = CommandStream::at_rest(self.desired, self.settings.period_s);
        self.motion = SetPointMode::Follow(FollowedCommands {
            stream: self.last_stream,
            mirror_checked: false,
            missed_in_a_row: 0,
        });
        self.counts.entries += 1;
    }

    /// Returns the first joint whose command differs from the controller's position, with the commanded value.
    pub(in crate::sim::lwr) fn not_mirrored(
        &self,
        command: &CommandDatagram,
    ) -> Option<(usize, f64)> {
        let values = command.joint_position.map(f64::from);
        let tolerance = self.settings.mirror_tolerance_rad;
        (0..JOINTS)
            .find(|&joint| {
                let distance = (values[joint] - self.desired[joint]).abs();
                distance.is_nan() || distance > tolerance
            })
            .map(|joint| (joint, values[joint]))
    }

    /// Brings the set-point to rest if it follows commands.
    pub(super) fn brake(&mut self) {
        if let SetPointMode::Follow(commands) = self.motion {
            let brake = StopRamp::new(
                self.desired,
                commands.stream.velocity(),
                self.settings.brake_deceleration,
                self.settings.brake_jerk,
            );
            self.motion = SetPointMode::Stop(brake);
        }
    }
}
