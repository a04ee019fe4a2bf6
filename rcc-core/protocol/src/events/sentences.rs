//! Formats events as sentences: what was lost, what ended and why, and the remedy. Pure functions.

use rcc_core::counted::Counted;

use super::{CommandFault, Event, EventKind, EventOrigin, Predecessor};
use crate::ending::ending;

/// Names of commands, which the executor does not know.
pub trait CommandNames {
    /// Returns `net#id` for a command of an incarnation of the executor.
    fn net(&self, executor: &str, id: u64) -> String;

    /// Returns the name of an outcome of its net, counted from 1; `None` if it is not known or has none.
    fn outcome(&self, executor: &str, id: u64, number: u32) -> Option<String>;
}

/// Names of nets only.
struct NetNames<'a>(&'a dyn Fn(&str, u64) -> String);

impl CommandNames for NetNames<'_> {
    fn net(&self, executor: &str, id: u64) -> String {
        (self.0)(executor, id)
    }

    fn outcome(&self, _executor: &str, _id: u64, _number: u32) -> Option<String> {
        None
    }
}

impl Event {
    /// Returns the writer of the event for people: `executor`, `driver lwr`.
    #[must_use]
    pub fn who(&self) -> String {
        match self.source.role {
            EventOrigin::Driver => format!("driver {}", self.source.label),
            role => role.as_str().to_owned(),
        }
    }

    /// Returns the incarnation of the executor to which the event's command ids belong; empty if it has none.
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

    /// Formats the event as a sentence; `net` names a command of an incarnation of the executor.
    #[must_use]
    pub fn sentence(&self, net: &dyn Fn(&str, u64) -> String) -> String {
        self.sentence_with(&NetNames(net))
    }

