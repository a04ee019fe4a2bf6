//! Values that are set while a net is ready or running, and values that are read, in virtual time.

use crate::common::{EngineFixture, HOLD, PERIOD_NS, TestPlan, input_net, line_net, start_of};
use rcc_core::message::CommandState;
use rcc_core::plan::{PlanError, Rate, ValuePoint};
use rcc_core::types::Store;
use rcc_engine::queue::EngineRequest;
use rcc_protocol::control::{Answer, InputFault, InputValue, PlanData, Refusal};

const NULL: f64 = f64::NAN;

/// The three monitors of `input_net` in the newest cycle.
fn shown(fixture: &mut EngineFixture) -> (f64, [f64; 3], f64) {
    let records = fixture.records();
    let [.., one, three, age] = records.as_slice() else {
        panic!("{} records", records.len())
    };
    assert_eq!((one.cycle, one.cycle), (three.cycle, age.cycle));
    let three = three.values;
    (one.values[0], [three[0], three[1], three[2]], age.values[0])
}

fn same(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-12 || a.is_nan() && b.is_nan()
}

#[track_caller]
fn sees(fixture: &mut EngineFixture, one: f64, age: f64) {
    let seen = shown(fixture);
    assert!(
        same(seen.0, one) && same(seen.2, age),
        "{seen:?}, not {one} of age {age}"
    );
}

fn running(plan: PlanData) -> (EngineFixture, u64) {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(plan);
    assert!(matches!(fixture.start(id), Answer::Done { .. }));
    (fixture, id)
}

#[test]
fn an_input_begins_with_its_initial_value_and_without_age() {
    let (mut fixture, _) = running(input_net(0.5, 0));
    sees(&mut fixture, 0.5, NULL);
    let (mut fixture, _) = running(input_net(NULL, 0));
    sees(&mut fixture, NULL, NULL);
}

#[test]
fn a_set_value_is_seen_in_the_cycle_of_the_answer_and_ages() {
    let (mut fixture, id) = running(input_net(0.5, 0));
    let answer = fixture.set(id, &[(0, &[0.75])]);
    assert_eq!(
        answer,
        Answer::Done {
            cycle: fixture.engine.status().cycle
        }
    );
    sees(&mut fixture, 0.75, 0.0);
    assert_eq!(fixture.told().analog[0], 0.75);
    fixture.step();
    sees(&mut fixture, 0.75, 0.001);
    fixture.steps(9);
    sees(&mut fixture, 0.75, 0.01);
    fixture.set(id, &[(0, &[NULL])]);
    sees(&mut fixture, NULL, 0.0);
    assert!(fixture.told().analog[0].is_nan(), "null commands nothing");
}

#[test]
fn all_inputs_of_one_request_change_in_the_same_cycle_or_none_does() {
    let (mut fixture, id) = running(input_net(0.5, 0));
    fixture.set(id, &[(1, &[1.0, 2.0, 3.0]), (0, &[0.25])]);
    assert_eq!(shown(&mut fixture), (0.25, [1.0, 2.0, 3.0], 0.0));
    for (values, input, fault) in [
        (&[(0, &[9.0][..]), (2, &[9.0])][..], 2, InputFault::Unknown),
        (&[(0, &[9.0]), (1, &[9.0])], 1, InputFault::Elements),
        (
            &[(0, &[9.0]), (1, &[9.0, f64::INFINITY, 9.0])],
            1,
            InputFault::NoValue,
        ),
        (&[(0, &[9.0]), (0, &[8.0])], 0, InputFault::Twice),
    ] {
        let answer = fixture.set(id, values);
        assert_eq!(answer, Answer::Refused(Refusal::Input { input, fault }));
        assert_eq!(shown(&mut fixture).0, 0.25);
    }
}

#[test]
fn two_requests_of_one_cycle_leave_the_later_value() {
    let (mut fixture, id) = running(input_net(0.5, 0));
    for value in [1.0f64, 2.0] {
        let values = vec![InputValue {
            input: 0,
            words: vec![value.to_bits()],
        }];
        fixture.order(|ticket| EngineRequest::Set { ticket, id, values });
    }
    fixture.step();
    sees(&mut fixture, 2.0, 0.0);
}

