//! The newest values that the nets of a cell have published with `Monitor`. A helper thread of the loader reads the
//! executor's stream; blocking threads of the server look them up. The executor knows nothing of it.

use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rcc_api::bodies::{HistoryPage, MonitoredValue};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_core::message::MonitorRecord;
use rcc_ipc::Subscriber;
use rcc_language::names::{MonitorNames, Names};
use rcc_process::log_throttle::LogThrottle;
use rcc_protocol::element_kind::ElementKind;
use rcc_protocol::events::hex_digits;
use rcc_protocol::pattern::Pattern;
use serde_json::Value;

use super::Service;

/// Number of records that are kept, the newest; at 168 bytes a record, 11 MB.
pub const RECORDS_MAX: usize = 65_536;
/// Maximum number of values in an answer.
pub const VALUES_MAX: usize = 10_000;
/// Number of values in an answer to a request that names none.
const VALUES_DEFAULT: usize = 1_000;
/// Interval at which the stream is read; its buffers hold more than 100 ms.
pub const READ_EVERY: Duration = Duration::from_millis(20);

/// The records of the executor that was seen last.
#[derive(Debug, Default)]
pub(super) struct History(Mutex<RetainedRecords>);

#[derive(Debug, Default)]
struct RetainedRecords {
    /// Incarnation of the executor.
    executor: u64,
    /// In the order of their numbers.
    records: VecDeque<MonitorRecord>,
    /// Names of the commands with records.
    nets: HashMap<u64, Arc<MonitoredNet>>,
    /// Number after the newest record.
    next: u64,
}

/// The names of a command's monitors, which outlive the command.
#[derive(Clone, Debug, Default)]
struct MonitoredNet {
    name: String,
    monitors: Vec<MonitorNames>,
}

/// Query of a client.
#[derive(Clone, Debug, Default)]
pub struct HistoryRequest {
    /// Patterns of the ports; all if empty.
    pub ports: Vec<String>,
    /// `next` of an earlier answer.
    pub after: Option<String>,
    /// Only the last seconds.
    pub seconds: Option<f64>,
    /// Maximum number of values.
    pub limit: Option<usize>,
}

/// Where an answer begins.
#[derive(Clone, Copy, Debug, PartialEq)]
enum AnswerStart {
    /// With the newest values that the limit allows.
    Newest,
    /// After a position: the incarnation of the executor, and the number of the next record.
    After(u64, u64),
    /// This long before the newest record, ns.
    Last(u64),
}

/// Reads the stream of the living executor. Owned by the helper thread.
#[derive(Debug, Default)]
pub struct RecordFollower {
    /// Incarnation of the executor that `records` is of.
    executor: u64,
    records: Option<Subscriber<MonitorRecord>>,
    arrived: Vec<MonitorRecord>,
    log: LogThrottle,
}

impl RetainedRecords {
    fn add(&mut self, executor: u64, records: &[MonitorRecord]) {
        if self.executor != executor {
            *self = RetainedRecords {
                executor,
                ..RetainedRecords::default()
            };
        }
        for record in records {
            if self.records.len() == RECORDS_MAX {
                self.records.pop_front();
            }
            self.records.push_back(*record);
            self.next = record.sequence + 1;
        }
    }

    /// Forgets the names of commands that have no records any more.
    fn forget_names(&mut self) {
        let commands = self.records.iter().map(|record| record.command);
        let named: HashSet<u64> = commands.collect();
        self.nets.retain(|command, _| named.contains(command));
    }

    /// Returns the index of the first record of an answer, and whether nothing is missing before it.
    fn first(&self, begin: AnswerStart) -> (usize, bool) {
        match begin {
            AnswerStart::Newest => (0, true),
            AnswerStart::After(executor, number) => {
                let oldest = self
                    .records
                    .front()
                    .map_or(self.next, |record| record.sequence);
                let is_known = executor == self.executor && (oldest..=self.next).contains(&number);
                let before = |record: &MonitorRecord| is_known && record.sequence < number;
                (self.records.partition_point(before), is_known)
            }
            AnswerStart::Last(span_ns) => {
                let newest = self.records.back().map_or(0, |record| record.stamp_ns);
                let from_ns = newest.saturating_sub(span_ns);
                (
                    self.records
                        .partition_point(|record| record.stamp_ns < from_ns),
                    true,
                )
            }
        }
    }