    /// Formats the event as a sentence, with the names of nets and of their outcomes.
    #[must_use]
    pub fn sentence_with(&self, names: &dyn CommandNames) -> String {
        let named = |id: u64| names.net(self.executor(), id);
        match &self.what {
            EventKind::Command {
                command,
                state,
                reason,
                outcome,
                cycles,
                fault,
            } => {
                let (net, cycles) = (named(*command), cycles.unwrap_or(0));
                let number = outcome.unwrap_or(0);
                let outcome = names.outcome(self.executor(), *command, number);
                match (fault, reason) {
                    (Some(fault), _) => format!("{net} {state} by a fault, {}", fault.sentence()),
                    (None, Some(reason)) => {
                        format!(
                            "{net} {state}: {}",
                            ending(reason, outcome.as_deref(), cycles)
                        )
                    }
                    (None, None) => format!("{net} {state}"),
                }
            }
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
                let primitives = Counted(u64::from(*primitives), "primitive");
                format!("{} loaded: {primitives}{uses}", named(*command))
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
                format!(
                    "{net} rejected: {code} {words}{more}; `rcc-cli state {command}` shows the remedy"
                )
            }
            EventKind::Rule {
                rule,
                state,
                command,
                why,
            } => {
                let about = command.map(&named);
                match (about, why.as_str()) {
                    (_, "") => format!("rule {rule} {state}"),
                    (None, why) => format!("rule {rule} {state}: {why}"),
                    (Some(about), why) => format!("rule {rule} {state}: {about}: {why}"),
                }
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
        (Some(0), _) if *count == 1 => String::new(),
        (Some(0), _) => "; all woke late".to_owned(),
        (Some(_), None) if *count == 1 => "; computed long, without a net".to_owned(),
        (Some(_), Some(command)) if *count == 1 => format!(
            "; computed long, most of it {} ({:.3} ms)",
            named(*command),
            command_us.unwrap_or(0.0) / 1e3
        ),
        (Some(long), None) => format!("; {long} computed long, without a net"),
        (Some(long), Some(command)) => format!(
            "; {long} computed long, most of it {} ({:.3} ms)",
            named(*command),
            command_us.unwrap_or(0.0) / 1e3
        ),
    };
    let (wake_ms, exec_ms) = (worst_wake_us / 1e3, worst_exec_us / 1e3);
    Some(match count {
        1 => format!(
            "1 late cycle, cycle {first_cycle}: woke up {wake_ms:.3} ms late, computed for {exec_ms:.3} ms{cause}"
        ),
        count => format!(
            "{} from cycle {first_cycle} on: woke up to {wake_ms:.3} ms late, computed for up to {exec_ms:.3} ms{cause}",
            Counted(*count, "late cycle")
        ),
    })
}

impl EventKind {
    /// Sentences that do not name a net.
    fn plain(&self) -> String {
        match self {
            EventKind::Started { note, predecessor } => started(note, predecessor.as_ref()),
            EventKind::Stopping { why } => format!("stopping: {why}"),
            EventKind::HelperEnded { why } => why.clone(),
            EventKind::HelperHangs {
                helper,
                silent_ms,
                limit_ms,
            } => format!(
                "helper thread `{helper}` has made no progress for {silent_ms} ms (limit {limit_ms} ms): the supervisor ends \
                 this process, devices come to rest, and it is restarted"
            ),
            EventKind::LifeUnknown { process, why } => format!(
                "cannot determine whether {process} is alive ({why}); it counts as alive, and the check is repeated"
            ),
            EventKind::Suppressed { count } => {
                let were = if *count == 1 { "was" } else { "were" };
                format!(
                    "{} {were} not written: too many at once, or the disk is not writable",
                    Counted(*count, "more event")
                )
            }
            EventKind::LeaseLost {
                lease,
                rules,
                commands,
            } => format!(
                "lease {lease} is lost: its client is gone; {} disarmed, {} stopped",
                Counted(u64::from(*rules), "rule"),
                Counted(u64::from(*commands), "command")
            ),
            EventKind::Acknowledged { late } => {
                let late = Counted(*late, "late cycle");
                format!("{late} acknowledged: latched values are cleared")
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
                    others => format!(", and {others} more"),
                };
                format!(
                    "incident ({reason}{more}): the last {:.1} s are in {file}; replay them with `rcc-cli replay`",
                    *span_ms as f64 / 1e3
                )
            }
            EventKind::IncidentLost { why } => format!("an incident could not be written: {why}"),
            EventKind::ExecutorFound { pid, .. } => {
                format!("connected to the executor (pid {pid})")
            }
            EventKind::ExecutorLost { pid, .. } => format!(
                "the executor (pid {pid}) is gone and all commands are lost: load your nets again when it is back"
            ),
            EventKind::ClientCutOff { client, why } => {
                format!("disconnected client {client}: {why}")
            }
            EventKind::CellStarted {
                config, previous, ..
            } => match previous {
                None => format!("cell started from {config}"),
                Some(last) => format!(
                    "cell started from {config}; the previous run did not end in order, its last event ({}, {}): {}",
                    last.time, last.who, last.words
                ),
            },
            EventKind::CellStopping { why } => format!("the cell is stopping: {why}"),
            EventKind::CellEnded { kept } => {
                format!("the cell has ended; events, incidents and logs stay in {kept}")
            }
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
                    "cleaned up after {of}: {}, {}, {}",
                    Counted(*dead_nodes, "node"),
                    Counted::of(*files, "file"),
                    Counted::of(*half_created, "half-created file")
                )
            }
            EventKind::FaultInjected { target, what } => {
                format!("injected fault: {target} {what}")
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
                    (None, "") => "reported by its driver".to_owned(),
                    (None, reason) => reason.to_owned(),
                };
                format!(
                    "device {device} lost: {why}; its ports are null, and a net that commands it ends"
                )
            }
            EventKind::DeviceFound { device, state, .. } => {
                format!(
                    "device {device} found: {state}, not commanded; it does not move before START"
                )
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
                format!("attached to the driver of {device} (pid {pid}, incarnation {driver})")
            }
            EventKind::DriverGone { device, driver } => format!(
                "the driver of {device} is dead (incarnation {driver}); the supervisor restarts it, nets do not resume by \
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
                    "; see `rcc-cli devices`"
                } else {
                    ""
                };
                format!("connection quality {was:.1} % → {now:.1} %{advice}")
            }
            EventKind::RestBegun { reason } => format!("brings the device to rest: {reason}"),
            EventKind::RestReached { after_ms } => {
                format!(
                    "the device came to rest after {after_ms} ms; it moves again only after START"
                )
            }
            EventKind::Refused { words, .. } => {
                format!("refused a set-point, {words}; correct the net's limits or its path")
            }
            EventKind::OutOfRange { words, .. } => format!(
                "commanded out of range and released (on_release): {words}; limit the value in the net that commands it: \
                 `rcc-cli devices` names the holder"
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
                "refuses to work with {process} (pid {pid}), which was built from another version ({differs}); {remedy}"
            ),
            EventKind::ConfigurationMismatch {
                process,
                pid,
                differs,
                remedy,
                ..
            } => format!(
                "refuses to work with {process} (pid {pid}), which was started with another configuration ({differs}); \
                 {remedy}"
            ),
            EventKind::ConfigurationChanged { differs, fault } => {
                crate::configuration::changed(differs, fault.as_deref())
            }
            EventKind::ProcessStarted { process, pid } => format!("{process} is up (pid {pid})"),
            EventKind::ProcessDied {
                process,
                pid,
                how,
                last_words,
            } => {
                let words = match last_words.as_str() {
                    "" => String::new(),
                    words => format!("; last output: {words}"),
                };
                format!("{process} (pid {pid}) died: {how}{words}")
            }
            EventKind::ProcessRestart {
                process,
                nth,
                most,
                within_s,
            } => format!(
                "restarting {process} ({nth} of {most} in {within_s} s); no motion is resumed"
            ),
            EventKind::ProcessFailed { process, why } => format!(
                "{process} failed and is not restarted: {why}; stop the cell, fix the cause and start it again"
            ),
            EventKind::WatchdogKill {
                process,
                pid,
                silent_ms,
            } => format!("{process} (pid {pid}) was killed: no heartbeat for {silent_ms} ms"),
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
            "started after its predecessor (pid {}, incarnation {}) died{note}",
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

impl CommandFault {
    /// Formats the fault and its remedy.
    #[must_use]
    pub fn sentence(&self) -> String {
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
            // Without a joint the rule is complete.
            (None, Some(rule), ..) => format!(": {rule}"),
            _ => String::new(),
        };
        let advice = match self.code.as_str() {
            "device lost" => {
                "when it is ready again (see `rcc-cli devices`), load and start the net again"
            }
            "jump" => "start at the position where the device is held",
            "limit" if self.joint.is_some() => "reduce the speeds of the net or correct its path",
            "limit" => "stay within the limits of the robot's file and of the cell's configuration",
            "overrun" => "make the net cheaper, or the machine quieter (see `rcc-cli doctor`)",
            "panic" => "this is a bug in RCC: report it with the net",
            _ => "correct the net's parameters",
        };
        let details = match (device.is_empty(), numbers.is_empty()) {
            (true, true) => "",
            _ => ":",
        };
        format!("{}{details}{device}{numbers}; {advice}", self.code)
    }
}
