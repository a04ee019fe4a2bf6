//! Nets that are not evaluated in every cycle, and base periods from 125 µs to 20 ms, in virtual time.

use crate::common::{EngineFixture, line_net, output_net, start_of, time_net};
use rcc_core::message::{CommandState, DeviceState, EndReason, SetPoint};
use rcc_core::plan::{PlanError, Rate};
use rcc_engine::queue::EngineRequest;
use rcc_protocol::control::{Answer, Refusal};

const FIFTH: Rate = Rate { every: 5, phase: 2 };

fn cycle(fixture: &EngineFixture) -> u64 {
    fixture.engine.status().cycle
}

fn newest(fixture: &EngineFixture) -> SetPoint {
    let image = fixture.engine.image(0).unwrap();
    *image.at(image.head.sequence).unwrap()
}

/// Steps until `FIFTH` is due neither in the next cycle nor in the one after it.
fn between(fixture: &mut EngineFixture) {
    while (cycle(fixture) + 1) % 5 != 3 {
        fixture.step();
    }
}

/// Starts a net with the rate `FIFTH`; returns it with the cycle of its first evaluation.
fn started(fixture: &mut EngineFixture) -> (u64, u64) {
    let id = fixture.load(time_net(FIFTH));
    let ticket = fixture.order(start_of(id));
    for _ in 0..5 {
        fixture.step();
        if let Some(answer) = fixture.answer(ticket) {
            let cycle = cycle(fixture);
            assert_eq!(answer, Answer::Done { cycle });
            return (id, cycle);
        }
    }
    panic!("START was not answered within a period of the net");
}

#[test]
fn a_net_is_evaluated_in_its_cycles_and_its_time_is_exact() {
    let mut fixture = EngineFixture::new();
    let (id, first) = started(&mut fixture);
    assert_eq!(first % 5, 2, "START takes effect in the net's next cycle");
    assert_eq!(fixture.entry(id).started_cycle, first);
    fixture.steps(5 * 700);
    let records = fixture.records();
    assert_eq!(records.len(), 701);
    for (record, evaluation) in records.iter().zip(0u64..) {
        assert_eq!(record.cycle, first + 5 * evaluation);
        assert_eq!(
            record.values[0],
            evaluation as f64 * 5e-3,
            "in the net's {evaluation}th"
        );
    }
    assert_eq!(fixture.entry(id).cycles, 701);
}

#[test]
fn between_two_evaluations_outputs_stay_commanded() {
    let mut fixture = EngineFixture::new();
    let (_, first) = started(&mut fixture);
    for _ in 0..50 {
        let evaluations = (cycle(&fixture) - first) / 5;
        assert_eq!(newest(&fixture).analog[0], evaluations as f64 * 5e-3);
        fixture.step();
    }
}

#[test]
fn monitors_are_due_by_evaluations() {
    let mut fixture = EngineFixture::new();
    let mut plan = time_net(FIFTH);
    plan.monitors[0].every = 3;
    let id = fixture.load(plan);
    fixture.order(start_of(id));
    fixture.steps(5 * 9);
    let cycles: Vec<u64> = fixture
        .records()
        .iter()
        .map(|record| record.cycle)
        .collect();
    assert_eq!(cycles.len(), 3);
    assert!(
        cycles.windows(2).all(|pair| pair[1] - pair[0] == 15),
        "{cycles:?}"
    );
}

#[test]
fn the_resources_of_a_slow_net_are_held_from_start_on() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(time_net(FIFTH));
    let other = fixture.load(time_net(Rate::EVERY_CYCLE));
    between(&mut fixture);
    fixture.order(start_of(id));
    let answer = fixture.start(other);
    let busy = matches!(answer, Answer::Refused(Refusal::Busy { holder, .. }) if holder == id);
    assert!(busy, "{answer:?}");
    assert_eq!(
        fixture.state(id),
        CommandState::Ready,
        "its first cycle has not come"
    );
}

