//! Leases: what happens to rules and commands when their client is gone.

use super::*;

const EXPIRES_NS: u64 = 100_000_000;

fn grant(fixture: &mut EngineFixture) -> u64 {
    let answer = fixture.ask(|ticket| EngineRequest::GrantLease {
        ticket,
        expires_ns: EXPIRES_NS,
    });
    match answer {
        Answer::Reserved { id } => id,
        answer => panic!("{answer:?}"),
    }
}

fn renew(fixture: &mut EngineFixture, lease: u64) -> Answer {
    fixture.ask(|ticket| EngineRequest::RenewLease { ticket, lease })
}

fn leased(lease: u64, rule: Rule) -> Rule {
    Rule {
        lease,
        goes_on: false,
        ..rule
    }
}

/// An arm that drifts until `over`, another one that follows, and a rule between them.
fn handing_over(lease: u64, fixture: &mut EngineFixture) -> (u64, u64, Rule) {
    let first = fixture.load(drift_until(HOLD[0], 0.0, 500));
    let second = fixture.load(drift_net(HOLD[0], 0.0));
    let rule = rule(&[over(first)], &[first], &[], &[second]);
    (first, second, leased(lease, rule))
}

#[test]
fn a_rule_of_a_client_that_is_gone_starts_no_arm() {
    let mut fixture = EngineFixture::new();
    let lease = grant(&mut fixture);
    let (first, second, rule) = handing_over(lease, &mut fixture);
    let (id, _) = install(&mut fixture, &[rule]);
    cycle_of(fixture.start(first));
    for _ in 0..5 {
        fixture.steps(50);
        cycle_of(renew(&mut fixture, lease));
    }
    let renewed = fixture.engine.status().cycle;
    fixture.steps(600);
    assert_eq!(fixture.state(first), CommandState::Running);
    assert_eq!(fixture.state(second), CommandState::Ready);
    let status = status(&mut fixture, id);
    let lost = DisarmReason::ClientLost { lease };
    assert_eq!(status.disarmed, Some(lost));
    assert_eq!(status.cycle, renewed + EXPIRES_NS / 1_000_000 + 1);
    let answer = renew(&mut fixture, lease);
    assert!(matches!(answer, Answer::Refused(Refusal::Rule { .. })));
}

#[test]
fn a_rule_that_goes_on_does_and_one_whose_client_is_there_too() {
    for goes_on in [false, true] {
        let mut fixture = EngineFixture::new();
        let lease = grant(&mut fixture);
        let (first, second, rule) = handing_over(lease, &mut fixture);
        install(&mut fixture, &[Rule { goes_on, ..rule }]);
        cycle_of(fixture.start(first));
        for _ in 0..20 {
            fixture.steps(50);
            if !goes_on {
                cycle_of(renew(&mut fixture, lease));
            }
        }
        assert_eq!(fixture.state(second), CommandState::Running);
        // Commands that a rule with a lease has started are bound to it, except with `goes_on`.
        fixture.steps(200);
        assert_eq!(fixture.state(second).is_active(), goes_on);
    }
}

#[test]
fn commands_that_are_bound_are_canceled_or_aborted_when_the_lease_is_lost() {
    for ended in [false, true] {
        let mut fixture = EngineFixture::new();
        let lease = grant(&mut fixture);
        let [line, endless, free] =
            [line_net(), endless_net(1), endless_net(2)].map(|plan| fixture.load(plan));
        let commands = named(&[line, endless]);
        cycle_of(fixture.ask(|ticket| EngineRequest::BindLease {
            ticket,
            lease,
            commands,
        }));
        for id in [line, endless, free] {
            cycle_of(fixture.start(id));
        }
        fixture.steps(20);
        if ended {
            cycle_of(fixture.ask(|ticket| EngineRequest::EndLease { ticket, lease }));
        } else {
            fixture.steps(100);
        }
        assert_eq!(fixture.state(line), CommandState::Canceling);
        assert_eq!(fixture.reason(endless), EndReason::Aborted);
        assert_eq!(fixture.state(free), CommandState::Running);
        assert_eq!(fixture.until_terminated(line, 1000), EndReason::Canceled);
        let mut events = std::iter::from_fn(|| fixture.ends.events.pop().ok());
        let lost = events.find_map(|event| match event {
            EngineEvent::LeaseLost {
                lease, commands, ..
            } => Some((lease, commands)),
            _ => None,
        });
        assert_eq!(lost, Some((lease, 2)));
    }
}

fn bind(fixture: &mut EngineFixture, lease: u64, commands: &[u64]) -> Answer {
    let commands = named(commands);
    fixture.ask(|ticket| EngineRequest::BindLease {
        ticket,
        lease,
        commands,
    })
}

#[test]
fn a_command_whose_client_is_gone_is_not_started() {
    let mut fixture = EngineFixture::new();
    let (lease, other) = (grant(&mut fixture), grant(&mut fixture));
    let arm = fixture.load(drift_net(HOLD[0], 0.0));
    cycle_of(bind(&mut fixture, lease, &[arm]));
    for _ in 0..5 {
        cycle_of(renew(&mut fixture, other));
        fixture.steps(50);
    }
    let ended = Refusal::LeaseEnded { lease };
    assert_eq!(fixture.start(arm), Answer::Refused(ended));
    let refused = fixture.switch(&[], &[arm]);
    let (id, refusal) = (arm, ended);
    assert_eq!(refused, Answer::RefusedFor { id, refusal });
    assert_eq!(fixture.entry(arm).cycles, 0);
    // Bound to another client it starts, and with it it ends.
    cycle_of(bind(&mut fixture, other, &[arm]));
    cycle_of(fixture.start(arm));
    fixture.steps(200);
    assert_eq!(fixture.reason(arm), EndReason::Aborted);
}

