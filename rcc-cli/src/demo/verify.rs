//! Checks of a motion, based on recorded data alone: set-points, the simulated arm, and datagrams on the wire. Pure;
//! called by the demo's main thread when a motion has ended.

use rcc_core::counted::Counted;
use rcc_core::path::PathLimits;
use rcc_motion::stop_time;

/// Tolerance of set-points on the line, m.
pub const SET_POINT_TOLERANCE_M: f64 = 1e-9;
/// Tolerance of the simulated arm on the line, m.
pub const ARM_TOLERANCE_M: f64 = 1e-3;
/// Tolerance of positions on the wire, m: binary32 rounds 1 rad to 6e-8 rad, at less than 1 m.
pub const WIRE_TOLERANCE_M: f64 = 1e-6;
/// Relative tolerance of limits.
const RELATIVE_TOLERANCE: f64 = 1e-6;
/// Rounding error of a distance below 1 m.
const ROUNDING_M: f64 = 2.3e-16;

/// One check and its result.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionCheck {
    /// The checked quantity, in words.
    pub what: String,
    /// Expected value.
    pub expected: String,
    /// Measured value.
    pub found: String,
    /// True if the measured value is as expected.
    pub holds: bool,
}

impl MotionCheck {
    /// Creates a check.
    pub fn new(
        what: impl Into<String>,
        holds: bool,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> MotionCheck {
        MotionCheck {
            what: what.into(),
            expected: expected.into(),
            found: found.into(),
            holds,
        }
    }
}

/// A straight line between two points, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineSegment {
    /// Start point.
    pub start: [f64; 3],
    /// End point.
    pub end: [f64; 3],
}

impl LineSegment {
    /// Returns the length, m.
    #[must_use]
    pub fn length(&self) -> f64 {
        norm(minus(self.end, self.start))
    }

    /// Returns the position of the foot of `point` along the line, m from the start; not clamped to the line.
    #[must_use]
    pub fn along(&self, point: [f64; 3]) -> f64 {
        let direction = minus(self.end, self.start);
        dot(minus(point, self.start), direction) / self.length()
    }

    /// Returns the distance of a point from the line segment, m; NaN if any coordinate is NaN.
    #[must_use]
    pub fn distance(&self, point: [f64; 3]) -> f64 {
        let length = self.length();
        let along = self.along(point);
        // Written so that NaN propagates.
        let part = if along < 0.0 {
            0.0
        } else if along > length {
            1.0
        } else {
            along / length
        };
        let direction = minus(self.end, self.start);
        let foot = [0, 1, 2].map(|i| self.start[i] + part * direction[i]);
        norm(minus(point, foot))
    }
}

/// Checks that every point is within `tolerance` (m) of the line; fails without points or with a NaN point.
#[must_use]
pub fn on_the_line(
    what: &str,
    points: &[[f64; 3]],
    line: &LineSegment,
    tolerance: f64,
) -> MotionCheck {
    let mut worst = 0.0_f64;
    for point in points {
        let distance = line.distance(*point);
        if distance.is_nan() || distance > worst {
            worst = distance;
        }
        if worst.is_nan() {
            break;
        }
    }
    let holds = !points.is_empty() && worst <= tolerance;
    let found = format!("{} over {} points", metres(worst), points.len());
    MotionCheck::new(what, holds, format!("≤ {}", metres(tolerance)), found)
}

/// Distances along the line, one per cycle.
#[derive(Clone, Copy, Debug)]
pub struct DistanceTrack<'a> {
    /// Cycle of the first distance.
    pub first_cycle: u64,
    /// Distances, m, one per cycle.
    pub distances: &'a [f64],
    /// Limits of the motion (m, s).
    pub limits: PathLimits,
    /// Period, s.
    pub dt_s: f64,
}

