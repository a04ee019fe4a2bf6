//! Random motions of each kind and robot under random speed overrides, checked from outside: by differences of the
//! set-points, cycle by cycle, and by independently computed geometry. Used by the test `random_motions` and by the
//! example of that name, which runs more.
#![allow(dead_code)] // Each of those who use it uses a part of it.

use rcc_core::frame::DeviceModel;
use rcc_core::kinematics::Arm;
use rcc_core::message::Joints;
use rcc_core::path::{
    ArcOrientation, ElbowMotion, Leg, MotionBuilder, MotionLimits, MotionState, Motions,
    PathRequest, PathSegment, SpeedOverride, SpeedProfile, StopReserve,
};
use rcc_core::pose::Pose;
use rcc_core::vector::{add, cross, dot, norm, scale, subtract};
use rcc_motion::{MotionSet, MotionSetBuilder};
use rcc_testing::{Random, arms};

mod judge;
mod random;
pub mod sampled;

pub use judge::WorstCase;
use judge::{ExpectedPath, MotionJudge, ReferenceResolution, ReferenceRun};
use random::SplitMix64;

/// Most cycles of a motion; the slowest ones take a tenth of it.
const CYCLES_MAX: usize = 400_000;

/// Resolutions of the references that are tried, one after the other.
const RESOLUTIONS: [ReferenceResolution; 4] = [
    ReferenceResolution {
        speed: 0.25,
        step: 2e-5,
    },
    ReferenceResolution {
        speed: 0.06,
        step: 5e-6,
    },
    ReferenceResolution {
        speed: 0.01,
        step: 1e-6,
    },
    ReferenceResolution {
        speed: 0.003,
        step: 3e-7,
    },
];

/// A kind of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionKind {
    /// A line.
    Line,
    /// An arc of a circle.
    Circle,
    /// A curve through poses.
    Spline,
    /// A line in joint space.
    PointToPoint,
    /// Several legs of all kinds, with and without blends.
    Sequence,
    /// A time-optimal sequence.
    Fastest,
    /// A sequence in which the arm angle turns.
    Elbow,
    /// A time-optimal sequence that reserves hardly anything for stops.
    FastestGive,
}

/// All kinds.
pub const KINDS: [MotionKind; 8] = [
    MotionKind::Line,
    MotionKind::Circle,
    MotionKind::Spline,
    MotionKind::PointToPoint,
    MotionKind::Sequence,
    MotionKind::Fastest,
    MotionKind::Elbow,
    MotionKind::FastestGive,
];

/// The kinds that are built with each profile of speed and compared.
pub const COMPARED: [MotionKind; 4] = [
    MotionKind::Line,
    MotionKind::Circle,
    MotionKind::Spline,
    MotionKind::Sequence,
];

/// An arm, its start, and its name.
pub struct TestRobot {
    /// Name for reports.
    pub name: &'static str,
    model: DeviceModel,
    home: Joints,
}

/// The robots: two of seven joints and one of six in closed form, one of six and one of seven with numeric inverse.
#[must_use]
pub fn robots() -> [TestRobot; 5] {
    let seven = arms::radians([20.0, 30.0, -10.0, -90.0, 5.0, 60.0, 20.0]);
    [
        TestRobot {
            name: "LWR 4+",
            model: arms::lwr(),
            home: seven,
        },
        TestRobot {
            name: "iiwa 14",
            model: arms::model(
                Arm::Srs(arms::IIWA),
                arms::SEVEN_JOINTS,
                [85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0],
                [420.0, 420.0, 500.0, 370.0, 650.0, 670.0, 670.0],
            ),
            home: seven,
        },
        TestRobot {
            name: "KR 6 R900-2",
            model: arms::model(
                Arm::OrthoParallel(arms::KR6),
                arms::SIX_JOINTS,
                [360.0, 300.0, 360.0, 450.0, 450.0, 540.0],
                [1300.0, 370.0, 1390.0, 7000.0, 6800.0, 13500.0],
            ),
            home: arms::radians([10.0, -80.0, 100.0, 10.0, 60.0, -20.0]),
        },
        TestRobot {
            name: "UR5e",
            model: arms::ur5e_model(),
            home: arms::UR_HOLD,
        },
        TestRobot {
            name: "Panda",
            model: arms::panda_model(),
            home: arms::PANDA_HOLD,
        },
    ]
}

