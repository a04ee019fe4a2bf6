//! Stages for a line of EtherCAT terminals: interface, line, states of the terminals, drives, exchanges, error counters of the ports.
//! Pure functions of the facts.

use rcc_core::counted::Counted;
use serde_json::Value;

use super::plain::{quality, settings};
use super::{LinkFacts, LinkStage, configuration, driver};
use crate::doctor::HealthFinding;

/// Stages in order; the first failed one ends the report.
pub const STAGES: &[LinkStage] = &[
    ("configuration", configuration),
    ("driver", driver),
    ("settings", settings),
    ("interface", interface),
    ("line", line),
    ("terminals", terminals),
    ("drives", drives),
    ("clocks", clocks),
    ("exchange", exchange),
    ("errors", errors),
    ("quality", quality),
];

/// Reasons of the driver `ethercat`.
mod reason {
    pub const INTERFACE: u64 = 100;
    pub const SILENT: u64 = 101;
    pub const WRONG_LINE: u64 = 102;
    pub const START: u64 = 103;
}

/// Counters of a port, and what they mean.
const PORT_COUNTERS: [(&str, &str); 3] = [
    ("lost_links", "lost link"),
    ("invalid_frames", "damaged frame"),
    ("receive_errors", "receive error"),
];

fn name(facts: &LinkFacts) -> &str {
    facts.settings["interface"].as_str().unwrap_or("?")
}

/// Why the last session ended, in the driver's words.
fn fault(facts: &LinkFacts) -> String {
    let words = facts.link()["fault"].as_str();
    words
        .unwrap_or("the driver has not said why yet")
        .to_owned()
}

fn interface(facts: &LinkFacts) -> Option<HealthFinding> {
    let name = name(facts);
    if let Some(address) = name.strip_prefix("udp ") {
        return Some(HealthFinding::note(format!(
            "a simulated line at {address}, over UDP"
        )));
    }
    let permission = "as root, as a service (`rcc-cli install-units` permits it), or `setcap cap_net_raw=ep` the program rcc-ethercat";
    if facts.total("reason") == reason::INTERFACE {
        let fix =
            format!("`ip link` lists the interfaces; raw packets need CAP_NET_RAW: {permission}");
        return Some(HealthFinding::fail(fault(facts), fix));
    }
    match facts.nic? {
        (false, _) => Some(HealthFinding::fail(
            format!("the network interface {name} is down"),
            format!(
                "ip link set {name} up; keep it without an address and away from network managers"
            ),
        )),
        (true, false) => Some(HealthFinding::fail(
            format!("no cable at the network interface {name}"),
            "plug the cable into the input (IN, X1) of the first terminal or coupler, and switch its supply on",
        )),
        (true, true) => Some(HealthFinding::ok(format!(
            "the network interface {name} is up, with a cable"
        ))),
    }
}

fn line(facts: &LinkFacts) -> Option<HealthFinding> {
    let rows = facts.link()["terminals"].as_array()?;
    let fix = match facts.total("reason") {
        reason::SILENT => {
            "check the cable (into IN of the first terminal), its supply, and that no other program exchanges on this interface"
        }
        reason::WRONG_LINE => {
            "correct `settings.terminals`, or the order of the terminals: every terminal of the line has its row, couplers too"
        }
        reason::START => {
            "switch the line's supply off and on; if it persists, a terminal is not supported: the log of the driver has each attempt"
        }
        _ => {
            return Some(HealthFinding::ok(format!(
                "the line has the {} of the configuration",
                Counted(rows.len() as u64, "terminal")
            )));
        }
    };
    Some(HealthFinding::fail(fault(facts), fix))
}

/// Returns `terminal 2 (lamps, EL2008)`.
fn title(row: &Value) -> String {
    let text = |key: &str| row[key].as_str().unwrap_or("?");
    let position = row["position"].as_u64().unwrap_or(0);
    format!("terminal {position} ({}, {})", text("name"), text("type"))
}

