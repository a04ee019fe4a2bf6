//! How fast the pace of a trajectory may fall from 1 to 0 after CANCEL, so that the arm comes to rest on its path within
//! its limits. Run by whoever imports.
//!
//! With the pace r = ds/dt along q(s): q̈ = q″ r² + q′ ṙ and q⃛ = q‴ r³ + 3 q″ r ṙ + q′ r̈ (Verscheure et al., Time-optimal
//! path tracking for robots, IEEE TAC 54, 2009). As r is at most 1 and ṙ at most 0, q′ ṙ only adds to q″ where both have
//! opposite signs.

use rcc_config::JointConfig;

use crate::path::TrajectoryPath;

/// Part of the limits that a stop uses; the rest is for differences of rounded positions.
const USED: f64 = 0.95;
/// Part of the jerk limit that counts as used by the trajectory at most: where it uses more, a stop adds up to 5 % of the limit.
/// Short first and last sections need nearly all of it, and their velocity is near 0.
const JERK_USED_MAX: f64 = 0.9;
/// Places of the path that are looked at.
const PLACES: usize = 4000;
/// Candidates for the rate of the pace, from the largest possible one down.
const CANDIDATES: u32 = 24;

/// Limits of the pace after CANCEL.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brake {
    /// Largest rate of the pace, 1/s.
    pub rate_per_s: f64,
    /// Largest change of this rate, 1/s².
    pub change_per_s2: f64,
}

/// State of one joint at one place of the path, and the limits that a stop must keep there.
struct Margin {
    velocity: f64,
    acceleration: f64,
    jerk: f64,
    acceleration_max: f64,
    jerk_max: f64,
}

impl Margin {
    /// Largest rate of the pace, 1/s.
    fn rate(&self) -> f64 {
        let slows = self.velocity * self.acceleration < 0.0;
        let used = if slows { self.acceleration.abs() } else { 0.0 };
        (USED * self.acceleration_max - used) / self.velocity.abs()
    }

    /// Largest change of the rate, 1/s².
    fn change(&self, rate: f64) -> f64 {
        let own = self.jerk.abs().min(JERK_USED_MAX * self.jerk_max);
        let used = own + 3.0 * self.acceleration.abs() * rate;
        (USED * self.jerk_max - used) / self.velocity.abs()
    }
}

impl Brake {
    /// Returns the quickest stop that keeps all limits at every place of the path; `None` if the trajectory uses them up.
    #[must_use]
    pub fn of(path: &TrajectoryPath, joints: &[&JointConfig]) -> Option<Brake> {
        let mut margins = Vec::new();
        for place in 0..=PLACES {
            let time_s = path.duration_s() * place as f64 / PLACES as f64;
            for (joint, config) in joints.iter().enumerate() {
                let there = path.at(joint, time_s);
                margins.push(Margin {
                    velocity: there.velocity,
                    acceleration: there.acceleration,
                    jerk: there.jerk,
                    acceleration_max: config.acceleration_rad_s2,
                    jerk_max: config.jerk_rad_s3,
                });
            }
        }
        // A joint that does not move sets no bound.
        margins.retain(|margin| margin.velocity != 0.0);
        let rate_max = margins.iter().map(Margin::rate).fold(100.0, f64::min);
        let candidates = (0..CANDIDATES).map(|step| rate_max * 0.8_f64.powi(step as i32));
        let brakes = candidates.map(|rate| Brake {
            rate_per_s: rate,
            change_per_s2: margins
                .iter()
                .map(|margin| margin.change(rate))
                .fold(10_000.0, f64::min),
        });
        let possible = brakes.filter(|brake| brake.rate_per_s > 0.0 && brake.change_per_s2 > 0.0);
        possible.min_by(|a, b| a.duration_s().total_cmp(&b.duration_s()))
    }

    /// Returns the time from the full pace to rest, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        // The rate is reached only if the pace is not 0 before.
        let reached = self.rate_per_s.powi(2) <= self.change_per_s2;
        match reached {
            true => 1.0 / self.rate_per_s + self.rate_per_s / self.change_per_s2,
            false => 2.0 / self.change_per_s2.sqrt(),
        }
    }
}

#[cfg(test)]
mod tests;
