//! Timing in virtual time: the engine is told the duration of a cycle, and its clock advances at each read.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, VecDeque};

use crate::common::{EngineFixture, PERIOD_NS, endless_net, line_net, output_net, start_of};
use rcc_core::message::{CommandState, EndReason, FaultCode};
use rcc_core::plan::Rate;
use rcc_core::primitives::CATALOGUE;
use rcc_core::timing::LateCause;
use rcc_engine::net::Net;
use rcc_engine::queue::{EngineEvent, EngineRequest};
use rcc_protocol::control::{Answer, PlanData};

/// Advance of the clock per read, unless `STEPS_NS` says otherwise.
const LOOK_NS: u64 = 10;

thread_local! {
    static NOW_NS: Cell<u64> = const { Cell::new(1) };
    /// Advances of the clock at the next reads, ns.
    static STEPS_NS: RefCell<VecDeque<u64>> = const { RefCell::new(VecDeque::new()) };
}

fn clock() -> u64 {
    let step_ns = STEPS_NS.with_borrow_mut(VecDeque::pop_front);
    NOW_NS.set(NOW_NS.get() + step_ns.unwrap_or(LOOK_NS));
    NOW_NS.get()
}

fn fixture() -> EngineFixture {
    let mut fixture = EngineFixture::new();
    fixture.engine = fixture.engine.with_clock(clock);
    fixture
}

fn start(fixture: &mut EngineFixture, id: u64) {
    let answer = fixture.start(id);
    assert!(matches!(answer, Answer::Done { .. }), "{answer:?}");
}

fn acknowledge(fixture: &mut EngineFixture) {
    let answer = fixture.ask(|ticket| EngineRequest::Acknowledge { ticket });
    assert!(matches!(answer, Answer::Done { .. }), "{answer:?}");
}

#[test]
fn first_and_last_late_cycle_are_latched_with_cause_and_most_expensive_net() {
    let mut fixture = fixture();
    let (cheap, dear) = (fixture.load(endless_net(0)), fixture.load(endless_net(1)));
    start(&mut fixture, cheap);
    start(&mut fixture, dear);
    // Two nets read the clock five times; the last read ends the second one.
    STEPS_NS.with_borrow_mut(|steps| steps.extend([LOOK_NS; 5]));
    fixture.steps(1);
    let first_cycle = fixture.engine.status().cycle;
    fixture.engine.account(300, 1_400_000, 1);
    let first = fixture.engine.status().first_late;
    assert_eq!(
        (first.cycle, first.cause),
        (first_cycle, LateCause::ComputedLong as u32)
    );
    assert!(first.command == cheap || first.command == dear);
    assert!(first.command_ns > 0);
    fixture.steps(5);
    fixture.engine.account(2_500_000, 900, 2);
    let status = fixture.engine.status();
    assert_eq!(status.first_late, first, "the first stays");
    assert_eq!(status.last_late.cycle, first_cycle + 5);
    assert_eq!(status.last_late.cause, LateCause::WokenLate as u32);
    assert_eq!(status.last_late.skipped_periods, 2);
    assert_eq!((status.late_woken, status.late_computed), (1, 1));
}

#[test]
fn the_most_expensive_net_of_a_late_cycle_computed_longest_in_it() {
    let mut fixture = fixture();
    let (first, second) = (fixture.load(endless_net(0)), fixture.load(endless_net(1)));
    start(&mut fixture, first);
    start(&mut fixture, second);
    // Whichever of the two is timed in detail, the second read is within the first net, and the fifth ends the second.
    for (looks, dear) in [([1, 9_000, 1, 1, 1], first), ([1, 1, 1, 1, 9_000], second)] {
        STEPS_NS.with_borrow_mut(|steps| steps.extend(looks));
        fixture.steps(1);
        fixture.engine.account(0, 2_000_000, 1);
        assert_eq!(fixture.engine.status().last_late.command, dear);
        STEPS_NS.with_borrow_mut(VecDeque::clear);
    }
}

