//! Tests of stops, with a loader whose answers the tests give: before, during and after START, and while nobody answers.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use rcc_api::codes::{self, ErrorCode};

use super::*;
use crate::fake_loader::{FakeLoader, connected_pair, socket};
use crate::firing::fire_due;
use crate::gateway::GatewayOptions;
use crate::outbox::Outbox;
use crate::requests::Dialogue;
use crate::rules::RuleState;
use crate::state::{GatewayNet, ReportedValue};

/// Nets that can be canceled, in the core, and a client.
struct Bench {
    gateway: Arc<Gateway>,
    folder: rcc_testing::TempDir,
    dialogue: Dialogue,
    frames: Receiver<Vec<u8>>,
}

impl Bench {
    fn new(nets: &[(&str, NetState)]) -> Bench {
        let folder = rcc_testing::folder();
        let options = GatewayOptions {
            session_timeout: Duration::from_secs(10),
        };
        let gateway = Arc::new(Gateway::new(options, socket(&folder), None));
        for (number, (name, state)) in (1..).zip(nets) {
            let net = GatewayNet {
                state: *state,
                command: Some(number),
                can_cancel: true,
                ..GatewayNet::default()
            };
            gateway.state().nets.insert((*name).to_owned(), net);
        }
        let (server, _) = connected_pair();
        let (outbox, frames) = Outbox::new(1, Arc::new(server));
        let dialogue = Dialogue::new(Arc::clone(&gateway), outbox);
        let mut bench = Bench {
            gateway,
            folder,
            dialogue,
            frames,
        };
        assert_eq!(bench.ask("ver(\"2.0\")"), "ok(\"handshake ok\")");
        bench
    }

    /// Sends a request; returns its answer.
    fn ask(&mut self, request: &str) -> String {
        self.dialogue.answer(&format!("c={request}"));
        let frame = self.frames.try_recv().expect("an answer");
        // Head of two bytes, or four for long texts.
        let text = String::from_utf8_lossy(&frame);
        let (_, text) = text.split_once("c=").expect("the answer to c");
        text.to_owned()
    }

    /// Returns a client of the loader, without a lease.
    fn loader(&self) -> CellClient {
        CellClient::new(&socket(&self.folder))
    }

    /// Decides every rule, as the engine does in a turn. Rules that wait for another attempt are due.
    fn fire(&self) {
        let mut state = self.gateway.state();
        state
            .rules
            .values_mut()
            .for_each(|rule| rule.not_before = None);
        drop(state);
        fire_due(&self.gateway, &mut self.loader());
    }

    fn state(&self, net: &str) -> NetState {
        self.gateway.state().nets[net].state
    }

    fn rule(&self, number: u64) -> RuleState {
        self.gateway.state().rules[&number].state
    }
}

/// Runs `meanwhile` between the START of `n` and its answer; returns the requests. Until then the core refuses stops, as it
/// does while it builds the net anew.
fn while_starting(
    bench: &mut Bench,
    answer: Result<(), ErrorCode>,
    meanwhile: impl FnOnce(&mut Bench),
) -> Vec<String> {
    let (arrived, has_arrived) = channel();
    let (release, released) = channel::<()>();
    let released = std::sync::Mutex::new((released, false));
    let loader = FakeLoader::start(&bench.folder, move |request| match request {
        "n/start" => {
            arrived.send(()).expect("the test waits");
            let mut released = released.lock().expect("no panic");
            // The test has failed if the other end is gone.
            let _ = released.0.recv();
            released.1 = true;
            answer
        }
        _ => match released.try_lock() {
            Ok(released) if released.1 => Ok(()),
            _ => Err(codes::WRONG_STATE),
        },
    });
    let (gateway, mut client) = (Arc::clone(&bench.gateway), bench.loader());
    let engine = std::thread::spawn(move || fire_due(&gateway, &mut client));
    // Generous: only a failing test waits so long.
    let limit = Duration::from_secs(60);
    has_arrived.recv_timeout(limit).expect("START");
    meanwhile(bench);
    drop(release);
    engine.join().expect("no panic");
    loader.requests()
}

#[test]
fn a_net_that_is_stopped_before_its_start_is_sent_never_starts() {
    for stop in [
        "neab(\"n\")",
        "neca(\"n\")",
        "nesc(\"t\",[\"n\"],[],[])",
        "nesc(\"t\",[],[\"n\"],[])",
    ] {
        let mut bench = Bench::new(&[("n", NetState::Ready)]);
        let loader = FakeLoader::start(&bench.folder, |_| Ok(()));
        assert_eq!(bench.ask("nest(\"n\")"), "ok()");
        assert!(bench.ask(stop).starts_with("ok("), "{stop}");
        bench.fire();
        assert_eq!(bench.state("n"), NetState::Terminated, "{stop}");
        assert_eq!(bench.rule(1), RuleState::FireFailed, "{stop}");
        assert!(loader.requests().is_empty(), "{stop}");
    }
}

#[test]
fn a_cancel_does_nothing_to_a_net_that_nothing_starts() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    assert_eq!(bench.ask("neca(\"n\")"), "ok()");
    assert_eq!(bench.state("n"), NetState::Ready);
}