fn terminals(facts: &LinkFacts) -> Option<HealthFinding> {
    let rows = facts.link()["terminals"].as_array()?;
    // Without a driver nothing may be driven.
    let wanted = match facts.is_answered() {
        true => "OP",
        false => "SAFEOP",
    };
    let state = |row: &Value| row["state"].as_str().unwrap_or("unknown").to_owned();
    let Some(row) = rows.iter().find(|row| state(row) != wanted) else {
        return Some(HealthFinding::ok(format!("all terminals are in {wanted}")));
    };
    let state = state(row);
    let position = row["position"].as_u64().unwrap_or(0);
    let (what, fix) = match state.as_str() {
        "no answer" => (
            format!("{} does not answer", title(row)),
            match position {
                0 | 1 => "check the cable from this machine and the supply of the line".to_owned(),
                _ => format!(
                    "check the connection between terminals {} and {position}, and the supply from there on",
                    position - 1
                ),
            },
        ),
        "unknown" => (
            format!("the state of {} is not known yet", title(row)),
            "retry in two seconds; if it persists, the log has the reason".to_owned(),
        ),
        other => (
            format!("{} is in {other}, not in {wanted}", title(row)),
            "the driver starts the line again by itself; if it does so again and again, raise `settings.watchdog` or lower the load \
             of this machine (`rcc-cli doctor`)"
                .to_owned(),
        ),
    };
    let finding = HealthFinding::fail(what, fix);
    Some(match facts.link()["fault"].as_str() {
        Some(fault) => finding.cause(fault),
        None => finding,
    })
}

/// The drives of the joints; none without a robot.
fn drives(facts: &LinkFacts) -> Option<HealthFinding> {
    let rows = facts.link()["drives"].as_array()?;
    if rows.is_empty() || !facts.is_answered() {
        return None;
    }
    let text = |row: &Value, key: &str| row[key].as_str().unwrap_or("?").to_owned();
    let title = |row: &Value| {
        format!(
            "the drive of {} ({})",
            text(row, "joint"),
            text(row, "terminal")
        )
    };
    let is_fault = |row: &&Value| text(row, "state").starts_with("fault");
    if let Some(row) = rows.iter().find(is_fault) {
        let code = match row["error_code"].as_u64().unwrap_or(0) {
            0 => "its error code is not exchanged: see `error_code` of its axis".to_owned(),
            0x8611 => "error code 0x8611: following error".to_owned(),
            0x7500 => "error code 0x7500: communication".to_owned(),
            code => format!("error code {code:#06x}: see the manual of the drive"),
        };
        let fix = "remove the cause, then switch the output with the address `axes enable` off and on; without such an output, \
                   reset the fault at the drive and restart the driver";
        return Some(HealthFinding::fail(
            format!("{} is in {}; {code}", title(row), text(row, "state")),
            fix,
        ));
    }
    let off = |row: &&Value| text(row, "state") != "operation enabled";
    Some(match rows.iter().find(off) {
        Some(row) => HealthFinding::note(format!(
            "{} is in `{}`: a net that switches the output with the address `axes enable` on enables the drives",
            title(row),
            text(row, "state")
        )),
        None => HealthFinding::ok("all drives are in `operation enabled`"),
    })
}

/// Largest difference of two clocks that SYNC0 does not show, ns.
const CLOCKS_AGREE_NS: u64 = 1_000;

/// The distributed clocks; none unless the driver uses them.
fn clocks(facts: &LinkFacts) -> Option<HealthFinding> {
    let link = facts.link();
    let rows = link["terminals"].as_array()?;
    if link["distributed_clocks"] != true || !facts.is_answered() {
        return None;
    }
    let known = rows.iter().filter_map(|row| {
        let difference = row["clock_difference_ns"].as_i64()?;
        Some((difference.unsigned_abs(), row))
    });
    let count = known.clone().count();
    let Some((largest, row)) = known.max_by_key(|(difference, _)| *difference) else {
        return Some(HealthFinding::note(
            "the clocks of the terminals have not been read yet: retry in two seconds",
        ));
    };
    let all = Counted(count as u64, "clock");
    if largest <= CLOCKS_AGREE_NS {
        return Some(HealthFinding::ok(format!(
            "{all}, at most {largest} ns from the reference clock"
        )));
    }
    let what = format!(
        "the clock of {} is {largest} ns from the reference clock",
        title(row)
    );
    let fix = "right after the start the clocks still approach each other: retry in ten seconds. If it persists, a terminal in front \
               of it has no fixed delay (a switch, a media converter), or exchanges are lost";
    Some(HealthFinding::warn(what, fix))
}

