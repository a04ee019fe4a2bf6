//! Stages after the first valid datagram: what the controller reports about itself, and how it rates our answers.

use rcc_core::counted::Counted;

use super::{LinkFacts, wire};
use crate::doctor::HealthFinding;
use crate::doctor::link::percent;
use crate::table::time;

pub(super) fn drives(facts: &LinkFacts) -> Option<HealthFinding> {
    let wire = wire(facts)?;
    let bits = |key: &str| wire[key].as_u64().unwrap_or(0);
    let (power, error, warning) = (bits("power"), bits("error"), bits("warning"));
    if error != 0 {
        let fix = "read the message on the KCP, remove its cause, acknowledge";
        return Some(HealthFinding::fail(
            format!("the drives report an error: {}", joints(error)),
            fix,
        ));
    }
    if power == 0 {
        let fix = "release the E-stop, close the gate, acknowledge on the KCP; in T1 and T2 hold the enabling switch; a \
                   motion of the KRL program (a small PTP) releases the brakes";
        return Some(HealthFinding::fail("the drives have no power", fix).cause(
            "E-stop, safety gate, or no enabling switch in T1 and T2: FRI 1.0 does not report which",
        ));
    }
    if warning != 0 {
        let fix = "read the message on the KCP";
        return Some(HealthFinding::warn(
            format!("the drives report a warning: {}", joints(warning)),
            fix,
        ));
    }
    Some(HealthFinding::ok("the drives have power, without error"))
}

/// Formats the set bits as `joint 1, joint 3`.
fn joints(bits: u64) -> String {
    let set = (0..16).filter(|bit| bits >> bit & 1 == 1);
    let names: Vec<String> = set.map(|bit| format!("joint {}", bit + 1)).collect();
    names.join(", ")
}

pub(super) fn control(facts: &LinkFacts) -> Option<HealthFinding> {
    match wire(facts)?["control"].as_str()? {
        known @ ("position" | "cartesian impedance" | "joint impedance") => Some(
            HealthFinding::ok(format!("the controller is in {known} control")),
        ),
        other => Some(HealthFinding::fail(
            format!("the controller is in another control strategy ({other})"),
            "set $STIFFNESS.STRATEGY = 10 (position), 20 or 30 (impedance) in the KRL program, before friStart",
        )),
    }
}

pub(super) fn quality(facts: &LinkFacts) -> Option<HealthFinding> {
    let wire = wire(facts)?;
    let word = wire["quality"].as_str()?;
    let Some(status) = facts.driver_status.as_ref() else {
        return Some(
            HealthFinding::note(format!(
                "quality {word}: not meaningful, because no driver answers the controller"
            ))
            .fix(format!("start the cell: rcc-cli up {}", facts.source)),
        );
    };
    let history = status.history();
    let real = |key: &str| wire[key].as_f64().unwrap_or(0.0);
    let what = format!(
        "quality {word} (last {} s: mean {}, min {}); the controller counts {} of 100 answers in time, delay {}, jitter {}",
        history.seconds,
        percent(history.quality_mean_permille),
        percent(history.quality_min_permille),
        (real("answer_rate") * 100.0).round(),
        time((real("latency_s") * 1e9) as u64),
        time((real("jitter_s") * 1e9) as u64)
    );
    let rank = |word: &str| {
        ["unacceptable", "bad", "ok", "perfect"]
            .iter()
            .position(|one| *one == word)
    };
    let wanted = facts.settings["quality_min"].as_str().unwrap_or("ok");
    if rank(word) < rank(wanted) {
        let (cause, fix) = quality_cause(facts, history.late);
        return Some(HealthFinding::fail(what, fix).cause(cause));
    }
    if history.late > 0 {
        let (cause, fix) = quality_cause(facts, history.late);
        return Some(HealthFinding::warn(what, fix).cause(cause));
    }
    Some(HealthFinding::ok(what))
}

/// Decides whether our answers are late or are lost on the way; returns cause and remedy.
fn quality_cause(facts: &LinkFacts, late: u64) -> (String, String) {
    let period_ns = facts.period_ns;
    let slow = facts.total("answer_max_ns") > period_ns / 2;
    let gaps = facts.grown("gaps_datagrams") > 0 || facts.total("interval_max_ns") > 2 * period_ns;
    let counted = format!("{late} late or lost answers in the last minute");
    if slow {
        let took = time(facts.total("answer_max_ns"));
        return (
            format!("{counted}; our answers took up to {took}"),
            "this machine is late: run `rcc-cli doctor`".to_owned(),
        );
    }
    if gaps && facts.simulated {
        return (
            format!(
                "{counted}; the simulator's datagrams are late as well: both run on this machine"
            ),
            "this machine is late: run `rcc-cli doctor`".to_owned(),
        );
    }
    if gaps {
        return (
            format!("{counted}; the controller's datagrams are lost or late as well"),
            "check the network (dedicated cable, no switch, no Wi-Fi), then this machine (`rcc-cli doctor`)".to_owned(),
        );
    }
    (
        format!("{counted}; answers leave in time, so they are lost on the way to the controller"),
        "check the network (dedicated cable, no switch, no Wi-Fi) and the controller's VxWorks settings"
            .to_owned(),
    )
}

pub(super) fn session(facts: &LinkFacts) -> Option<HealthFinding> {
    let wire = wire(facts)?;
    let status = facts.driver_status.as_ref()?;
    match wire["session"].as_str()? {
        "command" if status.reason == 0 => Some(HealthFinding::ok(format!(
            "session in command mode; the device is {}",
            status.state
        ))),
        "command" => Some(HealthFinding::warn(
            format!("session in command mode, but: {}", status.reason_words),
            "follow the message",
        )),
        _ => {
            let fix = match facts.settings["krl"].as_str() {
                Some("auto") => {
                    "the KRL program calls friStart itself: start it, and check where it waits"
                }
                Some("stanford") => {
                    "start the KRL program; it must call friStart(1.0) when $FRI_FRM_INT[16] becomes 10"
                }
                Some("centro") => {
                    "start the KRL program; it must call friStart(1.0) when $FRI_FRM_INT[2] becomes 1"
                }
                _ => {
                    "start the KRL program; it must call friStart(1.0) when $FRI_FRM_INT[1] becomes 10"
                }
            };
            Some(HealthFinding::fail(
                "the controller is in monitor mode: command mode has not started",
                fix,
            ))
        }
    }
}

pub(super) fn answers(facts: &LinkFacts) -> Option<HealthFinding> {
    let status = facts.driver_status.as_ref()?;
    let mean_ns = facts.link()["answer_mean_ns"].as_u64()?;
    let longest_ns = facts.total("answer_max_ns");
    let what = format!(
        "answers leave after {} on average, at most {} during the check and {} since the start; {} came too late",
        time(mean_ns),
        time(longest_ns),
        time(facts.total("answer_longest_ns")),
        Counted(status.starved, "set-point")
    );
    if longest_ns > facts.period_ns / 2 {
        return Some(HealthFinding::warn(
            what,
            "this machine is late: run `rcc-cli doctor`",
        ));
    }
    Some(HealthFinding::ok(what))
}
