//! Events as sentences: what was lost, what ended and why, and what to do.
//! Pure.

use super::{CommandFault, Event, EventKind, EventOrigin, Predecessor};

impl Event {
    /// Who says so: `executor`, `driver lwr`.
    #[must_use]
    pub fn who(&self) -> String {
        match self.source.role {
            EventOrigin::Driver => format!("driver {}", self.source.label),
            role => role.as_str().to_owned(),
        }
    }

    /// The life of the executor that its command numbers belong to; empty if it has none.
    #[must_use]
    pub fn executor(&self) -> &str {
        match (&self.what, self.source.role) {
            (EventKind::Loaded { executor, .. } | EventKind::Rejected { executor, .. }, _) => {
                executor
            }
            (_, EventOrigin::Executor) => &self.source.incarnation,
            _ => "",
        }
    }

    /// What happened, in a sentence; `net` names a command of a life of the executor.
    #[must_use]
    pub fn sentence(&self, net: &dyn Fn(&str, u64) -> String) -> String {
        let named = |id: u64| net(self.executor(), id);
        match &self.what {
            EventKind::Command {
                command,
                state,
                reason,
                fault,
            } => command_words(&named(*command), state, reason.as_deref(), fault.as_ref()),
            EventKind::Loaded {
                command,
                primitives,
                uses,
                ..
            } => {
                let uses = match uses.join(", ") {
                    none if none.is_empty() => String::new(),
                    some => format!(", uses {some}"),
                };
                format!("{} loaded: {primitives} primitives{uses}", named(*command))
            }
            EventKind::Rejected {
                command,
                code,
                words,
                count,
                ..
            } => {
                let more = match count.saturating_sub(1) {
                    0 => String::new(),
                    more => format!(" (and {more} more)"),
                };
                let net = named(*command);
                format!("{net} rejected: {code} {words}{more}; correct the text and load it again")
            }
            EventKind::Late { .. } => late_words(&self.what, &named).unwrap_or_default(),
            other => other.plain(),
        }
    }
}

fn late_words(late: &EventKind, named: &dyn Fn(u64) -> String) -> Option<String> {
    let EventKind::Late {
        count,
        first_cycle,
        worst_wake_us,
        worst_exec_us,
        computed_long,
        command,
        command_us,
    } = late
    else {
        return None;
    };
    let cause = match (computed_long, command) {
        (None, _) => String::new(),
        (Some(0), _) => "; all were woken late".to_owned(),
        (Some(long), None) => format!("; {long} computed long, without a net"),
        (Some(long), Some(command)) => format!(
            "; {long} computed long, most of it {} ({:.3} ms)",
            named(*command),
            command_us.unwrap_or(0.0) / 1e3
        ),
    };
    Some(format!(
        "{count} late cycles, the first is {first_cycle}: woke up to {:.3} ms after its time, computed up to {:.3} ms\
         {cause}",
        worst_wake_us / 1e3,
        worst_exec_us / 1e3
    ))
}

