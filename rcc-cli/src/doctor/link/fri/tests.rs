//! Each stage on fixed facts: good ones, and every way in which users' connections have failed. Run by the test
//! harness.

use serde_json::{Value, json};

use super::super::LinkReport;
use super::super::sockets::NetworkInterface;
use super::*;
use crate::doctor::driver_status::{DriverStatus, SecondStats, now};

fn link(change: Value) -> Value {
    let mut link = json!({
        "listen": "192.168.0.1:49938", "controller": "192.168.0.20:49938", "datagrams": 5000, "accepted": 5000,
        "foreign": 0, "wrong_size": 0, "wrong_identity": 0, "malformed": 0, "disordered": 0, "gaps": 0,
        "gaps_datagrams": 0, "interval_max_ns": 1_100_000, "interval_longest_ns": 1_900_000, "answered": 5000,
        "answer_mean_ns": 30_000, "answer_max_ns": 80_000, "answer_longest_ns": 90_000,
        "wire": {
            "session": "command", "quality": "perfect", "control": "position", "power": 127, "error": 0, "warning": 0,
            "missed": 0, "period_s": 0.001, "answer_rate": 1.0, "latency_s": 0.0001, "jitter_s": 0.00002
        }
    });
    for (key, value) in change.as_object().into_iter().flatten() {
        let object = if link["wire"].get(key).is_some() {
            &mut link["wire"]
        } else {
            &mut link
        };
        object[key] = value.clone();
    }
    link
}

fn interface() -> NetworkInterface {
    NetworkInterface {
        name: "enp3s0".to_owned(),
        address: [192, 168, 0, 1].into(),
        mask: [255, 255, 255, 0].into(),
        up: true,
    }
}

/// Facts with a running driver; `change` modifies its good diagnosis.
fn running(change: Value) -> LinkFacts {
    let second = SecondStats {
        quality_min: 1000,
        quality_mean: 1000,
        exchanges: 1000,
        ..SecondStats::default()
    };
    LinkFacts {
        device: "lwr".to_owned(),
        driver: "fri-lwr".to_owned(),
        source: "lwr.yaml".to_owned(),
        settings: json!({"listen": "192.168.0.1:49938"}),
        period_ns: 1_000_000,
        pid: Some(7),
        driver_status: Some(DriverStatus {
            pid: 7,
            at: now(),
            since: now(),
            state: "ready".to_owned(),
            seconds: vec![second; 60],
            link: link(change),
            ..DriverStatus::default()
        }),
        interfaces: vec![interface()],
        ..LinkFacts::default()
    }
}

/// Facts without a driver; `change` modifies what was heard in its place.
fn heard(change: Value) -> LinkFacts {
    LinkFacts {
        pid: None,
        driver_status: None,
        probe: Some(json!({"opened": true, "link": link(change)})),
        ..running(json!({}))
    }
}

/// Returns the failed stage and the text of its finding.
fn failure(facts: &LinkFacts) -> (&'static str, String) {
    let report = LinkReport::of(facts);
    let last = report.findings.last().expect("a finding");
    let words = format!(
        "{} | {} | {}",
        last.what,
        last.cause.clone().unwrap_or_default(),
        last.fix.clone().unwrap_or_default()
    );
    (report.failed.unwrap_or("none"), words)
}

fn assert_fails(facts: &LinkFacts, stage: &str, words: &[&str]) {
    let (failed, said) = failure(facts);
    assert_eq!(failed, stage, "{said}");
    for word in words {
        assert!(said.contains(word), "{word}: {said}");
    }
}

#[test]
fn a_good_connection_passes_every_stage() {
    let report = LinkReport::of(&running(json!({})));
    assert_eq!(report.failed, None);
    let bad: Vec<_> = report
        .findings
        .iter()
        .filter(|finding| finding.level != FindingLevel::Ok)
        .collect();
    assert!(bad.is_empty(), "{bad:?}");
    assert!(report.human().contains("lwr works"));
}