/// Result of a random motion.
#[derive(Debug)]
pub enum RunOutcome {
    /// Refused when it was built.
    Refused,
    /// It ran; how close it came to its limits.
    Ran(WorstCase),
    /// It violated a rule.
    Broken(String),
}

/// Numbers of random motions by outcome, and the worst of those that ran.
#[derive(Debug, Default)]
pub struct Tally {
    pub ran: u64,
    pub refused: u64,
    pub broken: u64,
    pub worst: WorstCase,
}

impl Tally {
    /// Counts an outcome; returns the rule that a broken motion violated.
    pub fn count(&mut self, outcome: RunOutcome) -> Option<String> {
        match outcome {
            RunOutcome::Ran(motion) => {
                self.ran += 1;
                self.worst.and(motion);
            }
            RunOutcome::Refused => self.refused += 1,
            RunOutcome::Broken(fault) => {
                self.broken += 1;
                return Some(fault);
            }
        }
        None
    }
}

/// The random parameters of a motion.
struct DrawnMotion {
    start: Joints,
    from: Pose,
    scale: f64,
    /// Arm angle at the start, rad.
    arm_angle: f64,
    /// Targets of legs, and points of splines.
    poses: Vec<Pose>,
    joints: Vec<Joints>,
    /// Limits of the flange, if it has any.
    line: MotionLimits,
    turn: MotionLimits,
    dt_s: f64,
}

/// Profiles of the kinds that are not time-optimal.
pub const PACES: [SpeedProfile; 2] = [SpeedProfile::Uniform, SpeedProfile::Adaptive];

/// All kinds with their profiles.
pub fn kinds_and_paces() -> impl Iterator<Item = (MotionKind, SpeedProfile)> {
    KINDS.into_iter().flat_map(|kind| match kind {
        MotionKind::Fastest => vec![(kind, SpeedProfile::TimeOptimal(StopReserve::Keep))],
        MotionKind::FastestGive => vec![(kind, SpeedProfile::TimeOptimal(StopReserve::Give))],
        _ => PACES.map(|pace| (kind, pace)).to_vec(),
    })
}

/// Builds, runs and checks the motion of this seed.
#[must_use]
pub fn case((kind, pace): (MotionKind, SpeedProfile), robot: &TestRobot, seed: u64) -> RunOutcome {
    let mut random = SplitMix64(seed ^ (kind as u64) << 60);
    let Some(drawn) = draw(robot, &mut random) else {
        return RunOutcome::Refused;
    };
    let legs = legs(kind, &drawn, &mut random);
    let Some(motion) = build(robot, (&drawn, &legs), pace) else {
        return RunOutcome::Refused;
    };
    let judge = |geometry| MotionJudge::new(&robot.model, (&drawn, &legs), geometry);
    let geometry = match (kind, &legs[0].segment) {
        (MotionKind::Line, PathSegment::Line { to }) => ExpectedPath::Line(drawn.from, *to),
        (
            MotionKind::Circle,
            PathSegment::Circle {
                via,
                to,
                orientation,
                ..
            },
        ) => ExpectedPath::Circle(drawn.from, *via, *to, *orientation),
        (MotionKind::PointToPoint, PathSegment::Joints { to }) => {
            ExpectedPath::Joints(drawn.start, *to)
        }
        _ => {
            let mut outcome = RunOutcome::Refused;
            // A curve so sharp that the polynomial of the first reference deviates needs a finer reference.
            for resolution in RESOLUTIONS {
                let reference =
                    ReferenceRun::run(motion.clone(), resolution.in_cycles_of(drawn.dt_s));
                let Some(reference) = reference else {
                    return match crawls(motion.clone()) {
                        true => RunOutcome::Refused,
                        false => RunOutcome::Broken("the reference run did not end".into()),
                    };
                };
                let judge = judge(ExpectedPath::ReferenceRun(Box::new(reference)));
                outcome = run(motion.clone(), judge, &mut random.clone());
                if !matches!(outcome, RunOutcome::Broken(_)) {
                    break;
                }
            }
            return outcome;
        }
    };
    run(motion, judge(geometry), &mut random)
}

