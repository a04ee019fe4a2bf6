//! The state of a simulated robot at one moment, for the control port.
//! Plain data; written by the clock thread, converted to JSON by the control port's threads.

use super::arm::Joints;
use super::arm::dynamics::FlangeLoad;
use super::arm::environment::Wall;
use super::network::NetworkCounts;
use serde::Serialize;

/// A fault in the history.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultRecord {
    /// Tick in which the fault was detected.
    pub tick: u64,
    /// Controller's time, s.
    pub time_s: f64,
    /// Kind of the fault; of a KRC as in `$FRI_TO_INT[2]`.
    pub code: i32,
    /// Description with values.
    pub reason: String,
}

/// The state that every simulated robot reports.
#[derive(Clone, Debug, Serialize)]
pub struct RobotSnapshot {
    /// Cycles since the start.
    pub tick: u64,
    /// Controller's time since the start, s.
    pub time_s: f64,
    /// Why commands are not executed; null while they are.
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
    /// Counters of the simulated network faults.
    pub network: NetworkCounts,
}
