//! Replay judges every condition again, and reproduces every firing.

use std::collections::BTreeMap;

use rcc_core::plan::{KernelRun, PublishPoint};
use rcc_core::primitives;
use rcc_core::topic::Topic;
use rcc_core::types::Store;
use rcc_engine::record::{FlightRecorder, FlightRecorderConfig, FlightRecorderHelper};
use rcc_engine::replay::{ReplaySource, RuleReplayResult, replay_with_rules};

use super::continued::{CONTINUES, GoalNet, HOLDS, flange_net, goal_net};
use super::*;

struct Recorded {
    fixture: EngineFixture,
    helper: FlightRecorderHelper,
    nets: BTreeMap<u64, rcc_engine::net::NetOrigin>,
}

impl Recorded {
    fn new(memory: usize) -> Recorded {
        let config = FlightRecorderConfig {
            span_ns: 10_000_000_000,
            memory,
            period_ns: crate::common::PERIOD_NS,
        };
        let (recorder, helper) = FlightRecorder::new(config, 1);
        Recorded {
            fixture: EngineFixture::new().recorded_by(recorder),
            helper,
            nets: BTreeMap::new(),
        }
    }

    fn load(&mut self, plan: PlanData) -> u64 {
        let origin = self.fixture.build(plan.clone()).expect("a net").origin();
        let id = self.fixture.load(plan);
        self.nets.insert(id, origin);
        id
    }

    fn words(&mut self) -> Vec<u64> {
        self.fixture
            .order(|ticket| EngineRequest::Record { ticket });
        self.fixture.steps(210);
        let recording = self.helper.recordings.pop().expect("a recording");
        recording.ring.newest().concat()
    }

    fn replay(&self, words: &[u64]) -> RuleReplayResult {
        let source = ReplaySource {
            models: &self.fixture.models,
            configuration: 5,
            nets: &self.nets,
            words,
        };
        let (nets, rules) = replay_with_rules(&source, None, |_| ()).expect("this build");
        assert!(nets.iter().all(|net| net.mismatch.is_none()), "{nets:?}");
        rules
    }
}

/// As `ends_after`, and publishes `over`.
fn publishes_over(topic: Topic) -> PlanData {
    let mut plan = TestPlan {
        data: ends_after(60, 3),
    };
    let out = plan.bool(2);
    // It publishes `over`, and never ends by it.
    let termination = plan.data.runs.last().expect("a run").first as usize;
    plan.data.operands[termination + 1] = 0;
    let first = plan.data.operands.len() as u32;
    plan.data.operands.extend([OVER, out]);
    let (publish, _) = primitives::find("Publish").expect("a primitive");
    plan.data.runs.push(KernelRun {
        // Its kernels are those of Copy: the third is that of one Bool.
        kernel: primitives::kernel_number(publish, 2),
        first,
        operands: 2,
    });
    let last = plan.data.runs.len() - 1;
    plan.data.runs.swap(last - 1, last);
    plan.data.publishes.push(PublishPoint {
        topic,
        store: Store::Bool,
        slot: out,
        width: 1,
    });
    plan.data
}

/// Values, outcomes, topics and reasons: a chain of rules in which every kind of condition holds once.
fn chain(recorded: &mut Recorded) {
    let topic = Topic::new("part/there", "Bool", "");
    let drift = recorded.load(drift_until(HOLD[0], 0.0, 50));
    let second = recorded.load(drift_until(HOLD[0], 0.0, 50));
    let teller = recorded.load(publishes_over(topic));
    let lamp = recorded.load(ends_after(30, 1));
    let last = recorded.load(output_net(2));
    let other = recorded.load(output_net(0));
    let rules = [
        rule(&[over(drift)], &[drift], &[], &[second]),
        rule(&[outcome(lamp, 2)], &[], &[], &[last]),
        rule(
            &[
                RuleTerm::Topic { topic },
                reason(drift, EndReason::Aborted),
                RuleTerm::And,
            ],
            &[],
            &[],
            &[lamp],
        ),
        rule(&[outcome(lamp, 1)], &[], &[], &[other]),
    ];
    install(&mut recorded.fixture, &rules);
    for id in [drift, teller] {
        cycle_of(recorded.fixture.start(id));
    }
    recorded.fixture.steps(150);
    assert_eq!(recorded.fixture.state(last), CommandState::Running);
    assert_eq!(recorded.fixture.state(other), CommandState::Ready);
}

