//! Stages for a KUKA LBR iiwa or Med over FRI 1.11 to 2.7: interface, port, datagrams, sender, version, safety, quality, session,
//! drives, inputs and outputs.
//! Pure functions of the facts.

use rcc_core::counted::Counted;

use super::fri::{interface, listen, port};
use super::{LinkFacts, LinkStage, configuration, driver, percent};
use crate::doctor::{FindingLevel, HealthFinding};

/// Longest time between two answers with which the robot executes commands, ms (KUKA).
const ANSWER_MAX_MS: u64 = 10;

/// Stages in order; the first failed one ends the report.
pub const STAGES: &[LinkStage] = &[
    ("configuration", configuration),
    ("interface", interface),
    ("driver", driver),
    ("port", port),
    ("datagrams", datagrams),
    ("sender", sender),
    ("version", version),
    ("order", order),
    ("safety", safety),
    ("quality", quality),
    ("session", session),
    ("drives", drives),
    ("io", io),
    ("ready", ready),
];

fn word<'a>(facts: &'a LinkFacts, key: &str) -> Option<&'a str> {
    facts.link()[key].as_str()
}

fn datagrams(facts: &LinkFacts) -> Option<HealthFinding> {
    let listen = listen(facts)?;
    let came = facts.grown("datagrams");
    if came > 0 {
        return Some(HealthFinding::ok(format!(
            "datagrams arrive at {listen}: {came} during the check"
        )));
    }
    let ever = facts.total("datagrams");
    let what = match ever {
        0 => format!("no datagrams arrive at {listen}"),
        _ => format!("no more datagrams arrive at {listen} ({ever} since the driver started)"),
    };
    let fix = match facts.simulated {
        true => "start the simulator (`rcc-cli up` does); its --driver option must be this address"
            .to_owned(),
        false => format!(
            "on the controller: the application must open an FRI session to {} (createRemoteConfiguration), port {} \
             (setPortOnRemote). Here: is the cable in the port that the session uses (KONI or X66), and UDP {} not blocked by a \
             firewall?",
            listen.ip(),
            listen.port(),
            listen.port()
        ),
    };
    let cause = "the robot sends first, as soon as its application has opened the session";
    Some(HealthFinding::fail(what, fix).cause(cause))
}

fn sender(facts: &LinkFacts) -> Option<HealthFinding> {
    let foreign = facts.grown("foreign");
    if foreign == 0 {
        let from = word(facts, "robot")?;
        return Some(HealthFinding::ok(format!("datagrams come from {from}")));
    }
    let other = word(facts, "foreign_last").unwrap_or("nobody");
    let others = format!("{} came from {other}", Counted(foreign, "datagram"));
    if facts.grown("accepted") > 0 {
        let fix = "identify that sender: only one robot may send here";
        return Some(HealthFinding::warn(
            format!("{others}; they are refused"),
            fix,
        ));
    }
    let address = other.split_once(':').map_or(other, |(address, _)| address);
    let fix = format!("set settings.peer to {address} if that is the robot, or remove it");
    let peer = facts.settings["peer"].as_str().unwrap_or("nobody");
    let cause = format!("settings.peer accepts only {peer}");
    Some(HealthFinding::fail(others, fix).cause(cause))
}

fn version(facts: &LinkFacts) -> Option<HealthFinding> {
    let wanted = facts.settings["version"].as_str().unwrap_or("-");
    let unreadable = facts.grown("unreadable");
    if unreadable == 0 {
        return Some(HealthFinding::ok(format!("the datagrams are FRI {wanted}")));
    }
    // Invalid datagrams beside valid ones are a warning only.
    let level = match facts.grown("accepted") {
        0 => FindingLevel::Fail,
        _ => FindingLevel::Warn,
    };
    let what = format!(
        "{} cannot be read as FRI {wanted}",
        Counted(unreadable, "datagram")
    );
    let fix = "set `version` in the device's settings to that of FRI on the controller, or stop the other program that sends \
               here";
    let last = word(facts, "last_error").unwrap_or("unknown").to_owned();
    Some(HealthFinding {
        level,
        ..HealthFinding::fail(what, fix).cause(last)
    })
}

fn order(facts: &LinkFacts) -> Option<HealthFinding> {
    let refused = facts.grown("refused");
    if refused == 0 {
        return None;
    }
    let what = format!(
        "{} repeated, out of order, or not believed until the next one confirmed them",
        Counted(refused, "datagram")
    );
    let last = word(facts, "last_error").unwrap_or("unknown").to_owned();
    let fix =
        "use a cable of its own between the cabinet and this machine, without switch or Wi-Fi";
    let level = match facts.grown("accepted") {
        0 => FindingLevel::Fail,
        _ => FindingLevel::Warn,
    };
    Some(HealthFinding {
        level,
        ..HealthFinding::fail(what, fix).cause(last)
    })
}

