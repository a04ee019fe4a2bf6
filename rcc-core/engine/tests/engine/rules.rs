//! Rules in virtual time: what follows begins in the cycle after its condition became true, or nothing changes.

mod continued;
mod installation;
mod leases;
mod recording;
mod replayed;

use crate::common::{
    EngineFixture, HOLD, TestPlan, drift_net, endless_net, line_net, named, output_net,
};
use rcc_core::message::{CommandState, DeviceState, EndReason};
use rcc_core::plan::Rate;
use rcc_engine::queue::{EngineEvent, EngineReply, EngineRequest};
use rcc_protocol::control::{Answer, PlanData, Refusal};
use rcc_protocol::rules::{DisarmReason, Rule, RuleState, RuleStatus, RuleTerm};

/// The slot of `over` in [`drift_until`] and [`ends_after`].
const OVER: u32 = 1;

/// A rule that goes on without its client.
fn rule(terms: &[RuleTerm], stop: &[u64], cancel: &[u64], start: &[u64]) -> Rule {
    let mut rule = Rule {
        stop: named(stop),
        cancel: named(cancel),
        start: named(start),
        goes_on: true,
        ..Rule::EMPTY
    };
    for (place, term) in rule.when.iter_mut().zip(terms) {
        *place = Some(*term);
    }
    rule
}

fn outcome(command: u64, outcome: u32) -> RuleTerm {
    RuleTerm::Outcome { command, outcome }
}

fn reason(command: u64, reason: EndReason) -> RuleTerm {
    let reason = reason as u32;
    RuleTerm::Reason { command, reason }
}

fn over(command: u64) -> RuleTerm {
    RuleTerm::Value {
        command,
        slot: OVER,
    }
}

/// Installs rules and runs one cycle; returns the id of the first and the cycle.
fn install(fixture: &mut EngineFixture, rules: &[Rule]) -> (u64, u64) {
    match try_install(fixture, rules) {
        Answer::RulesInstalled { first, cycle } => (first, cycle),
        answer => panic!("not installed: {answer:?}"),
    }
}

fn try_install(fixture: &mut EngineFixture, rules: &[Rule]) -> Answer {
    let rules = rules.to_vec();
    fixture.ask(|ticket| EngineRequest::InstallRules { ticket, rules })
}

/// All rules, as the engine lists them.
fn listed(fixture: &mut EngineFixture) -> Vec<RuleStatus> {
    let list = Vec::with_capacity(200);
    fixture.order(|ticket| EngineRequest::ListRules {
        ticket,
        after: 0,
        list,
    });
    fixture.step();
    while let Ok(reply) = fixture.ends.replies.pop() {
        if let EngineReply::Rules { list, .. } = reply {
            return list.into_iter().map(|(_, status)| status).collect();
        }
    }
    panic!("no list")
}

fn status(fixture: &mut EngineFixture, id: u64) -> RuleStatus {
    let listed = listed(fixture);
    *listed
        .iter()
        .find(|status| status.id == id)
        .expect("listed")
}

/// The rules that ended, as reported so far.
fn reported(fixture: &mut EngineFixture) -> Vec<(u64, RuleState)> {
    let events = std::iter::from_fn(|| fixture.ends.events.pop().ok());
    let rules = events.filter_map(|event| match event {
        EngineEvent::Rule(status) => Some((status.id, status.state)),
        _ => None,
    });
    rules.collect()
}

/// As `drift_net`; its Bool slot [`OVER`] is true from evaluation `cycles` + 2 on.
fn drift_until(from: f64, velocity: f64, cycles: u32) -> PlanData {
    let mut plan = TestPlan {
        data: drift_net(from, velocity),
    };
    let end = plan.reals(&[f64::from(cycles) * 1e-3]);
    assert_eq!(plan.bool(2), OVER);
    plan.add("Greater", &[2, end, OVER]);
    // `Termination` must stay the last one.
    let termination = plan.data.runs.remove(plan.data.runs.len() - 2);
    plan.data.runs.push(termination);
    plan.data
}

/// A net that ends when [`OVER`] is true, with its second outcome; it writes an output until then.
fn ends_after(cycles: u32, channel: u32) -> PlanData {
    let mut plan = TestPlan::new();
    let no = plan.bool(0);
    assert_eq!(plan.bool(2), OVER);
    let on = plan.bool(1);
    let time = plan.reals(&[f64::NAN]);
    let end = plan.reals(&[f64::from(cycles) * 1e-3]);
    plan.add("Time", &[time]);
    plan.add("Greater", &[time, end, OVER]);
    plan.add("DigitalOutput", &[on, 0, channel]);
    plan.add("Termination", &[no, OVER]);
    plan.data
}

