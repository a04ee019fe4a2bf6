//! Admission in virtual time: the expected durations of nets are given to the engine, nothing is measured.

use crate::common::{EngineFixture, endless_net, output_net};
use rcc_core::message::{CommandState, EndReason};
use rcc_core::plan::Rate;
use rcc_engine::queue::EngineRequest;
use rcc_protocol::control::{Answer, Refusal, SWITCH_MAX};

const BUDGET_NS: u64 = 500_000;

fn fixture() -> EngineFixture {
    let mut fixture = EngineFixture::new();
    fixture.engine = fixture.engine.with_budget(BUDGET_NS);
    fixture
}

/// Loads a net with this expected duration (ns) and rate.
fn load(fixture: &mut EngineFixture, channel: u32, expected_ns: u64, rate: Rate) -> u64 {
    let mut plan = endless_net(channel);
    plan.rate = rate;
    let mut net = fixture.build(plan).expect("a good plan");
    net.expected_ns = expected_ns;
    let Answer::Reserved { id } = fixture.ask(|ticket| EngineRequest::Reserve { ticket }) else {
        panic!("no row")
    };
    fixture.ask(|ticket| EngineRequest::Install { ticket, id, net });
    id
}

fn refused(needed_ns: u64, in_use_ns: u64) -> Answer {
    Answer::Refused(Refusal::Budget {
        needed_ns,
        in_use_ns,
        budget_ns: BUDGET_NS,
    })
}

#[test]
fn what_a_net_is_expected_to_need_is_in_the_table() {
    let mut fixture = fixture();
    let id = load(&mut fixture, 0, 123_456, Rate::EVERY_CYCLE);
    assert_eq!(fixture.entry(id).expected_ns, 123_456);
    assert_eq!(fixture.engine.status().budget_ns, BUDGET_NS);
}

#[test]
fn a_start_beyond_the_budget_is_refused_with_the_numbers_and_changes_nothing() {
    let mut fixture = fixture();
    let first = load(&mut fixture, 0, 300_000, Rate::EVERY_CYCLE);
    let second = load(&mut fixture, 1, 200_001, Rate::EVERY_CYCLE);
    let third = load(&mut fixture, 2, 200_000, Rate::EVERY_CYCLE);
    assert!(matches!(fixture.start(first), Answer::Done { .. }));
    assert_eq!(fixture.start(second), refused(200_001, 300_000));
    assert_eq!(fixture.state(second), CommandState::Ready);
    assert!(
        matches!(fixture.start(third), Answer::Done { .. }),
        "exactly the budget"
    );
}

#[test]
fn a_net_that_needs_more_than_the_budget_alone_never_starts() {
    let mut fixture = fixture();
    let id = load(&mut fixture, 0, u64::MAX, Rate::EVERY_CYCLE);
    assert_eq!(fixture.start(id), refused(u64::MAX, 0));
}

#[test]
fn what_is_over_needs_nothing_any_more() {
    let mut fixture = fixture();
    let first = load(&mut fixture, 0, 300_000, Rate::EVERY_CYCLE);
    let second = load(&mut fixture, 1, 300_000, Rate::EVERY_CYCLE);
    fixture.start(first);
    assert_eq!(fixture.start(second), refused(300_000, 300_000));
    fixture.ask(|ticket| EngineRequest::Abort { ticket, id: first });
    assert_eq!(fixture.reason(first), EndReason::Aborted);
    assert!(matches!(fixture.start(second), Answer::Done { .. }));
}

#[test]
fn two_starts_of_one_cycle_count_each_other() {
    let mut fixture = fixture();
    let ids = [0, 1].map(|channel| load(&mut fixture, channel, 300_000, Rate::EVERY_CYCLE));
    for (ticket, id) in (100..).zip(ids) {
        fixture
            .ends
            .requests
            .push(EngineRequest::Start {
                ticket,
                id,
                lease: 0,
            })
            .expect("room");
    }
    fixture.step();
    // The second is answered at once, the first after its evaluation.
    assert_eq!(fixture.answer(101), Some(refused(300_000, 300_000)));
    assert!(matches!(fixture.answer(100), Some(Answer::Done { .. })));
}

#[test]
fn nets_count_together_unless_no_cycle_has_both() {
    let mut fixture = fixture();
    let every = |every, phase| Rate { every, phase };
    let even = load(&mut fixture, 0, 400_000, every(2, 0));
    let odd = load(&mut fixture, 1, 400_000, every(2, 1));
    let third = load(&mut fixture, 2, 400_000, every(3, 0));
    assert!(matches!(fixture.start(even), Answer::Done { .. }));
    fixture
        .ends
        .requests
        .push(EngineRequest::Start {
            ticket: 77,
            id: odd,
            lease: 0,
        })
        .expect("room");
    fixture.steps(2);
    assert!(
        matches!(fixture.answer(77), Some(Answer::Done { .. })),
        "never together"
    );
    assert_eq!(fixture.start(third), refused(400_000, 800_000));
}

#[test]
fn without_a_budget_everything_is_admitted() {
    let mut fixture = EngineFixture::new();
    let id = load(&mut fixture, 0, u64::MAX, Rate::EVERY_CYCLE);
    assert!(matches!(fixture.start(id), Answer::Done { .. }));
}

#[test]
fn a_hand_over_counts_those_that_begin_and_not_those_that_leave() {
    let mut fixture = fixture();
    let old = load(&mut fixture, 0, 400_000, Rate::EVERY_CYCLE);
    let (new, more) = (
        load(&mut fixture, 0, 300_000, Rate::EVERY_CYCLE),
        load(&mut fixture, 1, 200_001, Rate::EVERY_CYCLE),
    );
    fixture.start(old);
    let switch = |fixture: &mut EngineFixture, ids: &[u64]| {
        let (mut stop, mut start) = ([0; SWITCH_MAX], [0; SWITCH_MAX]);
        stop[0] = old;
        start[..ids.len()].copy_from_slice(ids);
        fixture.ask(|ticket| EngineRequest::Handover {
            ticket,
            stop,
            start,
            lease: 0,
        })
    };
    let refusal = switch(&mut fixture, &[new, more]);
    assert!(
        matches!(
            refusal,
            Answer::RefusedFor {
                refusal: Refusal::Budget {
                    needed_ns: 300_000,
                    in_use_ns: 200_001,
                    ..
                },
                ..
            }
        ),
        "{refusal:?}"
    );
    assert_eq!(fixture.state(old), CommandState::Running);
    assert!(matches!(switch(&mut fixture, &[new]), Answer::Done { .. }));
    assert_eq!(fixture.state(new), CommandState::Running);
}

#[test]
fn a_net_that_ends_by_itself_leaves_its_share() {
    let mut fixture = fixture();
    let mut net = fixture.build(output_net(0)).expect("a good plan");
    net.expected_ns = 400_000;
    let Answer::Reserved { id } = fixture.ask(|ticket| EngineRequest::Reserve { ticket }) else {
        panic!("no row")
    };
    fixture.ask(|ticket| EngineRequest::Install { ticket, id, net });
    fixture.start(id);
    fixture.ask(|ticket| EngineRequest::Cancel { ticket, id });
    fixture.steps(2);
    assert_eq!(fixture.state(id), CommandState::Terminated);
    let next = load(&mut fixture, 1, 400_000, Rate::EVERY_CYCLE);
    assert!(matches!(fixture.start(next), Answer::Done { .. }));
}
