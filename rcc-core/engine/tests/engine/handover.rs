//! Hand-over in virtual time: some commands end and others begin between the same two cycles, or nothing changes.

mod random;
mod waiting;

use crate::common::{
    EngineFixture, HOLD, TestPlan, drift_net, endless_net, line_net, named, output_net,
};
use rcc_core::guard::ViolationKind;
use rcc_core::message::{CommandImage, CommandState, DeviceState, EndReason};
use rcc_core::plan::{Rate, Resource};
use rcc_engine::queue::EngineRequest;
use rcc_protocol::control::{Answer, PlanData, Refusal};

fn cycle_of(answer: Answer) -> u64 {
    match answer {
        Answer::Done { cycle } => cycle,
        answer => panic!("not done: {answer:?}"),
    }
}

fn refused_for(answer: Answer) -> (u64, Refusal) {
    match answer {
        Answer::RefusedFor { id, refusal } => (id, refusal),
        answer => panic!("not refused because of one: {answer:?}"),
    }
}

/// A fixture in which this plan runs, and the id of the command.
fn running(plan: PlanData) -> (EngineFixture, u64) {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(plan);
    cycle_of(fixture.start(id));
    (fixture, id)
}

/// The bytes of a command image, without the times at which it was written.
fn bits(image: &CommandImage) -> Vec<u8> {
    bytemuck::bytes_of(image).to_vec()
}

#[test]
fn what_is_stopped_ends_in_the_cycle_before_what_is_started_begins() {
    let (mut fixture, old) = running(endless_net(1));
    let new = fixture.load(output_net(1));
    fixture.steps(10);
    let cycle = fixture.engine.status().cycle + 1;
    assert_eq!(cycle_of(fixture.switch(&[old], &[new])), cycle);
    assert_eq!(
        (fixture.state(old), fixture.reason(old)),
        (CommandState::Terminated, EndReason::Aborted)
    );
    assert_eq!(fixture.entry(old).ended_cycle, cycle - 1);
    assert_eq!(fixture.state(new), CommandState::Running);
    assert_eq!(
        (fixture.entry(new).started_cycle, fixture.entry(new).cycles),
        (cycle, 1)
    );
    let evaluated = fixture.entry(old).cycles;
    fixture.step();
    assert_eq!(
        (fixture.entry(old).cycles, fixture.entry(new).cycles),
        (evaluated, 2)
    );
}

#[test]
fn an_output_that_both_command_is_not_released_and_one_that_only_the_old_one_commands_is() {
    let mut fixture = EngineFixture::new();
    let [both, only, new] =
        [endless_net(1), endless_net(2), output_net(1)].map(|plan| fixture.load(plan));
    fixture.start(both);
    fixture.start(only);
    assert_eq!(fixture.told().digital_commanded, 0b110);
    cycle_of(fixture.switch(&[both, only], &[new]));
    assert_eq!(fixture.told().digital_commanded, 0b010);
    assert_eq!(fixture.told().digital, 0b010);
}

#[test]
fn an_arm_in_motion_is_handed_over_in_one_stream_of_set_points() {
    let (mut fixture, old) = running(drift_net(HOLD[0], 0.015));
    fixture.steps(50);
    let before = fixture.told();
    let next = before.position[0] + 0.015e-3;
    let new = fixture.load(drift_net(next + 2.0 * 0.015e-3, 0.015));
    cycle_of(fixture.switch(&[old], &[new]));
    let after = fixture.told();
    assert_eq!((after.has_position, after.owner), (1, before.owner));
    assert!((after.position[0] - next - 2.0 * 0.015e-3).abs() < 1e-12);
    fixture.steps(50);
    assert_eq!(fixture.state(new), CommandState::Running);
    assert_eq!(fixture.told().owner, before.owner);
}

