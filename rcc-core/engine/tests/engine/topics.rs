//! Values between nets in virtual time: when they arrive, that the order of nets has no effect, and who may publish.

use crate::common::{EngineFixture, publishing_net, start_of, subscribing_net};
use rcc_core::message::{CommandState, EndReason};
use rcc_core::plan::{PlanError, Rate, Resource, TOPICS_MAX};
use rcc_core::topic::Topic;
use rcc_protocol::control::{Answer, InputFault, Refusal};

const NULL: f64 = f64::NAN;
const EACH: Rate = Rate::EVERY_CYCLE;

fn topic() -> Topic {
    Topic::new("tool/force", "Real", "N")
}

/// Value and age as a subscriber showed them in the newest cycle.
#[track_caller]
fn sees(fixture: &mut EngineFixture, value: f64, age: f64) {
    let same = |a: f64, b: f64| (a - b).abs() < 1e-12 || a.is_nan() && b.is_nan();
    let records = fixture.records();
    let [.., shown, old] = records.as_slice() else {
        panic!("{} records", records.len())
    };
    assert_eq!(shown.cycle, fixture.engine.status().cycle);
    let (shown, old) = (shown.values[0], old.values[0]);
    assert!(
        same(shown, value) && same(old, age),
        "{shown} of age {old}, not {value} of {age}"
    );
}

fn started(fixture: &mut EngineFixture, plan: rcc_protocol::control::PlanData) -> u64 {
    let id = fixture.load(plan);
    assert!(matches!(fixture.start(id), Answer::Done { .. }));
    id
}

#[test]
fn a_value_comes_in_the_cycle_after_it_was_published_whichever_net_is_first() {
    for publisher_first in [true, false] {
        let mut fixture = EngineFixture::new();
        let (gives, takes) = (
            publishing_net(topic(), EACH),
            subscribing_net(topic(), EACH, 0),
        );
        let (gives, _) = if publisher_first {
            let gives = fixture.load(gives);
            (gives, fixture.load(takes))
        } else {
            let takes = fixture.load(takes);
            (fixture.load(gives), takes)
        };
        let takes = if publisher_first {
            gives + 1
        } else {
            gives - 1
        };
        assert!(matches!(fixture.start(takes), Answer::Done { .. }));
        sees(&mut fixture, NULL, NULL);
        // Its time is 0 in its first cycle.
        assert!(matches!(fixture.start(gives), Answer::Done { .. }));
        sees(&mut fixture, NULL, NULL);
        for cycle in 0..5 {
            fixture.step();
            sees(&mut fixture, f64::from(cycle) * 1e-3, 0.0);
        }
    }
}

#[test]
fn a_net_that_starts_later_begins_with_what_is_published_then() {
    let mut fixture = EngineFixture::new();
    let takes = fixture.load(subscribing_net(topic(), EACH, 0));
    started(&mut fixture, publishing_net(topic(), EACH));
    fixture.steps(10);
    assert!(matches!(fixture.start(takes), Answer::Done { .. }));
    sees(&mut fixture, 0.010, 0.0);
}

#[test]
fn a_topic_is_null_when_its_publisher_ends_until_another_one_publishes() {
    for abort in [true, false] {
        let mut fixture = EngineFixture::new();
        started(&mut fixture, subscribing_net(topic(), EACH, 0));
        let gives = started(&mut fixture, publishing_net(topic(), EACH));
        fixture.steps(3);
        sees(&mut fixture, 0.002, 0.0);
        let id = gives;
        fixture.ask(|ticket| match abort {
            true => rcc_engine::queue::EngineRequest::Abort { ticket, id },
            false => rcc_engine::queue::EngineRequest::Cancel { ticket, id },
        });
        fixture.step();
        assert_eq!(fixture.state(gives), CommandState::Terminated);
        fixture.step();
        // Null arrived when the publisher ended.
        let age = if abort { 0.002 } else { 0.001 };
        sees(&mut fixture, NULL, age);
        fixture.steps(100);
        sees(&mut fixture, NULL, age + 0.1);
        started(&mut fixture, publishing_net(topic(), EACH));
        fixture.step();
        sees(&mut fixture, 0.0, 0.0);
    }
}

#[test]
fn a_slow_net_is_seen_with_its_age_and_expires() {
    let slow = Rate { every: 4, phase: 0 };
    let mut fixture = EngineFixture::new();
    started(&mut fixture, subscribing_net(topic(), EACH, 2));
    let gives = fixture.load(publishing_net(topic(), slow));
    fixture.order(start_of(gives));
    while fixture.state(gives) != CommandState::Running {
        fixture.step();
    }
    for turn in 0..3 {
        let value = f64::from(turn) * 0.004;
        for (shown, age) in [(value, 0.0), (value, 0.001), (value, 0.002), (NULL, 0.003)] {
            fixture.step();
            sees(&mut fixture, shown, age);
        }
    }
}