#[test]
fn cancel_is_seen_by_the_next_evaluation_and_abort_takes_effect_at_once() {
    let mut fixture = EngineFixture::new();
    let (id, _) = started(&mut fixture);
    between(&mut fixture);
    let asked = cycle(&fixture);
    fixture.ask(|ticket| EngineRequest::Cancel { ticket, id });
    assert_eq!(fixture.state(id), CommandState::Canceling);
    assert_eq!(fixture.until_terminated(id, 5), EndReason::Canceled);
    assert_eq!(fixture.entry(id).ended_cycle, asked + 5);
    let (id, _) = started(&mut fixture);
    between(&mut fixture);
    fixture.ask(|ticket| EngineRequest::Abort { ticket, id });
    assert_eq!(fixture.reason(id), EndReason::Aborted);
    assert!(newest(&fixture).analog[0].is_nan(), "no command any more");
}

#[test]
fn abort_before_the_first_cycle_prevents_it() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(time_net(FIFTH));
    between(&mut fixture);
    let start = fixture.order(start_of(id));
    fixture.step();
    let abort = fixture.order(|ticket| EngineRequest::Abort { ticket, id });
    fixture.step();
    let refused = Refusal::WrongState {
        state: CommandState::Terminated as u32,
    };
    assert_eq!(fixture.answer(start), Some(Answer::Refused(refused)));
    assert!(matches!(fixture.answer(abort), Some(Answer::Done { .. })));
    fixture.steps(10);
    assert_eq!(
        (fixture.reason(id), fixture.entry(id).cycles),
        (EndReason::Aborted, 0)
    );
}

#[test]
fn cancel_before_the_first_cycle_withdraws_the_start() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(time_net(FIFTH));
    between(&mut fixture);
    let start = fixture.order(start_of(id));
    fixture.step();
    let cancel = fixture.order(|ticket| EngineRequest::Cancel { ticket, id });
    fixture.step();
    assert_eq!(
        fixture.answer(start),
        Some(Answer::Refused(Refusal::Withdrawn))
    );
    assert!(matches!(fixture.answer(cancel), Some(Answer::Done { .. })));
    fixture.steps(10);
    assert_eq!(
        (fixture.state(id), fixture.entry(id).cycles),
        (CommandState::Ready, 0)
    );
    // START and CANCEL in one cycle.
    let start = fixture.order(start_of(id));
    fixture.order(|ticket| EngineRequest::Cancel { ticket, id });
    fixture.step();
    assert_eq!(
        fixture.answer(start),
        Some(Answer::Refused(Refusal::Withdrawn))
    );
    assert_eq!(fixture.state(id), CommandState::Ready);
}

#[test]
fn an_executor_that_stops_does_not_begin_a_first_cycle() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(time_net(FIFTH));
    between(&mut fixture);
    let start = fixture.order(start_of(id));
    while (cycle(&fixture) + 1) % 5 != 2 {
        fixture.step();
    }
    fixture.engine.begin_stop();
    fixture.step();
    assert_eq!(
        fixture.answer(start),
        Some(Answer::Refused(Refusal::Stopping))
    );
    assert!(fixture.engine.is_idle());
    assert_eq!(fixture.entry(id).cycles, 0);
}

#[test]
fn an_executor_that_stops_does_not_wait_for_a_first_cycle() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(time_net(FIFTH));
    between(&mut fixture);
    let start = fixture.order(start_of(id));
    fixture.step();
    fixture.engine.begin_stop();
    fixture.step();
    assert_eq!(
        fixture.answer(start),
        Some(Answer::Refused(Refusal::Stopping))
    );
    assert!(fixture.engine.is_idle());
}

#[test]
fn a_device_that_is_lost_between_two_evaluations_ends_the_net_at_once() {
    let mut fixture = EngineFixture::new();
    let (id, _) = started(&mut fixture);
    between(&mut fixture);
    fixture.driver.measurement.state = DeviceState::Offline as u32;
    fixture.step();
    assert_eq!(fixture.reason(id), EndReason::Fault);
    assert_eq!(fixture.entry(id).ended_cycle, cycle(&fixture));
    assert!(newest(&fixture).analog[0].is_nan());
}