#[test]
fn an_input_expires_to_null_and_is_valid_again_when_it_is_set() {
    let (mut fixture, id) = running(input_net(0.5, 3));
    fixture.steps(10);
    sees(&mut fixture, 0.5, NULL);
    fixture.set(id, &[(0, &[0.25])]);
    fixture.steps(3);
    sees(&mut fixture, 0.25, 0.003);
    fixture.step();
    sees(&mut fixture, NULL, 0.004);
    fixture.steps(100);
    sees(&mut fixture, NULL, 0.104);
    fixture.set(id, &[(0, &[0.75])]);
    sees(&mut fixture, 0.75, 0.0);
}

#[test]
fn a_range_is_kept_at_both_ends_and_null_is_in_it() {
    let mut plan = input_net(0.5, 0);
    plan.reals.extend([0.0, 1.0]);
    let bound = plan.reals.len() as u32 - 2;
    (plan.inputs[0].at_least, plan.inputs[0].at_most) = (Some(bound), Some(bound + 1));
    let (mut fixture, id) = running(plan);
    for (value, good) in [
        (0.0, true),
        (1.0, true),
        (1.0 + 1e-12, false),
        (-1e-300, false),
        (NULL, true),
    ] {
        let answer = fixture.set(id, &[(0, &[value])]);
        assert_eq!(
            matches!(answer, Answer::Done { .. }),
            good,
            "{value}: {answer:?}"
        );
    }
}

#[test]
fn a_value_set_before_start_is_seen_in_the_first_cycle() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(input_net(0.5, 0));
    assert!(matches!(
        fixture.set(id, &[(0, &[0.25])]),
        Answer::Done { .. }
    ));
    fixture.steps(50);
    fixture.start(id);
    sees(&mut fixture, 0.25, 0.0);
}

#[test]
fn a_refused_start_keeps_staged_values() {
    let mut plan = line_net();
    let mut with_input = TestPlan { data: plan.clone() };
    let input = with_input.input(&[NULL], 0);
    with_input.monitor(Store::Real, input.slot, 1, 1);
    plan = with_input.data;
    let mut fixture = EngineFixture::new();
    let id = fixture.load(plan);
    fixture.set(id, &[(0, &[0.25])]);
    fixture.driver.measurement.hold[0] += 0.1;
    let refused = fixture.start(id);
    assert!(
        matches!(refused, Answer::Refused(Refusal::FirstSetPoint { .. })),
        "{refused:?}"
    );
    fixture.driver.measurement.hold = HOLD;
    assert!(matches!(fixture.start(id), Answer::Done { .. }));
    let records = fixture.records();
    assert_eq!(records.last().map(|record| record.values[0]), Some(0.25));
}

#[test]
fn a_net_loaded_again_begins_from_its_initial_values() {
    let (mut fixture, id) = running(input_net(0.5, 0));
    fixture.set(id, &[(0, &[0.25])]);
    let again = fixture.load(input_net(0.5, 0));
    fixture.records();
    fixture.order(|ticket| EngineRequest::Abort { ticket, id });
    fixture.start(again);
    sees(&mut fixture, 0.5, NULL);
}

#[test]
fn only_ready_and_active_nets_are_set() {
    let (mut fixture, id) = running(input_net(0.5, 0));
    fixture.ask(|ticket| EngineRequest::Cancel { ticket, id });
    fixture.steps(3);
    let state = CommandState::Terminated as u32;
    assert_eq!(
        fixture.set(id, &[(0, &[0.1])]),
        Answer::Refused(Refusal::WrongState { state })
    );
    assert_eq!(
        fixture.set(999, &[(0, &[0.1])]),
        Answer::Refused(Refusal::UnknownCommand)
    );
}

#[test]
fn a_slower_net_sees_the_last_value_and_counts_its_own_time() {
    let mut plan = input_net(0.5, 0);
    plan.rate = Rate { every: 4, phase: 0 };
    let mut fixture = EngineFixture::new();
    let id = fixture.load(plan);
    fixture.order(start_of(id));
    while fixture.engine.status().cycle % 4 != 1 || fixture.state(id) != CommandState::Running {
        fixture.step();
    }
    fixture.records();
    fixture.set(id, &[(0, &[0.1])]);
    fixture.set(id, &[(0, &[0.2])]);
    assert!(fixture.records().is_empty());
    fixture.step();
    sees(&mut fixture, 0.2, 0.0);
    fixture.steps(4);
    sees(&mut fixture, 0.2, 4.0 * PERIOD_NS as f64 * 1e-9);
}