#[test]
fn the_time_of_a_net_begins_where_that_of_the_net_before_ends() {
    let mut fixture = fixture();
    let ids = [fixture.load(endless_net(0)), fixture.load(endless_net(1))];
    ids.iter().for_each(|id| start(&mut fixture, *id));
    let before_ns = NOW_NS.get();
    fixture.steps(1);
    let all_ns = NOW_NS.get() - before_ns;
    let nets_ns: u64 = ids.iter().map(|id| fixture.entry(*id).exec_last_ns).sum();
    // Without the read with which the first one begins.
    assert_eq!((all_ns, nets_ns), (5 * LOOK_NS, 4 * LOOK_NS));
}

#[test]
fn an_acknowledgement_resets_the_counts_and_is_logged() {
    let mut fixture = fixture();
    fixture.engine.account(5_000, 2_000_000, 1);
    fixture.engine.account(5_000, 2_000_000, 1);
    acknowledge(&mut fixture);
    let status = *fixture.engine.status();
    assert_eq!(
        (status.late, status.late_acknowledged),
        (2, 2),
        "the whole count stays"
    );
    assert_eq!((status.first_late.cycle, status.last_late.cycle), (0, 0));
    assert_eq!((status.late_woken, status.late_computed), (0, 2));
    let timing = fixture.engine.timing();
    assert_eq!(timing.exec_acknowledged.max(), 2_000_000);
    assert!(
        timing.exec_acknowledged.sum() >= 4_000_000 && timing.wake_acknowledged.sum() >= 10_000
    );
    assert_eq!(timing.acknowledged_cycle, status.cycle);
    assert!(timing.exec.max() < 2_000_000 && timing.exec.count() <= 1);
    let told = std::iter::from_fn(|| fixture.ends.events.pop().ok())
        .any(|event| matches!(event, EngineEvent::Acknowledged { late: 2, .. }));
    assert!(told);
}

#[test]
fn nets_are_not_ended_for_cycles_that_were_woken_late() {
    let mut fixture = fixture();
    let id = fixture.load(endless_net(0));
    start(&mut fixture, id);
    (0..100).for_each(|_| fixture.engine.account(3_000_000, 2_000, 3));
    assert_eq!(fixture.state(id), CommandState::Running);
    // Between cycles with long computation they neither count nor reset the count.
    for _ in 0..2 {
        fixture.engine.account(0, 2_000_000, 1);
        fixture.engine.account(3_000_000, 2_000, 3);
    }
    assert_eq!(fixture.state(id), CommandState::Running);
    fixture.engine.account(0, 2_000_000, 1);
    assert_eq!(fixture.reason(id), EndReason::Fault);
    assert_eq!(fixture.entry(id).fault.code, FaultCode::Overrun as u32);
}

#[test]
fn the_net_that_took_longest_in_the_late_cycle_is_ended_and_none_that_was_not_evaluated() {
    let mut fixture = fixture();
    let every = PlanData {
        rate: Rate {
            every: 1000,
            phase: 0,
        },
        ..endless_net(0)
    };
    let (seldom, often) = (fixture.load(every), fixture.load(endless_net(1)));
    fixture.order(start_of(seldom));
    while !(fixture.engine.status().cycle + 1).is_multiple_of(1000) {
        fixture.step();
    }
    // The net at the slow rate takes long, in a cycle that is in time.
    STEPS_NS.with_borrow_mut(|steps| steps.extend([900_000; 2]));
    fixture.step();
    STEPS_NS.with_borrow_mut(VecDeque::clear);
    assert!(fixture.entry(seldom).exec_last_ns >= 900_000);
    start(&mut fixture, often);
    (0..3).for_each(|_| fixture.engine.account(0, 2_000_000, 1));
    assert_eq!(fixture.entry(often).fault.code, FaultCode::Overrun as u32);
    assert_eq!(fixture.state(seldom), CommandState::Running);
}

