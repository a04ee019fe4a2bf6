//! Stages for a device whose inputs are topics of another cell (`rcc-link-device`): connection, certificate, cell, topics. Pure
//! functions of the facts.

use rcc_core::printable::OneLine;

use super::plain::{quality, settings};
use super::{LinkFacts, LinkStage, configuration, driver};
use crate::doctor::HealthFinding;

/// Stages in order; the first failed one ends the report.
pub const STAGES: &[LinkStage] = &[
    ("configuration", configuration),
    ("driver", driver),
    ("settings", settings),
    ("connection", connection),
    ("certificate", certificate),
    ("cell", cell),
    ("topics", topics),
    ("quality", quality),
];

/// Returns the cell whose topics these are; `None` if no driver has told.
fn peer(facts: &LinkFacts) -> Option<&str> {
    facts.link()["peer"].as_str()
}

/// The facts about the certificates of the connection.
fn verification(facts: &LinkFacts) -> String {
    format!(
        "`rcc-link doctor --config {}` says who answers at each endpoint, and which side refuses",
        facts.source
    )
}

fn connection(facts: &LinkFacts) -> Option<HealthFinding> {
    let peer = peer(facts)?;
    match facts.total("connections") {
        0 => Some(
            HealthFinding::fail(
                format!("nothing is connected: {peer} is not reached"),
                verification(facts),
            )
            .cause("settings.connect, settings.listen or settings.router, the network, or a certificate that is refused"),
        ),
        1 => Some(HealthFinding::ok("connected")),
        count => Some(HealthFinding::ok(format!("connected to {count} processes"))),
    }
}

/// Stage: with TLS, one of the connections has the certificate of the cell; what the others send is dropped in silence.
fn certificate(facts: &LinkFacts) -> Option<HealthFinding> {
    let peer = peer(facts)?;
    if facts.settings["tls"].is_null() {
        let what = "no `tls`: whoever connects can send in the name of that cell";
        return Some(HealthFinding::note(what));
    }
    let names = facts.link()["names"].as_array()?;
    let names: Vec<&str> = names.iter().filter_map(|name| name.as_str()).collect();
    if names.contains(&peer) {
        let what = format!("the certificate at the other end is that of {peer}");
        return Some(HealthFinding::ok(what));
    }
    let names = match names.is_empty() {
        true => "without a common name".to_owned(),
        // They are what others have written.
        false => format!("of {}", OneLine(&names.join(", "))),
    };
    let what = format!("connected, but to a certificate {names}: what it sends is dropped");
    let fix = format!(
        "let settings.peer be the cell that is meant, or give it a certificate with the common name {peer}; a router is no way with `tls`"
    );
    let cause = format!("values of {peer} are taken from the certificate of {peer} only");
    Some(HealthFinding::fail(what, fix).cause(cause))
}

fn cell(facts: &LinkFacts) -> Option<HealthFinding> {
    let peer = peer(facts)?;
    if facts.link()["peer_is_alive"] == true {
        return Some(HealthFinding::ok(format!("{peer} is alive")));
    }
    let fix =
        "start it and its rcc-link, and compare site and name with its `link: site` and `cell`";
    Some(HealthFinding::fail(format!("{peer} is not there"), fix))
}

fn topics(facts: &LinkFacts) -> Option<HealthFinding> {
    let channels = facts.link()["channels"].as_object()?;
    let without = channels.iter().filter_map(|(name, channel)| {
        let (topic, state) = (channel["topic"].as_str()?, channel["state"].as_str()?);
        (state != "a value").then(|| format!("{name} ({topic}): {state}"))
    });
    let without: Vec<String> = without.collect();
    if without.is_empty() {
        let what = format!("every topic has a value: {}", channels.len());
        return Some(HealthFinding::ok(what));
    }
    let fix = "start the net there that publishes it, compare type and unit with the channel, and see that cell's `link: publish`";
    let what = without.join("; ");
    Some(match without.len() == channels.len() {
        true => HealthFinding::fail(what, fix),
        false => HealthFinding::warn(what, fix),
    })
}

#[cfg(test)]
mod tests {
    use super::super::LinkReport;
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::driver_status::{DriverStatus, now};
    use serde_json::{Value, json};

    fn report(tls: Value, link: Value) -> LinkReport {
        LinkReport::of(&LinkFacts {
            device: "press".to_owned(),
            driver: "/opt/rcc-link-device".to_owned(),
            settings: json!({"peer": "lab/press", "tls": tls}),
            pid: Some(7),
            driver_status: Some(DriverStatus {
                at: now(),
                since: now(),
                link,
                ..DriverStatus::default()
            }),
            ..LinkFacts::default()
        })
    }

    fn link(connections: u32, names: &[&str], is_alive: bool, states: [&str; 2]) -> Value {
        let [open, belt] = states.map(|state| json!({"topic": "door/open", "state": state}));
        json!({
            "peer": "lab/press", "connections": connections, "names": names, "peer_is_alive": is_alive,
            "channels": {"open": open, "belt": belt},
        })
    }

    #[test]
    fn the_first_stage_that_fails_is_the_cause() {
        let fine = ["a value"; 2];
        let files = json!({"authority": "/a", "certificate": "/c", "key": "/k"});
        for (link, failed, words) in [
            (
                link(0, &[], false, fine),
                Some("connection"),
                "is not reached",
            ),
            (
                link(1, &["lab/other"], false, fine),
                Some("certificate"),
                "a certificate of lab/other: what it sends is dropped",
            ),
            (
                link(1, &["lab/press"], false, fine),
                Some("cell"),
                "lab/press is not there",
            ),
            (
                link(1, &["lab/press"], true, ["never arrived"; 2]),
                Some("topics"),
                "open (door/open): never arrived",
            ),
            (
                link(1, &["lab/press"], true, fine),
                None,
                "every topic has a value: 2",
            ),
        ] {
            let report = report(files.clone(), link);
            assert_eq!(report.failed, failed, "{report:?}");
            assert!(report.human().contains(words), "{}", report.human());
        }
    }

    #[test]
    fn a_name_from_a_certificate_makes_no_line_of_its_own() {
        let files = json!({"authority": "/a", "certificate": "/c", "key": "/k"});
        let forged = link(1, &["lab/x\nok    press: fine"], true, ["a value"; 2]);
        let report = report(files, forged);
        let found = report.findings.last().expect("a finding");
        assert_eq!(report.failed, Some("certificate"));
        assert!(!found.what.contains('\n'), "{}", found.what);
    }

    #[test]
    fn one_topic_of_two_is_a_warning_and_a_link_without_certificates_a_note() {
        let link = link(1, &[], true, ["a value", "is Int, but the channel is Bool"]);
        let report = report(Value::Null, link);
        let level = |check: &str| {
            let found = report.findings.iter().find(|it| it.check == check);
            found.map(|it| it.level)
        };
        assert_eq!(level("certificate"), Some(FindingLevel::Note));
        assert_eq!(level("topics"), Some(FindingLevel::Warn));
        assert_eq!(report.failed, None);
    }
}
