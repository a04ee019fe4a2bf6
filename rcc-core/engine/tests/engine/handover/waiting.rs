//! Hand-overs that wait for a cycle in which all nets are due.

use super::*;
use crate::common::start_of;

/// Requests a hand-over and runs cycles until it is answered.
fn switch_in_time(fixture: &mut EngineFixture, stop: &[u64], start: &[u64]) -> Answer {
    let (stop, start) = (named(stop), named(start));
    let ticket = fixture.order(|ticket| EngineRequest::Handover {
        ticket,
        stop,
        start,
        lease: 0,
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
        lease: 0,
    });
    fixture.step();
    assert_eq!(
        fixture.switch(&[old], &[other]),
        Answer::Refused(Refusal::Overloaded)
    );
    fixture.ask(|ticket| EngineRequest::Unload { ticket, id: new });
    fixture.step();
    let refusal = Refusal::UnknownCommand;
    assert_eq!(
        fixture.answer(ticket),
        Some(Answer::RefusedFor { id: new, refusal })
    );
    assert_eq!(fixture.state(old), CommandState::Running);
}

/// A hand-over that waits, from a running net to one that is due in some cycles only, and one that is due in each.
struct Waiting {
    fixture: EngineFixture,
    old: u64,
    new: [u64; 2],
    ticket: u64,
}

impl Waiting {
    fn new() -> Waiting {
        let (mut fixture, old) = running(output_net(1));
        let new = [drift_net(HOLD[0], 0.0), slow(2, 200, 0)].map(|plan| fixture.load(plan));
        let (stop, start) = (named(&[old]), named(&new));
        let ticket = fixture.order(|ticket| EngineRequest::Handover {
            ticket,
            stop,
            start,
            lease: 0,
        });
        fixture.steps(3);
        Waiting {
            fixture,
            old,
            new,
            ticket,
        }
    }

    /// Asserts that the hand-over was refused because a client stopped a command, and that it starts nothing.
    fn assert_withdrawn(&mut self, id: u64, answer: Option<Answer>) {
        let refusal = Refusal::Withdrawn;
        assert_eq!(answer, Some(Answer::RefusedFor { id, refusal }));
        self.fixture.steps(400);
        for id in self.new {
            assert_eq!(self.fixture.state(id), CommandState::Ready);
            assert_eq!(self.fixture.entry(id).cycles, 0);
        }
    }
}

type Stop = fn(u64, u64) -> EngineRequest;

const STOPS: [Stop; 2] = [
    |ticket, id| EngineRequest::Cancel { ticket, id },
    |ticket, id| EngineRequest::Abort { ticket, id },
];

#[test]
fn a_client_that_stops_a_command_to_be_started_withdraws_the_hand_over() {
    for stop in STOPS {
        for index in 0..2 {
            let mut waiting = Waiting::new();
            let id = waiting.new[index];
            let stopped = waiting.fixture.order(|ticket| stop(ticket, id));
            waiting.fixture.step();
            let answer = waiting.fixture.answer(waiting.ticket);
            let done = waiting.fixture.answer(stopped);
            assert!(matches!(done, Some(Answer::Done { .. })), "{done:?}");
            waiting.assert_withdrawn(id, answer);
            assert_eq!(waiting.fixture.state(waiting.old), CommandState::Running);
        }
    }
}

#[test]
fn a_client_that_stops_the_command_to_be_replaced_withdraws_the_hand_over() {
    for stop in STOPS {
        let mut waiting = Waiting::new();
        let old = waiting.old;
        waiting.fixture.order(|ticket| stop(ticket, old));
        waiting.fixture.step();
        let answer = waiting.fixture.answer(waiting.ticket);
        waiting.assert_withdrawn(waiting.new[0], answer);
        assert_eq!(waiting.fixture.state(old), CommandState::Terminated);
    }
}

#[test]
fn a_hand_over_that_only_stops_withdraws_the_one_that_waits_and_is_carried_out() {
    let mut waiting = Waiting::new();
    let stop = named(&[waiting.old]);
    let start = named(&[]);
    let stopped = waiting.fixture.order(|ticket| EngineRequest::Handover {
        ticket,
        stop,
        start,
        lease: 0,
    });
    waiting.fixture.step();
    let answer = waiting.fixture.answer(waiting.ticket);
    let done = waiting.fixture.answer(stopped);
    assert!(matches!(done, Some(Answer::Done { .. })), "{done:?}");
    waiting.assert_withdrawn(waiting.new[0], answer);
    assert_eq!(waiting.fixture.state(waiting.old), CommandState::Terminated);
}

#[test]
fn a_stop_withdraws_a_start_as_well_as_the_hand_over() {
    for stop in STOPS {
        let mut waiting = Waiting::new();
        let id = waiting.new[1];
        let start = waiting.fixture.order(start_of(id));
        let stopped = waiting.fixture.order(|ticket| stop(ticket, id));
        waiting.fixture.step();
        let answer = waiting.fixture.answer(waiting.ticket);
        assert!(
            matches!(answer, Some(Answer::RefusedFor { .. })),
            "{answer:?}"
        );
        let refused = waiting.fixture.answer(start);
        assert!(matches!(refused, Some(Answer::Refused(_))), "{refused:?}");
        let done = waiting.fixture.answer(stopped);
        assert!(matches!(done, Some(Answer::Done { .. })), "{done:?}");
        waiting.fixture.steps(400);
        assert_eq!(waiting.fixture.entry(id).cycles, 0);
    }
}

#[test]
fn a_hand_over_that_only_stops_withdraws_a_start_and_stops_the_others() {
    let (mut fixture, old) = running(output_net(1));
    let seldom = fixture.load(slow(2, 200, 0));
    fixture.order(start_of(seldom));
    fixture.steps(3);
    let stopped = fixture.switch(&[old, seldom], &[]);
    assert!(matches!(stopped, Answer::Done { .. }), "{stopped:?}");
    assert_eq!(fixture.state(old), CommandState::Terminated);
    fixture.steps(400);
    assert_eq!(fixture.state(seldom), CommandState::Ready);
    assert_eq!(fixture.entry(seldom).cycles, 0);
}
