//! Compares a curve with the limits of a robot's joints, at the periods of the cell, as the rehearsal of the net will. Run
//! by whoever imports.

use std::fmt;

use rcc_config::JointConfig;
use rcc_core::guard::{JERK_TOLERANCE, RELATIVE_TOLERANCE};

use crate::path::TrajectoryPath;

/// A quantity with a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// rad
    Position,
    /// rad/s
    Velocity,
    /// rad/s²
    Acceleration,
    /// rad/s³
    Jerk,
}

/// The value of a joint that is farthest beyond a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Excess {
    /// Index of the joint.
    pub joint: usize,
    /// The quantity that is beyond its limit.
    pub quantity: Quantity,
    /// Time from the start, s.
    pub time_s: f64,
    /// Value, in the unit of the quantity.
    pub value: f64,
    /// The limit that it passes.
    pub limit: f64,
}

impl Excess {
    /// Returns it in words, for the name of its joint.
    #[must_use]
    pub fn sentence(&self, joint: &str) -> String {
        let Excess {
            quantity,
            time_s,
            value,
            limit,
            ..
        } = self;
        let unit = quantity.unit();
        format!("{joint} at {time_s:.3} s: {quantity} {value:.4} {unit} exceeds {limit:.4} {unit}")
    }
}

impl Quantity {
    /// Returns its unit.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Quantity::Position => "rad",
            Quantity::Velocity => "rad/s",
            Quantity::Acceleration => "rad/s²",
            Quantity::Jerk => "rad/s³",
        }
    }

    /// Returns by how much longer a trajectory must take whose value is this multiple of its limit.
    fn stretch(self, ratio: f64) -> Option<f64> {
        match self {
            Quantity::Position => None,
            Quantity::Velocity => Some(ratio),
            Quantity::Acceleration => Some(ratio.sqrt()),
            Quantity::Jerk => Some(ratio.cbrt()),
        }
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Quantity::Position => "position",
            Quantity::Velocity => "velocity",
            Quantity::Acceleration => "acceleration",
            Quantity::Jerk => "jerk",
        })
    }
}

/// Returns the worst value of each joint and quantity that passes a limit; `joints` has a joint for each of the curve.
#[must_use]
pub fn excesses(path: &TrajectoryPath, joints: &[&JointConfig], period_s: f64) -> Vec<Excess> {
    let mut found = Vec::new();
    for (joint, config) in joints.iter().enumerate() {
        let mut worst: [Option<(f64, Excess)>; 4] = [None; 4];
        let mut history = [path.at(joint, 0.0).position; 3];
        // Three more cycles: the end, too, has differences.
        let cycles = (path.duration_s() / period_s).ceil() as u64 + 3;
        for cycle in 1..=cycles {
            let time_s = cycle as f64 * period_s;
            let position = path.at(joint, time_s).position;
            let [last, before, oldest] = history;
            let velocity = (position - last) / period_s;
            let acceleration = (position - 2.0 * last + before) / period_s.powi(2);
            let jerk = (position - 3.0 * last + 3.0 * before - oldest) / period_s.powi(3);
            history = [position, last, before];
            let bound = if position > config.upper_rad {
                config.upper_rad
            } else {
                config.lower_rad
            };
            let outside = (config.lower_rad - position).max(position - config.upper_rad);
            let rows = [
                (Quantity::Position, position, bound, 1.0 + outside),
                ratio(
                    Quantity::Velocity,
                    velocity,
                    config.velocity_rad_s,
                    RELATIVE_TOLERANCE,
                ),
                ratio(
                    Quantity::Acceleration,
                    acceleration,
                    config.acceleration_rad_s2,
                    RELATIVE_TOLERANCE,
                ),
                ratio(Quantity::Jerk, jerk, config.jerk_rad_s3, JERK_TOLERANCE),
            ];
            for (worst, (quantity, value, limit, ratio)) in worst.iter_mut().zip(rows) {
                if ratio > 1.0 && worst.is_none_or(|(most, _)| ratio > most) {
                    let excess = Excess {
                        joint,
                        quantity,
                        time_s,
                        value,
                        limit,
                    };
                    *worst = Some((ratio, excess));
                }
            }
        }
        found.extend(worst.into_iter().flatten().map(|(_, excess)| excess));
    }
    found
}

fn ratio(quantity: Quantity, value: f64, limit: f64, tolerance: f64) -> (Quantity, f64, f64, f64) {
    (
        quantity,
        value,
        limit,
        value.abs() / (limit * (1.0 + tolerance)),
    )
}

/// Returns the factor for all times with which these limits are kept, rounded up to hundredths; `None` if no factor helps.
#[must_use]
pub fn stretch(excesses: &[Excess]) -> Option<f64> {
    let factors = excesses
        .iter()
        .map(|excess| excess.quantity.stretch(excess.value.abs() / excess.limit));
    let most = factors.collect::<Option<Vec<f64>>>()?;
    let most = most.into_iter().fold(1.0, f64::max);
    Some((most * 100.0).ceil() / 100.0 + 0.01)
}