#[test]
fn a_set_point_that_does_not_continue_is_refused_with_joint_value_and_limit() {
    let (mut fixture, old) = running(drift_net(HOLD[0], 0.015));
    fixture.steps(50);
    let here = fixture.told().position[0];
    for (from, kind) in [
        (here + 0.5, ViolationKind::Jump),
        (here + 5e-3, ViolationKind::Velocity),
        (here + 1e-4, ViolationKind::Acceleration),
        (9.0, ViolationKind::Range),
    ] {
        let new = fixture.load(drift_net(from, 0.015));
        let (id, refusal) = refused_for(fixture.switch(&[old], &[new]));
        let Refusal::Continuation {
            device,
            joint,
            violation,
            ..
        } = refusal
        else {
            panic!("{refusal:?}")
        };
        assert_eq!((id, device, joint, violation), (new, 0, 1, kind.number()));
        assert_eq!(fixture.state(old), CommandState::Running);
        assert_eq!(
            (fixture.state(new), fixture.entry(new).cycles),
            (CommandState::Ready, 0)
        );
        fixture.ask(|ticket| EngineRequest::Unload { ticket, id: new });
    }
}

#[test]
fn a_refused_hand_over_leaves_no_trace_in_what_devices_are_told() {
    let benches: Vec<(Vec<Vec<u8>>, Vec<u64>)> = [false, true]
        .into_iter()
        .map(|asks| {
            let mut fixture = EngineFixture::new();
            let ids = [
                drift_net(HOLD[0], 0.015),
                endless_net(1),
                drift_net(0.0, 0.0),
                output_net(2),
            ]
            .map(|plan| fixture.load(plan));
            let [old, lamp, elsewhere, other] = ids;
            fixture.start(old);
            fixture.start(lamp);
            let told = (0..50)
                .map(|_| {
                    if asks {
                        // `other` is evaluated first and could begin.
                        let (id, _) =
                            refused_for(fixture.switch(&[old, lamp], &[other, elsewhere]));
                        assert_eq!(id, elsewhere);
                    } else {
                        fixture.step();
                    }
                    bits(fixture.engine.image(0).unwrap())
                })
                .collect();
            (told, ids.map(|id| fixture.entry(id).cycles).to_vec())
        })
        .collect();
    assert_eq!(benches[0], benches[1]);
}

#[test]
fn a_hand_over_that_was_refused_can_succeed_later() {
    let (mut fixture, old) = running(drift_net(HOLD[0], 0.01));
    let ahead = fixture.load(drift_net(HOLD[0] + 0.01, 0.01));
    let mut refusals = 0;
    while let Answer::RefusedFor { id, .. } = fixture.switch(&[old], &[ahead]) {
        assert_eq!(id, ahead);
        refusals += 1;
    }
    // The old net reaches that position after a second.
    assert!((990..1000).contains(&refusals), "{refusals}");
    assert_eq!(fixture.state(ahead), CommandState::Running);
}

#[test]
fn commands_in_the_wrong_state_are_refused_by_id() {
    let (mut fixture, old) = running(endless_net(1));
    let new = fixture.load(output_net(1));
    let wrong = |state| Refusal::WrongState {
        state: state as u32,
    };
    for (stop, start, refused) in [
        (new, 0, (new, wrong(CommandState::Ready))),
        (old, old, (old, wrong(CommandState::Running))),
        (999, new, (999, Refusal::UnknownCommand)),
        (old, 999, (999, Refusal::UnknownCommand)),
    ] {
        assert_eq!(refused_for(fixture.switch(&[stop], &[start])), refused);
    }
    let twice = refused_for(fixture.switch(&[old], &[new, new]));
    assert_eq!(twice, (new, Refusal::NamedTwice));
    assert_eq!(
        refused_for(fixture.switch(&[old, old], &[])),
        (old, Refusal::NamedTwice)
    );
    assert_eq!(fixture.state(old), CommandState::Running);
    fixture.engine.begin_stop();
    assert_eq!(
        fixture.switch(&[], &[new]),
        Answer::Refused(Refusal::Stopping)
    );
}

#[test]
fn a_resource_that_somebody_else_holds_is_busy_also_among_those_that_begin() {
    let mut fixture = EngineFixture::new();
    let [old, other, new, rival] = [endless_net(1), endless_net(2), output_net(2), output_net(2)]
        .map(|plan| fixture.load(plan));
    fixture.start(old);
    fixture.start(other);
    let resource = Resource::Digital {
        device: 0,
        channel: 2,
    };
    let busy = |holder| Refusal::Busy { holder, resource };
    assert_eq!(
        refused_for(fixture.switch(&[old], &[new])),
        (new, busy(other))
    );
    let (id, refusal) = refused_for(fixture.switch(&[other], &[new, rival]));
    assert!([new, rival].contains(&id));
    assert!(matches!(refusal, Refusal::Busy { .. }), "{refusal:?}");
    cycle_of(fixture.switch(&[other], &[new]));
}

