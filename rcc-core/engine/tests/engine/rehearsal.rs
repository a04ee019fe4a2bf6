//! Rehearsal: nets are run in virtual time before they command an arm, and prepared again for where the arm rests at
//! START.

use crate::common::{
    EngineFixture, HOLD, TestPlan, drift_net, input_net, line_net, model, motion_net, output_net,
};
use rcc_core::axis::AXIS_WORDS;
use rcc_core::frame::{DeviceInput, DeviceModel, PrepareFault};
use rcc_core::kinematics::SingularityKind;
use rcc_core::message::{CommandState, EndReason};
use rcc_core::path::MotionFault;
use rcc_core::workspace::Workspace;
use rcc_engine::net::Net;
use rcc_engine::queue::EngineRequest;
use rcc_engine::rehearsal::{RehearsalScene, TIME_MAX_S, rehearse};
use rcc_protocol::control::{Answer, PlanData, Refusal};
use rcc_protocol::rehearsal::{
    PredictedViolation, RehearsalEnd, RehearsalReport, RehearsalRule, SlowerMotion,
};

const DT_S: f64 = 1e-3;
/// Slots of `line_net`: y of its goal, and the limits of velocity, acceleration and jerk.
const GOAL_Y: usize = 11;
const LIMITS: usize = 24;
/// Slots of `line_net`: distance travelled, and the last joint position.
const DISTANCE: u32 = 7;
const JOINT_7: u32 = 36;

fn build(plan: PlanData, models: &[DeviceModel]) -> Box<Net> {
    Net::build(plan, models, 5, &[Some(HOLD)], DT_S).expect("a good plan")
}

/// Rehearses with an arm that rests at `HOLD`.
fn rehearsed(
    net: &mut Net,
    models: &[DeviceModel],
) -> Result<Option<RehearsalReport>, PredictedViolation> {
    let scene = RehearsalScene {
        models,
        devices: &[],
        holds: &[Some(HOLD)],
        values: &[],
        dt_s: DT_S,
    };
    rehearse(net, &scene).map_err(|refusal| match refusal {
        Refusal::Foreseen(foreseen) => foreseen,
        other => panic!("{other:?}"),
    })
}

/// A line of `metres` along y from the hold set-point.
fn line(metres: f64, limits: [f64; 3]) -> PlanData {
    let mut plan = line_net();
    plan.reals[GOAL_Y] += metres - 0.1;
    plan.reals[LIMITS..LIMITS + 3].copy_from_slice(&limits);
    plan
}

const SLOW: [f64; 3] = [0.2, 1.0, 10.0];

/// A line of 0.3 m while joint 7 turns by 8 rad/m: too fast for that joint only, which the rehearsal alone finds.
fn turning_line(limits: [f64; 3]) -> PlanData {
    let mut plan = TestPlan {
        data: line(0.3, limits),
    };
    let behind = plan.data.runs.split_off(3);
    let [gain, hold, turn] = [8.0, HOLD[6], f64::NAN].map(|value| plan.reals(&[value]));
    plan.add("Multiply", &[DISTANCE, gain, turn]);
    plan.add("Add", &[hold, turn, JOINT_7]);
    plan.data.runs.extend(behind);
    plan.data
}

#[test]
fn a_line_within_its_limits_is_reported_with_its_use_of_them() {
    let models = [model()];
    let mut net = build(line(0.1, SLOW), &models);
    let told = rehearsed(&mut net, &models)
        .unwrap()
        .expect("it commands an arm");
    assert_eq!(told.end, RehearsalEnd::Finished);
    // 0.1 m at 0.2 m/s, 1 m/s², 10 m/s³: 0.5 s, and the time of acceleration and jerk.
    assert!((told.time_s - 0.8).abs() < 0.01, "{told:?}");
    for peak in told.peaks {
        assert!(peak.share > 0.01 && peak.share < 1.0, "{told:?}");
        assert!((1..=7).contains(&peak.joint));
    }
}