impl EventKind {
    /// The sentences that name no net.
    fn plain(&self) -> String {
        match self {
            EventKind::Started { note, predecessor } => started(note, predecessor.as_ref()),
            EventKind::Stopping { why } => format!("stops: {why}"),
            EventKind::HelperEnded { why } => why.clone(),
            EventKind::HelperHangs {
                helper,
                silent_ms,
                limit_ms,
            } => format!(
                "its helper thread `{helper}` makes no turn for {silent_ms} ms, {limit_ms} ms are the most: its supervisor \
                 ends it, devices come to rest, and it is started again"
            ),
            EventKind::LifeUnknown { process, why } => format!(
                "whether {process} lives is not known ({why}); it counts as living, and is looked at again"
            ),
            EventKind::Suppressed { count } => {
                format!("{count} more events were not written: too many at once, or no disk")
            }
            EventKind::Acknowledged { late } => {
                format!("{late} late cycles are acknowledged: what is latched begins anew")
            }
            EventKind::IncidentWritten {
                reason,
                file,
                span_ms,
                others,
                ..
            } => {
                let more = match others {
                    0 => String::new(),
                    others => format!(", and {others} more reasons"),
                };
                format!(
                    "incident ({reason}{more}): the last {:.1} s are in {file}; `rcc-cli replay` runs them again",
                    *span_ms as f64 / 1e3
                )
            }
            EventKind::IncidentLost { why } => format!("an incident was not written: {why}"),
            EventKind::ExecutorFound { pid, .. } => format!("works with the executor (pid {pid})"),
            EventKind::ExecutorLost { pid, .. } => format!(
                "the executor (pid {pid}) is gone, and with it every command: load your nets again when it is back"
            ),
            EventKind::ClientCutOff { client, why } => format!("cut off client {client}: {why}"),
            EventKind::CellStarted {
                config, previous, ..
            } => match previous {
                None => format!("cell started from {config}"),
                Some(last) => format!(
                    "cell started from {config}; the life before ended without a goodbye, its last word ({}, {}): {}",
                    last.time, last.who, last.words
                ),
            },
            EventKind::CellStopping { why } => format!("the cell stops: {why}"),
            EventKind::Cleaned {
                half_created,
                dead_nodes,
                files,
                of,
            } => {
                let of = if of.is_empty() {
                    "dead processes".to_owned()
                } else {
                    of.join(", ")
                };
                format!(
                    "cleaned up after {of}: {dead_nodes} nodes, {files} files, {half_created} half-made"
                )
            }
            EventKind::FaultInjected { target, what } => {
                format!("fault on purpose: {target} {what}")
            }
            other => other.of_device().unwrap_or_else(|| other.of_process()),
        }
    }

    fn of_device(&self) -> Option<String> {
        Some(match self {
            EventKind::DeviceLost {
                device,
                board_age_us,
                reason,
                ..
            } => {
                let age = board_age_us.map(|age| age as f64 / 1e3);
                let why = match (age, reason.as_str()) {
                    (Some(age), "") => format!("no measurement for {age:.1} ms"),
                    (Some(age), reason) => {
                        format!("{reason}, its last measurement is {age:.1} ms old")
                    }
                    (None, "") => "its driver says so".to_owned(),
                    (None, reason) => reason.to_owned(),
                };
                format!(
                    "device {device} lost: {why}; its ports are null, a net that commands it ends"
                )
            }
            EventKind::DeviceFound { device, state, .. } => {
                format!("device {device} found: {state}, not commanded; nothing moves before START")
            }
            EventKind::DeviceState {
                device,
                state,
                was,
                reason,
            } => {
                format!("device {device}: {was} → {state}{}", because(reason))
            }
            EventKind::DriverAttached {
                device,
                pid,
                driver,
            } => {
                format!("follows the driver of {device} (pid {pid}, life {driver})")
            }
            EventKind::DriverGone { device, driver } => format!(
                "the driver of {device} is dead (life {driver}); its supervisor starts another, nets do not go on by \
                 themselves"
            ),
            EventKind::DriverState { state, was, reason } if state == was => {
                format!("still {state}{}", because(reason))
            }
            EventKind::DriverState { state, was, reason } => {
                format!("{was} → {state}{}", because(reason))
            }
            EventKind::Quality { permille, was } => {
                let (now, was) = (f64::from(*permille) / 10.0, f64::from(*was) / 10.0);
                let advice = if now < was {
                    "; rcc-cli devices shows it"
                } else {
                    ""
                };
                format!("quality of the connection {was:.1} % → {now:.1} %{advice}")
            }
            EventKind::RestBegun { reason } => format!("brings the device to rest: {reason}"),
            EventKind::RestReached { after_ms } => {
                format!("the device rests, {after_ms} ms after; it moves again only by START")
            }
            EventKind::Refused { words, .. } => {
                format!("refused a set-point, {words}; correct the net's limits or its path")
            }
            EventKind::OutOfRange { channels } => format!(
                "{} commanded out of range and released (on_release); correct the net",
                channels.join(", ")
            ),
            _ => return None,
        })
    }

