//! Values from net to net in virtual time: when they come, that the order of nets does not show, who may publish what.

mod common;

use common::{Bench, publishing_net, subscribing_net};
use rcc_core::message::{CommandState, EndReason};
use rcc_core::plan::{PlanError, Rate, Resource, TOPICS_MAX};
use rcc_core::topic::Topic;
use rcc_ipc::control::{Answer, InputFault, Refusal};

const NULL: f64 = f64::NAN;
const EACH: Rate = Rate::EVERY_CYCLE;

fn topic() -> Topic {
    Topic::new("tool/force", "Real", "N")
}

/// Value and age as a subscriber showed them in the newest cycle.
#[track_caller]
fn sees(bench: &mut Bench, value: f64, age: f64) {
    let same = |a: f64, b: f64| (a - b).abs() < 1e-12 || a.is_nan() && b.is_nan();
    let records = bench.records();
    let [.., shown, old] = records.as_slice() else {
        panic!("{} records", records.len())
    };
    assert_eq!(shown.cycle, bench.engine.status().cycle);
    let (shown, old) = (shown.values[0], old.values[0]);
    assert!(
        same(shown, value) && same(old, age),
        "{shown} of age {old}, not {value} of {age}"
    );
}

fn started(bench: &mut Bench, plan: rcc_ipc::control::PlanData) -> u64 {
    let id = bench.load(plan);
    assert!(matches!(bench.start(id), Answer::Done { .. }));
    id
}

#[test]
fn a_value_comes_in_the_cycle_after_it_was_published_whichever_net_is_first() {
    for publisher_first in [true, false] {
        let mut bench = Bench::new();
        let (gives, takes) = (
            publishing_net(topic(), EACH),
            subscribing_net(topic(), EACH, 0),
        );
        let (gives, _) = if publisher_first {
            let gives = bench.load(gives);
            (gives, bench.load(takes))
        } else {
            let takes = bench.load(takes);
            (bench.load(gives), takes)
        };
        let takes = if publisher_first {
            gives + 1
        } else {
            gives - 1
        };
        assert!(matches!(bench.start(takes), Answer::Done { .. }));
        sees(&mut bench, NULL, NULL);
        // Its time is 0 in its first cycle.
        assert!(matches!(bench.start(gives), Answer::Done { .. }));
        sees(&mut bench, NULL, NULL);
        for cycle in 0..5 {
            bench.step();
            sees(&mut bench, f64::from(cycle) * 1e-3, 0.0);
        }
    }
}

#[test]
fn a_net_that_starts_later_begins_with_what_is_published_then() {
    let mut bench = Bench::new();
    let takes = bench.load(subscribing_net(topic(), EACH, 0));
    started(&mut bench, publishing_net(topic(), EACH));
    bench.steps(10);
    assert!(matches!(bench.start(takes), Answer::Done { .. }));
    sees(&mut bench, 0.010, 0.0);
}

#[test]
fn when_its_net_ends_there_is_null_and_another_net_may_go_on() {
    for abort in [true, false] {
        let mut bench = Bench::new();
        started(&mut bench, subscribing_net(topic(), EACH, 0));
        let gives = started(&mut bench, publishing_net(topic(), EACH));
        bench.steps(3);
        sees(&mut bench, 0.002, 0.0);
        let id = gives;
        bench.ask(|ticket| match abort {
            true => rcc_engine::queue::Order::Abort { ticket, id },
            false => rcc_engine::queue::Order::Cancel { ticket, id },
        });
        bench.step();
        assert_eq!(bench.state(gives), CommandState::Terminated);
        bench.step();
        // It came with the end.
        let age = if abort { 0.002 } else { 0.001 };
        sees(&mut bench, NULL, age);
        bench.steps(100);
        sees(&mut bench, NULL, age + 0.1);
        started(&mut bench, publishing_net(topic(), EACH));
        bench.step();
        sees(&mut bench, 0.0, 0.0);
    }
}

#[test]
fn a_slow_net_is_seen_with_its_age_and_expires() {
    let slow = Rate { every: 4, phase: 0 };
    let mut bench = Bench::new();
    started(&mut bench, subscribing_net(topic(), EACH, 2));
    let gives = bench.load(publishing_net(topic(), slow));
    bench.order(|ticket| rcc_engine::queue::Order::Start { ticket, id: gives });
    while bench.state(gives) != CommandState::Running {
        bench.step();
    }
    for turn in 0..3 {
        let value = f64::from(turn) * 0.004;
        for (shown, age) in [(value, 0.0), (value, 0.001), (value, 0.002), (NULL, 0.003)] {
            bench.step();
            sees(&mut bench, shown, age);
        }
    }
}

#[test]
fn who_begins_late_sees_how_old_the_value_is() {
    let slow = Rate {
        every: 100,
        phase: 0,
    };
    let mut bench = Bench::new();
    let gives = bench.load(publishing_net(topic(), slow));
    bench.order(|ticket| rcc_engine::queue::Order::Start { ticket, id: gives });
    while bench.state(gives) != CommandState::Running {
        bench.step();
    }
    let [fresh, old] = [0, 10].map(|expires| bench.load(subscribing_net(topic(), EACH, expires)));
    let computed = bench.entry(gives).started_cycle;
    while bench.engine.status().cycle < computed + 50 {
        bench.step();
    }
    assert!(matches!(bench.start(fresh), Answer::Done { .. }));
    let age = |bench: &Bench| (bench.engine.status().cycle - computed - 1) as f64 * 1e-3;
    let now = age(&bench);
    assert!(now > 0.04, "{now}");
    sees(&mut bench, 0.0, now);
    bench.step();
    let now = age(&bench);
    sees(&mut bench, 0.0, now);
    // And one for which it is too old already.
    bench.ask(|ticket| rcc_engine::queue::Order::Abort { ticket, id: fresh });
    assert!(matches!(bench.start(old), Answer::Done { .. }));
    let now = age(&bench);
    sees(&mut bench, NULL, now);
}