fn safety(facts: &LinkFacts) -> Option<HealthFinding> {
    let mode = word(facts, "operation").unwrap_or("an unknown mode");
    match word(facts, "safety")? {
        "Normal" => Some(HealthFinding::ok(format!(
            "the safety controller does not stop the robot; operating mode {mode}"
        ))),
        stop => {
            let fix = "release the E-stop, close the gate, acknowledge on the smartPAD; in T1 and T2 hold the enabling switch";
            let what = format!("the safety controller stops the robot ({stop}, mode {mode})");
            Some(HealthFinding::fail(what, fix))
        }
    }
}

fn quality(facts: &LinkFacts) -> Option<HealthFinding> {
    let quality = word(facts, "quality")?.to_lowercase();
    let Some(status) = facts.driver_status.as_ref() else {
        let what =
            format!("quality {quality}: not meaningful, because no driver answers the robot");
        let fix = format!("start the cell: rcc-cli up {}", facts.source);
        return Some(HealthFinding::note(what).fix(fix));
    };
    let history = status.history();
    let what = format!(
        "quality {quality} (last {} s: mean {}, min {})",
        history.seconds,
        percent(history.quality_mean_permille),
        percent(history.quality_min_permille)
    );
    let rank = |word: &str| {
        ["poor", "fair", "good", "excellent"]
            .iter()
            .position(|one| *one == word)
    };
    let wanted = facts.settings["quality_min"].as_str().unwrap_or("good");
    if rank(&quality) < rank(wanted) {
        let fix = "check this machine (`rcc-cli doctor`), then the network: a cable of its own, no switch, no Wi-Fi; a longer \
                   send period in the application";
        let cause = "our answers reach the robot late or not at all";
        return Some(HealthFinding::fail(what, fix).cause(cause));
    }
    Some(HealthFinding::ok(what))
}

fn session(facts: &LinkFacts) -> Option<HealthFinding> {
    let (period, multiplier) = (
        facts.total("send_period_ms"),
        facts.total("receive_multiplier"),
    );
    let every = format!("send period {period} ms, receive multiplier {multiplier}");
    match word(facts, "session")? {
        "Idle" => Some(HealthFinding::fail(
            "the robot's application has closed the FRI session",
            "start the application again",
        )),
        "MonitoringWait" | "MonitoringReady" if period * multiplier > ANSWER_MAX_MS => {
            let fix = "setSendPeriodMilliSec and setReceiveMultiplier in the application";
            let what =
                format!("an answer is due less often than each {ANSWER_MAX_MS} ms ({every})");
            Some(HealthFinding::fail(what, fix).cause("the robot then takes no commands"))
        }
        "MonitoringWait" | "MonitoringReady" => {
            let fix = "the application must wait for good quality (FRISession.await) and then run a motion with an FRI overlay, such \
                       as a PositionHold";
            let what = format!("no motion with an FRI overlay runs ({every})");
            Some(HealthFinding::fail(what, fix))
        }
        state => {
            let mode = word(facts, "command_mode").unwrap_or("none");
            let words = match state {
                "CommandingWait" => "the motion begins",
                _ => "the motion executes commands",
            };
            Some(HealthFinding::ok(format!(
                "{words}, overlay of {mode} ({every})"
            )))
        }
    }
}

fn drives(facts: &LinkFacts) -> Option<HealthFinding> {
    match word(facts, "drives")? {
        "Active" => Some(HealthFinding::ok("all drives are active")),
        state => {
            let what = format!("not all drives are active (the last one: {state})");
            let fix = "wait until the motion has begun; in T1 and T2 hold the enabling switch";
            Some(HealthFinding::fail(what, fix))
        }
    }
}

fn io(facts: &LinkFacts) -> Option<HealthFinding> {
    let missing = word(facts, "missing_io")?;
    let what = format!("the robot does not list `{missing}` with this direction and type");
    let fix = "compare the channel's address with the I/O configuration of the station; a message lists ten, FRI 1.11 none";
    Some(HealthFinding::fail(what, fix))
}

