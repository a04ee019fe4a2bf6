//! The common part of simulated robots behind FRI: arm, environment, set-point, simulated faults of the connection, and the
//! history of its own faults.
//! Plain data and pure functions; run by the clock thread once per tick.

use super::arm::command_stream::{CommandStream, SupervisedLimits};
use super::arm::dynamics::FlangeLoad;
use super::arm::environment::{Environment, Wall};
use super::arm::impedance::{ControlLaw, ImpedanceControl, ImpedanceSettings};
use super::arm::model::{ArmModel, Geometry, geometry};
use super::arm::simulated_arm::SimulatedArm;
use super::arm::{JOINTS, Joints};
use super::network::{Network, NetworkRates, impossible};
use super::quality::{QualityFigures, WINDOW};
use super::requests::{Chance, RequestError};
use super::robot_settings::RobotSettings;
use super::robot_snapshot::{FaultRecord, RobotSnapshot};
use super::trace::TraceRecord;
use thiserror::Error;

/// Number of faults in the history.
const FAULTS_KEPT: usize = 16;

/// The arm itself, which yields in impedance control, has left its range or is too fast. Joints are counted from 0 here and from 1
/// in messages.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error(
    "joint {} {what} {value}, the limit is ±{limit}: the springs and forces that are commanded do not hold the arm",
    joint + 1
)]
pub struct Runaway {
    /// Index of the joint.
    pub joint: usize,
    /// Name and unit of the value that is too large.
    pub what: &'static str,
    /// Measured.
    pub value: f64,
    /// Limit.
    pub limit: f64,
}

/// A simulated robot without its protocol.
#[derive(Clone, Debug)]
pub struct SimulatedRobot {
    /// Cycles since the start.
    pub tick: u64,
    /// The controller's time since the start, s.
    pub time_s: f64,
    /// The emergency stop is pressed.
    pub emergency_stop: bool,
    /// The drives are wanted on.
    pub drives_wanted: bool,
    /// The last faults, oldest first.
    pub faults: Vec<FaultRecord>,
    /// The arm.
    pub arm: SimulatedArm,
    /// Springs, dampers and what is added to them.
    pub impedance: ImpedanceSettings,
    /// The forces on the flange.
    pub environment: Environment,
    /// Pose and Jacobian of the flange.
    pub geometry: Geometry,
    /// Wrench on the flange, N and Nm, base axes.
    pub wrench: [f64; 6],
    /// Time since the arm came to rest or, if it already rested, since the last fault, s.
    pub at_rest_for_s: f64,
    /// Set-point of the joints, rad.
    pub desired: Joints,
    /// Set-point at which the present step begins, rad.
    pub from: Joints,
    /// The commanded stream, or the last one.
    pub last_stream: CommandStream,
    /// Ticks for which nothing is sent.
    pub withheld_ticks: u64,
    /// Share of the answers that are dropped, percent.
    pub drop_percent: f64,
    /// Simulated faults of the network.
    pub network: Network,
    /// The datagram of the present cycle.
    pub sent: Option<TraceRecord>,
    /// The datagrams of the cycle that the last tick has ended.
    pub exchanged: Option<TraceRecord>,
    chance: Chance,
}

impl SimulatedRobot {
    /// A robot at rest with its drives on.
    #[must_use]
    pub fn new(
        settings: &RobotSettings,
        model: &ArmModel,
        impedance: ImpedanceSettings,
        period_s: f64,
    ) -> Self {
        let start = settings.start;
        Self {
            tick: 0,
            time_s: 0.0,
            emergency_stop: false,
            drives_wanted: true,
            faults: Vec::new(),
            arm: SimulatedArm::new(start, settings.bandwidth_rad_s),
            impedance,
            environment: settings.environment(),
            geometry: geometry(model, &start),
            wrench: [0.0; 6],
            at_rest_for_s: 0.0,
            desired: start,
            from: start,
            last_stream: CommandStream::at_rest(start, period_s),
            withheld_ticks: 0,
            drop_percent: 0.0,
            network: Network::new(settings.seed),
            sent: None,
            exchanged: None,
            chance: Chance(settings.seed),
        }
    }

    /// Moves the arm by one step, under this control law.
    pub fn step(&mut self, law: ControlLaw, model: &ArmModel, step_s: f64) {
        match law {
            ControlLaw::Position => self.arm.follow(&self.from, &self.desired, step_s),
            law => {
                let control = ImpedanceControl {
                    law,
                    settings: &self.impedance,
                    model,
                };
                let goal = (&self.from, &self.desired);
                self.arm
                    .step_impedance(goal, step_s, &control, &self.environment);
            }
        }
        self.geometry = geometry(model, &self.arm.position);
        self.wrench = self.environment.wrench(&self.geometry, &self.arm.velocity);
    }

    /// Counts the time at rest.
    pub fn count_rest(&mut self, is_at_rest: bool, step_s: f64) {
        self.at_rest_for_s = if is_at_rest {
            self.at_rest_for_s + step_s
        } else {
            0.0
        };
    }