/// Returns true for a motion that grazes a singular position at some micrometres per second and takes too long to test.
fn crawls(mut motion: MotionSet) -> bool {
    let mut states = (0..CYCLES_MAX).map(|_| motion.step(0, SpeedOverride::RUN));
    states.all(|state| state.is_some_and(|state| !state.path.done))
}

/// Durations of the motion of this seed with the uniform, the adaptive and the time-optimal profile, s, and the time to
/// build each, s; `None` if it cannot be built.
#[must_use]
pub fn compared(kind: MotionKind, robot: &TestRobot, seed: u64) -> Option<([f64; 3], [f64; 3])> {
    let (drawn, mut random) = unbound(kind, robot, seed)?;
    let legs = legs(kind, &drawn, &mut random);
    let (mut times_s, mut built_s) = ([0.0; 3], [0.0; 3]);
    let paces = [
        SpeedProfile::Uniform,
        SpeedProfile::Adaptive,
        SpeedProfile::TimeOptimal(StopReserve::Keep),
    ];
    for (index, pace) in paces.into_iter().enumerate() {
        let begin = std::time::Instant::now();
        let mut motion = build(robot, (&drawn, &legs), pace)?;
        built_s[index] = begin.elapsed().as_secs_f64();
        while !motion.step(0, SpeedOverride::RUN)?.path.done {
            times_s[index] += drawn.dt_s;
        }
    }
    Some((times_s, built_s))
}

/// Random parameters limited by the joints alone, in cycles of 1 ms.
fn unbound(kind: MotionKind, robot: &TestRobot, seed: u64) -> Option<(DrawnMotion, SplitMix64)> {
    let mut random = SplitMix64(seed ^ (kind as u64) << 60);
    let mut drawn = draw(robot, &mut random)?;
    (drawn.line, drawn.turn, drawn.dt_s) = (MotionLimits::NONE, MotionLimits::NONE, 1e-3);
    Some((drawn, random))
}