#[test]
fn the_interface_must_have_the_address_be_up_and_share_the_subnet() {
    let mut facts = running(json!({}));
    facts.settings = json!({"listen": "192.168.1.1:49938"});
    assert_fails(
        &facts,
        "interface",
        &[
            "no network interface",
            "192.168.1.1",
            "enp3s0 192.168.0.1/24",
        ],
    );
    let mut facts = running(json!({}));
    facts.interfaces[0].up = false;
    assert_fails(&facts, "interface", &["enp3s0", "is down", "cable"]);
    let mut facts = running(json!({}));
    facts.settings = json!({"listen": "192.168.0.1:49938", "peer": "192.168.1.20:49938"});
    assert_fails(&facts, "interface", &["192.168.1.20", "subnet"]);
    facts.settings = json!({"listen": "192.168.0.1:49938", "peer": "192.168.1.20"});
    assert_fails(&facts, "interface", &["192.168.1.20", "subnet"]);
    facts.settings = json!({"listen": "nonsense"});
    assert_fails(&facts, "interface", &["settings.listen"]);
}

#[test]
fn a_sparse_header_and_a_doubt_are_told_with_their_settings() {
    let unfilled = json!({"accepted": 0, "wrong_identity": 5000, "wrong_identity_last": 0});
    assert_fails(&heard(unfilled), "version", &["identity", "header: sparse"]);
    let doubt = "the sample time differed from its mean by more than settings.period_tolerance";
    let report = LinkReport::of(&running(json!({"doubted": 3, "doubt_last": doubt})));
    let told = report.human();
    assert!(
        report.failed.is_none() && told.contains("period_tolerance"),
        "{told}"
    );
}

#[test]
fn a_port_in_use_names_its_holder() {
    let mut facts = heard(json!({}));
    facts.probe = Some(json!({"opened": false, "error": "…", "errno": nix::libc::EADDRINUSE}));
    facts.holder = Some("other (pid 99)".to_owned());
    assert_fails(&facts, "port", &["in use by other (pid 99)", "FRISOCK"]);
    facts.probe = Some(json!({"opened": false, "error": "devices.lwr.robot: …", "errno": null}));
    assert_fails(&facts, "port", &["devices.lwr.robot"]);
}

#[test]
fn silence_names_what_to_look_at_on_the_controller() {
    let silent = json!({"datagrams": 0, "accepted": 0, "controller": null, "wire": null});
    assert_fails(
        &running(silent.clone()),
        "datagrams",
        &[
            "no datagrams arrive at 192.168.0.1:49938",
            "FRIHOST=192.168.0.1",
            "firewall",
        ],
    );
    assert_fails(&heard(silent), "datagrams", &["friOpen"]);
    let mut stopped = running(json!({}));
    stopped.previous_status = stopped.driver_status.clone();
    assert_fails(&stopped, "datagrams", &["no more datagrams", "(5000 since"]);
}

#[test]
fn datagrams_of_another_sender_name_both_addresses() {
    let mut facts = running(
        json!({"accepted": 0, "foreign": 2000, "foreign_last": "127.0.0.2:40000", "wire": null}),
    );
    facts.settings = json!({"listen": "192.168.0.1:49938", "peer": "192.168.0.20:49938"});
    assert_fails(
        &facts,
        "sender",
        &[
            "2000 datagrams came from 127.0.0.2:40000",
            "accepts only 192.168.0.20:49938",
        ],
    );
    let beside = LinkReport::of(&running(
        json!({"foreign": 20, "foreign_last": "10.0.0.9:5"}),
    ));
    assert_eq!(beside.failed, None);
    assert!(
        beside
            .human()
            .contains("20 datagrams came from 10.0.0.9:5; they are refused")
    );
}

