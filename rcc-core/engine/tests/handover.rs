//! Hand-over in virtual time: some commands end and others begin between the same two cycles, or nothing changes.

mod common;

use common::{EngineFixture, HOLD, TestPlan, drift_net, endless_net, line_net, named, output_net};
use rcc_core::guard::ViolationKind;
use rcc_core::message::{CommandImage, CommandState, DeviceState, EndReason};
use rcc_core::plan::{Rate, Resource};
use rcc_engine::queue::EngineRequest;
use rcc_protocol::control::{Answer, PlanData, Refusal};
use rcc_testing::{Random, Rng};

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

/// Requests a hand-over and runs cycles until it is answered.
fn switch_in_time(fixture: &mut EngineFixture, stop: &[u64], start: &[u64]) -> Answer {
    let (stop, start) = (named(stop), named(start));
    let ticket = fixture.order(|ticket| EngineRequest::Handover {
        ticket,
        stop,
        start,
    });
    for _ in 0..1100 {
        fixture.step();
        if let Some(answer) = fixture.answer(ticket) {
            return answer;
        }
    }
    panic!("no answer")
}

#[test]
fn slower_nets_take_over_in_the_next_cycle_in_which_all_of_them_are_due() {
    let (mut fixture, old) = running(endless_net(1));
    let new = [slow(1, 10, 3), slow(2, 15, 8), slow(3, 1, 0)].map(|plan| fixture.load(plan));
    let answer = switch_in_time(&mut fixture, &[old], &new);
    let cycle = fixture.engine.status().cycle;
    assert_eq!((cycle_of(answer), cycle % 30), (cycle, 23));
    assert!(
        new.iter()
            .all(|id| fixture.entry(*id).started_cycle == cycle)
    );
    assert_eq!(fixture.entry(old).ended_cycle, cycle - 1);
    assert_eq!(fixture.told().digital_commanded, 0b1110);
    fixture.step();
    assert_eq!(fixture.told().digital_commanded, 0b1110);
}

#[test]
fn nets_that_are_never_due_together_do_not_take_over() {
    let (mut fixture, old) = running(endless_net(1));
    let new = [slow(1, 10, 3), slow(2, 10, 4)].map(|plan| fixture.load(plan));
    let (id, refusal) = refused_for(switch_in_time(&mut fixture, &[old], &new));
    assert!(new.contains(&id));
    assert_eq!(refusal, Refusal::NeverTogether);
    assert_eq!(fixture.state(old), CommandState::Running);
}

#[test]
fn a_hand_over_that_waits_is_checked_again_and_only_one_waits() {
    let (mut fixture, old) = running(endless_net(1));
    let new = fixture.load(slow(1, 200, 0));
    let other = fixture.load(endless_net(2));
    let (stop, start) = (named(&[old]), named(&[new]));
    let ticket = fixture.order(|ticket| EngineRequest::Handover {
        ticket,
        stop,
        start,
    });
    fixture.step();
    assert_eq!(
        fixture.switch(&[old], &[other]),
        Answer::Refused(Refusal::Overloaded)
    );
    fixture.order(|ticket| EngineRequest::Abort { ticket, id: old });
    fixture.step();
    let state = CommandState::Terminated as u32;
    assert_eq!(
        fixture.answer(ticket),
        Some(Answer::RefusedFor {
            id: old,
            refusal: Refusal::WrongState { state }
        })
    );
    assert_eq!(fixture.state(new), CommandState::Ready);
}

/// A random net of one of several types; some begin where the arm is, some do not.
fn any_net(fixture: &EngineFixture, random: &mut Rng) -> PlanData {
    let here = match fixture.told().has_position {
        1 => fixture.told().position[0],
        _ => fixture.driver.measurement.hold[0],
    };
    match random.below(8) {
        0 => line_net(),
        1 => drift_net(here + 0.01e-3, 0.01),
        2 => drift_net(here, -0.012),
        3 => drift_net(here + 0.1, 0.0),
        4 => drift_net(f64::NAN, 0.0),
        5 => slow(1, 1 + random.below(7) as u32, 0),
        6 => output_net(random.below(4) as u32),
        _ => endless_net(random.below(4) as u32),
    }
}

#[test]
fn set_points_keep_the_limits_of_the_arm_through_any_hand_over() {
    let mut all = 0;
    for seed in 1..=60 {
        let mut random = Rng::with_seed(seed);
        let mut fixture = EngineFixture::new();
        let mut ids: Vec<u64> = Vec::new();
        let (mut history, mut switched) = (Vec::new(), 0);
        for _ in 0..400 {
            let pick = |random: &mut Rng, ids: &[u64]| match ids.len() {
                0 => 1,
                len => ids[random.below(len)],
            };
            match random.below(10) {
                0..=2 if ids.len() < 20 => {
                    let plan = any_net(&fixture, &mut random);
                    ids.push(fixture.load(plan));
                }
                3 => {
                    let id = pick(&mut random, &ids);
                    fixture.order(|ticket| EngineRequest::Start { ticket, id });
                }
                4 => {
                    let id = pick(&mut random, &ids);
                    fixture.order(|ticket| EngineRequest::Cancel { ticket, id });
                }
                5 => {
                    let id = pick(&mut random, &ids);
                    fixture.order(|ticket| EngineRequest::Unload { ticket, id });
                }
                6..=8 => {
                    let active = |id: &&u64| {
                        let row = fixture
                            .engine
                            .tables()
                            .commands
                            .iter()
                            .find(|row| row.id == **id);
                        row.is_some_and(|row| CommandState::from_number(row.state).is_active())
                    };
                    let stop: Vec<u64> = ids.iter().filter(active).take(3).copied().collect();
                    let start = [pick(&mut random, &ids)];
                    let (stop, start) = (named(&stop), named(&start));
                    let ticket = fixture.order(|ticket| EngineRequest::Handover {
                        ticket,
                        stop,
                        start,
                    });
                    fixture.step();
                    history.push(fixture.told());
                    let answer = fixture.answer(ticket);
                    switched += u32::from(matches!(answer, Some(Answer::Done { .. })));
                }
                _ => {}
            }
            for _ in 0..random.below(30) {
                fixture.step();
                history.push(fixture.told());
            }
            fixture.records();
            while fixture.ends.replies.pop().is_ok() {}
            while fixture.ends.events.pop().is_ok() {}
            let rows = fixture.engine.tables().commands;
            ids.retain(|id| rows.iter().any(|row| row.id == *id));
        }
        all += switched;
        // Three set-points of one engagement in consecutive cycles give two velocities and an acceleration.
        for three in history.windows(3) {
            let one = |point: &rcc_core::message::SetPoint| {
                point.has_position == 1 && point.owner == three[0].owner
            };
            let gap = three[2].logical_ns - three[0].logical_ns != 2 * fixture.period_ns;
            if gap || !three.iter().all(one) {
                continue;
            }
            for joint in 0..7 {
                let [a, b, c] = [0, 1, 2].map(|index| three[index].position[joint]);
                let acceleration = (c - 2.0 * b + a) / 1e-6;
                assert!(
                    acceleration.abs() <= 20.1,
                    "seed {seed}: {acceleration} rad/s²"
                );
            }
        }
    }
    assert!(all > 600, "{all} hand-overs");
}
