//! Stages for a KUKA LWR over FRI 1.0: interface, port, datagrams, sender, version, drives, control, quality, session.
//! Pure functions of the facts.
//!
//! FRI 1.0 reports neither operating mode nor E-stop; both appear as drives without power, and the finding says so.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use rcc_core::counted::Counted;
use serde_json::Value;

use super::{LinkFacts, LinkStage, configuration, driver, plain};
use crate::doctor::{FindingLevel, HealthFinding};
use crate::table::time;
use controller::{answers, control, drives, quality, session};

mod controller;

/// Error numbers EADDRINUSE and EADDRNOTAVAIL.
const IN_USE: i64 = nix::libc::EADDRINUSE as i64;
const NOT_OURS: i64 = nix::libc::EADDRNOTAVAIL as i64;
/// Identities of the two datagrams of FRI 1.0.
const MEASUREMENT: u64 = 0x2006;
const COMMAND: u64 = 0x1005;
/// Field 1 of a Sunrise message: its identifier 0x00245142 in protobuf encoding.
const SUNRISE: [u8; 5] = [0x08, 0xc2, 0xa2, 0x91, 0x01];

/// The place of the controller's configuration of the connection.
struct ControllerSide {
    network: &'static str,
    host: &'static str,
    port: &'static str,
}

impl ControllerSide {
    fn of(facts: &LinkFacts) -> Self {
        match facts.driver.as_str() {
            "fri-iiwa" => Self {
                network: "KONI or X66 of the Sunrise Cabinet",
                host: "the client of the FRI configuration",
                port: "setPortOnRemote of the FRI configuration (30200 to 30209)",
            },
            _ => Self {
                network: "VxWorks, KRC network settings",
                host: "FRIHOST",
                port: "FRISOCK (dlrrc.ini)",
            },
        }
    }
}

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
    ("arrival", arrival),
    ("drives", drives),
    ("control", control),
    ("quality", quality),
    ("session", session),
    ("answers", answers),
];

pub(super) fn listen(facts: &LinkFacts) -> Option<SocketAddr> {
    facts.settings["listen"].as_str()?.parse().ok()
}

pub(super) fn interface(facts: &LinkFacts) -> Option<HealthFinding> {
    let Some(SocketAddr::V4(listen)) = listen(facts) else {
        let fix = "set settings.listen to an IPv4 address with a port, such as 192.168.0.1:49938";
        return Some(HealthFinding::fail(
            "settings.listen is not an IPv4 address with a port",
            fix,
        ));
    };
    let ip = *listen.ip();
    if ip.is_unspecified() {
        return Some(
            HealthFinding::note("listens on every network interface of this machine").fix(
                "set settings.listen to the address of the interface that leads to the controller",
            ),
        );
    }
    let Some(interface) = facts.interfaces.iter().find(|interface| {
        interface.address == ip || (ip.is_loopback() && interface.address.is_loopback())
    }) else {
        let have: Vec<String> = facts
            .interfaces
            .iter()
            .map(super::sockets::NetworkInterface::label)
            .collect();
        let fix = format!(
            "assign this address to an interface (ip addr add {ip}/24 dev INTERFACE), or correct settings.listen"
        );
        return Some(
            HealthFinding::fail(
                format!("no network interface of this machine has the address {ip}"),
                fix,
            )
            .cause(format!("available: {}", have.join(", "))),
        );
    };
    if !interface.up {
        let fix = format!(
            "plug in the cable and switch on the controller; ip link set {} up",
            interface.name
        );
        return Some(HealthFinding::fail(
            format!("the network interface {} is down", interface.label()),
            fix,
        ));
    }
    if let Some(peer) = peer(facts).filter(|peer| !interface.is_near(*peer)) {
        let side = ControllerSide::of(facts).network;
        let fix = format!("give both interfaces addresses in one subnet (controller side: {side})");
        return Some(HealthFinding::fail(
            format!(
                "the controller {peer} is not in the subnet of {}",
                interface.label()
            ),
            fix,
        ));
    }
    if ip.is_loopback() && !facts.simulated {
        return Some(HealthFinding::warn(
            format!("listens on {ip}, which is reachable from this machine only"),
            format!(
                "for a real controller, set settings.listen and {} to the address of the interface that leads to it",
                ControllerSide::of(facts).host
            ),
        ));
    }
    Some(HealthFinding::ok(format!(
        "network interface {} is up",
        interface.label()
    )))
}

/// Returns the address of `settings.peer`, which may have a port.
fn peer(facts: &LinkFacts) -> Option<Ipv4Addr> {
    let text = facts.settings["peer"].as_str()?;
    let socket = || Some(text.parse::<SocketAddr>().ok()?.ip());
    match text.parse::<IpAddr>().ok().or_else(socket)? {
        IpAddr::V4(ip) => Some(ip),
        IpAddr::V6(_) => None,
    }
}