#[test]
fn a_hand_over_that_waits_starts_nothing_after_its_client_is_gone() {
    let mut fixture = EngineFixture::new();
    let lease = grant(&mut fixture);
    let slow = PlanData {
        rate: Rate {
            every: 1000,
            phase: 0,
        },
        ..output_net(1)
    };
    let ids = [slow, drift_net(HOLD[0], 0.0)].map(|plan| fixture.load(plan));
    cycle_of(bind(&mut fixture, lease, &ids));
    let (stop, start) = (named(&[]), named(&ids));
    let ticket = fixture.order(|ticket| EngineRequest::Handover {
        ticket,
        stop,
        start,
        lease: 0,
    });
    fixture.steps(200);
    let (id, refusal) = (ids[0], Refusal::LeaseEnded { lease });
    let refused = Answer::RefusedFor { id, refusal };
    assert_eq!(fixture.answer(ticket), Some(refused));
    fixture.steps(1000);
    assert!(ids.iter().all(|id| fixture.entry(*id).cycles == 0));
}

fn start_for(fixture: &mut EngineFixture, lease: u64, id: u64) -> Answer {
    fixture.ask(|ticket| EngineRequest::Start { ticket, id, lease })
}

#[test]
fn a_command_that_is_started_for_a_client_ends_with_it() {
    let mut fixture = EngineFixture::new();
    let lease = grant(&mut fixture);
    let [arm, lamp] = [drift_net(HOLD[0], 0.0), output_net(1)].map(|plan| fixture.load(plan));
    cycle_of(start_for(&mut fixture, lease, arm));
    let (stop, start) = (named(&[]), named(&[lamp]));
    cycle_of(fixture.ask(|ticket| EngineRequest::Handover {
        ticket,
        stop,
        start,
        lease,
    }));
    fixture.steps(200);
    assert_eq!(fixture.reason(arm), EndReason::Aborted);
    assert_eq!(fixture.reason(lamp), EndReason::Canceled);
    let again = fixture.load(drift_net(HOLD[0], 0.0));
    let refused = Answer::Refused(Refusal::LeaseEnded { lease });
    assert_eq!(start_for(&mut fixture, lease, again), refused);
    assert_eq!(fixture.entry(again).cycles, 0);
}

#[test]
fn a_start_that_is_refused_leaves_a_running_command_bound_to_its_client() {
    let mut fixture = EngineFixture::new();
    let [own, other] = [(); 2].map(|()| grant(&mut fixture));
    let arm = fixture.load(drift_net(HOLD[0], 0.0));
    cycle_of(start_for(&mut fixture, own, arm));
    // Another client takes it for its own, with START and with a hand-over.
    let refused = start_for(&mut fixture, other, arm);
    assert!(matches!(refused, Answer::Refused(_)), "{refused:?}");
    let (stop, start) = (named(&[]), named(&[arm]));
    let refused = fixture.ask(|ticket| EngineRequest::Handover {
        ticket,
        stop,
        start,
        lease: other,
    });
    assert!(matches!(refused, Answer::RefusedFor { .. }), "{refused:?}");
    for _ in 0..4 {
        cycle_of(renew(&mut fixture, other));
        fixture.steps(50);
    }
    assert_eq!(fixture.reason(arm), EndReason::Aborted);
}

#[test]
fn a_start_that_waits_is_withdrawn_when_its_client_is_gone() {
    let mut fixture = EngineFixture::new();
    let lease = grant(&mut fixture);
    let seldom = PlanData {
        rate: Rate {
            every: 1000,
            phase: 0,
        },
        ..output_net(1)
    };
    let id = fixture.load(seldom);
    let ticket = fixture.order(|ticket| EngineRequest::Start { ticket, id, lease });
    fixture.steps(1200);
    let refused = Answer::Refused(Refusal::Withdrawn);
    assert_eq!(fixture.answer(ticket), Some(refused));
    assert_eq!(fixture.entry(id).cycles, 0);
    assert_eq!(fixture.state(id), CommandState::Ready);
}

#[test]
fn a_row_that_is_used_again_is_not_bound_any_more() {
    let mut fixture = EngineFixture::new();
    let lease = grant(&mut fixture);
    let old = fixture.load(endless_net(1));
    let commands = named(&[old]);
    cycle_of(fixture.ask(|ticket| EngineRequest::BindLease {
        ticket,
        lease,
        commands,
    }));
    cycle_of(fixture.ask(|ticket| EngineRequest::Unload { ticket, id: old }));
    let new = fixture.load(endless_net(1));
    cycle_of(fixture.start(new));
    fixture.steps(300);
    assert_eq!(fixture.state(new), CommandState::Running);
}

#[test]
fn leases_are_bounded_in_number_and_time() {
    let mut fixture = EngineFixture::new();
    for expires_ns in [0, 1, u64::MAX] {
        let answer = fixture.ask(|ticket| EngineRequest::GrantLease { ticket, expires_ns });
        assert!(matches!(answer, Answer::Refused(Refusal::LeaseTime { .. })));
    }
    let mut granted = 0;
    loop {
        let answer = fixture.ask(|ticket| EngineRequest::GrantLease {
            ticket,
            expires_ns: 3_600_000_000_000,
        });
        match answer {
            Answer::Reserved { .. } => granted += 1,
            Answer::Refused(Refusal::LeasesFull { max }) => {
                assert_eq!(granted, max);
                return;
            }
            answer => panic!("{answer:?}"),
        }
    }
}
