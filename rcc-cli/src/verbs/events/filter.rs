//! Filters of the event log: by time, severity, net and device. Pure.

use std::collections::BTreeSet;
use std::time::Duration;

use rcc_api::codes;
use rcc_api::events::EventNames;
use rcc_protocol::events::{CommandNames, Event, EventOrigin, EventSeverity, wall_time_before};

use super::Arguments;
use crate::failure::Failure;

/// Form of a date and time, of which a beginning of at least the date is accepted; 0 is any digit.
const DATE_FORM: &str = "0000-00-00T00:00:00.000000Z";
/// Length of the date in [`DATE_FORM`].
const DATE_LENGTH: usize = 10;

/// Start of the shown events.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Since {
    /// The first event.
    Always,
    /// Wall time, or a beginning of it, as in the log.
    Time(String),
    /// Cycle of the newest executor.
    Cycle(u64),
}

/// The events to show, and the names of the nets in them.
#[derive(Debug)]
pub(super) struct EventFilter {
    since: Since,
    severity: EventSeverity,
    net: Option<String>,
    device: Option<String>,
    names: EventNames,
    /// Devices and processes that have events.
    devices: BTreeSet<String>,
}

impl EventFilter {
    /// Creates the filter of the arguments.
    ///
    /// # Errors
    /// Fails if `--since` cannot be understood.
    pub(super) fn new(arguments: &Arguments) -> Result<EventFilter, Failure> {
        Ok(EventFilter {
            since: since(arguments.since.as_deref())?,
            severity: arguments.severity.map_or(EventSeverity::Info, Into::into),
            net: arguments.net.clone(),
            device: arguments.device.clone(),
            // The whole log is shown.
            names: EventNames::keeping(usize::MAX),
            devices: BTreeSet::new(),
        })
    }

    /// Returns the start of the shown events.
    pub(super) fn since(&self) -> &Since {
        &self.since
    }

    /// Learns names, which may be reported late, and the time of the first requested cycle.
    pub(super) fn prepare(&mut self, events: &[Event]) {
        events.iter().for_each(|event| self.learn(event));
        let Since::Cycle(from) = self.since else {
            return;
        };
        // Cycles are counted from 1 in each incarnation of the executor: the newest is meant.
        let ours =
            |event: &&Event| event.source.role == EventOrigin::Executor && event.cycle.is_some();
        let newest = events
            .iter()
            .rfind(ours)
            .map(|event| &event.source.incarnation);
        let first = events
            .iter()
            .filter(ours)
            .find(|event| Some(&event.source.incarnation) == newest && event.cycle >= Some(from));
        if let Some(first) = first {
            self.since = Since::Time(first.time.clone());
        }
    }

    /// Learns the names of an event.
    pub(super) fn learn(&mut self, event: &Event) {
        self.names.learn(event);
        let driver = event.source.role == EventOrigin::Driver;
        let driver = driver.then_some(event.source.label.as_str());
        for name in event.what.device().into_iter().chain(driver) {
            if !self.devices.contains(name) {
                self.devices.insert(name.to_owned());
            }
        }
    }

    /// Refuses a device or net that occurs nowhere, which would show nothing. A net that is loaded later may be followed.
    ///
    /// # Errors
    /// Fails with the names that are known.
    pub(super) fn require_known(&self, configured: &[String], follow: bool) -> Result<(), Failure> {
        if let Some(device) = &self.device {
            let mut known: BTreeSet<&str> = self.devices.iter().map(String::as_str).collect();
            known.extend(configured.iter().map(String::as_str));
            let process = device.strip_prefix("driver/").unwrap_or(device);
            if !known.contains(process) {
                return Err(unknown("device or process", device, known));
            }
        }
        if let Some(net) = self.net.as_ref().filter(|_| !follow) {
            let mut commands = self.names.commands();
            if !commands.any(|(executor, id, _)| self.is_net(net, executor, id)) {
                let known = self.names.commands().map(|(_, _, name)| name).collect();
                return Err(unknown("net", net, known));
            }
        }
        Ok(())
    }

