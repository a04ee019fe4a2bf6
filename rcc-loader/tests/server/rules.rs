//! Rules and leases by name, against the fake executor.

use rcc_api::bodies::{LeaseBody, LeaseCommands, OnClientLoss, RuleBody, RulesBody, Start};
use rcc_core::topic::Topic;
use rcc_protocol::rules::{RULE_TEXT_MAX, Rule, RuleTerm};

use super::*;

/// A net with two outcomes and a Bool output.
const GRIP: &str = "net: grip
primitives:
  time: {type: Time}
  late: {type: Greater, inputs: {a: time.out, b: 1 s}}
  last: {type: Greater, inputs: {a: time.out, b: 2 s}}
  end: {type: Termination, inputs: {done: {held: late.out, empty: last.out}}}
";

fn rule(when: &str) -> RuleBody {
    serde_json::from_str(&format!(
        r#"{{"when": "{when}", "start": "line", "on_client_loss": "go on"}}"#
    ))
    .expect("a rule")
}

/// Loads `grip` and `line`; returns their ids.
fn loaded(service: &rcc_loader::server::service::Service) -> (u64, u64) {
    let load = |text: &str| {
        let id = service.reserve(&without_deadline(), text).expect("a row");
        install(service, id, text, "net.yaml");
        id
    };
    (load(GRIP), load(&line()))
}

fn installed(executor: &FakeExecutor) -> Vec<Rule> {
    let seen = executor.seen.lock().expect("seen");
    let calls = seen.calls.iter().rev();
    let mut rules = calls.filter_map(|call| match call {
        Call::InstallRules { rules } => Some(rules.iter().map(|new| new.rule).collect()),
        _ => None,
    });
    rules.next().unwrap_or_default()
}

#[test]
fn names_of_a_condition_become_numbers_and_come_back_in_the_list() {
    let test = TestCell::new("rules");
    let executor = FakeExecutor::start(&test.cell, &[], None);
    let service = service(&test.cell);
    let (grip, line) = loaded(&service);
    let body = RulesBody {
        rules: vec![
            RuleBody {
                name: Some("lift".to_owned()),
                stop: serde_json::from_str("\"grip\"").expect("one"),
                ..rule("grip.outcome == empty and not topic(part/there)")
            },
            RuleBody {
                on_client_loss: OnClientLoss::Cancel,
                ..rule("grip.late.out or grip.state != running")
            },
        ],
        lease: Some(3),
    };
    let done = service.install_rules(&without_deadline(), &body);
    let done = done.expect("installed");
    assert_eq!((done.cycle, done.rules[1].rule), (8, 2));
    let rules = installed(&executor);
    let terms: Vec<RuleTerm> = rules[0].terms().copied().collect();
    let topic = Topic::new("part/there", "Bool", "");
    assert_eq!(
        terms,
        [
            RuleTerm::Outcome {
                command: grip,
                outcome: 2
            },
            RuleTerm::Topic { topic },
            RuleTerm::Not,
            RuleTerm::And
        ]
    );
    assert_eq!((rules[0].stop[0], rules[0].start[0]), (grip, line));
    assert_eq!((rules[0].lease, rules[0].goes_on), (3, true));
    assert!(!rules[1].goes_on);
    assert!(
        matches!(rules[1].when[0], Some(RuleTerm::Value { command, .. }) if command == grip),
        "{rules:?}"
    );
    let listed = service.rules().expect("listed");
    assert_eq!((listed.len(), listed[0].name.as_str()), (2, "lift"));
    assert_eq!(listed[0].start, [format!("line#{line}")]);
    assert_eq!(listed[1].name, listed[1].when);
    assert_eq!(service.rule(2).expect("there"), listed[1]);
    assert_eq!(service.rule(7).expect_err("none").code, codes::UNKNOWN_RULE);
    service
        .remove_rule(&without_deadline(), 1)
        .expect("removed");
    assert_eq!(service.rules().expect("listed").len(), 1);
}