#[test]
fn without_a_net_too_many_late_cycles_end_nothing() {
    let mut fixture = fixture();
    let id = fixture.load(endless_net(0));
    (0..100).for_each(|_| fixture.engine.account(0, 2_000_000, 1));
    assert_eq!(fixture.state(id), CommandState::Ready);
}

/// Number of runs timed so far, by type.
fn timed(fixture: &EngineFixture) -> BTreeMap<&'static str, u64> {
    let rows = CATALOGUE.iter().zip(&fixture.engine.timing().primitives);
    rows.filter(|(_, row)| row.runs > 0)
        .map(|(entry, row)| (entry.spec.name, row.runs))
        .collect()
}

#[test]
fn every_run_of_every_active_net_is_timed_in_turn() {
    let mut fixture = fixture();
    let (first, second) = (fixture.load(output_net(0)), fixture.load(endless_net(1)));
    start(&mut fixture, first);
    start(&mut fixture, second);
    acknowledge(&mut fixture);
    fixture.steps(3 * 5 - 1);
    let wanted = [("Cancel", 3), ("DigitalOutput", 6), ("Termination", 6)];
    assert_eq!(timed(&fixture), BTreeMap::from(wanted));
    let rows = fixture.engine.timing().primitives;
    let sum_ns: u64 = rows.iter().map(|row| row.sum_ns).sum();
    assert_eq!(sum_ns, 15 * LOOK_NS, "each includes one clock read");
}

#[test]
fn nets_that_have_ended_are_not_timed() {
    let mut fixture = fixture();
    let (first, second) = (fixture.load(output_net(0)), fixture.load(endless_net(1)));
    start(&mut fixture, first);
    start(&mut fixture, second);
    fixture.ask(|ticket| EngineRequest::Abort { ticket, id: first });
    acknowledge(&mut fixture);
    fixture.steps(9);
    assert_eq!(
        timed(&fixture),
        BTreeMap::from([("DigitalOutput", 5), ("Termination", 5)])
    );
}

#[test]
fn a_timed_run_computes_the_same() {
    let fixture = EngineFixture::new();
    let mut plain = fixture.build(line_net()).expect("a good plan");
    let mut detailed = fixture.build(line_net()).expect("a good plan");
    let runs = detailed.runs();
    for cycle in 0..3 * (runs + 1) {
        let plainly = plain.evaluate(&fixture.models, &[], 1e-3);
        let timed = (cycle % (runs + 1), clock as fn() -> u64);
        let (evaluation, time) = detailed.evaluate_timed(&fixture.models, &[], 1e-3, timed);
        assert_eq!(plainly, evaluation);
        let position = |net: &Net| net.outputs()[0].position.map(f64::to_bits);
        assert_eq!(position(&plain), position(&detailed));
        assert_eq!(time.is_some(), timed.0 < runs, "no run with that index");
    }
}

#[test]
fn histograms_contain_every_cycle() {
    let mut fixture = fixture();
    acknowledge(&mut fixture);
    fixture.steps(49);
    fixture.engine.account(700, 40_000, 0);
    let timing = fixture.engine.timing();
    // The cycle of the acknowledgement is the first of the new count; one cycle is accounted twice here.
    assert_eq!((timing.exec.count(), timing.wake.count()), (51, 51));
    assert_eq!((timing.exec.max(), timing.wake.max()), (40_000, 700));
    assert_eq!(timing.length.count(), 49);
    assert_eq!(
        (timing.length.min(), timing.length.max()),
        (PERIOD_NS, PERIOD_NS)
    );
}

#[test]
fn timing_is_written_ten_times_a_second_and_when_acknowledged() {
    let mut fixture = fixture();
    let due = (0..1000).filter(|_| {
        fixture.step();
        fixture.engine.timing_due()
    });
    assert_eq!(due.count(), 10);
    acknowledge(&mut fixture);
    assert!(fixture.engine.timing_due());
}