#[test]
fn a_rehearsal_restores_the_state_of_the_net() {
    let models = [model()];
    let (mut net, mut other) = (build(line_net(), &models), build(line_net(), &models));
    rehearsed(&mut net, &models).unwrap();
    let mut measurement: rcc_core::message::Measurement = bytemuck::Zeroable::zeroed();
    measurement.joints = 7;
    let inputs = [DeviceInput {
        present: true,
        measurement,
    }];
    for _ in 0..100 {
        let pair = [&mut net, &mut other].map(|net| net.evaluate(&models, &inputs, DT_S));
        assert_eq!(pair[0], pair[1]);
        assert_eq!(net.outputs()[0].position, other.outputs()[0].position);
        assert_eq!(net.cycles, other.cycles);
    }
}

#[test]
fn a_joint_that_would_be_too_fast_is_reported_with_position_and_possible_speed() {
    let models = [model()];
    let fast = [0.5, 4.0, 80.0];
    let foreseen = rehearsed(&mut build(turning_line(fast), &models), &models).unwrap_err();
    assert!(
        matches!(
            foreseen.rule,
            RehearsalRule::Velocity | RehearsalRule::Acceleration | RehearsalRule::Jerk
        ),
        "{foreseen:?}"
    );
    assert!(foreseen.value.abs() > foreseen.limit && foreseen.limit > 0.0);
    let place = foreseen.place.expect("a motion is under way");
    assert!(place.fraction > 0.0 && place.fraction < 1.0, "{place:?}");
    assert!(
        (place.distance_m - 0.3 * place.fraction).abs() < 1e-6,
        "{place:?}"
    );
    let SlowerMotion::KeepsLimits { speed: part } = foreseen.slower else {
        panic!("{foreseen:?}");
    };
    assert!(part > 0.05 && part < 1.0, "{foreseen:?}");
    let slower = [
        fast[0] * part,
        fast[1] * part.powi(2),
        fast[2] * part.powi(3),
    ];
    let told = rehearsed(&mut build(turning_line(slower), &models), &models);
    assert_eq!(told.unwrap().unwrap().end, RehearsalEnd::Finished);
}

/// Commands joint 1 to a constant that is `step` (rad) from its hold position, after a cycle at the hold position.
fn stepping_net(step: f64) -> PlanData {
    let mut plan = TestPlan::new();
    let no = plan.bool(0);
    let [from, to, out] = [HOLD[0], HOLD[0] + step, f64::NAN].map(|value| plan.reals(&[value]));
    let first = plan.bool(2);
    let joints = plan.reals(&HOLD[..7]);
    plan.add("FirstCycle", &[first]);
    plan.add("Select", &[first, from, to, out]);
    plan.add("Copy", &[out, joints]);
    plan.add("JointPositionCommand", &[joints, 0, 7]);
    plan.add("Termination", &[no]);
    plan.data
}

#[test]
fn a_set_point_that_jumps_is_not_told_to_go_slower() {
    let models = [model()];
    for step in [1e-4, 1e-3, 0.1] {
        let foreseen = rehearsed(&mut build(stepping_net(step), &models), &models).unwrap_err();
        assert_eq!(foreseen.slower, SlowerMotion::Jumps, "{step}: {foreseen:?}");
    }
    // A velocity that jumps is too fast only as far as its speed is.
    let foreseen = rehearsed(&mut build(drift_net(HOLD[0], 1e-2), &models), &models).unwrap_err();
    let SlowerMotion::KeepsLimits { speed } = foreseen.slower else {
        panic!("{foreseen:?}");
    };
    assert!(
        rehearsed(
            &mut build(drift_net(HOLD[0], 1e-2 * speed), &models),
            &models
        )
        .is_ok()
    );
}

/// Joint 1 follows a goal that moves away from its hold position at 0.1 rad/s and changes in each cycle.
fn moving_goal_net() -> PlanData {
    let mut plan = TestPlan::new();
    let [no, done] = [0, 2].map(|value| plan.bool(value));
    let reals = [HOLD[0], 0.1, 1.0, 1.0, 5.0, 50.0];
    let [from, rate, speed, velocity, acceleration, jerk] = reals.map(|value| plan.reals(&[value]));
    let [time, way, goal, v, a, initial] = [f64::NAN; 6].map(|value| plan.reals(&[value]));
    let state = plan.reals(&[f64::NAN; AXIS_WORDS]);
    let joints = plan.reals(&HOLD[..7]);
    plan.add("Time", &[time]);
    plan.add("Multiply", &[time, rate, way]);
    plan.add("Add", &[from, way, goal]);
    let ports = [goal, speed, no, joints, v, a, done];
    let rest = [velocity, acceleration, jerk, initial, state];
    plan.add("ScalarGoal", &[&ports[..], &rest[..]].concat());
    plan.add("JointPositionCommand", &[joints, 0, 7]);
    plan.add("Termination", &[no]);
    plan.data
}