#[test]
fn a_wrong_name_is_refused_with_what_is_probably_meant() {
    let test = TestCell::new("rule-names");
    let _executor = FakeExecutor::start(&test.cell, &[], None);
    let service = service(&test.cell);
    loaded(&service);
    for (when, code, help) in [
        ("grip.outcome == hold", codes::BAD_CONDITION, "held"),
        ("line.outcome == there", codes::BAD_CONDITION, "reason"),
        ("grip.lat.out", codes::BAD_CONDITION, "late"),
        ("grip.late.oot", codes::BAD_CONDITION, "out"),
        ("grip.time.out", codes::BAD_CONDITION, ">"),
        ("grip.time.out[1] > 1", codes::BAD_CONDITION, "0 to 0"),
        (
            "grip.late.out > 1",
            codes::BAD_CONDITION,
            "not grip.late.out",
        ),
        ("grip.time.out[x] > 1", codes::BAD_CONDITION, "[2]"),
        ("late.oot", codes::BAD_CONDITION, "load the net"),
        ("grap.outcome == held", codes::UNKNOWN_COMMAND, "grip"),
        ("grip.outcome", codes::BAD_CONDITION, "=="),
    ] {
        let body = RulesBody {
            rules: vec![rule(when)],
            lease: None,
        };
        let error = service
            .install_rules(&without_deadline(), &body)
            .expect_err(when);
        assert_eq!(error.code, code, "{when}: {error:?}");
        assert!(error.help.contains(help), "{when}: {error:?}");
    }
    let long = format!("true{}", " ".repeat(1000));
    let body = RulesBody {
        rules: vec![RuleBody {
            name: Some("ä".repeat(1000)),
            ..rule(&long)
        }],
        lease: None,
    };
    let done = service.install_rules(&without_deadline(), &body);
    let done = done.expect("installed, with a short name");
    assert!(done.rules[0].name.len() <= RULE_TEXT_MAX);
}

#[test]
fn a_start_that_is_refused_leaves_no_rule_and_one_with_a_lease_carries_it() {
    let test = TestCell::new("rule-start");
    let executor = FakeExecutor::start(&test.cell, &[(77, CommandState::Running)], None);
    let service = service(&test.cell);
    let (grip, _) = loaded(&service);
    let options = Start {
        rules: vec![rule("true")],
        lease: Some(3),
        ..Start::default()
    };
    let started = service.start(&without_deadline(), "grip", &options);
    assert_eq!(started.expect("started").id, grip);
    assert_eq!(service.rules().expect("listed").len(), 1);
    let calls = executor.seen.lock().expect("seen").calls.clone();
    let place = |wanted: &dyn Fn(&Call) -> bool| calls.iter().position(wanted).expect("called");
    let ruled = place(&|call| matches!(call, Call::InstallRules { .. }));
    let begun = place(&|call| matches!(call, Call::Start { id, lease: 3 } if *id == grip));
    assert!(ruled < begun);
    // The lease has ended when START arrives: neither a rule nor a start.
    let lost = Start {
        lease: Some(4),
        ..options.clone()
    };
    let error = service.start(&without_deadline(), "grip", &lost);
    assert_eq!(error.expect_err("lost").code, codes::UNKNOWN_LEASE);
    assert_eq!(service.rules().expect("listed").len(), 1);
    // 0 is no lease for clients.
    let none = Start {
        lease: Some(0),
        ..Start::default()
    };
    let error = service.start(&without_deadline(), "grip", &none);
    assert_eq!(error.expect_err("no lease").code, codes::UNKNOWN_LEASE);
    // No such command any more when START arrives.
    let gone = service.start(
        &without_deadline(),
        "999",
        &Start {
            lease: None,
            ..options
        },
    );
    assert_eq!(gone.expect_err("gone").code, codes::UNKNOWN_COMMAND);
    assert_eq!(service.rules().expect("listed").len(), 1);
}

#[test]
fn a_lease_is_granted_renewed_bound_and_ended_over_http() {
    let test = TestCell::new("leases");
    let _executor = FakeExecutor::start(&test.cell, &[(77, CommandState::Running)], None);
    let service = service(&test.cell);
    let caller = without_deadline();
    let body = LeaseBody { expires_ms: 500 };
    assert_eq!(
        service.grant_lease(&caller, &body).expect("granted").lease,
        3
    );
    assert_eq!(service.renew_lease(&caller, 3).expect("renewed").cycle, 8);
    let commands: LeaseCommands = serde_json::from_str(r#"{"commands": 77}"#).expect("one");
    assert!(service.bind_lease(&caller, 3, &commands).is_ok());
    assert!(service.end_lease(&caller, 3).is_ok());
    let lost = service.renew_lease(&caller, 9).expect_err("unknown");
    assert_eq!(lost.code, codes::UNKNOWN_LEASE);
}