#[test]
fn a_flood_of_requests_is_taken_in_bounded_portions_and_none_is_lost() {
    let (mut fixture, id) = running(input_net(0.5, 0));
    let flood = 200;
    for number in 0..flood {
        let values = vec![InputValue {
            input: 0,
            words: vec![f64::from(number).to_bits()],
        }];
        fixture.order(|ticket| EngineRequest::Set { ticket, id, values });
    }
    let mut seen = Vec::new();
    for _ in 0..flood as usize / 8 {
        fixture.records();
        fixture.step();
        seen.push(shown(&mut fixture).0);
    }
    let last_of_each: Vec<f64> = (1..=25).map(|cycle| f64::from(cycle * 8 - 1)).collect();
    assert_eq!(seen, last_of_each);
}

#[test]
fn a_plan_whose_inputs_lie_outside_is_refused() {
    let fixture = EngineFixture::new();
    let spoil: [fn(&mut PlanData); 5] = [
        |plan| plan.inputs[1].width = 1000,
        |plan| plan.inputs[1].since = 1000,
        |plan| plan.inputs[1].age = u32::MAX,
        |plan| plan.inputs[1].at_least = Some(plan.reals.len() as u32 - 1),
        |plan| plan.inputs[1].slot = u32::MAX,
    ];
    for spoil in spoil {
        let mut plan = input_net(0.5, 0);
        spoil(&mut plan);
        let refused = fixture.build(plan).map(|_| ());
        assert_eq!(
            refused,
            Err(Refusal::Plan(PlanError::BadInput { input: 1 }))
        );
    }
    let mut plan = input_net(0.5, 0);
    plan.inputs = vec![plan.inputs[0]; 257];
    let refused = fixture.build(plan).map(|_| ());
    assert_eq!(refused, Err(Refusal::Plan(PlanError::TooLarge)));
}

#[test]
fn all_values_of_a_reading_are_from_one_cycle_and_it_is_named() {
    let (mut fixture, id) = running(crate::common::time_net(Rate::EVERY_CYCLE));
    fixture.steps(41);
    let cycle = fixture.engine.status().cycle;
    let points = [Store::Real, Store::Bool].map(|store| ValuePoint {
        store,
        slot: 0,
        width: 1,
    });
    let values = fixture.read(id, &points).expect("values");
    assert_eq!(
        (values.cycle, values.evaluations, values.every),
        (cycle, 42, 1)
    );
    assert_eq!(values.state, CommandState::Running as u32);
    assert_eq!(values.words, [0.041f64.to_bits(), 0]);
    let outside = ValuePoint {
        store: Store::Real,
        slot: 1,
        width: 2,
    };
    let refused = fixture.read(id, &[points[0], outside]);
    assert_eq!(refused, Err(Refusal::NoSuchValue { value: 1 }));
    assert_eq!(fixture.read(77, &points), Err(Refusal::UnknownCommand));
}

#[test]
fn a_net_that_is_over_can_be_read_and_one_that_waits_too() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(input_net(0.5, 0));
    let one = [ValuePoint {
        store: Store::Real,
        slot: 0,
        width: 1,
    }];
    let ready = fixture.read(id, &one).expect("values");
    assert_eq!(
        (
            ready.cycle,
            ready.evaluations,
            f64::from_bits(ready.words[0])
        ),
        (0, 0, 0.5)
    );
    fixture.start(id);
    fixture.set(id, &[(0, &[0.75])]);
    let last = fixture.engine.status().cycle;
    fixture.order(|ticket| EngineRequest::Abort { ticket, id });
    fixture.steps(10);
    let over = fixture.read(id, &one).expect("values");
    assert_eq!((over.cycle, f64::from_bits(over.words[0])), (last, 0.75));
    assert_eq!(over.state, CommandState::Terminated as u32);
}