#[test]
fn a_goal_that_moves_is_rehearsed_as_it_is_run() {
    let models = [model()];
    let mut net = build(moving_goal_net(), &models);
    let rehearsed = rehearsed(&mut net, &models).expect("fine").expect("an arm");
    let limits = models[0].limits;
    let told = rehearsed.peaks[0].share * limits.velocity_max[0];

    let mut run = build(moving_goal_net(), &models);
    let mut position = HOLD[0];
    let mut fastest = 0.0_f64;
    for _ in 0..(rehearsed.time_s / DT_S).round() as usize {
        run.evaluate(&models, &[], DT_S);
        let now = run.outputs()[0].position[0];
        fastest = fastest.max((now - position).abs() / DT_S);
        position = now;
    }
    assert!((0.1..0.3).contains(&fastest), "{fastest} rad/s");
    assert!((told - fastest).abs() < 1e-9, "{told} rad/s of {fastest}");
}

#[test]
fn a_joint_beyond_its_range_is_reported_with_the_limit() {
    let mut narrow = model();
    narrow.limits.upper[0] = HOLD[0] + 1e-5;
    let models = [narrow];
    let drift = drift_net(HOLD[0], 1e-6);
    let foreseen = rehearsed(&mut build(drift, &models), &models).unwrap_err();
    assert_eq!(
        (foreseen.rule, foreseen.joint),
        (RehearsalRule::Position, 1)
    );
    assert_eq!(foreseen.limit, HOLD[0] + 1e-5);
    assert!((foreseen.time_s - 10.0).abs() < 0.01, "{foreseen:?}");
    assert_eq!(foreseen.place, None, "no motion is under way");
    assert_eq!(foreseen.slower, SlowerMotion::Unknown);
}

#[test]
fn a_flange_that_leaves_the_workspace_is_reported_with_axis_and_bound() {
    let mut bounded = model();
    let y = bounded.arm.unwrap().forward(&HOLD).position[1];
    let mut space = Workspace::ANYWHERE;
    space.upper[1] = y + 0.05;
    bounded.workspace = Some(space);
    let models = [bounded];
    let foreseen = rehearsed(&mut build(line(0.1, SLOW), &models), &models).unwrap_err();
    assert_eq!(
        (foreseen.rule, foreseen.joint),
        (RehearsalRule::Workspace, 2)
    );
    assert!(
        (foreseen.value - foreseen.limit).abs() < 1e-3,
        "{foreseen:?}"
    );
    assert!((foreseen.place.unwrap().fraction - 0.5).abs() < 0.01);
    space.upper[1] = y + 0.11;
    let models = [DeviceModel {
        workspace: Some(space),
        ..models[0]
    }];
    assert!(rehearsed(&mut build(line(0.1, SLOW), &models), &models).is_ok());
}

#[test]
fn an_arm_too_near_to_a_singular_position_is_reported_with_its_kind() {
    let mut bounded = model();
    let arm = bounded.arm.unwrap();
    let at = |space: Workspace| DeviceModel {
        workspace: Some(space),
        ..bounded
    };
    let told = rehearsed(&mut build(line(0.1, SLOW), &[bounded]), &[bounded]);
    let nearest = told.unwrap().unwrap().singularity;
    let rests = arm.singularity(&HOLD).distance;
    assert!(
        nearest < rests - 0.01,
        "the line goes nearer: {nearest} {rests}"
    );
    let mut space = Workspace::ANYWHERE;
    space.singularity_min = (nearest + rests) / 2.0;
    let models = [at(space)];
    let foreseen = rehearsed(&mut build(line(0.1, SLOW), &models), &models).unwrap_err();
    assert_eq!(foreseen.rule, RehearsalRule::Singularity);
    assert!(
        SingularityKind::from_number(foreseen.joint).is_some(),
        "{foreseen:?}"
    );
    assert_eq!(foreseen.limit, space.singularity_min);
    assert!(foreseen.value < foreseen.limit && foreseen.value > foreseen.limit - 1e-3);
    let place = foreseen.place.expect("a motion is under way");
    assert!(place.fraction > 0.0 && place.fraction < 1.0, "{place:?}");
    space.singularity_min = nearest - 1e-6;
    bounded.workspace = Some(space);
    let models = [bounded];
    assert!(rehearsed(&mut build(line(0.1, SLOW), &models), &models).is_ok());
}