#[test]
fn a_device_that_is_lost_before_the_first_cycle_refuses_the_start() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(time_net(FIFTH));
    between(&mut fixture);
    let start = fixture.order(start_of(id));
    fixture.step();
    fixture.driver.measurement.state = DeviceState::Offline as u32;
    fixture.steps(5);
    let answer = fixture.answer(start);
    let not_ready = Some(Answer::Refused(Refusal::DeviceNotReady {
        device: 0,
        state: DeviceState::Offline as u32,
        reason: 0,
    }));
    assert_eq!(answer, not_ready);
    assert_eq!(fixture.state(id), CommandState::Ready);
}

#[test]
fn nets_of_several_rates_run_beside_each_other() {
    let mut fixture = EngineFixture::new();
    let (slow, first) = started(&mut fixture);
    let fast = fixture.load(output_net(1));
    fixture.start(fast);
    let begun = cycle(&fixture);
    fixture.steps(1000);
    assert_eq!(fixture.entry(fast).cycles, 1001);
    assert_eq!(fixture.entry(slow).cycles, (begun + 1000 - first) / 5 + 1);
    let both = newest(&fixture);
    assert_eq!(both.digital_commanded, 0b10);
    assert!(!both.analog[0].is_nan());
}

#[test]
fn a_plan_with_an_invalid_rate_is_refused() {
    let fixture = EngineFixture::new();
    for (every, phase) in [(0, 0), (5, 5), (10_001, 0)] {
        let refused = fixture.build(time_net(Rate { every, phase })).err();
        assert_eq!(
            refused,
            Some(Refusal::Plan(PlanError::BadRate)),
            "{every} {phase}"
        );
    }
    let mut line = line_net();
    line.rate = Rate { every: 2, phase: 0 };
    let refused = fixture.build(line).err();
    assert_eq!(
        refused,
        Some(Refusal::Plan(PlanError::SlowArm { device: 0 }))
    );
}

/// A line of 0.1 m with these limits takes about 0.80 s, and the cycles in which it begins and ends.
#[test]
fn a_line_takes_the_same_logical_time_at_every_base_period() {
    let periods = [125_000, 250_000, 500_000, 1_000_000, 5_000_000, 20_000_000];
    let seconds = periods.map(|period_ns| {
        let mut fixture = EngineFixture::at_period(period_ns);
        let id = fixture.load(line_net());
        assert!(matches!(fixture.start(id), Answer::Done { .. }));
        let most = 3_000_000_000 / period_ns;
        assert_eq!(
            fixture.until_terminated(id, most as usize),
            EndReason::Finished
        );
        let image = fixture.engine.image(0).unwrap();
        assert_eq!(
            image.at(image.head.sequence).unwrap().logical_ns,
            image.head.sequence * period_ns
        );
        fixture.entry(id).cycles as f64 * period_ns as f64 * 1e-9
    });
    let least = seconds[0] - 2.0 * 125e-6;
    for (taken, period_ns) in seconds.iter().zip(periods) {
        let more = taken - least;
        let cycles = 2.0 * period_ns as f64 * 1e-9 + 2.0 * 125e-6;
        assert!(more >= 0.0 && more <= cycles, "{period_ns}: {seconds:?}");
    }
}

#[test]
fn time_is_exact_at_every_base_period() {
    for period_ns in [125_000, 20_000_000] {
        let mut fixture = EngineFixture::at_period(period_ns);
        let id = fixture.load(time_net(Rate::EVERY_CYCLE));
        fixture.start(id);
        fixture.steps(8000);
        let last = fixture.records().last().copied().unwrap();
        assert_eq!(
            last.values[0],
            8000.0 * period_ns as f64 / 1e9,
            "{period_ns}"
        );
    }
}

#[test]
fn a_silent_device_is_lost_after_the_same_time_at_every_base_period() {
    for period_ns in [125_000, 1_000_000, 20_000_000] {
        let mut fixture = EngineFixture::at_period(period_ns);
        let id = fixture.load(output_net(1));
        fixture.start(id);
        fixture.driver.alive = false;
        let (begun_ns, stale_ns) = (fixture.now_ns, (3 * period_ns).max(50_000_000));
        assert_eq!(fixture.until_terminated(id, 1000), EndReason::Fault);
        let after_ns = fixture.now_ns - begun_ns;
        assert!(
            (stale_ns..=stale_ns + 2 * period_ns).contains(&after_ns),
            "{period_ns}: {after_ns}"
        );
    }
}