#[test]
fn what_was_published_before_a_net_ran_is_nothing_to_it() {
    let mut bench = Bench::new();
    let gives = started(&mut bench, publishing_net(topic(), EACH));
    let mut plan = subscribing_net(topic(), EACH, 0);
    plan.reals[plan.inputs[0].slot as usize] = 42.0;
    let takes = bench.load(plan);
    bench.steps(10);
    bench.ask(|ticket| rcc_engine::queue::Order::Abort { ticket, id: gives });
    bench.steps(10);
    assert!(matches!(bench.start(takes), Answer::Done { .. }));
    sees(&mut bench, 42.0, NULL);
}

#[test]
fn a_slow_net_sees_the_newest_value() {
    let mut bench = Bench::new();
    let gives = started(&mut bench, publishing_net(topic(), EACH));
    let slow = Rate { every: 5, phase: 0 };
    let takes = bench.load(subscribing_net(topic(), slow, 0));
    bench.order(|ticket| rcc_engine::queue::Order::Start { ticket, id: takes });
    for _ in 0..4 {
        bench.step();
        while !bench.engine.status().cycle.is_multiple_of(5) {
            bench.step();
        }
        // What was published in the cycle before, the first of which is 0.
        let last = bench.engine.status().cycle - 1 - bench.entry(gives).started_cycle;
        sees(&mut bench, last as f64 * 1e-3, 0.0);
    }
}

#[test]
fn one_net_at_a_time_publishes_a_topic() {
    let mut bench = Bench::new();
    let first = started(&mut bench, publishing_net(topic(), EACH));
    let second = bench.load(publishing_net(topic(), EACH));
    let resource = Resource::Topic { key: topic().key };
    let busy = Refusal::Busy {
        holder: first,
        resource,
    };
    assert_eq!(bench.start(second), Answer::Refused(busy));
    started(&mut bench, subscribing_net(topic(), EACH, 0));
    bench.steps(20);
    // Handed over without a cycle in between.
    assert!(matches!(
        bench.switch(&[first], &[second]),
        Answer::Done { .. }
    ));
    let last = bench.entry(first).cycles;
    sees(&mut bench, (last as f64 - 1.0) * 1e-3, 0.0);
    bench.step();
    sees(&mut bench, 0.0, 0.0);
    assert_eq!(bench.reason(first), EndReason::Aborted);
}

#[test]
fn nets_that_mean_different_types_do_not_run_together() {
    let other = Topic::new("tool/force", "Real", "m");
    let key = other.key;
    for publisher_first in [true, false] {
        let mut bench = Bench::new();
        let gives = publishing_net(topic(), EACH);
        let takes = subscribing_net(other, EACH, 0);
        let (first, second) = if publisher_first {
            (gives, takes)
        } else {
            (takes, gives)
        };
        let first = started(&mut bench, first);
        let second = bench.load(second);
        let refused = Refusal::OtherTopic { other: first, key };
        assert_eq!(bench.start(second), Answer::Refused(refused));
        bench.ask(|ticket| rcc_engine::queue::Order::Abort { ticket, id: first });
        assert!(matches!(bench.start(second), Answer::Done { .. }));
    }
}

#[test]
fn nobody_sets_what_another_net_publishes() {
    let mut bench = Bench::new();
    let takes = started(&mut bench, subscribing_net(topic(), EACH, 0));
    let (input, fault) = (0, InputFault::Subscribed);
    let refused = Answer::Refused(Refusal::Input { input, fault });
    assert_eq!(bench.set(takes, &[(0, &[1.0])]), refused);
}

#[test]
fn a_plan_with_impossible_topics_is_refused() {
    let bench = Bench::new();
    let refused = |plan| match bench.build(plan) {
        Err(Refusal::Plan(error)) => error,
        other => panic!("{other:?}"),
    };
    let good = publishing_net(topic(), EACH);
    let mut twice = good.clone();
    twice.publishes.push(twice.publishes[0]);
    let resource = Resource::Topic { key: topic().key };
    assert_eq!(refused(twice), PlanError::ClaimedTwice { resource });
    let mut outside = good.clone();
    outside.publishes[0].slot = outside.reals.len() as u32;
    assert_eq!(refused(outside), PlanError::BadPublish { publish: 0 });
    let mut own = subscribing_net(topic(), EACH, 0);
    let publish = good.publishes[0];
    own.publishes
        .push(rcc_core::plan::PublishPoint { slot: 0, ..publish });
    assert_eq!(refused(own), PlanError::BadInput { input: 0 });
    let mut many = good;
    many.publishes = vec![publish; TOPICS_MAX + 1];
    assert_eq!(refused(many), PlanError::TooLarge);
}
