//! Tests of nets whose START was taken and not answered.

use super::*;
use crate::engine::end_sessions;
use crate::state::Session;

/// Starts `n` with a loader that takes START and whose answer is lost; a second START is refused.
fn with_lost_start(bench: &mut Bench) -> FakeLoader {
    let attempts = std::sync::atomic::AtomicUsize::new(0);
    let loader = FakeLoader::start(&bench.folder, move |request| match request {
        "n/start" => match attempts.fetch_add(1, std::sync::atomic::Ordering::Relaxed) {
            0 => Err(codes::LOADER_SILENT),
            _ => Err(codes::WRONG_STATE),
        },
        _ => Ok(()),
    });
    assert_eq!(bench.ask("nest(\"n\")"), "ok()");
    bench.fire();
    assert_eq!(bench.rule(1), RuleState::Active);
    assert!(bench.gateway.state().nets["n"].may_run);
    loader
}

#[test]
fn a_start_whose_answer_was_lost_has_succeeded_if_the_net_runs() {
    for state in ["running", "canceling", "terminated"] {
        let mut bench = Bench::new(&[("n", NetState::Ready)]);
        let loader = with_lost_start(&mut bench);
        loader.tell(state);
        bench.fire();
        assert_eq!(bench.rule(1), RuleState::Fired, "{state}");
        assert_eq!(bench.state("n"), NetState::Running, "{state}");
        assert!(!bench.gateway.state().nets["n"].may_run, "{state}");
        let requests = loader.requests();
        assert_eq!(requests, ["n/start", "n/start", "n"], "{state}");
    }
}

#[test]
fn a_start_whose_answer_was_lost_is_tried_again_until_it_is_taken() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    let loader = with_lost_start(&mut bench);
    // The core waits for the next cycle: the net is ready, and another START is wrong.
    bench.fire();
    assert_eq!(bench.rule(1), RuleState::Active);
    assert!(bench.gateway.state().nets["n"].may_run);
    loader.tell("running");
    bench.fire();
    assert_eq!(bench.rule(1), RuleState::Fired);
}

#[test]
fn a_stop_after_a_start_whose_answer_was_lost_is_sent() {
    for (stop, sent) in [("neab(\"n\")", "n/abort"), ("neca(\"n\")", "n/cancel")] {
        let mut bench = Bench::new(&[("n", NetState::Ready)]);
        let loader = with_lost_start(&mut bench);
        loader.tell("running");
        assert_eq!(bench.ask(stop), "ok()");
        bench.fire();
        assert_eq!(bench.rule(1), RuleState::FireFailed);
        send_owed(&bench.gateway, &mut bench.loader());
        assert_eq!(loader.requests(), ["n/start", sent, sent, "n", sent]);
        let state = bench.gateway.state();
        let net = &state.nets["n"];
        // It runs until the core has told of its end.
        assert_eq!(net.state, NetState::Running);
        assert!(!net.may_run && net.owed_stop.is_none());
    }
}

#[test]
fn a_net_that_never_started_is_terminated_by_a_stop_after_a_lost_answer() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    let _loader = with_lost_start(&mut bench);
    assert_eq!(bench.ask("neab(\"n\")"), "ok()");
    send_owed(&bench.gateway, &mut bench.loader());
    assert_eq!(bench.state("n"), NetState::Terminated);
    assert!(!bench.gateway.state().nets["n"].may_run);
}

#[test]
fn a_rule_stops_a_net_whose_start_was_not_answered() {
    for rule in ["nesc(\"t\",[\"n\"],[],[])", "nesc(\"t\",[],[\"n\"],[])"] {
        let mut bench = Bench::new(&[("n", NetState::Ready)]);
        let loader = with_lost_start(&mut bench);
        loader.tell("running");
        assert_eq!(bench.ask(rule), "ok(\"2\")");
        bench.fire();
        // The newest rule is first.
        assert_eq!(bench.rule(2), RuleState::Fired, "{rule}");
        assert_eq!(
            loader.requests(),
            ["n/start", "n/cancel", "n", "n/cancel"],
            "{rule}"
        );
        assert_eq!(bench.state("n"), NetState::Running, "{rule}");
    }
}

#[test]
fn a_net_that_runs_although_its_rule_has_failed_is_stopped() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    let loader = with_lost_start(&mut bench);
    let mut state = bench.gateway.state();
    state.decide(1, RuleState::FireFailed, std::time::Instant::now());
    drop(state);
    assert!(bench.ask("neun(\"n\")").starts_with("err("));
    loader.tell("running");
    stop_unnoticed(&bench.gateway, &mut bench.loader());
    send_owed(&bench.gateway, &mut bench.loader());
    assert_eq!(loader.requests(), ["n/start", "n", "n/cancel"]);
    assert_eq!(bench.state("n"), NetState::Cancelling);
}

#[test]
fn a_net_that_is_ready_after_its_rule_has_failed_can_be_started_again() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    let loader = with_lost_start(&mut bench);
    let mut state = bench.gateway.state();
    state.decide(1, RuleState::FireFailed, std::time::Instant::now());
    drop(state);
    stop_unnoticed(&bench.gateway, &mut bench.loader());
    send_owed(&bench.gateway, &mut bench.loader());
    assert_eq!(loader.requests(), ["n/start", "n"]);
    let state = bench.gateway.state();
    assert!(!state.nets["n"].may_run && !state.nets["n"].state.is_over());
}

#[test]
fn the_end_of_a_session_stops_a_net_whose_start_was_not_answered() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    let loader = with_lost_start(&mut bench);
    let session = Session {
        is_ending: true,
        ..Session::default()
    };
    bench
        .gateway
        .state()
        .sessions
        .insert(String::new(), session);
    end_sessions(&bench.gateway, &mut bench.loader());
    assert!(bench.gateway.state().nets["n"].owed_stop.is_some());
    send_owed(&bench.gateway, &mut bench.loader());
    assert_eq!(loader.requests(), ["n/start", "n/cancel", "n"]);
    assert_eq!(bench.state("n"), NetState::Terminated);
    end_sessions(&bench.gateway, &mut bench.loader());
    let state = bench.gateway.state();
    assert!(state.nets.is_empty() && state.sessions.is_empty());
}
