//! `start: continue`: what follows begins from position, velocity and acceleration of what was stopped.

use rcc_core::axis::AXIS_WORDS;
use rcc_core::message::JOINTS_MAX;
use rcc_core::pose::Pose;
use rcc_testing::{Random, Rng};

use super::*;
use crate::common::model;

pub(super) const HOLDS: i64 = 0;
pub(super) const CONTINUES: i64 = 1;

/// Slots that tests look at.
pub(super) struct GoalNet {
    pub(super) plan: PlanData,
    pub(super) over: u32,
}

/// A net of `JointGoal` that moves all joints by `by` rad from where the arm is held in these tests; its Bool slot
/// `over` is true after `cycles`.
pub(super) fn goal_net(by: f64, cycles: u32, start: i64) -> GoalNet {
    let mut plan = TestPlan::new();
    let (requested, stop) = (plan.bool(2), plan.bool(0));
    let [done, accepted, over] = [(); 3].map(|()| plan.bool(2));
    let goal: Vec<f64> = HOLD[..7].iter().map(|joint| joint + by).collect();
    let goal = plan.reals(&goal);
    let one = plan.reals(&[1.0]);
    let [position, velocity] = [(); 2].map(|()| plan.reals(&[f64::NAN; 7]));
    let null = plan.reals(&[f64::NAN]);
    let state = plan.reals(&[0.0; JOINTS_MAX * AXIS_WORDS]);
    let time = plan.reals(&[f64::NAN]);
    let end = plan.reals(&[f64::from(cycles) * 1e-3]);
    plan.data.ints.extend([start, 0]);
    let synchronize = plan.data.ints.len() as u32 - 1;
    let start = synchronize - 1;
    plan.add("Cancel", &[requested]);
    plan.add("Time", &[time]);
    plan.add("Greater", &[time, end, over]);
    let outputs = [position, velocity, done, accepted];
    let parameters = [0, one, null, null, null, start, synchronize];
    plan.add(
        "JointGoal",
        &[&[goal, one, stop][..], &outputs, &parameters, &[state, 7]].concat(),
    );
    plan.add("JointPositionCommand", &[position, 0, 7]);
    plan.add("Termination", &[requested]);
    GoalNet {
        plan: plan.data,
        over,
    }
}

/// A net of `PoseGoal` that moves the flange by `by` (m, axes of the flange) from where the arm is held in these tests; its
/// Bool slot `over` is true after `cycles`.
pub(super) fn flange_net(by: [f64; 3], cycles: u32, start: i64) -> GoalNet {
    let mut plan = TestPlan::new();
    let (requested, stop) = (plan.bool(2), plan.bool(0));
    let [done, over] = [(); 2].map(|()| plan.bool(2));
    let held = model().arm.expect("an arm").forward(&HOLD);
    let goal = held.compose(&Pose::from_xyz_rpy(by, [0.0; 3]));
    let goal = plan.reals(&goal.to_slots());
    let [speed, pose, joints] =
        [&[f64::NAN; 1][..], &[f64::NAN; 7], &[f64::NAN; 7]].map(|values| plan.reals(values));
    let one = plan.reals(&[1.0]);
    let limits = [0.3, 2.0, 20.0, 1.0, 4.0, 40.0].map(|limit| plan.reals(&[limit]));
    let states = [6 * AXIS_WORDS + 16, 10].map(|count| plan.reals(&vec![f64::NAN; count]));
    let time = plan.reals(&[f64::NAN]);
    let end = plan.reals(&[f64::from(cycles) * 1e-3]);
    let first = plan.data.ints.len() as u32;
    plan.data.ints.extend([0, 0, start]);
    let [reason, joint, start] = [first, first + 1, first + 2];
    plan.add("Cancel", &[requested]);
    plan.add("Time", &[time]);
    plan.add("Greater", &[time, end, over]);
    let ports = [goal, one, stop, pose, done, speed, 0];
    plan.add(
        "PoseGoal",
        &[&ports[..], &limits, &[start, states[0]]].concat(),
    );
    let operands = [pose, joints, reason, joint, 0, start, states[1], 7];
    plan.add("InverseKinematics", &operands);
    plan.add("JointPositionCommand", &[joints, 0, 7]);
    plan.add("Termination", &[requested]);
    GoalNet {
        plan: plan.data,
        over,
    }
}

/// Compares velocity and acceleration of every set-point with the limits, and jerk with what differences allow.
struct Watched {
    last: Option<[f64; 7]>,
    velocity: Option<[f64; 7]>,
    steepest: f64,
}

impl Watched {
    fn see(&mut self, fixture: &EngineFixture) {
        let told = fixture.told();
        let limits = &fixture.models[0].limits;
        let now: [f64; 7] = std::array::from_fn(|joint| told.position[joint]);
        if let Some(last) = self.last {
            let velocity: [f64; 7] = std::array::from_fn(|joint| (now[joint] - last[joint]) / 1e-3);
            for (joint, velocity) in velocity.iter().enumerate() {
                let limit = limits.velocity_max[joint] * (1.0 + 1e-9);
                assert!(velocity.abs() <= limit, "joint {joint}");
            }
            if let Some(before) = self.velocity {
                for joint in 0..7 {
                    let acceleration = (velocity[joint] - before[joint]) / 1e-3;
                    let limit = limits.acceleration_max[joint] * (1.0 + 1e-6) + 1e-6;
                    assert!(acceleration.abs() <= limit, "joint {joint}: {acceleration}");
                    self.steepest = self.steepest.max(acceleration.abs());
                }
            }
            self.velocity = Some(velocity);
        }
        self.last = Some(now);
    }
}