fn cycle_of(answer: Answer) -> u64 {
    match answer {
        Answer::Done { cycle } => cycle,
        answer => panic!("not done: {answer:?}"),
    }
}

#[test]
fn a_condition_that_is_true_when_it_is_installed_fires_in_that_cycle() {
    let mut fixture = EngineFixture::new();
    let lamp = fixture.load(output_net(1));
    let (id, cycle) = install(&mut fixture, &[rule(&[RuleTerm::True], &[], &[], &[lamp])]);
    assert_eq!(fixture.entry(lamp).started_cycle, cycle);
    let status = status(&mut fixture, id);
    assert_eq!((status.state, status.cycle), (RuleState::Fired, cycle));
    assert_eq!(reported(&mut fixture), [(id, RuleState::Fired)]);
}

#[test]
fn a_rule_that_is_refused_leaves_what_another_one_started_in_the_same_cycle() {
    let mut fixture = EngineFixture::new();
    let lamp = fixture.load(output_net(2));
    let elsewhere = fixture.load(drift_net(HOLD[0] + 0.1, 0.0));
    let rules = [lamp, elsewhere].map(|id| rule(&[RuleTerm::True], &[], &[], &[id]));
    let (first, cycle) = install(&mut fixture, &rules);
    assert_eq!(fixture.entry(lamp).started_cycle, cycle);
    assert_eq!(fixture.told().digital_commanded, 1 << 2);
    let told = reported(&mut fixture);
    assert_eq!(
        told,
        [(first, RuleState::Fired), (first + 1, RuleState::Refused)]
    );
    fixture.step();
    assert_eq!(fixture.told().digital_commanded, 1 << 2);
}

#[test]
fn an_arm_that_a_rule_hands_over_in_flight_goes_on_though_the_next_rule_is_refused() {
    let mut fixture = EngineFixture::new();
    let first = fixture.load(drift_until(HOLD[0], 0.0, 50));
    let second = fixture.load(drift_net(HOLD[0], 0.0));
    // Its first evaluation is refused: it needs the same arm elsewhere, after the first rule has taken it.
    let refused = fixture.load(drift_net(HOLD[0] + 0.1, 0.0));
    let rules = [
        rule(&[over(first)], &[first], &[], &[second]),
        rule(&[over(first)], &[], &[], &[refused]),
    ];
    let (hands_over, _) = install(&mut fixture, &rules);
    cycle_of(fixture.start(first));
    for _ in 0..100 {
        fixture.step();
        assert!(fixture.told().has_position == 1);
    }
    assert_eq!(fixture.state(second), CommandState::Running);
    assert_eq!(
        status(&mut fixture, hands_over + 1).state,
        RuleState::Refused
    );
}

#[test]
fn what_follows_an_outcome_begins_in_the_next_cycle_and_the_other_rule_expires() {
    let mut fixture = EngineFixture::new();
    let [first, second, third] =
        [ends_after(20, 1), output_net(1), output_net(2)].map(|plan| fixture.load(plan));
    let rules = [
        rule(&[outcome(first, 1)], &[], &[], &[third]),
        rule(&[outcome(first, 2)], &[], &[], &[second]),
    ];
    let (wrong, _) = install(&mut fixture, &rules);
    cycle_of(fixture.start(first));
    fixture.steps(30);
    let (ended, started) = (fixture.entry(first), fixture.entry(second));
    assert_eq!((ended.outcome, ended.cycles), (2, 22));
    assert_eq!(started.started_cycle, ended.ended_cycle + 1);
    assert_eq!(fixture.state(third), CommandState::Ready);
    let told = reported(&mut fixture);
    assert_eq!(
        told,
        [(wrong, RuleState::Expired), (wrong + 1, RuleState::Fired)]
    );
}