#[test]
fn several_begin_in_the_same_cycle_and_several_end_without_others() {
    let mut fixture = EngineFixture::new();
    let ids = [endless_net(0), endless_net(1), endless_net(2)].map(|plan| fixture.load(plan));
    let cycle = cycle_of(fixture.switch(&[], &ids));
    assert!(
        ids.iter()
            .all(|id| fixture.entry(*id).started_cycle == cycle)
    );
    assert_eq!(fixture.told().digital_commanded, 0b111);
    let cycle = cycle_of(fixture.switch(&ids, &[]));
    assert!(
        ids.iter()
            .all(|id| fixture.entry(*id).ended_cycle == cycle - 1)
    );
    assert_eq!(fixture.told().digital_commanded, 0);
}

#[test]
fn an_arm_at_rest_is_begun_as_by_start() {
    let (mut fixture, old) = running(endless_net(1));
    let [line, elsewhere] = [line_net(), drift_net(0.0, 0.0)].map(|plan| fixture.load(plan));
    let (id, refusal) = refused_for(fixture.switch(&[old], &[elsewhere]));
    assert_eq!(id, elsewhere);
    assert!(
        matches!(refusal, Refusal::FirstSetPoint { .. }),
        "{refusal:?}"
    );
    cycle_of(fixture.switch(&[old], &[line]));
    assert_eq!(fixture.until_terminated(line, 3000), EndReason::Finished);
}

#[test]
fn a_device_that_is_lost_refuses_those_that_use_it() {
    let (mut fixture, old) = running(endless_net(1));
    let new = fixture.load(line_net());
    fixture.driver.measurement.state = DeviceState::Online as u32;
    let (id, refusal) = refused_for(fixture.switch(&[old], &[new]));
    let Refusal::DeviceNotReady { device, state, .. } = refusal else {
        panic!("{refusal:?}")
    };
    assert_eq!((id, device, state), (new, 0, DeviceState::Online as u32));
    assert_eq!(fixture.state(old), CommandState::Running);
}

#[test]
fn nobody_takes_an_arm_to_let_it_go() {
    let (mut fixture, old) = running(drift_net(HOLD[0], 0.015));
    let new = fixture.load(drift_net(f64::NAN, 0.0));
    assert_eq!(
        refused_for(fixture.switch(&[old], &[new])),
        (new, Refusal::LetsGo { device: 0 })
    );
    assert_eq!(fixture.told().has_position, 1);
}

#[test]
fn a_motion_that_has_ended_hands_its_arm_over_while_the_driver_still_plays_it() {
    // The driver plays ten cycles later; in each of them the next net may begin, and it continues to its own end.
    for wait in 0..12 {
        let (mut fixture, old) = running(line_net());
        while fixture.entry(old).ended_cycle == 0 {
            fixture.step();
        }
        let last = fixture.told();
        let ended = fixture.entry(old).ended_cycle;
        let new = {
            let mut plan = TestPlan::new();
            let requested = plan.bool(2);
            let joints = plan.reals(&last.position[..7]);
            plan.add("Cancel", &[requested]);
            plan.add("JointPositionCommand", &[joints, 0, 7]);
            plan.add("Termination", &[requested]);
            let net = fixture.build(plan.data).unwrap();
            let ticket = 77;
            // In the same cycle as the hand-over: the row is reserved and the net installed.
            fixture.steps(wait);
            let id = old + 1;
            fixture
                .ends
                .requests
                .push(EngineRequest::Reserve { ticket })
                .unwrap();
            fixture
                .ends
                .requests
                .push(EngineRequest::Install { ticket, id, net })
                .unwrap();
            id
        };
        if fixture.state(old) == CommandState::Terminated {
            assert!(wait > 9, "terminated after {wait} cycles");
            continue;
        }
        let cycle = cycle_of(fixture.switch(&[old], &[new]));
        assert_eq!(fixture.reason(old), EndReason::Finished);
        assert_eq!(fixture.entry(old).ended_cycle, ended);
        assert_eq!(fixture.entry(new).started_cycle, cycle);
        // Without delay it is one stream of set-points; later the driver saw a gap at rest, so it is another one.
        assert_eq!(
            fixture.told().owner == last.owner,
            wait == 0,
            "after {wait}"
        );
        fixture.steps(100);
        assert_eq!(fixture.state(new), CommandState::Running, "after {wait}");
        fixture.ask(|ticket| EngineRequest::Cancel { ticket, id: new });
        assert_eq!(fixture.until_terminated(new, 100), EndReason::Canceled);
    }
}