fn exchange(facts: &LinkFacts) -> Option<HealthFinding> {
    facts.driver_status.as_ref()?;
    let (complete, wrong) = (
        facts.grown("complete"),
        facts.grown("wrong_working_counter"),
    );
    let silent = facts.grown("silent");
    if complete == 0 {
        let what = format!(
            "no complete exchange during the check; {} with a wrong working counter, {} without an answer",
            wrong, silent
        );
        let fix = "check cables and supply of the line; the stage `terminals` names the first one that does not answer";
        return Some(HealthFinding::fail(what, fix));
    }
    if wrong + silent == 0 {
        return Some(HealthFinding::ok(format!(
            "{} during the check, all with the right working counter",
            Counted(complete, "exchange")
        )));
    }
    let last = &facts.link()["last_wrong"];
    let counter = match wrong {
        0 => String::new(),
        _ => format!(
            " (the last one {} instead of {})",
            last["have"].as_u64().unwrap_or(0),
            last["want"].as_u64().unwrap_or(0)
        ),
    };
    let what = format!(
        "{complete} complete exchanges during the check, {wrong} with a wrong working counter{counter}, {silent} without an answer"
    );
    let fix = match wrong {
        0 => {
            "this machine answers late: `rcc-cli doctor`; or frames are damaged: see the counters below"
        }
        _ => {
            "a terminal loses contact now and then: see the counters below, and the plugs in front of it"
        }
    };
    Some(HealthFinding::warn(what, fix))
}

fn errors(facts: &LinkFacts) -> Option<HealthFinding> {
    let rows = facts.link()["terminals"].as_array()?;
    let mut found = Vec::new();
    for row in rows {
        for (key, words) in PORT_COUNTERS {
            let ports = row[key].as_array().into_iter().flatten().zip(0..);
            let counted = ports.filter_map(|(count, port)| Some((count.as_u64()?, port)));
            for (count, port) in counted.filter(|(count, _)| *count > 0) {
                let count = Counted(count, words);
                found.push(format!("{} port {port}: {count}", title(row)));
            }
        }
    }
    if found.is_empty() {
        return Some(HealthFinding::ok(
            "no terminal has counted an error at a port",
        ));
    }
    let fix = "the first terminal of the list is behind the fault: port 0 leads towards this machine, the others to the next terminals. \
               Replace the cable or plug there. The counters go to 255, and to 0 with the supply";
    Some(HealthFinding::warn(found.join("; "), fix))
}

#[cfg(test)]
mod tests {
    use super::super::LinkReport;
    use super::*;
    use crate::doctor::driver_status::{DriverStatus, now};
    use serde_json::json;

    fn link(state: &str, reason: u64, fault: Value) -> Value {
        let row = |position: u64, name: &str, state: &str, lost: u64| {
            json!({"position": position, "name": name, "type": "EL2008", "state": state,
                   "lost_links": [0, lost, 0, 0], "invalid_frames": [0, 0, 0, 0], "receive_errors": [0, 0, 0, 0]})
        };
        json!({
            "reason": reason, "fault": fault, "complete": 900, "silent": 0, "wrong_working_counter": 0,
            "last_wrong": {"have": 3, "want": 6},
            "terminals": [row(1, "valves", "OP", 0), row(2, "lamps", state, 0)],
        })
    }

    fn facts(link: Value) -> LinkFacts {
        let status = |link: Value, complete: u64| DriverStatus {
            at: now(),
            since: now(),
            exchanges: complete,
            link,
            ..DriverStatus::default()
        };
        LinkFacts {
            device: "line".to_owned(),
            driver: "ethercat".to_owned(),
            settings: json!({"interface": "eth1"}),
            pid: Some(7),
            nic: Some((true, true)),
            driver_status: Some(status(link, 900)),
            previous_status: Some(status(json!({}), 0)),
            ..LinkFacts::default()
        }
    }

    fn failed(facts: &LinkFacts) -> (Option<&'static str>, String) {
        let report = LinkReport::of(facts);
        (report.failed, report.human())
    }

    #[test]
    fn a_line_in_op_works() {
        let (failed, words) = failed(&facts(link("OP", 0, Value::Null)));
        assert_eq!(failed, None, "{words}");
        assert!(
            words.contains("the line has the 2 terminals of the configuration"),
            "{words}"
        );
        assert!(
            words.contains("900 exchanges during the check, all with the right working counter"),
            "{words}"
        );
    }

