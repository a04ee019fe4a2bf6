//! Hand-overs that wait for a cycle in which all nets are due.

use super::*;

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
