//! The joint path of a random motion as samples, with how it is gone along: for others who go along the same path.

use super::*;

/// Cycles in which a path is gone along once, about.
const CYCLES: f64 = 4000.0;

/// Of a path from rest to rest, the least way from one sample to the next.
const STEP: f64 = 1e-5;

/// What a clock has counted, and the joints there.
pub type Sample = (f64, Joints);

/// A path and how ours goes along it.
pub struct Sampled {
    /// Joints of the arm.
    pub joints: usize,
    /// Velocity, acceleration and jerk of each joint that were kept, rad and s.
    pub limits: [Joints; 3],
    /// s of the path and the joints there, for each part from rest to rest.
    pub path: Vec<Vec<Sample>>,
    /// What its clock has counted and the joints in each cycle of the same parts, as fast as can be.
    pub fastest: Vec<Vec<Sample>>,
    /// Evenly and as fast as can be, s.
    pub times_s: [f64; 2],
    /// The same with a jerk limit that is as many times as high as was asked for, s.
    pub loose_s: [f64; 2],
}

/// The motion of this seed, also with a jerk limit that is `jerk` times as high; `None` if it cannot be built.
#[must_use]
pub fn sampled(kind: MotionKind, robot: &TestRobot, seed: u64, jerk: f64) -> Option<Sampled> {
    let (drawn, mut random) = unbound(kind, robot, seed)?;
    let legs = legs(kind, &drawn, &mut random);
    let mut loose = TestRobot { ..*robot };
    for limit in &mut loose.model.limits.jerk_max {
        *limit *= jerk;
    }
    let run = |robot: &TestRobot, pace| {
        let motion = build(robot, (&drawn, &legs), pace)?;
        let run = run(motion, SpeedOverride::RUN)?;
        let cycles = run.iter().map(|part| part.len() - 1).sum::<usize>();
        Some((cycles as f64 * drawn.dt_s, run))
    };
    let (even_s, _) = run(robot, Pace::Even)?;
    let (fastest_s, fastest) = run(robot, Pace::Fastest)?;
    let loose_s = [run(&loose, Pace::Even)?.0, run(&loose, Pace::Fastest)?.0];
    let slowly = SpeedOverride {
        speed: (even_s / drawn.dt_s / CYCLES).min(1.0),
        ..SpeedOverride::RUN
    };
    // Slower where it is bent, as the pace is even.
    let path = build(robot, (&drawn, &legs), Pace::Even)?;
    let path = self::run(path, slowly)?;
    let limits = &robot.model.limits;
    let rows = [
        limits.velocity_max,
        limits.acceleration_max,
        limits.jerk_max,
    ];
    Some(Sampled {
        joints: limits.joints,
        limits: rows.map(|row| row.map(|limit| limit * drawn.scale)),
        path: path.into_iter().map(apart).collect(),
        fastest,
        times_s: [even_s, fastest_s],
        loose_s,
    })
}

/// Every cycle of a motion, for each part from rest to rest: the first cycle is at the start, and the first sample of each
/// further part is the last one before it.
fn run(mut motion: MotionSet, drive: SpeedOverride) -> Option<Vec<Vec<Sample>>> {
    let (mut parts, mut part) = (Vec::new(), Vec::new());
    loop {
        let MotionState { path, joints, .. } = motion.step(0, drive)?;
        part.push((path.s, joints));
        if path.velocity == 0.0 && path.s > part.first().map_or(0.0, |(s, _): &Sample| *s) {
            parts.push(core::mem::replace(&mut part, vec![(path.s, joints)]));
        }
        if path.done {
            return Some(parts);
        }
    }
}

/// Without the samples that are next to others, as they are at both ends.
fn apart(samples: Vec<Sample>) -> Vec<Sample> {
    let (Some(first), Some(last)) = (samples.first().copied(), samples.last().copied()) else {
        return samples;
    };
    let least = STEP * (last.0 - first.0);
    let mut kept = vec![first];
    let mut before = first.0;
    for sample in samples {
        if sample.0 - before > least && last.0 - sample.0 > least {
            before = sample.0;
            kept.push(sample);
        }
    }
    kept.push(last);
    kept
}