    fn page(&self, begin: AnswerStart, patterns: &[Pattern], limit: usize) -> HistoryPage {
        let (mut first, continues) = self.first(begin);
        if begin == AnswerStart::Newest {
            first = self.records.len();
            let mut found = 0;
            while first > 0 && found < limit {
                first -= 1;
                found += usize::from(self.shown(&self.records[first], patterns).is_some());
            }
        }
        let mut page = HistoryPage {
            continues,
            ..HistoryPage::default()
        };
        let mut next = match begin {
            AnswerStart::After(_, number) if continues => number,
            _ => self
                .records
                .get(first)
                .map_or(self.next, |record| record.sequence),
        };
        for record in self.records.iter().skip(first) {
            if page.values.len() == limit {
                break;
            }
            page.lost += record.sequence.saturating_sub(next);
            next = record.sequence + 1;
            page.values.extend(self.shown(record, patterns));
        }
        page.next = format!("{}-{next}", hex_digits(self.executor));
        page
    }

    /// Returns the value of a record if a pattern selects it.
    fn shown(&self, record: &MonitorRecord, patterns: &[Pattern]) -> Option<MonitoredValue> {
        let net = self.nets.get(&record.command);
        let net_name = net.map_or_else(|| format!("#{}", record.command), |net| net.name.clone());
        let monitor = net.and_then(|net| net.monitors.get(record.monitor as usize));
        let source = match monitor {
            Some(monitor) => monitor.source.clone(),
            None => format!("monitor{}", record.monitor),
        };
        let primitive = monitor.map_or("", |monitor| &monitor.primitive);
        let mut name = format!("{net_name}/{source}");
        let own = format!("{net_name}/{primitive}");
        let selects = |pattern: &&Pattern| pattern.matches(&name) || pattern.matches(&own);
        let element = match patterns.iter().find(selects) {
            Some(pattern) => pattern.element,
            None if patterns.is_empty() => None,
            None => return None,
        };
        let width = (record.width as usize).min(record.values.len());
        let mut elements = record.values.get(..width)?;
        if let Some(index) = element {
            elements = elements.get(index..=index)?;
            name = format!("{name}[{index}]");
        }
        let ty = monitor.map_or_else(String::new, |monitor| monitor.type_name.clone());
        let kind = ElementKind::of(&ty);
        let value = match elements {
            [one] => kind.json(*one),
            all => Value::Array(all.iter().map(|element| kind.json(*element)).collect()),
        };
        Some(MonitoredValue {
            name,
            net: net_name,
            command: record.command,
            source,
            monitor: primitive.to_owned(),
            ty,
            unit: monitor.and_then(|monitor| monitor.unit.clone()),
            sequence: record.sequence,
            cycle: record.cycle,
            stamp_ns: record.stamp_ns,
            value,
        })
    }
}

impl History {
    fn kept(&self) -> MutexGuard<'_, RetainedRecords> {
        // A panic leaves at worst a part of a batch.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Service {
    /// Returns values that were published, see [`HistoryRequest`].
    ///
    /// # Errors
    /// Returns an error if a pattern, the position, the time or the limit is invalid.
    pub fn history(&self, request: &HistoryRequest) -> Result<HistoryPage, ApiError> {
        let patterns = request.ports.iter().map(|port| port.parse::<Pattern>());
        let patterns: Result<Vec<Pattern>, _> = patterns.collect();
        let patterns = patterns.map_err(|error| bad(error.to_string(), "`*` selects all"))?;
        let limit = request.limit.unwrap_or(VALUES_DEFAULT);
        if limit > VALUES_MAX {
            let message = format!("limit: {limit} is more than {VALUES_MAX}");
            return Err(bad(
                message,
                "ask again with `after` for the values that follow",
            ));
        }
        Ok(self.history.kept().page(begin(request)?, &patterns, limit))
    }