/// Builds the motion of legs.
fn build(
    robot: &TestRobot,
    (drawn, legs): (&DrawnMotion, &[Leg<'_>]),
    pace: SpeedProfile,
) -> Option<MotionSet> {
    let (models, holds) = ([robot.model], [Some(drawn.start)]);
    let mut builder = MotionSetBuilder::new(&models, &holds, drawn.dt_s, 1);
    let request = PathRequest {
        device: 0,
        from: None,
        legs,
        pace,
    };
    builder.path(0, &request).ok()?;
    builder.finish().ok()
}

/// Draws the start and the targets; `None` if the start is not valid.
fn draw(robot: &TestRobot, random: &mut SplitMix64) -> Option<DrawnMotion> {
    let arm = robot.model.arm?;
    let limits = &robot.model.limits;
    let mut near = |home: &Joints, by: f64| {
        let mut joints = *home;
        for (index, joint) in joints.iter_mut().enumerate().take(limits.joints) {
            *joint += random.uniform(-by, by);
            if *joint <= limits.lower[index] + 0.01 || *joint >= limits.upper[index] - 0.01 {
                return None;
            }
        }
        Some(joints)
    };
    let start = near(&robot.home, 0.5)?;
    // NaN where the arm has no joint.
    let mut joints = (0..5)
        .map(|_| near(&start, 0.5))
        .collect::<Option<Vec<_>>>()?;
    for target in &mut joints {
        target[limits.joints..].fill(f64::NAN);
    }
    let from = arm.forward(&start);
    let reach = random.log_uniform(0.005, 0.2);
    let poses = (0..20).map(|_| {
        let mut around = |by: f64| random.uniform(-by, by);
        let turn = [around(0.25), around(0.25), around(0.25)];
        let way = [around(reach), around(reach), around(reach)];
        from.compose(&Pose::from_xyz_rpy(way, turn))
    });
    let poses = poses.collect();
    let given = random.unit() < 0.3;
    let mut of = |low: f64, high: f64| {
        let velocity = random.log_uniform(low, high);
        let acceleration = velocity * random.log_uniform(2.0, 20.0);
        MotionLimits {
            velocity,
            acceleration,
            jerk: acceleration * random.log_uniform(5.0, 50.0),
        }
    };
    let (line, turn) = if given {
        (of(0.02, 0.2), of(0.2, 1.0))
    } else {
        (MotionLimits::NONE, MotionLimits::NONE)
    };
    Some(DrawnMotion {
        start,
        from,
        scale: random.log_uniform(0.2, 1.0),
        arm_angle: arm.configuration(&start).arm_angle,
        poses,
        joints,
        line,
        turn,
        dt_s: [1e-3, 4e-3, 4e-3][random.below(3)],
    })
}

/// The legs of a kind.
fn legs<'a>(kind: MotionKind, drawn: &'a DrawnMotion, random: &mut SplitMix64) -> Vec<Leg<'a>> {
    let leg = |segment, blend| Leg {
        line: drawn.line,
        turn: drawn.turn,
        scale: drawn.scale,
        blend,
        ..Leg::new(segment)
    };
    let circle = |index: usize, orientation| PathSegment::Circle {
        via: drawn.poses[index].position,
        to: drawn.poses[index + 1],
        orientation,
        angle: None,
    };
    let orientation = [
        ArcOrientation::Even,
        ArcOrientation::Constant,
        ArcOrientation::Path,
    ][random.below(3)];
    let through = 2 + random.below(4);
    match kind {
        MotionKind::Line => vec![leg(PathSegment::Line { to: drawn.poses[0] }, 0.0)],
        MotionKind::Circle => vec![leg(circle(0, orientation), 0.0)],
        MotionKind::Spline => {
            let through = &drawn.poses[..through];
            vec![leg(PathSegment::Spline { through }, 0.0)]
        }
        MotionKind::PointToPoint => vec![leg(
            PathSegment::Joints {
                to: drawn.joints[0],
            },
            0.0,
        )],
        MotionKind::Elbow => {
            let mut legs = legs(MotionKind::Sequence, drawn, random);
            for leg in &mut legs {
                let of_joints = matches!(leg.segment, PathSegment::Joints { .. });
                leg.elbow = match random.below(3) {
                    _ if of_joints => ElbowMotion::Stays,
                    0 => ElbowMotion::Middle,
                    1 => ElbowMotion::To(drawn.arm_angle + random.uniform(-0.8, 0.8)),
                    _ => ElbowMotion::Stays,
                };
            }
            legs
        }
        MotionKind::Sequence | MotionKind::Fastest | MotionKind::FastestGive => (0..2 + random
            .below(4))
            .map(|index| {
                let segment = match random.below(6) {
                    0 => circle(2 * index, ArcOrientation::Even),
                    1 => PathSegment::Spline {
                        through: &drawn.poses[2 * index..2 * index + 2],
                    },
                    2 => PathSegment::Joints {
                        to: drawn.joints[index.min(4)],
                    },
                    _ => PathSegment::Line {
                        to: drawn.poses[2 * index],
                    },
                };
                let blend = random.log_uniform(0.001, 0.05);
                leg(segment, if random.unit() < 0.7 { blend } else { 0.0 })
            })
            .collect(),
    }
}

/// Runs a motion under random overrides until it is done, and three cycles more.
fn run(mut motion: MotionSet, mut judge: MotionJudge, random: &mut SplitMix64) -> RunOutcome {
    let mut speed_override = SpeedOverride::RUN;
    let often = random.log_uniform(2.0, 500.0);
    let calm_at = random.below(1500);
    let stop_at = random.below(4000);
    for cycle in 0..CYCLES_MAX {
        if cycle >= calm_at {
            speed_override = SpeedOverride::RUN;
        } else if random.unit() * often < 1.0 {
            speed_override = random.speed_override();
        }
        let stop = cycle == stop_at;
        let Some(state) = motion.step(
            0,
            SpeedOverride {
                stop,
                ..speed_override
            },
        ) else {
            return RunOutcome::Broken("no motion with index 0".into());
        };
        if let Err(fault) = judge.see(&state) {
            return RunOutcome::Broken(format!("cycle {cycle}: {fault}"));
        }
        if state.path.done {
            for _ in 0..3 {
                let again = motion.step(0, random.speed_override());
                if again.is_none_or(|again| !again.path.done || again.path.s != state.path.s) {
                    return RunOutcome::Broken(format!("cycle {cycle}: done, but then not done"));
                }
            }
            return match judge.at_end(&state, cycle >= stop_at) {
                Ok(worst) => RunOutcome::Ran(worst),
                Err(fault) => RunOutcome::Broken(format!("cycle {cycle}: {fault}")),
            };
        }
    }
    RunOutcome::Broken("did not end".into())
}