    /// Returns a command's title: `line#3`, or `#3` if its name is unknown.
    pub(super) fn title(&self, executor: &str, id: u64) -> String {
        self.names.title(executor, id)
    }

    /// Returns true if the event is to be shown.
    pub(super) fn matches(&self, event: &Event) -> bool {
        let young = match &self.since {
            Since::Always => true,
            Since::Time(time) => event.time >= *time,
            Since::Cycle(cycle) => event.cycle.is_some_and(|is| is >= *cycle),
        };
        young
            && event.severity >= self.severity
            && self.matches_net(event)
            && self.matches_device(event)
    }

    fn is_net(&self, wanted: &str, executor: &str, id: u64) -> bool {
        let title = self.title(executor, id);
        let name = title.split('#').next().unwrap_or_default();
        [title.as_str(), name, &id.to_string()].contains(&wanted)
    }

    fn matches_net(&self, event: &Event) -> bool {
        let Some(wanted) = &self.net else {
            return true;
        };
        let id = event.what.command();
        id.is_some_and(|id| self.is_net(wanted, event.executor(), id))
    }

    fn matches_device(&self, event: &Event) -> bool {
        let Some(wanted) = &self.device else {
            return true;
        };
        let process = wanted.strip_prefix("driver/").unwrap_or(wanted);
        let of_driver = event.source.role == EventOrigin::Driver && event.source.label == process;
        of_driver || event.what.device() == Some(process)
    }
}

impl CommandNames for EventFilter {
    fn net(&self, executor: &str, id: u64) -> String {
        self.title(executor, id)
    }

    fn outcome(&self, executor: &str, id: u64, number: u32) -> Option<String> {
        self.names.outcome(executor, id, number)
    }
}

fn unknown(what: &str, name: &str, known: BTreeSet<&str>) -> Failure {
    let known: Vec<&str> = known.into_iter().collect();
    let help = match known.is_empty() {
        true => format!("no {what} has events; leave the filter out"),
        false => format!("known: {}", known.join(", ")),
    };
    Failure::new(
        codes::BAD_REQUEST,
        format!("no events of {what} `{name}`"),
        help,
    )
}

fn since(text: Option<&str>) -> Result<Since, Failure> {
    let Some(text) = text.map(str::trim) else {
        return Ok(Since::Always);
    };
    if let Ok(cycle) = text.replace([' ', '_'], "").parse() {
        return Ok(Since::Cycle(cycle));
    }
    let date = text.replacen(' ', "T", 1);
    if is_date(&date) {
        return Ok(Since::Time(date));
    }
    let ago = match hours_or_days(text) {
        Some(ago) => Ok(ago),
        None => crate::duration::duration(text),
    };
    ago.map(|ago| Since::Time(wall_time_before(ago)))
        .map_err(|_| {
            Failure::new(
                codes::BAD_REQUEST,
                format!("invalid --since `{text}`"),
                "write a duration (10s, 10min, 3h, 2d), a date and time in UTC (2026-11-23, 2026-11-23T16:35) or a cycle \
                 number",
            )
        })
}

fn is_date(text: &str) -> bool {
    let form = |(given, form): (char, char)| match form {
        '0' => given.is_ascii_digit(),
        form => given == form,
    };
    let length = text.len();
    (DATE_LENGTH..=DATE_FORM.len()).contains(&length)
        && text.chars().zip(DATE_FORM.chars()).all(form)
}

fn hours_or_days(text: &str) -> Option<Duration> {
    let units = [("h", 3600), ("d", 86_400)];
    let (number, seconds) = units
        .iter()
        .find_map(|(unit, seconds)| Some((text.strip_suffix(unit)?, seconds)))?;
    let number: u32 = number.trim_end().parse().ok()?;
    Some(Duration::from_secs(u64::from(number) * seconds))
}