#[test]
fn a_net_that_is_aborted_while_it_starts_is_aborted_when_it_has_started() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    bench.ask("nest(\"n\")");
    let requests = while_starting(&mut bench, Ok(()), |bench| {
        assert_eq!(bench.ask("neab(\"n\")"), "ok()");
    });
    assert_eq!(requests, ["n/start", "n/abort", "n/abort"]);
    let state = bench.gateway.state();
    let net = &state.nets["n"];
    assert!(net.is_ending && net.owed_stop.is_none() && !net.is_starting);
    // It runs until the core has told of its end.
    assert_eq!(net.state, NetState::Running);
}

#[test]
fn a_net_that_is_canceled_while_it_starts_is_canceled_when_it_has_started() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    bench.ask("nest(\"n\")");
    let requests = while_starting(&mut bench, Ok(()), |bench| {
        assert_eq!(bench.ask("neca(\"n\")"), "ok()");
    });
    assert_eq!(requests, ["n/start", "n/cancel", "n/cancel"]);
    assert_eq!(bench.state("n"), NetState::Cancelling);
}

#[test]
fn a_net_without_a_cancel_that_is_canceled_while_it_starts_is_aborted() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    let mut state = bench.gateway.state();
    state
        .nets
        .values_mut()
        .for_each(|net| net.can_cancel = false);
    drop(state);
    bench.ask("nest(\"n\")");
    let requests = while_starting(&mut bench, Ok(()), |bench| {
        assert_eq!(bench.ask("neca(\"n\")"), "ok()");
    });
    assert_eq!(requests, ["n/start", "n/abort", "n/abort"]);
}

#[test]
fn a_net_whose_start_was_refused_after_a_stop_is_not_started_again() {
    let mut bench = Bench::new(&[("n", NetState::Ready)]);
    bench.ask("nest(\"n\")");
    // A refusal after which a start is tried again.
    let requests = while_starting(&mut bench, Err(codes::DEVICE_NOT_READY), |bench| {
        assert_eq!(bench.ask("neab(\"n\")"), "ok()");
    });
    assert_eq!(requests, ["n/start", "n/abort", "n/abort"]);
    assert_eq!(bench.state("n"), NetState::Terminated);
    bench.fire();
    assert_eq!(bench.rule(1), RuleState::FireFailed);
}

#[test]
fn a_stop_that_the_core_does_not_take_after_start_stays_owed() {
    let mut bench = Bench::new(&[("n", NetState::Running)]);
    bench
        .gateway
        .state()
        .nets
        .values_mut()
        .for_each(|net| net.owed_stop = Some(StopKind::Abort));
    send_owed(&bench.gateway, &mut bench.loader());
    assert!(bench.gateway.state().nets["n"].owed_stop.is_some());
    assert!(bench.ask("neab(\"n\")").starts_with("err("));
    let loader = FakeLoader::start(&bench.folder, |_| Ok(()));
    send_owed(&bench.gateway, &mut bench.loader());
    assert!(bench.gateway.state().nets["n"].owed_stop.is_none());
    send_owed(&bench.gateway, &mut bench.loader());
    assert_eq!(loader.requests(), ["n/abort"]);
}

#[test]
fn a_net_that_may_run_is_not_unloaded() {
    let mut bench = Bench::new(&[("runs", NetState::Running), ("owed", NetState::Scheduled)]);
    let mut state = bench.gateway.state();
    let net = state.nets.get_mut("owed").expect("a net");
    net.owed_stop = Some(StopKind::Abort);
    drop(state);
    for name in ["runs", "owed"] {
        assert!(bench.ask(&format!("neun({name:?})")).starts_with("err("));
        assert!(bench.gateway.state().nets.contains_key(name));
    }
}

#[test]
fn a_cancel_that_nobody_takes_is_an_error() {
    let mut bench = Bench::new(&[("n", NetState::Running)]);
    assert!(bench.ask("neca(\"n\")").starts_with("err("));
    assert_eq!(bench.state("n"), NetState::Running);
    let _loader = FakeLoader::start(&bench.folder, |_| Err(codes::EXECUTOR_SILENT));
    assert!(bench.ask("neca(\"n\")").starts_with("err("));
    assert_eq!(bench.state("n"), NetState::Running);
}

#[test]
fn a_cancel_that_a_net_does_not_need_is_done() {
    for refusal in [
        codes::WRONG_STATE,
        codes::UNKNOWN_COMMAND,
        codes::NOT_CANCELABLE,
    ] {
        let mut bench = Bench::new(&[("n", NetState::Running)]);
        let _loader = FakeLoader::start(&bench.folder, move |_| Err(refusal));
        assert_eq!(bench.ask("neca(\"n\")"), "ok()", "{refusal:?}");
    }
}