impl DistanceTrack<'_> {
    /// Returns the distance in a cycle, m.
    #[must_use]
    pub fn at(&self, cycle: u64) -> Option<f64> {
        let index = usize::try_from(cycle.checked_sub(self.first_cycle)?).ok()?;
        self.distances.get(index).copied()
    }

    fn step(&self, cycle: u64) -> Option<f64> {
        Some(self.at(cycle)? - self.at(cycle.checked_sub(1)?)?)
    }

    /// Returns the first cycle with the final distance.
    #[must_use]
    pub fn rest_cycle(&self) -> Option<u64> {
        let last = self.distances.last()?;
        let moving = self.distances.iter().rposition(|distance| distance != last);
        Some(self.first_cycle + moving.map_or(0, |index| index as u64 + 1))
    }
}

/// Checks that velocity, acceleration and jerk, as finite differences of the set-points, are within the limits.
#[must_use]
pub fn within_limits(what: &str, track: &DistanceTrack<'_>) -> MotionCheck {
    let PathLimits {
        velocity,
        acceleration,
        jerk,
        ..
    } = track.limits;
    let mut differences = track.distances.to_vec();
    let (mut found, mut holds) = (Vec::new(), differences.len() > 3);
    for (order, (limit, unit)) in [(velocity, "v"), (acceleration, "a"), (jerk, "j")]
        .into_iter()
        .enumerate()
    {
        differences = differences
            .windows(2)
            .map(|pair| (pair[1] - pair[0]) / track.dt_s)
            .collect();
        let largest = differences
            .iter()
            .fold(0.0_f64, |most, value| nan_max(most, value.abs()));
        // Rounding of the distances, as amplified by differences of this order.
        let power = order as i32 + 1;
        let rounding = ROUNDING_M * 2.0_f64.powi(power) / track.dt_s.powi(power);
        holds &= largest <= limit * (1.0 + RELATIVE_TOLERANCE) + rounding;
        found.push(format!("{unit} {:.4}", largest / limit));
    }
    MotionCheck::new(
        what,
        holds,
        "v, a, j ≤ 1.0000 of their limits",
        found.join(", "),
    )
}

/// Checks a soft stop that was requested in cycle `asked` (`None`: never) at constant speed: it starts in that cycle or
/// the next, and takes the time predicted from the limits, ± 1 cycle.
#[must_use]
pub fn soft_stop(cause: &str, track: &DistanceTrack<'_>, asked: Option<u64>) -> Vec<MotionCheck> {
    let Some(asked) = asked else {
        let what = format!("soft stop begins after {cause}");
        return vec![MotionCheck::new(
            what,
            false,
            "within 1 cycle",
            format!("no {cause}"),
        )];
    };
    let started = stop_begins(track, asked);
    let begins = MotionCheck::new(
        format!("soft stop begins after {cause}"),
        started.is_some_and(|cycle| cycle == asked || cycle == asked + 1),
        "within 1 cycle",
        match started {
            Some(cycle) if cycle >= asked => {
                format!("cycle {cycle}, {cause} seen in {asked}")
            }
            Some(cycle) => format!("braked already in cycle {cycle}, {cause} in {asked}"),
            None => format!("no braking after cycle {asked}"),
        },
    );
    let rests = started.zip(track.rest_cycle()).and_then(|(started, rest)| {
        let speed = track.step(started - 1)? / track.dt_s;
        let predicted = stop_time(speed, 0.0, &track.limits) / track.dt_s;
        // Predicted: the first cycle at or after the end of the stop, counted from the last cycle before the stop.
        Some((predicted.ceil(), (rest + 1).checked_sub(started)? as f64))
    });
    let in_time = MotionCheck::new(
        "comes to rest in the predicted time",
        rests.is_some_and(|(predicted, found)| (predicted - found).abs() <= 1.0),
        rests.map_or_else(
            || "a stop".to_owned(),
            |(predicted, _)| format!("{predicted:.0} ± 1 cycles"),
        ),
        rests.map_or_else(
            || "none".to_owned(),
            |(_, found)| format!("{found:.0} cycles"),
        ),
    );
    let stopped = track.distances.last().copied().unwrap_or(f64::NAN);
    let on_the_way = MotionCheck::new(
        "comes to rest on the path, before its end",
        stopped > 0.0 && stopped < track.limits.length - SET_POINT_TOLERANCE_M,
        format!("between 0 and {:.4} m", track.limits.length),
        format!("{stopped:.4} m"),
    );
    vec![begins, in_time, on_the_way]
}