/// A net that drifts and terminates after `cycles`.
fn drift_and_end(cycles: u32, velocity: f64) -> PlanData {
    let mut plan = TestPlan {
        data: drift_net(HOLD[0], velocity),
    };
    let end = plan.reals(&[f64::from(cycles) * 1e-3]);
    let over = plan.bool(2);
    // The time is the third slot of the net; `Termination` reads the first Bool.
    plan.data.runs.pop();
    plan.data.operands.pop();
    plan.add("Greater", &[2, end, over]);
    plan.add("Termination", &[over]);
    plan.data
}

#[test]
fn a_net_that_ended_in_motion_does_not_hand_its_arm_over() {
    let (mut fixture, old) = running(drift_and_end(40, 0.015));
    let here = HOLD[0] + 0.015 * 0.041;
    let new = fixture.load(drift_net(here, 0.0));
    while fixture.entry(old).ended_cycle == 0 {
        fixture.step();
    }
    fixture.steps(2);
    let refused = refused_for(fixture.switch(&[old], &[new]));
    let not_ready = Refusal::DeviceNotReady {
        device: 0,
        state: DeviceState::Commanded as u32,
        reason: 0,
    };
    assert_eq!(refused, (new, not_ready));
    assert_eq!(fixture.state(old), CommandState::Running);
}

#[test]
fn orders_behind_a_hand_over_wait_for_the_next_cycle() {
    let (mut fixture, old) = running(endless_net(1));
    let new = fixture.load(endless_net(1));
    let (stop, start) = (named(&[old]), named(&[new]));
    let ticket = 70;
    let requests = [
        EngineRequest::Handover {
            ticket,
            stop,
            start,
            lease: 0,
        },
        EngineRequest::Abort {
            ticket: 71,
            id: new,
        },
    ];
    for request in requests {
        fixture.ends.requests.push(request).unwrap();
    }
    fixture.step();
    let cycle = fixture.engine.status().cycle;
    assert_eq!(fixture.answer(70), Some(Answer::Done { cycle }));
    assert_eq!(fixture.state(new), CommandState::Running);
    fixture.step();
    assert_eq!(fixture.state(new), CommandState::Terminated);
    assert_eq!(fixture.entry(new).cycles, 1);
}

#[test]
fn a_driver_that_refuses_after_a_hand_over_ends_the_new_net_only() {
    let (mut fixture, old) = running(drift_net(HOLD[0], 0.0));
    fixture.steps(20);
    let new = fixture.load(drift_net(HOLD[0], 0.0));
    cycle_of(fixture.switch(&[old], &[new]));
    fixture.driver.measurement.state = DeviceState::Online as u32;
    assert_eq!(fixture.until_terminated(new, 3), EndReason::Fault);
    assert_eq!(fixture.reason(old), EndReason::Aborted);
}

#[test]
fn hundreds_of_hand_overs_in_consecutive_cycles_keep_one_stream() {
    let (mut fixture, mut old) = running(drift_net(HOLD[0], 0.0));
    let owner = fixture.told().owner;
    for _ in 0..300 {
        let new = fixture.load(drift_net(HOLD[0], 0.0));
        let cycle = cycle_of(fixture.switch(&[old], &[new]));
        assert_eq!(
            fixture.entry(new).started_cycle,
            fixture.entry(old).ended_cycle + 1
        );
        assert_eq!(fixture.entry(new).started_cycle, cycle);
        assert_eq!(
            (fixture.told().has_position, fixture.told().owner),
            (1, owner)
        );
        fixture.ask(|ticket| EngineRequest::Unload { ticket, id: old });
        old = new;
    }
}

/// A net that commands an output in every `every`-th cycle.
fn slow(channel: u32, every: u32, phase: u32) -> PlanData {
    PlanData {
        rate: Rate { every, phase },
        ..endless_net(channel)
    }
}