#[test]
fn a_running_net_hands_its_arm_over_in_flight_on_a_value_of_its_own() {
    let velocity = 0.015;
    let mut fixture = EngineFixture::new();
    let first = fixture.load(drift_until(HOLD[0], velocity, 50));
    // `over` is true in evaluation 52; the next set-point is that of evaluation 53.
    let second = fixture.load(drift_net(HOLD[0] + velocity * 0.052, velocity));
    install(
        &mut fixture,
        &[rule(&[over(first)], &[first], &[], &[second])],
    );
    cycle_of(fixture.start(first));
    let (mut last, owner) = (fixture.told().position[0], fixture.told().owner);
    for _ in 0..100 {
        fixture.step();
        let told = fixture.told();
        assert_eq!((told.has_position, told.owner), (1, owner));
        assert!((told.position[0] - last - velocity * 1e-3).abs() < 1e-12);
        last = told.position[0];
    }
    let (old, new) = (fixture.entry(first), fixture.entry(second));
    assert_eq!((old.cycles, old.ended_cycle + 1), (52, new.started_cycle));
    assert_eq!(fixture.reason(first), EndReason::Aborted);
}

#[test]
fn a_net_that_ends_in_motion_hands_its_arm_over_in_that_cycle() {
    let velocity = 0.015;
    let mut fixture = EngineFixture::new();
    let mut plan = drift_until(HOLD[0], velocity, 40);
    // `Termination` reads `over` instead of a constant.
    let termination = plan.runs.last().expect("a run").first as usize;
    plan.operands[termination] = OVER;
    let first = fixture.load(plan);
    let second = fixture.load(drift_net(HOLD[0] + velocity * 0.042, velocity));
    install(
        &mut fixture,
        &[rule(&[outcome(first, 1)], &[], &[], &[second])],
    );
    cycle_of(fixture.start(first));
    let owner = fixture.told().owner;
    fixture.steps(100);
    let (old, new) = (fixture.entry(first), fixture.entry(second));
    assert_eq!(fixture.reason(first), EndReason::Finished);
    assert_eq!(old.ended_cycle + 1, new.started_cycle);
    assert_eq!(fixture.told().owner, owner);
    assert_eq!(fixture.state(second), CommandState::Running);
}

#[test]
fn of_two_rules_that_want_an_arm_the_one_installed_first_gets_it() {
    for swapped in [false, true] {
        let mut fixture = EngineFixture::new();
        let first = fixture.load(drift_until(HOLD[0], 0.0, 20));
        let mut heirs = [(); 2].map(|()| fixture.load(drift_net(HOLD[0], 0.0)));
        if swapped {
            heirs.reverse();
        }
        let rules = heirs.map(|heir| rule(&[over(first)], &[], &[], &[heir]));
        let rules = rules.map(|rule| Rule {
            stop: named(&[first]),
            ..rule
        });
        let (id, _) = install(&mut fixture, &rules);
        cycle_of(fixture.start(first));
        fixture.steps(40);
        assert_eq!(fixture.state(heirs[0]), CommandState::Running);
        assert_eq!(fixture.state(heirs[1]), CommandState::Ready);
        let loser = status(&mut fixture, id + 1);
        assert_eq!(loser.state, RuleState::Refused);
        let (concerned, refusal) = loser.refusal.expect("a reason");
        assert_eq!(concerned, heirs[1]);
        let Refusal::Busy { holder, .. } = refusal else {
            panic!("{refusal:?}")
        };
        assert_eq!(holder, heirs[0]);
        let winner = status(&mut fixture, id);
        // The loser names a command of the winner's hand-over, so it was tried one cycle later.
        assert_eq!(
            (winner.state, winner.cycle),
            (RuleState::Fired, loser.cycle - 1)
        );
    }
}

#[test]
fn a_chain_of_hundreds_of_rules_keeps_one_stream_of_set_points() {
    let mut fixture = EngineFixture::new();
    let mut old = fixture.load(drift_until(HOLD[0], 0.0, 3));
    cycle_of(fixture.start(old));
    let owner = fixture.told().owner;
    for _ in 0..300 {
        let new = fixture.load(drift_until(HOLD[0], 0.0, 3));
        install(&mut fixture, &[rule(&[over(old)], &[old], &[], &[new])]);
        while fixture.state(new) != CommandState::Running {
            fixture.step();
        }
        let (left, began) = (fixture.entry(old), fixture.entry(new));
        assert_eq!(left.ended_cycle + 1, began.started_cycle);
        assert_eq!(
            (fixture.told().has_position, fixture.told().owner),
            (1, owner)
        );
        cycle_of(fixture.ask(|ticket| EngineRequest::Unload { ticket, id: old }));
        old = new;
    }
}

