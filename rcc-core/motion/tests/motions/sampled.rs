//! The joint path of a random motion as samples, and the tested timing along it, for comparison with other planners.

use rcc_testing::work::processor_time;

use super::*;

/// Approximate number of cycles for sampling a path.
const CYCLES: f64 = 4000.0;

/// Least distance between samples, as a fraction of a section from rest to rest.
const STEP: f64 = 1e-5;

/// A clock value and the joints there.
pub type PathSample = (f64, Joints);

/// Number of times at which a motion is stopped and paused, evenly distributed over it.
pub const HALTS: usize = 8;

/// A path with the tested timing.
pub struct Sampled {
    /// Number of joints of the arm.
    pub joints: usize,
    /// Velocity, acceleration and jerk limit of each joint, in rad and s.
    pub limits: [Joints; 3],
    /// s of the path and the joints there, for each section from rest to rest.
    pub path: Vec<Vec<PathSample>>,
    /// Clock value and joints in each cycle of the same sections, time-optimal.
    pub fastest: Vec<Vec<PathSample>>,
    /// Duration with the default profile and the time-optimal ones that keep and give their reserve, s.
    pub times_s: [f64; 3],
    /// Duration with the second of them and a jerk limit that is `jerk` times as high, s.
    pub loose_s: f64,
    /// With each of these profiles: the time to rest after a stop and after a pause, at [`HALTS`] times of the motion, s.
    pub halts_s: [[Vec<f64>; 2]; 3],
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
        let run = run(motion.clone(), SpeedOverride::RUN)?;
        Some((duration_s(&run, drawn.dt_s), run, motion))
    };
    let [keep, give] = [StopReserve::Keep, StopReserve::Give].map(SpeedProfile::TimeOptimal);
    let (adaptive_s, _, adapted) = run(robot, SpeedProfile::Adaptive)?;
    let (fastest_s, fastest, kept) = run(robot, keep)?;
    let (give_s, _, given) = run(robot, give)?;
    let loose_s = run(&loose, keep)?.0;
    let halts_s = |motion: &MotionSet, duration_s: f64| {
        let cycles = (duration_s / drawn.dt_s) as usize;
        let times = || (0..HALTS).map(|number| cycles * (2 * number + 1) / (2 * HALTS));
        let durations = |halt| {
            let rest = |after| cycles_to_rest(motion.clone(), after, halt);
            let durations = times().map(|after| Some(rest(after)? as f64 * drawn.dt_s));
            durations.collect::<Option<Vec<f64>>>()
        };
        Some([
            durations(SpeedOverride::STOP)?,
            durations(SpeedOverride::PAUSE)?,
        ])
    };
    let halts_s = [
        halts_s(&adapted, adaptive_s)?,
        halts_s(&kept, fastest_s)?,
        halts_s(&given, give_s)?,
    ];
    let (uniform_s, _, uniform) = run(robot, SpeedProfile::Uniform)?;
    let slowly = SpeedOverride {
        speed: (uniform_s / drawn.dt_s / CYCLES).min(1.0),
        ..SpeedOverride::RUN
    };
    // The uniform profile is slower in bends, which gives more samples there.
    let path = self::run(uniform, slowly)?;
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
        times_s: [adaptive_s, fastest_s, give_s],
        loose_s,
        halts_s,
    })
}

/// Plans the motion of this seed; returns the processor time that this took and the duration of the motion, s. `None` if it
/// cannot be built.
#[must_use]
pub fn planned(
    kind: MotionKind,
    robot: &TestRobot,
    seed: u64,
    pace: SpeedProfile,
) -> Option<[f64; 2]> {
    let (drawn, mut random) = unbound(kind, robot, seed)?;
    let legs = legs(kind, &drawn, &mut random);
    let begun = processor_time();
    let motion = build(robot, (&drawn, &legs), pace)?;
    let planning_s = (processor_time() - begun).as_secs_f64();
    let run = run(motion, SpeedOverride::RUN)?;
    Some([planning_s, duration_s(&run, drawn.dt_s)])
}

/// The durations of the motion of this seed with `stops: keep` and with `stops: give`, and the processor time to plan each, s;
/// `None` if it cannot be built. Both are sums of the durations of sections, not rounded to cycles.
#[must_use]
pub fn kept_and_given(kind: MotionKind, robot: &TestRobot, seed: u64) -> Option<[[f64; 2]; 2]> {
    let (drawn, mut random) = unbound(kind, robot, seed)?;
    let legs = legs(kind, &drawn, &mut random);
    let (mut durations_s, mut planning_s) = ([0.0; 2], [0.0; 2]);
    let reserves = [StopReserve::Keep, StopReserve::Give];
    for (index, reserve) in reserves.into_iter().enumerate() {
        let begun = processor_time();
        let motion = build(robot, (&drawn, &legs), SpeedProfile::TimeOptimal(reserve))?;
        planning_s[index] = (processor_time() - begun).as_secs_f64();
        let sections = motion.sections();
        durations_s[index] = sections.map(|(_, section)| section.duration_s).sum();
    }
    Some([durations_s, planning_s])
}

/// Duration of a motion, s.
fn duration_s(run: &[Vec<PathSample>], dt_s: f64) -> f64 {
    let cycles: usize = run.iter().map(|part| part.len() - 1).sum();
    cycles as f64 * dt_s
}

/// The number of cycles until the motion rests if it is halted after some cycles.
fn cycles_to_rest(mut motion: MotionSet, after: usize, halt: SpeedOverride) -> Option<usize> {
    for _ in 0..after {
        motion.step(0, SpeedOverride::RUN)?;
    }
    let mut cycles = 0;
    loop {
        let state = motion.step(0, halt)?;
        if state.path.done || state.path.velocity == 0.0 {
            return Some(cycles);
        }
        cycles += 1;
    }
}

/// Every cycle of a motion, per section from rest to rest: the first cycle is at the start, and each further section
/// begins with the last sample of the previous one.
fn run(mut motion: MotionSet, speed_override: SpeedOverride) -> Option<Vec<Vec<PathSample>>> {
    let (mut parts, mut part) = (Vec::new(), Vec::new());
    loop {
        let MotionState { path, joints, .. } = motion.step(0, speed_override)?;
        part.push((path.s, joints));
        if path.velocity == 0.0 && path.s > part.first().map_or(0.0, |(s, _): &PathSample| *s) {
            parts.push(core::mem::replace(&mut part, vec![(path.s, joints)]));
        }
        if path.done {
            return Some(parts);
        }
    }
}

/// Removes samples that are too close to others, as they are at both ends.
fn apart(samples: Vec<PathSample>) -> Vec<PathSample> {
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
