//! Rules that record: the recording is frozen in the cycle after a value passed its limit, once or several times.

use rcc_engine::record::{
    FlightRecorder, FlightRecorderConfig, FlightRecorderHelper, Trigger, TriggerReason,
};
use rcc_protocol::rules::{Limit, RECORD_DISTANCE_MIN_NS, Relation, RuleFault, RuleRecording};

use super::*;
use crate::common::{PERIOD_NS, input_net};

const ONCE: RuleRecording = RuleRecording {
    times: 1,
    distance_ns: RECORD_DISTANCE_MIN_NS,
    edge: false,
};

fn recorded() -> (EngineFixture, FlightRecorderHelper) {
    let config = FlightRecorderConfig {
        span_ns: 10_000_000_000,
        memory: 16 << 20,
        period_ns: PERIOD_NS,
    };
    let (recorder, helper) = FlightRecorder::new(config, 1);
    (EngineFixture::new().recorded_by(recorder), helper)
}

/// A running net whose `Real` slot [`VALUE`] follows an input.
fn running(fixture: &mut EngineFixture) -> u64 {
    let id = fixture.load(input_net(0.0, 0));
    cycle_of(fixture.start(id));
    id
}

/// The slot of the input in [`input_net`].
fn slot() -> u32 {
    let point = input_net(0.0, 0).inputs[0];
    assert_eq!(
        (point.store, point.width),
        (rcc_core::types::Store::Real, 1)
    );
    point.slot
}

fn above(command: u64, limit: f64) -> RuleTerm {
    RuleTerm::Compare {
        command,
        slot: slot(),
        relation: Relation::Above,
        limit: Limit::Real(limit),
    }
}

fn records(terms: &[RuleTerm], recording: RuleRecording) -> Rule {
    Rule {
        record: Some(recording),
        ..rule(terms, &[], &[], &[])
    }
}

fn set(fixture: &mut EngineFixture, id: u64, value: f64) -> u64 {
    cycle_of(fixture.set(id, &[(0, &[value])]))
}

fn next(helper: &mut FlightRecorderHelper) -> Option<Trigger> {
    let recording = helper.recordings.pop().ok()?;
    let trigger = recording.trigger;
    let mut ring = recording.ring;
    ring.clear();
    helper.spare.push(ring).expect("room");
    Some(trigger)
}

#[test]
fn a_value_that_passes_its_limit_freezes_the_recording_once() {
    let (mut fixture, mut helper) = recorded();
    let net = running(&mut fixture);
    let (id, _) = install(&mut fixture, &[records(&[above(net, 30.0)], ONCE)]);
    fixture.steps(300);
    set(&mut fixture, net, 30.0);
    fixture.steps(300);
    assert!(next(&mut helper).is_none(), "30 is not above 30");
    assert_eq!(status(&mut fixture, id).state, RuleState::Armed);
    let cycle = set(&mut fixture, net, 30.5);
    fixture.steps(300);
    let trigger = next(&mut helper).expect("a recording");
    assert_eq!(trigger.reason, TriggerReason::Rule { id });
    // The net is evaluated in the cycle of the request; rules see it in the next.
    assert_eq!(trigger.cycle, cycle + 1);
    let fired = status(&mut fixture, id);
    assert_eq!((fired.state, fired.cycle), (RuleState::Fired, cycle + 1));
    assert_eq!((fired.recordings, fired.recorded_cycle), (1, cycle + 1));
    assert_eq!(reported(&mut fixture), [(id, RuleState::Fired)]);
    for value in [0.0, 31.0] {
        set(&mut fixture, net, value);
        fixture.steps(6_000);
    }
    assert!(next(&mut helper).is_none(), "it fired once");
    assert_eq!(fixture.state(net), CommandState::Running);
}

#[test]
fn it_repeats_at_a_distance_and_counts_what_it_skips() {
    let (mut fixture, mut helper) = recorded();
    let net = running(&mut fixture);
    let twice = RuleRecording { times: 2, ..ONCE };
    let (id, _) = install(&mut fixture, &[records(&[above(net, 30.0)], twice)]);
    set(&mut fixture, net, 31.0);
    fixture.steps(5_000);
    assert!(next(&mut helper).is_some());
    assert!(next(&mut helper).is_none(), "it only held");
    for _ in 0..3 {
        set(&mut fixture, net, 0.0);
        fixture.steps(1_500);
        set(&mut fixture, net, 31.0);
        fixture.steps(2);
        set(&mut fixture, net, 0.0);
        fixture.steps(2);
        set(&mut fixture, net, 31.0);
        fixture.steps(2);
        let now = status(&mut fixture, id);
        if now.state == RuleState::Fired {
            break;
        }
    }
    let fired = status(&mut fixture, id);
    assert_eq!((fired.state, fired.recordings), (RuleState::Fired, 2));
    fixture.steps(6_000);
    assert!(next(&mut helper).is_some());
    assert!(next(&mut helper).is_none());

    let often = RuleRecording { times: 9, ..ONCE };
    let (id, _) = install(&mut fixture, &[records(&[above(net, 30.0)], often)]);
    fixture.steps(2);
    for value in [0.0, 31.0, 0.0, 31.0] {
        set(&mut fixture, net, value);
        fixture.steps(2);
    }
    let now = status(&mut fixture, id);
    assert_eq!((now.recordings, now.skipped), (1, 2), "{now:?}");
    assert_eq!(now.state, RuleState::Armed);
}