    /// Reads what the executor has published since the last call. Run by the helper thread.
    pub fn follow_records(&self, follower: &mut RecordFollower) {
        let Ok((attached, store)) = self.attach() else {
            // Records that it sent before its death can still be read.
            return self.keep_arrived(follower, |_| None);
        };
        let executor = attached.announcement.incarnation;
        if follower.executor != executor || follower.records.is_none() {
            self.keep_arrived(follower, |_| None);
            match self.executor.subscribe_records(&attached) {
                Ok(records) => {
                    (follower.executor, follower.records) = (executor, Some(records));
                }
                Err(error) => return follower.report(&error.message),
            }
        }
        self.keep_arrived(follower, |command| store.names(command));
    }

    fn keep_arrived(&self, follower: &mut RecordFollower, names: impl Fn(u64) -> Option<Names>) {
        let Some(records) = &mut follower.records else {
            return;
        };
        loop {
            match records.read_into(&mut follower.arrived) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    follower.records = None;
                    follower.report(&error.to_string());
                    break;
                }
            }
        }
        let arrived = std::mem::take(&mut follower.arrived);
        if arrived.is_empty() {
            return;
        }
        let mut unnamed: Vec<u64> = arrived.iter().map(|record| record.command).collect();
        unnamed.sort_unstable();
        unnamed.dedup();
        {
            let mut kept = self.history.kept();
            kept.add(follower.executor, &arrived);
            unnamed.retain(|command| !kept.nets.contains_key(command));
        }
        // Files are read without the lock.
        let read = unnamed.into_iter().filter_map(|command| {
            let names = names(command)?;
            let net = MonitoredNet {
                name: names.net,
                monitors: names.monitors,
            };
            Some((command, Arc::new(net)))
        });
        let read: Vec<_> = read.collect();
        if !read.is_empty() {
            let mut kept = self.history.kept();
            kept.forget_names();
            kept.nets.extend(read);
        }
        follower.arrived = arrived;
        follower.arrived.clear();
    }
}

impl RecordFollower {
    fn report(&mut self, error: &str) {
        if self.log.admit(Instant::now()).is_some() {
            tracing::warn!("cannot keep monitored values for `GET /history`: {error}");
        }
    }
}

fn begin(request: &HistoryRequest) -> Result<AnswerStart, ApiError> {
    match (&request.after, request.seconds) {
        (Some(_), Some(_)) => Err(bad(
            "both `after` and `seconds` are given".to_owned(),
            "omit one of them",
        )),
        (Some(after), None) => {
            let position = after.split_once('-').and_then(|(executor, number)| {
                Some((
                    u64::from_str_radix(executor, 16).ok()?,
                    number.parse().ok()?,
                ))
            });
            let shown: String = after.chars().take(80).collect();
            let (executor, number) = position.ok_or_else(|| {
                bad(
                    format!("`{shown}` is not a position in the history"),
                    "give `after` the value of `next` of an earlier answer, or omit it",
                )
            })?;
            Ok(AnswerStart::After(executor, number))
        }
        (None, Some(seconds)) => match Duration::try_from_secs_f64(seconds) {
            Ok(span) => Ok(AnswerStart::Last(
                span.as_nanos().try_into().unwrap_or(u64::MAX),
            )),
            Err(_) => Err(bad(
                format!("seconds: {seconds} is not a length of time"),
                "give a number of seconds, such as 2.5",
            )),
        },
        (None, None) => Ok(AnswerStart::Newest),
    }
}

fn bad(message: String, help: &str) -> ApiError {
    ApiError::new(codes::BAD_REQUEST, message, help)
}

#[cfg(test)]
mod tests;