/// Returns the first cycle, starting shortly before `asked`, whose step is shorter than the previous one by half of
/// what the jerk limit allows in a cycle (half, because of rounding).
fn stop_begins(track: &DistanceTrack<'_>, asked: u64) -> Option<u64> {
    let slower = 0.5 * track.limits.jerk * track.dt_s.powi(3) / 6.0;
    let last = track.first_cycle + track.distances.len() as u64;
    (asked.saturating_sub(CYCLES_BEFORE_CAUSE)..last).find(|cycle| {
        let steps = track.step(*cycle).zip(track.step(cycle.wrapping_sub(1)));
        steps.is_some_and(|(now, before)| now < before - slower)
    })
}

/// Number of cycles before the cause that are searched for braking.
const CYCLES_BEFORE_CAUSE: u64 = 20;

/// One datagram to the robot: its set-point's position along the line, and an output bit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SentDatagram {
    /// Position along the line, m.
    pub along: f64,
    /// Output bit.
    pub on: bool,
}

/// Checks that the output becomes `on` exactly once, in the first datagram whose set-point has reached `along` (m): the
/// set-point of the cycle in which the net switched it. A driver that bridges a late executor also sends intermediate
/// points; then it is the first of those that is not before `along`.
#[must_use]
pub fn switches_with(what: &str, sent: &[SentDatagram], on: bool, along: f64) -> MotionCheck {
    let expected = format!("with the set-point at {along:.6} m");
    let changes: Vec<&[SentDatagram]> = sent
        .windows(2)
        .filter(|pair| pair[0].on != on && pair[1].on == on)
        .collect();
    let (holds, found) = match changes.as_slice() {
        [pair] => {
            let reached = along - WIRE_TOLERANCE_M;
            let found = format!(
                "at {:.6} m, before it at {:.6} m",
                pair[1].along, pair[0].along
            );
            (pair[0].along < reached && pair[1].along >= reached, found)
        }
        [] => (false, "never".to_owned()),
        many => (false, format!("{} times", many.len())),
    };
    MotionCheck::new(what, holds, expected, found)
}

/// Checks that the net switches in the first cycle whose set-point is beyond `position` (m). `pair` holds the distances
/// of the previous cycle and of that cycle.
#[must_use]
pub fn crosses(what: &str, position: f64, pair: Option<(f64, f64)>) -> MotionCheck {
    // A decimal position coincides with a set-point except for rounding.
    let rounding = 1e-12;
    let holds = pair.is_some_and(|(before, after)| {
        before <= position + rounding && after >= position - rounding
    });
    let found = pair.map_or_else(
        || "never".to_owned(),
        |(before, after)| format!("between {before:.6} and {after:.6} m"),
    );
    MotionCheck::new(what, holds, format!("at {position:.6} m"), found)
}

/// Checks that cycle numbers ascend by one.
#[must_use]
pub fn without_gaps(what: &str, cycles: &[u64]) -> MotionCheck {
    let gaps = cycles
        .windows(2)
        .filter(|pair| pair[1] != pair[0] + 1)
        .count();
    let holds = gaps == 0 && cycles.len() > 1;
    MotionCheck::new(
        what,
        holds,
        "no gap",
        format!(
            "{} in {}",
            Counted::of(gaps, "gap"),
            Counted::of(cycles.len(), "cycle")
        ),
    )
}

/// Formats a length in a suitable unit.
#[must_use]
pub fn metres(value: f64) -> String {
    match value.abs() {
        size if size.is_nan() => "null".to_owned(),
        size if size < 1e-6 => format!("{value:.1e} m"),
        size if size < 1.0 => format!("{:.3} mm", value * 1e3),
        _ => format!("{value:.3} m"),
    }
}

fn nan_max(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() {
        f64::NAN
    } else {
        a.max(b)
    }
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] - b[i])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests;