#[test]
fn a_motion_that_does_not_continue_is_refused_and_told_and_nothing_changes() {
    let mut fixture = EngineFixture::new();
    let first = fixture.load(drift_until(HOLD[0], 0.015, 20));
    let second = fixture.load(drift_net(HOLD[0] + 0.3, 0.0));
    let (id, _) = install(
        &mut fixture,
        &[rule(&[over(first)], &[first], &[], &[second])],
    );
    cycle_of(fixture.start(first));
    fixture.steps(40);
    let status = status(&mut fixture, id);
    assert_eq!(status.state, RuleState::Refused);
    let refusal = status.refusal.expect("a reason");
    assert_eq!(refusal.0, second);
    assert!(
        matches!(refusal.1, Refusal::Continuation { .. }),
        "{refusal:?}"
    );
    assert_eq!(fixture.state(first), CommandState::Running);
    assert_eq!(fixture.state(second), CommandState::Ready);
}

#[test]
fn a_rule_cancels_and_skips_what_has_ended() {
    let mut fixture = EngineFixture::new();
    let [line, timer, gone] =
        [line_net(), ends_after(100, 1), output_net(2)].map(|plan| fixture.load(plan));
    cycle_of(fixture.start(line));
    cycle_of(fixture.start(timer));
    cycle_of(fixture.start(gone));
    cycle_of(fixture.ask(|ticket| EngineRequest::Abort { ticket, id: gone }));
    let (id, _) = install(
        &mut fixture,
        &[rule(&[over(timer)], &[], &[line, gone], &[])],
    );
    assert_eq!(fixture.until_terminated(timer, 200), EndReason::Finished);
    fixture.step();
    assert_eq!(fixture.state(line), CommandState::Canceling);
    assert_eq!(fixture.until_terminated(line, 2000), EndReason::Canceled);
    assert_eq!(status(&mut fixture, id).state, RuleState::Fired);
}

#[test]
fn a_stop_by_a_client_wins_in_the_very_cycle_in_which_the_condition_holds() {
    for abort in [false, true] {
        for earlier in 0..2 {
            let mut fixture = EngineFixture::new();
            let first = fixture.load(drift_until(HOLD[0], 0.0, 20));
            let second = fixture.load(drift_net(HOLD[0], 0.0));
            let (id, _) = install(
                &mut fixture,
                &[rule(&[over(first)], &[first], &[], &[second])],
            );
            cycle_of(fixture.start(first));
            // 22 evaluations make the condition true; the request comes in that cycle, or in the next one.
            fixture.steps(21 - earlier);
            assert_eq!(fixture.state(second), CommandState::Ready);
            // CANCEL is refused, because the net has no `Cancel`: it disarms all the same.
            let answer = fixture.ask(|ticket| match abort {
                true => EngineRequest::Abort { ticket, id: first },
                false => EngineRequest::Cancel { ticket, id: first },
            });
            assert_eq!(matches!(answer, Answer::Done { .. }), abort);
            fixture.steps(40);
            assert_eq!(fixture.state(second), CommandState::Ready);
            let status = status(&mut fixture, id);
            let disarmed = Some(DisarmReason::Stopped { command: first });
            assert_eq!(
                (status.state, status.disarmed),
                (RuleState::Disarmed, disarmed)
            );
        }
    }
}

#[test]
fn a_stop_disarms_rules_of_other_commands_that_would_take_the_arm_and_no_others() {
    let mut fixture = EngineFixture::new();
    let [line, timer, heir, lamp] = [
        line_net(),
        ends_after(50, 1),
        drift_net(HOLD[0], 0.0),
        output_net(2),
    ]
    .map(|plan| fixture.load(plan));
    cycle_of(fixture.start(line));
    cycle_of(fixture.start(timer));
    let rules = [
        rule(&[outcome(timer, 2)], &[], &[], &[heir]),
        rule(&[outcome(timer, 2)], &[], &[], &[lamp]),
        rule(&[reason(line, EndReason::Canceled)], &[timer], &[], &[]),
    ];
    let (id, _) = install(&mut fixture, &rules);
    cycle_of(fixture.ask(|ticket| EngineRequest::Cancel { ticket, id: line }));
    let states: Vec<RuleState> = listed(&mut fixture).iter().map(|rule| rule.state).collect();
    assert_eq!(
        states,
        [RuleState::Disarmed, RuleState::Armed, RuleState::Armed]
    );
    fixture.until_terminated(timer, 2000);
    fixture.steps(2);
    assert_eq!(fixture.state(heir), CommandState::Ready);
    assert_eq!(status(&mut fixture, id).state, RuleState::Disarmed);
}