#[test]
fn a_net_that_releases_its_arm_in_motion_is_reported_with_the_position() {
    let mut narrow = model();
    narrow.limits.lower[0] = HOLD[0] - 0.05;
    narrow.limits.upper[0] = HOLD[0] + 0.05;
    let models = [narrow];
    let foreseen = rehearsed(&mut build(line(0.1, SLOW), &[model()]), &models).unwrap_err();
    assert_eq!(foreseen.rule, RehearsalRule::LetsGo, "{foreseen:?}");
    let place = foreseen.place.expect("a motion is under way");
    assert!(
        place.distance_m > 0.005 && place.distance_m < 0.1,
        "{place:?}"
    );
}

#[test]
fn a_line_that_the_joints_cannot_follow_is_refused_with_joint_and_place() {
    let refused = |metres: f64| {
        let plan = line(metres, SLOW);
        let built = Net::build(plan, &[model()], 5, &[Some(HOLD)], DT_S);
        match built.map(|_| ()) {
            Err(Refusal::Prepare(PrepareFault::Motion { fault, .. })) => fault,
            other => panic!("{other:?}"),
        }
    };
    let fault = refused(3.0);
    assert!(
        matches!(
            fault,
            MotionFault::Unreachable { fraction } | MotionFault::JointRange { fraction, .. }
                if fraction > 0.03 && fraction < 0.5
        ),
        "{fault:?}"
    );
}

#[test]
fn a_net_that_does_not_begin_where_the_arm_rests_is_left_to_start() {
    let models = [model()];
    let mut from = model().arm.unwrap().forward(&HOLD);
    from.position[2] += 0.05;
    let mut net = build(motion_net(Some(from.to_slots())), &models);
    let told = rehearsed(&mut net, &models).unwrap().unwrap();
    assert_eq!(told.end, RehearsalEnd::Elsewhere);
    let mut net = build(line_net(), &models);
    let scene = RehearsalScene {
        models: &models,
        devices: &[],
        holds: &[None],
        values: &[],
        dt_s: DT_S,
    };
    let told = rehearse(&mut net, &scene).unwrap().unwrap();
    assert_eq!(told.end, RehearsalEnd::Elsewhere);
}

#[test]
fn the_rehearsal_of_an_endless_net_ends() {
    let models = [model()];
    let mut drift = build(drift_net(HOLD[0], 0.0), &models);
    let told = rehearsed(&mut drift, &models).unwrap().unwrap();
    assert_eq!((told.end, told.time_s), (RehearsalEnd::Waits, 0.0));
    // Slow enough for the third difference of its first step.
    let mut drift = build(drift_net(HOLD[0], 1e-6), &models);
    let told = rehearsed(&mut drift, &models).unwrap().unwrap();
    assert_eq!((told.end, told.time_s), (RehearsalEnd::TooLong, TIME_MAX_S));
}

#[test]
fn a_net_that_commands_no_arm_is_not_rehearsed() {
    let models = [model()];
    assert_eq!(
        rehearsed(&mut build(output_net(1), &models), &models),
        Ok(None)
    );
}

/// Prepares the net again for where the arm rests now, as START requests it.
fn renew(fixture: &mut EngineFixture, id: u64, plan: PlanData) {
    let loaded = Net::build(plan, &fixture.models, 5, &[Some(HOLD)], DT_S).expect("a good plan");
    let holds = [Some(fixture.driver.measurement.hold)];
    let net =
        Net::prepare_again(&loaded.origin(), &fixture.models, 5, &holds).expect("from there, too");
    fixture.order(|_| EngineRequest::Renew { id, net });
}