#[test]
fn every_firing_is_reproduced_to_the_bit() {
    let mut recorded = Recorded::new(16 << 20);
    chain(&mut recorded);
    let words = recorded.words();
    let rules = recorded.replay(&words);
    assert_eq!(rules.mismatch, None, "{rules:?}");
    assert_eq!((rules.held, rules.reproduced), (3, 3), "{rules:?}");
    // Before its start is recorded, the state of the net that publishes the topic is not known: no rule names it.
    assert!(rules.recorded - rules.compared <= 1, "{rules:?}");
    assert!(rules.recorded > 200, "{rules:?}");
    let mut ended: Vec<RuleState> = rules.ended.iter().map(|(_, _, state)| *state).collect();
    ended.sort_by_key(|state| *state as u8);
    assert_eq!(
        ended,
        [
            RuleState::Fired,
            RuleState::Fired,
            RuleState::Fired,
            RuleState::Expired
        ]
    );
}

#[test]
fn a_firing_that_the_nets_do_not_justify_is_found() {
    let mut recorded = Recorded::new(16 << 20);
    chain(&mut recorded);
    let mut words = recorded.words();
    // The record of judgements: tag 11, four words. Claim that what was judged held, once.
    let place = words
        .iter()
        .position(|word| *word as u8 == 11 && *word >> 32 == 4)
        .expect("a judgement");
    let judged = words[place + 1];
    assert_ne!(judged, 0);
    words[place + 3] = judged;
    let rules = recorded.replay(&words);
    assert!(rules.mismatch.is_some(), "{rules:?}");
}

#[test]
fn a_ring_that_was_overwritten_is_compared_from_where_everything_is_known() {
    let mut recorded = Recorded::new(1 << 20);
    // Long enough that the installation of the rules is overwritten.
    let drift = recorded.load(drift_until(HOLD[0], 0.0, 30_000));
    let second = recorded.load(drift_net(HOLD[0], 0.0));
    let third = recorded.load(drift_net(HOLD[0], 0.0));
    let rules = [
        rule(&[over(drift)], &[drift], &[], &[second]),
        rule(&[outcome(drift, 1)], &[], &[], &[third]),
    ];
    install(&mut recorded.fixture, &rules);
    cycle_of(recorded.fixture.start(drift));
    recorded.fixture.steps(30_050);
    assert_eq!(recorded.fixture.state(second), CommandState::Running);
    let words = recorded.words();
    let rules = recorded.replay(&words);
    assert_eq!(rules.mismatch, None, "{rules:?}");
    assert_eq!((rules.held, rules.reproduced), (1, 1), "{rules:?}");
    assert!(rules.compared < rules.recorded, "{rules:?}");
    assert!(rules.compared > rules.recorded / 2, "{rules:?}");
}

#[test]
fn motions_that_begin_in_flight_are_replayed_from_what_they_took_over() {
    let by_joints = |by: f64, start: i64| goal_net(by, 100, start);
    let by_flange = |by: f64, start: i64| flange_net([by, -by, 0.0], 100, start);
    let nets: [&dyn Fn(f64, i64) -> GoalNet; 2] = [&by_joints, &by_flange];
    for net in nets {
        let mut recorded = Recorded::new(16 << 20);
        let first = net(0.05, HOLDS);
        let old = recorded.load(first.plan);
        let new = recorded.load(net(-0.05, CONTINUES).plan);
        let value = RuleTerm::Value {
            command: old,
            slot: first.over,
        };
        let rules = [rule(&[value], &[old], &[], &[new])];
        install(&mut recorded.fixture, &rules);
        cycle_of(recorded.fixture.start(old));
        recorded.fixture.steps(300);
        assert_eq!(recorded.fixture.state(new), CommandState::Running);
        let words = recorded.words();
        let rules = recorded.replay(&words);
        assert_eq!((rules.held, rules.reproduced), (1, 1), "{rules:?}");
    }
}
