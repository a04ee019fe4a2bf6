//! Stages for a device whose driver has no diagnosis of its own: driver, server, exchange, quality. Pure functions of
//! the facts.

use super::{LinkFacts, LinkStage, configuration, driver, percent};
use crate::doctor::HealthFinding;

/// Stages in order; the first failed one ends the report.
pub const STAGES: &[LinkStage] = &[
    ("configuration", configuration),
    ("driver", driver),
    ("settings", settings),
    ("server", server),
    ("exchange", exchange),
    ("quality", quality),
];

/// Stage: without a driver, its configuration is accepted.
pub(super) fn settings(facts: &LinkFacts) -> Option<HealthFinding> {
    if let Some(reason) = &facts.no_probe {
        let fix = "correct the device's entry in the cell's file";
        return Some(HealthFinding::fail(
            format!("no driver runs, and none can start: {reason}"),
            fix,
        ));
    }
    let probe = facts.probe.as_ref()?;
    match probe["error"].as_str() {
        // The driver's message names the setting and the remedy.
        Some(error) => Some(HealthFinding::fail(
            error,
            "correct the device's entry in the cell's file",
        )),
        None => Some(HealthFinding::note(
            "no driver runs; listened in its place, without answering",
        )),
    }
}

fn server(facts: &LinkFacts) -> Option<HealthFinding> {
    let server = facts.settings["server"].as_str()?;
    match facts.connects.as_ref()? {
        Ok(()) => Some(HealthFinding::ok(format!(
            "the server {server} accepts connections"
        ))),
        Err(error) => {
            let fix = format!(
                "check that it is on and in this subnet (ping {}), that its Modbus server is enabled on this port, \
                 that it accepts another client, and that no firewall blocks it",
                server.rsplit_once(':').map_or(server, |(host, _)| host)
            );
            Some(HealthFinding::fail(
                format!("cannot reach the server {server}: {error}"),
                fix,
            ))
        }
    }
}

/// Stage: data is exchanged, and the device can be commanded.
fn exchange(facts: &LinkFacts) -> Option<HealthFinding> {
    let (reason, description, exchanges) = match (&facts.driver_status, &facts.probe) {
        (Some(status), _) => {
            let before = facts
                .previous_status
                .as_ref()
                .map_or(0, |before| before.exchanges);
            (
                status.reason,
                status.reason_words.clone(),
                status.exchanges.saturating_sub(before),
            )
        }
        (None, Some(probe)) => {
            let last = &probe["last"];
            let reason = last["reason"]
                .as_u64()
                .and_then(|number| u32::try_from(number).ok());
            let description = last["reason_words"].as_str().unwrap_or_default().to_owned();
            (
                reason.unwrap_or(0),
                description,
                probe["exchanges"].as_u64().unwrap_or(0),
            )
        }
        (None, None) => return None,
    };
    let description = server_faults(facts).unwrap_or(description);
    if exchanges == 0 {
        let fix = "follow the message; the driver's log has every fault";
        return Some(HealthFinding::fail(
            format!("no data is exchanged: {description}"),
            fix,
        ));
    }
    match reason {
        0 => Some(HealthFinding::ok("the device answers and can be commanded")),
        _ => Some(HealthFinding::fail(
            format!("the device answers, but: {description}"),
            "follow the message",
        )),
    }
}

/// The last fault of each server that is lost, which names the point, the value or the unit.
fn server_faults(facts: &LinkFacts) -> Option<String> {
    let servers = facts.link()["servers"].as_array()?;
    let lost = servers.iter().filter(|server| server["online"] == false);
    let faults = lost.filter_map(|server| {
        let fault = server["last_fault"].as_str()?;
        Some(match server["server"].as_str() {
            Some(name) => format!("server '{name}': {fault}"),
            None => fault.to_owned(),
        })
    });
    let faults: Vec<String> = faults.collect();
    (!faults.is_empty()).then(|| faults.join("; "))
}

pub(super) fn quality(facts: &LinkFacts) -> Option<HealthFinding> {
    let history = facts.driver_status.as_ref()?.history();
    let what = format!(
        "quality {} in the last {} s, {} late or lost answers",
        percent(history.quality_mean_permille),
        history.seconds,
        history.late
    );
    if history.late == 0 {
        return Some(HealthFinding::ok(what));
    }
    let fix = "check the network to the device, and this machine with `rcc-cli doctor`";
    Some(HealthFinding::warn(what, fix))
}

#[cfg(test)]
mod tests {
    use super::super::LinkReport;
    use super::*;
    use crate::doctor::driver_status::{DriverStatus, now};
    use serde_json::json;

    fn running(status: DriverStatus) -> LinkFacts {
        LinkFacts {
            device: "io".to_owned(),
            driver: "modbus".to_owned(),
            settings: json!({"server": "127.0.0.1:502"}),
            pid: Some(7),
            connects: Some(Ok(())),
            driver_status: Some(DriverStatus {
                at: now(),
                since: now(),
                ..status
            }),
            previous_status: Some(DriverStatus::default()),
            ..LinkFacts::default()
        }
    }

    #[test]
    fn a_server_that_is_not_reached_ends_the_report() {
        let mut facts = running(DriverStatus::default());
        facts.connects = Some(Err("Connection refused".to_owned()));
        let report = LinkReport::of(&facts);
        assert_eq!(report.failed, Some("server"));
        assert!(
            report
                .human()
                .contains("cannot reach the server 127.0.0.1:502: Connection refused")
        );
    }

    #[test]
    fn exceptions_are_reported_in_the_drivers_words() {
        let text = "the Modbus server refuses an address or a value".to_owned();
        let facts = running(DriverStatus {
            reason: 102,
            reason_words: text,
            ..DriverStatus::default()
        });
        let report = LinkReport::of(&facts);
        assert_eq!(report.failed, Some("exchange"));
        assert!(report.human().contains("refuses an address"));
    }

    #[test]
    fn the_fault_of_a_lost_server_names_its_point() {
        let fault = "reading discrete 4 (door): exception 2: illegal address";
        let facts = running(DriverStatus {
            reason: 112,
            reason_words: "illegal address".to_owned(),
            link: json!({"servers": [
                {"server": "press", "online": false, "last_fault": fault},
                {"server": "belt", "online": true, "last_fault": "an old one"},
            ]}),
            ..DriverStatus::default()
        });
        let words = LinkReport::of(&facts).human();
        assert!(
            words.contains("server 'press': reading discrete 4 (door)"),
            "{words}"
        );
        assert!(!words.contains("an old one"), "{words}");
    }

    #[test]
    fn a_device_that_exchanges_works() {
        let facts = running(DriverStatus {
            exchanges: 100,
            state: "ready".to_owned(),
            ..DriverStatus::default()
        });
        assert_eq!(LinkReport::of(&facts).failed, None);
    }

    #[test]
    fn without_driver_the_probe_decides() {
        let mut facts = running(DriverStatus::default());
        (facts.driver_status, facts.previous_status, facts.pid) = (None, None, None);
        facts.probe = Some(
            json!({"opened": true, "exchanges": 9, "last": {"reason": 0, "reason_words": ""}}),
        );
        assert_eq!(LinkReport::of(&facts).failed, None);
        facts.probe =
            Some(json!({"opened": false, "error": "devices.io.settings.unit: invalid value 300"}));
        assert_eq!(LinkReport::of(&facts).failed, Some("settings"));
    }
}