#[test]
fn a_stop_of_everything_disarms_all_rules() {
    let mut fixture = EngineFixture::new();
    let [timer, lamp] = [ends_after(50, 1), output_net(2)].map(|plan| fixture.load(plan));
    cycle_of(fixture.start(timer));
    let (id, _) = install(
        &mut fixture,
        &[rule(&[outcome(timer, 2)], &[], &[], &[lamp])],
    );
    fixture.engine.begin_stop();
    fixture.steps(100);
    assert_eq!(fixture.state(lamp), CommandState::Ready);
    let status = status(&mut fixture, id);
    assert_eq!(status.disarmed, Some(DisarmReason::Stopping));
    let answer = try_install(&mut fixture, &[rule(&[RuleTerm::True], &[], &[], &[lamp])]);
    assert_eq!(answer, Answer::Refused(Refusal::Stopping));
}

#[test]
fn a_fault_is_a_reason_like_any_other() {
    let mut fixture = EngineFixture::new();
    let [first, lamp] = [drift_net(HOLD[0], 0.0), output_net(2)].map(|plan| fixture.load(plan));
    cycle_of(fixture.start(first));
    fixture.steps(5);
    install(
        &mut fixture,
        &[rule(&[reason(first, EndReason::Fault)], &[], &[], &[lamp])],
    );
    fixture.driver.measurement.state = DeviceState::Online as u32;
    assert_eq!(fixture.until_terminated(first, 10), EndReason::Fault);
    fixture.step();
    let (ended, started) = (fixture.entry(first), fixture.entry(lamp));
    // The lamp uses the same device, which is online: outputs need no arm that is ready.
    assert_eq!(started.started_cycle, ended.ended_cycle + 1);
}

#[test]
fn slower_nets_begin_in_the_next_cycle_in_which_all_are_due() {
    let slow = |channel: u32, every: u32, phase: u32| PlanData {
        rate: Rate { every, phase },
        ..endless_net(channel)
    };
    let mut fixture = EngineFixture::new();
    let timer = fixture.load(ends_after(20, 0));
    let nets = [slow(1, 4, 1), slow(2, 6, 3)].map(|plan| fixture.load(plan));
    let (id, _) = install(&mut fixture, &[rule(&[outcome(timer, 2)], &[], &[], &nets)]);
    cycle_of(fixture.start(timer));
    fixture.steps(60);
    let ended = fixture.entry(timer).ended_cycle;
    let due = (ended + 1..)
        .find(|cycle| cycle % 4 == 1 && cycle % 6 == 3)
        .expect("a cycle");
    for net in nets {
        assert_eq!(fixture.entry(net).started_cycle, due);
    }
    assert_eq!(status(&mut fixture, id).cycle, due);
    // Nets that are never due together are refused after a second.
    let never = [slow(1, 2, 0), slow(2, 2, 1)].map(|plan| fixture.load(plan));
    fixture.ask(|ticket| EngineRequest::Abort {
        ticket,
        id: nets[0],
    });
    fixture.ask(|ticket| EngineRequest::Abort {
        ticket,
        id: nets[1],
    });
    let (id, _) = install(&mut fixture, &[rule(&[RuleTerm::True], &[], &[], &never)]);
    fixture.steps(990);
    assert_eq!(status(&mut fixture, id).state, RuleState::Due);
    fixture.steps(20);
    let refused = status(&mut fixture, id);
    assert!(matches!(refused.refusal, Some((_, Refusal::NeverTogether))));
}

#[test]
fn a_rule_whose_net_to_start_is_not_ready_any_more_expires() {
    let mut fixture = EngineFixture::new();
    let [timer, lamp] = [endless_net(1), output_net(2)].map(|plan| fixture.load(plan));
    cycle_of(fixture.start(timer));
    let (id, _) = install(
        &mut fixture,
        &[rule(&[outcome(timer, 1)], &[], &[], &[lamp])],
    );
    cycle_of(fixture.start(lamp));
    fixture.step();
    let status = status(&mut fixture, id);
    assert_eq!(status.state, RuleState::Expired);
    assert_eq!(status.refusal.map(|(id, _)| id), Some(lamp));
}