#[test]
fn a_rule_fires_when_its_stops_have_been_delivered_and_not_before() {
    let mut bench = Bench::new(&[
        ("canceled", NetState::Running),
        ("stopped", NetState::Running),
        ("ready", NetState::Ready),
    ]);
    let rule = "nesc(\"t\",[\"stopped\",\"ready\"],[\"canceled\"],[])";
    assert_eq!(bench.ask(rule), "ok(\"1\")");
    bench.fire();
    assert_eq!(bench.rule(1), RuleState::Active);
    assert_eq!(bench.state("canceled"), NetState::Running);
    // What needs no loader is done already.
    assert_eq!(bench.state("ready"), NetState::Terminated);
    assert!(!bench.gateway.state().nets["stopped"].is_ending);
    let loader = FakeLoader::start(&bench.folder, |_| Ok(()));
    bench.fire();
    assert_eq!(bench.rule(1), RuleState::Fired);
    assert_eq!(bench.state("canceled"), NetState::Cancelling);
    assert!(bench.gateway.state().nets["stopped"].is_ending);
    assert_eq!(loader.requests(), ["canceled/cancel", "stopped/inputs"]);
}

#[test]
fn one_stop_that_is_not_delivered_does_not_keep_back_the_others() {
    let mut bench = Bench::new(&[("a", NetState::Running), ("b", NetState::Running)]);
    let loader = FakeLoader::start(&bench.folder, |request| match request {
        "a/cancel" => Err(codes::NO_EXECUTOR),
        _ => Ok(()),
    });
    bench.ask("nesc(\"t\",[],[\"a\",\"b\"],[])");
    bench.fire();
    assert_eq!(loader.requests(), ["a/cancel", "b/cancel"]);
    assert_eq!(bench.rule(1), RuleState::Active);
    bench.fire();
    assert_eq!(loader.requests(), ["a/cancel", "b/cancel", "a/cancel"]);
}

#[test]
fn a_net_that_cannot_be_ended_is_aborted_and_the_rule_waits_for_that() {
    let mut bench = Bench::new(&[("n", NetState::Running)]);
    let attempts = std::sync::atomic::AtomicUsize::new(0);
    let loader = FakeLoader::start(&bench.folder, move |request| {
        let attempt = attempts.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        match (request, attempt) {
            ("n/abort", 3) => Ok(()),
            _ => Err(codes::EXECUTOR_SILENT),
        }
    });
    bench.ask("nesc(\"t\",[\"n\"],[],[])");
    bench.fire();
    assert_eq!(bench.rule(1), RuleState::Active);
    bench.fire();
    assert_eq!(bench.rule(1), RuleState::Fired);
    let requests = loader.requests();
    assert_eq!(requests, ["n/inputs", "n/abort", "n/inputs", "n/abort"]);
}

#[test]
fn a_cancel_beside_a_start_stays_owed_until_the_core_takes_it() {
    let mut bench = Bench::new(&[("before", NetState::Running), ("n", NetState::Ready)]);
    let attempts = std::sync::atomic::AtomicUsize::new(0);
    let loader = FakeLoader::start(&bench.folder, move |_| {
        match attempts.fetch_add(1, std::sync::atomic::Ordering::Relaxed) {
            1 => Err(codes::EXECUTOR_SILENT),
            _ => Ok(()),
        }
    });
    bench.ask("nesc(\"t\",[],[\"before\"],[\"n\"])");
    bench.fire();
    assert_eq!(bench.rule(1), RuleState::Fired);
    assert_eq!(bench.state("n"), NetState::Running);
    assert_eq!(bench.state("before"), NetState::Running);
    send_owed(&bench.gateway, &mut bench.loader());
    assert_eq!(bench.state("before"), NetState::Cancelling);
    let requests = loader.requests();
    assert_eq!(requests, ["n/start", "before/cancel", "before/cancel"]);
}

#[test]
fn a_stop_that_was_not_delivered_no_longer_waits_for_its_condition() {
    // The condition is false then, or can never be true again.
    for ended in [false, true] {
        let mut bench = Bench::new(&[("n", NetState::Running), ("m", NetState::Running)]);
        let gateway = Arc::clone(&bench.gateway);
        let tell = |value: &str| {
            let mut state = gateway.state();
            let net = state.nets.get_mut("n").expect("a net");
            net.reported = vec![ReportedValue {
                port: "out_0.value".to_owned(),
                source: "a.out".to_owned(),
                type_name: "Bool".to_owned(),
                key: "out_0".to_owned(),
            }];
            net.values.insert("out_0".to_owned(), value.to_owned());
        };
        tell("true");
        assert_eq!(bench.ask("nesc(\"n.out_0\",[\"m\"],[],[])"), "ok(\"1\")");
        bench.fire();
        assert_eq!(bench.rule(1), RuleState::Active);
        tell("false");
        if ended {
            let mut state = bench.gateway.state();
            state.nets.get_mut("n").expect("a net").state = NetState::Terminated;
        }
        bench.fire();
        assert_eq!(bench.rule(1), RuleState::Active);
        let loader = FakeLoader::start(&bench.folder, |_| Ok(()));
        bench.fire();
        assert_eq!(bench.rule(1), RuleState::Fired);
        assert_eq!(loader.requests(), ["m/inputs"]);
    }
}

mod lost_answer;