#[test]
fn nets_that_were_loaded_in_advance_start_one_after_the_other_where_the_arm_rests() {
    let mut fixture = EngineFixture::new();
    let (out, back) = (line(0.1, SLOW), line(0.02, SLOW));
    let (first, second) = (fixture.load(out), fixture.load(back.clone()));
    assert!(matches!(fixture.start(first), Answer::Done { .. }));
    assert_eq!(fixture.until_terminated(first, 2000), EndReason::Finished);
    let rests = fixture.driver.measurement.hold;
    let refused = fixture.start(second);
    assert!(
        matches!(refused, Answer::Refused(Refusal::FirstSetPoint { .. })),
        "{refused:?}"
    );
    renew(&mut fixture, second, back);
    assert!(matches!(fixture.start(second), Answer::Done { .. }));
    let begins = fixture.told().position;
    assert!(begins.iter().zip(rests).all(|(a, b)| (a - b).abs() < 1e-12));
    assert_eq!(fixture.until_terminated(second, 2000), EndReason::Finished);
    let arm = model().arm.unwrap();
    let y = arm.forward(&HOLD).position[1];
    let ends = fixture.driver.measurement.hold;
    assert!((arm.forward(&ends).position[1] - (y + 0.02)).abs() < 1e-9);
}

#[test]
fn staged_values_move_to_the_net_that_replaces_another() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(input_net(1.0, 0));
    fixture.set(id, &[(0, &[4.5])]);
    renew(&mut fixture, id, input_net(1.0, 0));
    assert!(matches!(fixture.start(id), Answer::Done { .. }));
    assert_eq!(fixture.told().analog[0], 4.5);
}

#[test]
fn a_net_is_only_replaced_while_it_is_ready() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(line_net());
    fixture.start(id);
    fixture.steps(50);
    let before = fixture.entry(id).cycles;
    renew(&mut fixture, id, line_net());
    fixture.step();
    assert_eq!(fixture.entry(id).cycles, before + 1, "it goes on");
    assert_eq!(fixture.until_terminated(id, 2000), EndReason::Finished);
    renew(&mut fixture, id, line_net());
    fixture.step();
    assert_eq!(fixture.state(id), CommandState::Terminated);
    fixture.order(|_| EngineRequest::Renew {
        id: 999,
        net: build(line_net(), &[model()]),
    });
    fixture.step();
}

#[test]
fn a_net_whose_set_points_are_all_null_says_so() {
    let models = [model()];
    let net = |joint: f64, done: u8| {
        let mut plan = TestPlan::new();
        let done = plan.bool(done);
        let joints = plan.reals(&[joint, HOLD[1], HOLD[2], HOLD[3], HOLD[4], HOLD[5], HOLD[6]]);
        plan.add("JointPositionCommand", &[joints, 0, 7]);
        plan.add("Termination", &[done]);
        build(plan.data, &models)
    };
    for (joint, done, uncommanded) in [
        (f64::NAN, 1, 1),
        (f64::NAN, 0, 1),
        (HOLD[0], 1, 0),
        (HOLD[0], 0, 0),
    ] {
        let told = rehearsed(&mut net(joint, done), &models).unwrap();
        let told = told.expect("it commands an arm");
        assert_eq!(told.uncommanded, uncommanded, "{told:?}");
    }
}

#[test]
fn a_singular_position_is_no_reason_for_joints_that_are_computed_without_a_pose() {
    // A joint that steps to its velocity at once.
    let models = [model()];
    let mut net = build(drift_net(HOLD[0], 1.0), &models);
    let broken = rehearsed(&mut net, &models).unwrap_err();
    assert_eq!(broken.near, None, "{broken:?}");
    // A line computes joints from poses.
    let mut net = build(line(0.1, SLOW), &[model()]);
    let models = [DeviceModel {
        limits: rcc_core::guard::JointLimits {
            jerk_max: [1e-3; 8],
            ..model().limits
        },
        ..model()
    }];
    let broken = rehearsed(&mut net, &models).unwrap_err();
    assert!(broken.near.is_some(), "{broken:?}");
}