    /// Returns the first joint of the arm beyond its range or the supervised velocities times `scale`, which only springs and
    /// forces can bring about.
    #[must_use]
    pub fn runaway(&self, limits: &SupervisedLimits, scale: f64) -> Option<Runaway> {
        (0..JOINTS).find_map(|joint| {
            let (at, most) = (self.arm.position[joint], limits.position[joint]);
            let (rate, fastest) = (self.arm.velocity[joint], limits.velocity[joint] * scale);
            let rows = [
                ("is at (rad)", at, most),
                ("moves with (rad/s)", rate, fastest),
            ];
            let beyond = rows
                .into_iter()
                .find(|(_, value, limit)| value.abs() > *limit);
            beyond.map(|(what, value, limit)| Runaway {
                joint,
                what,
                value,
                limit,
            })
        })
    }

    /// Adds a fault to the history.
    pub fn remember(&mut self, code: i32, reason: String) {
        if self.faults.len() == FAULTS_KEPT {
            self.faults.remove(0);
        }
        self.faults.push(FaultRecord {
            tick: self.tick,
            time_s: self.time_s,
            code,
            reason,
        });
    }

    /// Forgets faults and extremes.
    pub fn reset_statistics(&mut self) {
        self.faults.clear();
        self.arm.reset_extremes();
        self.last_stream.reset_extremes();
    }

    /// Returns true if the answer that has come is dropped on request.
    pub fn drops_answer(&mut self) -> bool {
        self.drop_percent > 0.0 && self.chance.draw() * 100.0 < self.drop_percent
    }

    /// Sends nothing for this time, s; the controller continues and misses the answers.
    pub fn withhold(&mut self, time_s: f64, period_s: f64) {
        self.withheld_ticks = (time_s / period_s).round() as u64;
    }

    /// Returns true if the datagram of this cycle is withheld on request.
    pub fn withholds(&mut self) -> bool {
        let withholds = self.withheld_ticks > 0;
        self.withheld_ticks = self.withheld_ticks.saturating_sub(1);
        withholds
    }

    /// Returns the record of a datagram that is being sent, with its counter, state and quality.
    #[must_use]
    pub fn trace_record(&self, sequence: u32, state: u16, quality: u16) -> TraceRecord {
        TraceRecord {
            tick: self.tick,
            time_s: self.time_s,
            sequence,
            state,
            quality,
            answered: false,
            measured: self.arm.position,
            commanded: [f64::NAN; JOINTS],
            booleans: 0,
            flange: self.geometry.position,
            force: [self.wrench[0], self.wrench[1], self.wrench[2]],
        }
    }

    /// Replaces or removes the obstacle.
    ///
    /// # Errors
    /// Returns an error for an impossible wall; nothing has changed then.
    pub fn set_wall(&mut self, wall: Option<Wall>) -> Result<(), RequestError> {
        self.environment.wall = wall.map(Wall::checked).transpose()?;
        Ok(())
    }

    /// Replaces or removes the load.
    ///
    /// # Errors
    /// Returns an error for an impossible load; nothing has changed then.
    pub fn set_load(&mut self, load: Option<FlangeLoad>) -> Result<(), RequestError> {
        self.environment.load = load.map(FlangeLoad::checked).transpose()?;
        Ok(())
    }

    /// Loses, delays and changes datagrams from now on.
    ///
    /// # Errors
    /// Returns an error for a number that is no probability; nothing has changed then.
    pub fn set_network(&mut self, rates: NetworkRates) -> Result<(), RequestError> {
        match impossible(&rates) {
            Some(rate) => Err(RequestError::Probability(rate)),
            None => {
                self.network.set(rates);
                Ok(())
            }
        }
    }

    /// Ends all faults of the connection and all forces that were requested.
    pub fn clear(&mut self, settings: &RobotSettings) {
        self.network.set(NetworkRates::default());
        self.drop_percent = 0.0;
        self.withheld_ticks = 0;
        self.environment = settings.environment();
    }

    /// Returns the state; what the protocol knows is absent, false or 0.
    #[must_use]
    pub fn snapshot(&self, figures: QualityFigures) -> RobotSnapshot {
        RobotSnapshot {
            tick: self.tick,
            time_s: self.time_s,
            waiting_for: None,
            fault: None,
            faults: self.faults.clone(),
            last_refusal: None,
            drives_on: false,
            emergency_stop: self.emergency_stop,
            q: self.arm.position,
            velocity: self.arm.velocity,
            q_cmd: self.desired,
            velocity_max: self.arm.velocity_max,
            acceleration_max: self.arm.acceleration_max,
            commanded_velocity_max: self.last_stream.velocity_max,
            commanded_acceleration_max: self.last_stream.acceleration_max,
            at_rest: false,
            at_rest_for_s: self.at_rest_for_s,
            flange_position: self.geometry.position,
            flange_rotation: self.geometry.rotation,
            wrench: self.wrench,
            wall: self.environment.wall,
            load: self.environment.load,
            answer_rate: figures.answered as f64 / WINDOW as f64,
            latency_s: figures.latency_s,
            jitter_s: figures.jitter_s,
            network: self.network.counts(),
        }
    }
}