/// Goals of hand-overs around the place where the arm is held: by joints, or by the flange with the same arm angle.
#[derive(Clone, Copy, PartialEq)]
enum Goals {
    Joints,
    Flange,
}

impl Goals {
    fn net(self, random: &mut Rng, cycles: u32, start: i64) -> GoalNet {
        match self {
            Goals::Joints => goal_net(random.uniform(-0.4, 0.4), cycles, start),
            Goals::Flange => {
                let by = std::array::from_fn(|_| random.uniform(-0.1, 0.1));
                flange_net(by, cycles, start)
            }
        }
    }
}

/// Hands the arm over `times` times in flight; returns the steepest acceleration of a joint.
fn hand_over(goals: Goals, times: usize) -> f64 {
    let mut random = Rng::with_seed(21);
    let mut fixture = EngineFixture::new();
    let first = goals.net(&mut random, 30, HOLDS);
    let mut over = first.over;
    let mut old = fixture.load(first.plan);
    cycle_of(fixture.start(old));
    let owner = fixture.told().owner;
    let mut watched = Watched {
        last: None,
        velocity: None,
        steepest: 0.0,
    };
    watched.see(&fixture);
    for number in 0..times {
        let cycles = random.uniform(3.0, 60.0) as u32;
        let next = goals.net(&mut random, cycles, CONTINUES);
        // Loading takes two cycles in which the old net moves on.
        let net = fixture.build(next.plan).expect("a net");
        let ticket = 0;
        let id = old + 1;
        fixture
            .ends
            .requests
            .push(EngineRequest::Reserve { ticket })
            .expect("room");
        fixture
            .ends
            .requests
            .push(EngineRequest::Install { ticket, id, net })
            .expect("room");
        let value = RuleTerm::Value {
            command: old,
            slot: over,
        };
        let rules = vec![rule(&[value], &[old], &[], &[id])];
        fixture.order(|ticket| EngineRequest::InstallRules { ticket, rules });
        for waited in 0.. {
            fixture.step();
            watched.see(&fixture);
            let told = fixture.told();
            assert_eq!((told.has_position, told.owner), (1, owner), "{number}");
            if fixture.state(id) == CommandState::Running {
                break;
            }
            assert!(waited < 100, "{number}: {:?}", listed(&mut fixture).last());
        }
        let (left, began) = (fixture.entry(old), fixture.entry(id));
        assert_eq!(left.ended_cycle + 1, began.started_cycle);
        fixture.order(|ticket| EngineRequest::Unload { ticket, id: old });
        fixture.step();
        watched.see(&fixture);
        while fixture.ends.replies.pop().is_ok() {}
        (old, over) = (id, next.over);
    }
    watched.steepest
}

#[test]
fn a_thousand_hand_overs_in_flight_stay_within_the_limits() {
    let steepest = hand_over(Goals::Joints, 1000);
    assert!(steepest > 1.0, "it never really moved");
}

#[test]
fn a_thousand_hand_overs_of_a_flange_in_flight_stay_within_the_limits() {
    let steepest = hand_over(Goals::Flange, 1000);
    assert!(steepest > 1.0, "it never really moved");
}

#[test]
fn a_net_that_does_not_continue_is_refused_in_flight() {
    let mut fixture = EngineFixture::new();
    let first = goal_net(0.2, 100, HOLDS);
    let old = fixture.load(first.plan);
    let new = fixture.load(goal_net(-0.2, 100, HOLDS).plan);
    let value = RuleTerm::Value {
        command: old,
        slot: first.over,
    };
    let (id, _) = install(&mut fixture, &[rule(&[value], &[old], &[], &[new])]);
    cycle_of(fixture.start(old));
    fixture.steps(200);
    let refused = status(&mut fixture, id);
    assert!(
        matches!(refused.refusal, Some((_, Refusal::Continuation { .. }))),
        "{refused:?}"
    );
    assert_eq!(fixture.state(old), CommandState::Running);
}

#[test]
fn from_rest_it_begins_where_the_arm_is_held_now_and_not_where_it_was_at_load() {
    for start in [HOLDS, CONTINUES] {
        let mut fixture = EngineFixture::new();
        let net = fixture.load(goal_net(0.1, 100, start).plan);
        fixture.driver.measurement.hold[2] += 0.05;
        fixture.driver.measurement.position = fixture.driver.measurement.hold;
        let (id, cycle) = install(&mut fixture, &[rule(&[RuleTerm::True], &[], &[], &[net])]);
        let status = status(&mut fixture, id);
        match start {
            HOLDS => assert_eq!(status.state, RuleState::Refused),
            _ => assert_eq!((status.state, status.cycle), (RuleState::Fired, cycle)),
        }
    }
}