#[test]
fn an_edge_waits_until_the_condition_has_not_held() {
    let (mut fixture, mut helper) = recorded();
    let net = running(&mut fixture);
    set(&mut fixture, net, 31.0);
    let edge = RuleRecording { edge: true, ..ONCE };
    let (id, _) = install(&mut fixture, &[records(&[above(net, 30.0)], edge)]);
    fixture.steps(400);
    assert_eq!(status(&mut fixture, id).state, RuleState::Armed);
    // Null is not true.
    set(&mut fixture, net, f64::NAN);
    fixture.steps(2);
    set(&mut fixture, net, 31.0);
    fixture.steps(400);
    assert_eq!(status(&mut fixture, id).state, RuleState::Fired);
    assert!(next(&mut helper).is_some());
    let (level, cycle) = install(&mut fixture, &[records(&[above(net, 30.0)], ONCE)]);
    assert_eq!(status(&mut fixture, level).recorded_cycle, cycle);
}

#[test]
fn it_expires_when_its_condition_cannot_become_true_again_and_survives_a_stop() {
    let (mut fixture, _helper) = recorded();
    let net = running(&mut fixture);
    let topic = rcc_core::topic::Topic::new("part/there", "Bool", "");
    let many = RuleRecording { times: 9, ..ONCE };
    let rules = [
        records(&[above(net, 30.0)], many),
        records(
            &[above(net, 30.0), RuleTerm::Topic { topic }, RuleTerm::Or],
            many,
        ),
    ];
    let (first, _) = install(&mut fixture, &rules);
    set(&mut fixture, net, 31.0);
    fixture.steps(2);
    // It holds for ever now.
    fixture.ask(|ticket| EngineRequest::Abort { ticket, id: net });
    fixture.steps(5);
    assert_eq!(fixture.state(net), CommandState::Terminated);
    let ended = status(&mut fixture, first);
    assert_eq!((ended.state, ended.recordings), (RuleState::Expired, 1));
    assert_eq!(
        status(&mut fixture, first + 1).state,
        RuleState::Expired,
        "`or` holds whatever the topic becomes"
    );
}

#[test]
fn what_cannot_be_recorded_is_refused() {
    let fault = |fault| Answer::Refused(Refusal::Rule { index: 0, fault });
    let (mut fixture, _helper) = recorded();
    let net = running(&mut fixture);
    let lamp = fixture.load(output_net(1));
    let with = |times, distance_ns| RuleRecording {
        times,
        distance_ns,
        edge: false,
    };
    for recording in [
        with(0, RECORD_DISTANCE_MIN_NS),
        with(1001, RECORD_DISTANCE_MIN_NS),
        with(1, RECORD_DISTANCE_MIN_NS - 1),
        with(1, u64::MAX),
    ] {
        let answer = try_install(&mut fixture, &[records(&[above(net, 1.0)], recording)]);
        assert_eq!(answer, fault(RuleFault::Recording), "{recording:?}");
    }
    let both = Rule {
        record: Some(ONCE),
        ..rule(&[RuleTerm::True], &[], &[], &[lamp])
    };
    let answer = try_install(&mut fixture, &[both]);
    assert_eq!(answer, fault(RuleFault::RecordsOnly));
    let edge = RuleRecording { edge: true, ..ONCE };
    let answer = try_install(&mut fixture, &[records(&[RuleTerm::True], edge)]);
    assert_eq!(answer, fault(RuleFault::NeverFires));
    let outside = RuleTerm::Compare {
        command: net,
        slot: 1_000_000,
        relation: Relation::Below,
        limit: Limit::Int(0),
    };
    let answer = try_install(&mut fixture, &[records(&[outside], ONCE)]);
    let refusal = Refusal::Rule {
        index: 0,
        fault: RuleFault::NoSuchValue,
    };
    assert_eq!(answer, Answer::RefusedFor { id: net, refusal });

    let mut without = EngineFixture::new();
    let net = running(&mut without);
    let answer = try_install(&mut without, &[records(&[above(net, 1.0)], ONCE)]);
    assert_eq!(answer, Answer::Refused(Refusal::NoRecorder));
}