pub(super) fn port(facts: &LinkFacts) -> Option<HealthFinding> {
    let listen = listen(facts)?;
    if facts.is_answered() {
        return Some(HealthFinding::ok(format!("UDP {listen} is open")));
    }
    let Some(probe) = &facts.probe else {
        return plain::settings(facts);
    };
    let Some(error) = probe["error"].as_str() else {
        return Some(HealthFinding::note(format!(
            "no driver runs; listened on UDP {listen} in its place, without answering"
        )));
    };
    match probe["errno"].as_i64() {
        Some(IN_USE) => {
            let who = facts
                .holder
                .clone()
                .unwrap_or_else(|| "another process".to_owned());
            let fix = format!(
                "end that process, or choose another port in the cell's file and in {}",
                ControllerSide::of(facts).port
            );
            Some(HealthFinding::fail(
                format!("UDP {listen} is in use by {who}"),
                fix,
            ))
        }
        Some(NOT_OURS) => {
            let fix = "correct settings.listen";
            Some(HealthFinding::fail(
                format!("{} is not an address of this machine", listen.ip()),
                fix,
            ))
        }
        _ => Some(HealthFinding::fail(
            error,
            "correct the device's entry in the cell's file",
        )),
    }
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
    let what = if ever == 0 {
        format!("no datagrams arrive at {listen}")
    } else {
        format!("no more datagrams arrive at {listen} ({ever} since the driver started)")
    };
    let fix = if facts.simulated {
        "start the simulator (`rcc-cli up` does); its --driver option must be this address"
            .to_owned()
    } else {
        format!(
            "on the controller: C:\\KRC\\ROBOTER\\INIT\\dlrrc.ini FRIHOST={} FRISOCK={},0; has its KRL program called \
             friOpen? Here: is the cable in the right port, and UDP {} not blocked by a firewall?",
            listen.ip(),
            listen.port(),
            listen.port()
        )
    };
    Some(
        HealthFinding::fail(what, fix)
            .cause("the controller sends first; without its datagrams nothing can be answered"),
    )
}

fn sender(facts: &LinkFacts) -> Option<HealthFinding> {
    let foreign = facts.grown("foreign");
    let text = |key: &str| facts.link()[key].as_str().unwrap_or("nobody").to_owned();
    if foreign == 0 {
        return facts.link()["controller"]
            .as_str()
            .map(|from| HealthFinding::ok(format!("datagrams come from {from}")));
    }
    let others = format!(
        "{} came from {}",
        Counted(foreign, "datagram"),
        text("foreign_last")
    );
    let accepted = facts.grown("accepted");
    let expected = match facts.settings["peer"].as_str() {
        Some(peer) => format!("settings.peer accepts only {peer}"),
        None => format!("the accepted sender is {}", text("controller")),
    };
    if accepted == 0 {
        // A controller may send from another port after each friOpen: the address alone is what to configure.
        let other = text("foreign_last");
        let address = other
            .split_once(':')
            .map_or(&*other, |(address, _)| address);
        let fix = format!("set settings.peer to {address} if that is the controller, or remove it");
        return Some(HealthFinding::fail(others, fix).cause(expected));
    }
    let fix = "identify that sender: only one controller may send here";
    Some(HealthFinding::warn(format!("{others}; they are refused"), fix).cause(expected))
}