#[test]
fn garbage_other_versions_and_sunrise_are_distinguished() {
    let none = |key: &str, more: Value| {
        let mut change = json!({"accepted": 0, "wire": null, key: 100});
        for (key, value) in more.as_object().into_iter().flatten() {
            change[key] = value.clone();
        }
        running(change)
    };
    let garbage =
        json!({"wrong_size_last": 5, "wrong_size_head": [104, 101, 108, 108, 111, 0, 0, 0]});
    assert_fails(
        &none("wrong_size", garbage),
        "version",
        &["datagrams of 5 bytes", "916"],
    );
    let bare =
        json!({"wrong_size_last": 300, "wrong_size_head": [10, 17, 8, 194, 162, 145, 1, 16]});
    assert_fails(
        &none("wrong_size", bare),
        "version",
        &["Sunrise (SDK 1.x to 2.5)", "iiwa"],
    );
    let framed = json!({"wrong_size_last": 300, "wrong_size_head": [44, 1, 0, 0, 10, 17, 8, 194]});
    assert_fails(&none("wrong_size", framed), "version", &["SDK 2.7"]);
    let older = json!({"wrong_identity_last": 0x2005});
    assert_fails(
        &none("wrong_identity", older),
        "version",
        &["0x2005", "0x2006"],
    );
    let command = json!({"wrong_identity_last": 0x1005});
    assert_fails(
        &none("wrong_identity", command),
        "version",
        &["the other PC program"],
    );
    assert_fails(
        &none("malformed", json!({})),
        "version",
        &["invalid values"],
    );
    assert_fails(&none("disordered", json!({})), "order", &["are repeated"]);
}

#[test]
fn garbage_beside_a_good_controller_warns_only() {
    let report = LinkReport::of(&running(json!({"wrong_size": 3, "wrong_size_last": 5})));
    assert_eq!(report.failed, None);
    assert!(
        report
            .human()
            .contains(" WARN  received datagrams of 5 bytes")
    );
}

#[test]
fn drive_errors_and_missing_power_are_reported() {
    assert_fails(
        &running(json!({"error": 5})),
        "drives",
        &["joint 1, joint 3", "KCP"],
    );
    assert_fails(
        &running(json!({"power": 0})),
        "drives",
        &["no power", "E-stop", "T1"],
    );
    let warned = LinkReport::of(&running(json!({"warning": 2})));
    assert!(warned.human().contains("a warning: joint 2"));
}

#[test]
fn another_control_strategy_names_the_variable() {
    assert_fails(
        &running(json!({"control": "other"})),
        "control",
        &["other", "$STIFFNESS.STRATEGY = 10"],
    );
    let soft = LinkReport::of(&running(json!({"control": "joint impedance"})));
    assert!(
        soft.human()
            .contains("the controller is in joint impedance control")
    );
}

#[test]
fn bad_quality_names_the_cause() {
    let late = |change: Value| {
        let mut facts = running(change);
        if let Some(status) = &mut facts.driver_status {
            status.seconds.push(SecondStats {
                late: 61,
                quality_mean: 333,
                quality_min: 0,
                exchanges: 1000,
                refused: 0,
            });
        }
        facts
    };
    assert_fails(
        &late(json!({"quality": "bad"})),
        "quality",
        &[
            "quality bad",
            "61 late or lost answers",
            "on the way to the controller",
        ],
    );
    assert_fails(
        &late(json!({"quality": "bad", "answer_max_ns": 12_000_000})),
        "quality",
        &["took up to 12.0 ms", "rcc-cli doctor"],
    );
    assert_fails(
        &late(json!({"quality": "unacceptable", "gaps_datagrams": 7})),
        "quality",
        &["lost or late as well"],
    );
    let recovered = LinkReport::of(&late(json!({})));
    assert_eq!(recovered.failed, None);
    assert!(
        recovered.human().contains(" WARN  quality perfect"),
        "{}",
        recovered.human()
    );
}

#[test]
fn without_a_driver_quality_is_not_judged() {
    let report = LinkReport::of(&heard(
        json!({"quality": "unacceptable", "session": "monitor"}),
    ));
    assert_eq!(report.failed, None);
    assert!(
        report
            .human()
            .contains("not meaningful, because no driver answers the controller")
    );
}

#[test]
fn a_controller_that_monitors_names_the_call_that_is_missing() {
    assert_fails(
        &running(json!({"session": "monitor"})),
        "session",
        &["friStart", "$FRI_FRM_INT[1]"],
    );
}

#[test]
fn gaps_and_another_period_are_reported() {
    let pauses = LinkReport::of(&running(json!({"interval_max_ns": 9_000_000}))).human();
    assert!(
        pauses.contains("longest gap 9.0 ms during the check"),
        "{pauses}"
    );
    let period = LinkReport::of(&running(json!({"period_s": 0.012}))).human();
    assert!(
        period.contains("every 12.0 ms") && period.contains("friOpen(1)"),
        "{period}"
    );
}