    fn of_process(&self) -> String {
        match self {
            EventKind::BuildMismatch {
                process,
                pid,
                differs,
                remedy,
                ..
            } => format!(
                "does not work with {process} (pid {pid}), which was built from another version ({differs}); {remedy}"
            ),
            EventKind::ConfigurationMismatch {
                process,
                pid,
                differs,
                remedy,
                ..
            } => format!(
                "does not work with {process} (pid {pid}), which was started with another configuration ({differs}); \
                 {remedy}"
            ),
            EventKind::ConfigurationChanged { differs, fault } => {
                crate::configuration::changed(differs, fault.as_deref())
            }
            EventKind::ProcessStarted { process, pid } => format!("{process} up (pid {pid})"),
            EventKind::ProcessDied {
                process,
                pid,
                how,
                last_words,
            } => {
                let words = match last_words.as_str() {
                    "" => String::new(),
                    words => format!("; its last words: {words}"),
                };
                format!("{process} (pid {pid}) died: {how}{words}")
            }
            EventKind::ProcessRestart {
                process,
                nth,
                most,
                within_s,
            } => format!(
                "{process} is started again ({nth} of {most} in {within_s} s); nothing moves by that"
            ),
            EventKind::ProcessFailed { process, why } => format!(
                "{process} failed and is not started again: {why}; end the cell, cure that, start it again"
            ),
            EventKind::WatchdogKill {
                process,
                pid,
                silent_ms,
            } => format!(
                "{process} (pid {pid}) gave no sign of life for {silent_ms} ms and was killed"
            ),
            other => other.name().to_owned(),
        }
    }
}

fn started(note: &str, predecessor: Option<&Predecessor>) -> String {
    let note = match note {
        "" => String::new(),
        note => format!("; {note}"),
    };
    match predecessor {
        None => format!("started{note}"),
        Some(dead) => format!(
            "started after its predecessor (pid {}, life {}) died{note}",
            dead.pid, dead.incarnation
        ),
    }
}

fn because(reason: &str) -> String {
    match reason {
        "" => String::new(),
        reason => format!(" ({reason})"),
    }
}

fn command_words(
    net: &str,
    state: &str,
    reason: Option<&str>,
    fault: Option<&CommandFault>,
) -> String {
    match (fault, reason) {
        (Some(fault), _) => format!("{net} {state} by a fault, {}", fault.words()),
        (None, Some(reason)) => format!("{net} {state}: {reason}"),
        (None, None) => format!("{net} {state}"),
    }
}

impl CommandFault {
    /// What was wrong and what to do.
    #[must_use]
    pub fn words(&self) -> String {
        let device = match &self.device {
            Some(device) => format!(" {device}"),
            None => String::new(),
        };
        let numbers = match (self.joint, &self.rule, self.value, self.limit) {
            (Some(joint), Some(rule), Some(value), Some(limit)) => {
                let unit = self.unit.as_deref().unwrap_or("");
                format!(" joint {joint}: {rule} {value:.6} {unit}, allowed {limit:.6} {unit}")
            }
            (Some(joint), Some(rule), ..) => format!(" joint {joint}: {rule}"),
            // Of what is no joint, the rule says everything.
            (None, Some(rule), ..) => format!(": {rule}"),
            _ => String::new(),
        };
        let advice = match self.code.as_str() {
            "device lost" => {
                "when it is ready again (rcc-cli devices), load and start the net again"
            }
            "jump" => "begin where the device is held",
            "limit" if self.joint.is_some() => "correct the net's speeds or its path",
            "limit" => "stay within what the robot's file and the cell's configuration allow",
            "overrun" => "make the net cheaper, or the machine quieter (rcc-cli doctor)",
            "panic" => "a fault of ours: report it with the net",
            _ => "correct the net's parameters",
        };
        let details = match (device.is_empty(), numbers.is_empty()) {
            (true, true) => "",
            _ => ":",
        };
        format!("{}{details}{device}{numbers}; {advice}", self.code)
    }
}