fn version(facts: &LinkFacts) -> Option<HealthFinding> {
    let fails = |what: String, fix: &str| {
        // Invalid datagrams beside valid ones are a warning only.
        let level = if facts.grown("accepted") > 0 {
            FindingLevel::Warn
        } else {
            FindingLevel::Fail
        };
        Some(HealthFinding {
            level,
            ..HealthFinding::fail(what, fix)
        })
    };
    if facts.grown("wrong_size") > 0 {
        let head: Vec<u8> = facts.link()["wrong_size_head"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(|byte| u8::try_from(byte.as_u64()?).ok())
            .collect();
        let bytes = facts.total("wrong_size_last");
        return match sunrise(&head) {
            Some(which) => fails(
                format!(
                    "the sender uses the FRI of Sunrise ({which}): an LBR iiwa or Med, not an LWR"
                ),
                "this driver is for the LWR 4+ with KUKA.FRI 1.0; for an iiwa or Med write `driver: fri-iiwa`",
            ),
            None => fails(
                format!("received datagrams of {bytes} bytes; FRI 1.0 uses 916"),
                "stop the other program that sends here, or install KUKA.FRI 1.0 on the controller",
            ),
        };
    }
    if facts.grown("wrong_identity") > 0 {
        let id = facts.total("wrong_identity_last");
        return match id {
            COMMAND => fails(
                format!("datagrams have the identity {id:#06x}: commands, which a PC sends"),
                "stop the other PC program that sends here; the controller sends measurements",
            ),
            0 => fails(
                "the sender leaves the identity of its header 0".to_owned(),
                "set `header: sparse` in the device's settings, if that is the controller: then 916 bytes are enough",
            ),
            _ => fails(
                format!("datagrams have the identity {id:#06x}; FRI 1.0 uses {MEASUREMENT:#06x}"),
                "install KUKA.FRI 1.0 on the controller, which runs another version",
            ),
        };
    }
    if facts.grown("malformed") > 0 {
        return fails(
            "datagrams have the size and identity of FRI 1.0, but invalid values".to_owned(),
            "check the KUKA.FRI version, and any device in between that may change datagrams",
        );
    }
    Some(HealthFinding::ok(
        "the datagrams are FRI 1.0: 916 bytes, identity 0x2006",
    ))
}

/// Detects Sunrise messages: SDK 1.x to 2.5 send the bare message, SDK 2.7 prefixes its length.
fn sunrise(head: &[u8]) -> Option<&'static str> {
    let starts = |from: usize| {
        let (tag, rest) = (head.get(from)?, head.get(from + 2..)?);
        let known = SUNRISE.get(..rest.len().min(SUNRISE.len()))?;
        (*tag == 0x0a && !known.is_empty() && rest.starts_with(known)).then_some(())
    };
    if starts(0).is_some() {
        Some("SDK 1.x to 2.5")
    } else if starts(4).is_some() {
        Some("SDK 2.7")
    } else {
        None
    }
}

fn order(facts: &LinkFacts) -> Option<HealthFinding> {
    let disordered = facts.grown("disordered");
    let lost = facts.grown("gaps_datagrams");
    if disordered > 0 && facts.grown("accepted") == 0 {
        let fix =
            "restart the controller's FRI (friClose, friOpen), and stop any replay of a recording";
        return Some(HealthFinding::fail(
            "datagrams are repeated, out of order, or hold no numbers",
            fix,
        ));
    }
    if let (Some(doubt), true) = (
        facts.link()["doubt_last"].as_str(),
        facts.grown("doubted") > 0,
    ) {
        let doubted = Counted(facts.grown("doubted"), "datagram");
        let what =
            format!("{doubted} waited for the next one to confirm them; the last, because {doubt}");
        let fix = "if the controller behaves so by itself, widen the setting that is named; if not, look for another sender \
                   or a device in between that changes datagrams";
        return Some(HealthFinding::warn(what, fix));
    }
    if disordered + lost > 0 {
        let what = format!(
            "during the check, {} lost and {disordered} duplicated, late or implausible",
            Counted(lost, "datagram")
        );
        let fix = "use a dedicated cable between the controller and this machine, without switch or Wi-Fi";
        return Some(HealthFinding::warn(what, fix));
    }
    let (gaps, ever) = (facts.total("gaps"), facts.total("gaps_datagrams"));
    (gaps > 0).then(|| {
        HealthFinding::note(format!(
            "lost since the driver started: {} in {}",
            Counted(ever, "datagram"),
            Counted(gaps, "gap")
        ))
    })
}

fn wire(facts: &LinkFacts) -> Option<&Value> {
    let wire = &facts.link()["wire"];
    wire.is_object().then_some(wire)
}

fn arrival(facts: &LinkFacts) -> Option<HealthFinding> {
    let period_s = wire(facts)?["period_s"].as_f64()?;
    let period_ns = (period_s * 1e6).round() as u64 * 1000;
    let longest_ns = facts.total("interval_max_ns");
    let what = format!(
        "a datagram every {}; longest gap {} during the check, {} since the start",
        time(period_ns),
        time(longest_ns),
        time(facts.total("interval_longest_ns"))
    );
    if longest_ns > 3 * period_ns {
        let fix = "check this machine with `rcc-cli doctor` (late wake-ups), then the network";
        return Some(HealthFinding::warn(what, fix));
    }
    if period_ns != facts.period_ns {
        let fix = format!(
            "friOpen({}) on the controller, or `period` in the cell's file",
            facts.period_ns.div_ceil(1_000_000)
        );
        let cause = format!("the cell's period is {}", time(facts.period_ns));
        return Some(HealthFinding::note(what).cause(cause).fix(fix));
    }
    Some(HealthFinding::ok(what))
}

#[cfg(test)]
mod tests;