#[test]
fn a_net_that_starts_late_sees_the_age_of_the_value() {
    let slow = Rate {
        every: 100,
        phase: 0,
    };
    let mut fixture = EngineFixture::new();
    let gives = fixture.load(publishing_net(topic(), slow));
    fixture.order(start_of(gives));
    while fixture.state(gives) != CommandState::Running {
        fixture.step();
    }
    let [fresh, old] = [0, 10].map(|expires| fixture.load(subscribing_net(topic(), EACH, expires)));
    let computed = fixture.entry(gives).started_cycle;
    while fixture.engine.status().cycle < computed + 50 {
        fixture.step();
    }
    assert!(matches!(fixture.start(fresh), Answer::Done { .. }));
    let age =
        |fixture: &EngineFixture| (fixture.engine.status().cycle - computed - 1) as f64 * 1e-3;
    let now = age(&fixture);
    assert!(now > 0.04, "{now}");
    sees(&mut fixture, 0.0, now);
    fixture.step();
    let now = age(&fixture);
    sees(&mut fixture, 0.0, now);
    // A subscriber for which the value is too old already.
    fixture.ask(|ticket| rcc_engine::queue::EngineRequest::Abort { ticket, id: fresh });
    assert!(matches!(fixture.start(old), Answer::Done { .. }));
    let now = age(&fixture);
    sees(&mut fixture, NULL, now);
}

#[test]
fn values_published_before_a_net_ran_have_no_effect_on_it() {
    let mut fixture = EngineFixture::new();
    let gives = started(&mut fixture, publishing_net(topic(), EACH));
    let mut plan = subscribing_net(topic(), EACH, 0);
    plan.reals[plan.inputs[0].slot as usize] = 42.0;
    let takes = fixture.load(plan);
    fixture.steps(10);
    fixture.ask(|ticket| rcc_engine::queue::EngineRequest::Abort { ticket, id: gives });
    fixture.steps(10);
    assert!(matches!(fixture.start(takes), Answer::Done { .. }));
    sees(&mut fixture, 42.0, NULL);
}

#[test]
fn a_slow_net_sees_the_newest_value() {
    let mut fixture = EngineFixture::new();
    let gives = started(&mut fixture, publishing_net(topic(), EACH));
    let slow = Rate { every: 5, phase: 0 };
    let takes = fixture.load(subscribing_net(topic(), slow, 0));
    fixture.order(start_of(takes));
    for _ in 0..4 {
        fixture.step();
        while !fixture.engine.status().cycle.is_multiple_of(5) {
            fixture.step();
        }
        // The value published in the previous cycle; the first one is 0.
        let last = fixture.engine.status().cycle - 1 - fixture.entry(gives).started_cycle;
        sees(&mut fixture, last as f64 * 1e-3, 0.0);
    }
}

#[test]
fn one_net_at_a_time_publishes_a_topic() {
    let mut fixture = EngineFixture::new();
    let first = started(&mut fixture, publishing_net(topic(), EACH));
    let second = fixture.load(publishing_net(topic(), EACH));
    let resource = Resource::Topic { key: topic().key };
    let busy = Refusal::Busy {
        holder: first,
        resource,
    };
    assert_eq!(fixture.start(second), Answer::Refused(busy));
    started(&mut fixture, subscribing_net(topic(), EACH, 0));
    fixture.steps(20);
    // Handed over without a cycle in between.
    assert!(matches!(
        fixture.switch(&[first], &[second]),
        Answer::Done { .. }
    ));
    let last = fixture.entry(first).cycles;
    sees(&mut fixture, (last as f64 - 1.0) * 1e-3, 0.0);
    fixture.step();
    sees(&mut fixture, 0.0, 0.0);
    assert_eq!(fixture.reason(first), EndReason::Aborted);
}

#[test]
fn nets_with_different_types_for_a_topic_do_not_run_together() {
    let other = Topic::new("tool/force", "Real", "m");
    let key = other.key;
    for publisher_first in [true, false] {
        let mut fixture = EngineFixture::new();
        let gives = publishing_net(topic(), EACH);
        let takes = subscribing_net(other, EACH, 0);
        let (first, second) = if publisher_first {
            (gives, takes)
        } else {
            (takes, gives)
        };
        let first = started(&mut fixture, first);
        let second = fixture.load(second);
        let refused = Refusal::OtherTopic { other: first, key };
        assert_eq!(fixture.start(second), Answer::Refused(refused));
        fixture.ask(|ticket| rcc_engine::queue::EngineRequest::Abort { ticket, id: first });
        assert!(matches!(fixture.start(second), Answer::Done { .. }));
    }
}

#[test]
fn an_input_that_subscribes_to_a_topic_cannot_be_set() {
    let mut fixture = EngineFixture::new();
    let takes = started(&mut fixture, subscribing_net(topic(), EACH, 0));
    let (input, fault) = (0, InputFault::Subscribed);
    let refused = Answer::Refused(Refusal::Input { input, fault });
    assert_eq!(fixture.set(takes, &[(0, &[1.0])]), refused);
}

#[test]
fn a_plan_with_impossible_topics_is_refused() {
    let fixture = EngineFixture::new();
    let refused = |plan| match fixture.build(plan) {
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