fn ready(facts: &LinkFacts) -> Option<HealthFinding> {
    let status = facts.driver_status.as_ref()?;
    match status.reason {
        0 => Some(HealthFinding::ok(format!("the device is {}", status.state))),
        _ => Some(HealthFinding::warn(
            status.reason_words.clone(),
            "follow the message",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::super::LinkReport;
    use super::super::sockets::NetworkInterface;
    use super::*;
    use crate::doctor::driver_status::{DriverStatus, SecondStats, now};
    use serde_json::{Value, json};

    fn running(change: Value) -> LinkFacts {
        let mut link = json!({
            "robot": "192.170.10.2:30200", "datagrams": 5000, "accepted": 5000, "answered": 5000, "foreign": 0,
            "unreadable": 0, "refused": 0, "last_error": null, "missing_io": null, "session": "CommandingActive",
            "quality": "Excellent", "safety": "Normal", "operation": "Automatic", "control": "Position",
            "command_mode": "JointPosition", "drives": "Active", "send_period_ms": 5, "receive_multiplier": 1
        });
        for (key, value) in change.as_object().into_iter().flatten() {
            link[key] = value.clone();
        }
        let second = SecondStats {
            quality_min: 1000,
            quality_mean: 1000,
            exchanges: 200,
            ..SecondStats::default()
        };
        LinkFacts {
            device: "iiwa".to_owned(),
            driver: "fri-iiwa".to_owned(),
            source: "iiwa.yaml".to_owned(),
            settings: json!({"listen": "192.170.10.1:30200", "version": "1.15"}),
            period_ns: 5_000_000,
            pid: Some(7),
            driver_status: Some(DriverStatus {
                pid: 7,
                at: now(),
                since: now(),
                state: "ready".to_owned(),
                seconds: vec![second; 60],
                link,
                ..DriverStatus::default()
            }),
            interfaces: vec![NetworkInterface {
                name: "enp3s0".to_owned(),
                address: [192, 170, 10, 1].into(),
                mask: [255, 255, 255, 0].into(),
                up: true,
            }],
            ..LinkFacts::default()
        }
    }

    #[test]
    fn the_page_of_each_robot_has_every_stage() {
        for (page, stages) in [
            ("lwr.md", super::super::fri::STAGES),
            ("iiwa.md", super::STAGES),
        ] {
            let path = format!("{}/../docs/{page}", env!("CARGO_MANIFEST_DIR"));
            let text = std::fs::read_to_string(&path).expect("a page");
            for (stage, _) in stages {
                assert!(
                    text.contains(&format!("\n| `{stage}` | ")),
                    "{page}: {stage}"
                );
            }
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
        assert!(report.findings.len() >= 11);
    }

    #[test]
    fn each_failure_is_the_last_stage_and_says_what_to_do() {
        let rows = [
            (
                json!({"datagrams": 0}),
                "datagrams",
                "FRI session to 192.170.10.1",
            ),
            (
                json!({"foreign": 9, "accepted": 0, "foreign_last": "10.0.0.9:5"}),
                "sender",
                "10.0.0.9",
            ),
            (
                json!({"unreadable": 9, "accepted": 0, "last_error": "the peer speaks FRI 2.7"}),
                "version",
                "2.7",
            ),
            (json!({"refused": 9, "accepted": 0}), "order", "cable"),
            (json!({"safety": "Stop1"}), "safety", "E-stop"),
            (json!({"quality": "Fair"}), "quality", "late or not at all"),
            (
                json!({"session": "Idle"}),
                "session",
                "start the application",
            ),
            (
                json!({"session": "MonitoringReady"}),
                "session",
                "PositionHold",
            ),
            (
                json!({"session": "MonitoringReady", "receive_multiplier": 3}),
                "session",
                "setReceiveMultiplier",
            ),
            (
                json!({"drives": "Transitioning"}),
                "drives",
                "enabling switch",
            ),
            (
                json!({"missing_io": "FRI.Out_Torch"}),
                "io",
                "FRI.Out_Torch",
            ),
        ];
        for (change, stage, words) in rows {
            let report = LinkReport::of(&running(change));
            assert_eq!(report.failed, Some(stage));
            let last = report.findings.last().expect("a finding");
            let said = format!("{} {:?} {:?}", last.what, last.cause, last.fix);
            assert!(said.contains(words), "{stage}: {said}");
        }
    }

    #[test]
    fn the_remedies_are_those_of_a_sunrise_cabinet() {
        let mut facts = running(json!({}));
        facts.settings["peer"] = json!("192.171.10.2");
        let report = LinkReport::of(&facts);
        assert_eq!(report.failed, Some("interface"));
        let fix = report
            .findings
            .last()
            .and_then(|finding| finding.fix.clone());
        assert!(fix.is_some_and(|fix| fix.contains("KONI")));
    }
}