    #[test]
    fn the_clock_that_is_furthest_away_is_told() {
        let mut link = link("OP", 0, Value::Null);
        let words = |link: &Value| LinkReport::of(&facts(link.clone())).human();
        assert!(!words(&link).contains("clock"));
        link["distributed_clocks"] = json!(true);
        assert!(words(&link).contains("have not been read yet"));
        link["terminals"][0]["clock_difference_ns"] = json!(0);
        link["terminals"][1]["clock_difference_ns"] = json!(-40);
        let text = words(&link);
        assert!(
            text.contains("2 clocks, at most 40 ns from the reference clock"),
            "{text}"
        );
        link["terminals"][1]["clock_difference_ns"] = json!(-4000);
        let text = words(&link);
        assert!(
            text.contains("the clock of terminal 2 (lamps, EL2008) is 4000 ns"),
            "{text}"
        );
    }

    #[test]
    fn each_failure_ends_the_report_with_its_remedy() {
        let mut down = facts(link("OP", 0, Value::Null));
        down.nic = Some((false, false));
        let mut unplugged = facts(link("OP", 0, Value::Null));
        unplugged.nic = Some((true, false));
        let mut lost = link("OP", 0, Value::Null);
        lost["complete"] = json!(0);
        lost["wrong_working_counter"] = json!(40);
        let other = json!(
            "terminal 2 is EL3064 (vendor 0x2, product 0x0bf83052); the configuration names EL2008"
        );
        for (facts, stage, what, fix) in [
            (down, "interface", "eth1 is down", "ip link set eth1 up"),
            (unplugged, "interface", "no cable at", "first terminal"),
            (
                facts(link("OP", 100, json!("network interface `eth1` not found"))),
                "interface",
                "not found",
                "CAP_NET_RAW",
            ),
            (
                facts(link("OP", 101, json!("no terminal answers at `eth1`"))),
                "line",
                "no terminal answers",
                "supply",
            ),
            (
                facts(link("OP", 102, other)),
                "line",
                "terminal 2 is EL3064",
                "settings.terminals",
            ),
            (
                facts(link("OP", 103, json!("the line did not reach OP"))),
                "line",
                "did not reach OP",
                "supply",
            ),
            (
                facts(link("no answer", 104, Value::Null)),
                "terminals",
                "terminal 2 (lamps, EL2008) does not answer",
                "between terminals 1 and 2",
            ),
            (
                facts(link(
                    "SAFEOP",
                    105,
                    json!("because of its AL status code 0x001b"),
                )),
                "terminals",
                "is in SAFEOP, not in OP",
                "settings.watchdog",
            ),
            (
                facts(lost),
                "exchange",
                "40 with a wrong working counter",
                "cables",
            ),
        ] {
            let (failed, words) = failed(&facts);
            assert_eq!(failed, Some(stage), "{words}");
            assert!(words.contains(what) && words.contains(fix), "{words}");
        }
    }

    #[test]
    fn a_drive_in_fault_is_named_with_its_error_code() {
        let mut link = link("OP", 110, Value::Null);
        let row = |state: &str, code: u64| json!({"joint": "tilt", "terminal": "tilter", "state": state, "error_code": code});
        link["drives"] = json!([row("operation enabled", 0), row("fault", 0x8611)]);
        let (stage, words) = failed(&facts(link.clone()));
        assert_eq!(stage, Some("drives"), "{words}");
        let wanted = "the drive of tilt (tilter) is in fault; error code 0x8611: following error";
        assert!(
            words.contains(wanted) && words.contains("axes enable"),
            "{words}"
        );
        link["drives"] = json!([row("switch on disabled", 0)]);
        let (stage, words) = failed(&facts(link.clone()));
        assert_eq!(stage, None, "{words}");
        assert!(words.contains("`switch on disabled`"), "{words}");
        link["drives"] = json!([row("operation enabled", 0)]);
        assert!(failed(&facts(link)).1.contains("all drives are in"));
    }

    #[test]
    fn counted_errors_are_warnings_that_name_the_port() {
        let mut link = link("OP", 0, Value::Null);
        link["terminals"][1]["lost_links"] = json!([3, 0, 0, 0]);
        link["wrong_working_counter"] = json!(2);
        let (failed, words) = failed(&facts(link));
        assert_eq!(failed, None, "{words}");
        assert!(
            words.contains("terminal 2 (lamps, EL2008) port 0: 3 lost links"),
            "{words}"
        );
        assert!(
            words.contains("2 with a wrong working counter (the last one 3 instead of 6)"),
            "{words}"
        );
    }
}
