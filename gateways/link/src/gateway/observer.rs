//! Looks at the cell five times a second: which topics are published, events, states of nets, and the executor's cycle; once
//! a second, and when a net or event is new, makes the overview. A
//! thread of its own; follows the cell over restarts of its processes.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};

use rcc_api::bodies::{CommandView, DeviceView, EventPage, EventView, StatusView, TopicView};
use rcc_client::published::{PublishedTopic, streams};
use rcc_client::{LoaderClient, RequestError};
use rcc_protocol::pattern::wildcard;

use super::cycles::CycleTime;
use super::values::ValueReader;
use super::{GatewayOptions, News, tell};
use crate::keys::is_topic;
use crate::overview::CellOverview;
use rcc_process::readers::Readers;

/// Time between two looks.
const EVERY: Duration = Duration::from_millis(200);
/// Events that are taken in one look.
const EVENTS_MAX: usize = 256;
/// Longest time between two overviews.
const OVERVIEW_EVERY: Duration = Duration::from_secs(1);

pub(super) struct Observer {
    client: LoaderClient,
    cell: String,
    publish: Vec<String>,
    rate_hz: f64,
    told: SyncSender<News>,
    stop: Arc<AtomicBool>,
    /// Topics of the present readers.
    topics: BTreeSet<PublishedTopic>,
    readers: Readers<ValueReader>,
    /// Position in the event log.
    after: Option<String>,
    states: BTreeMap<u64, String>,
    event: Option<EventView>,
    /// Time of the last overview, and what it said.
    overview: Option<(Instant, CellOverview)>,
    /// The last problem, so that it is logged once.
    problem: String,
}

impl Observer {
    pub fn new(
        client: LoaderClient,
        options: &GatewayOptions,
        told: SyncSender<News>,
        stop: Arc<AtomicBool>,
    ) -> Observer {
        Observer {
            client,
            cell: options.cell.clone(),
            publish: options.link.publish.clone(),
            rate_hz: options.link.rate_hz,
            told,
            stop,
            topics: BTreeSet::new(),
            readers: Readers::new("values"),
            after: None,
            states: BTreeMap::new(),
            event: None,
            overview: None,
            problem: String::new(),
        }
    }

    pub fn run(mut self) {
        // Acquire pairs with the release of the thread that waits for signals.
        while !self.stop.load(Ordering::Acquire) {
            match self.look() {
                Ok(()) => self.problem.clear(),
                Err(error) => self.lost(&error),
            }
            std::thread::sleep(EVERY);
        }
        self.end_readers();
    }

    fn look(&mut self) -> Result<(), RequestError> {
        let at = Instant::now();
        let status: StatusView = self.client.get("/status")?;
        let executor = &status.executor;
        let cycle = CycleTime {
            at,
            cycle: executor.cycle,
            period_ns: executor.period_ns,
        };
        let base_rate_hz = 1e9 / executor.period_ns.max(1) as f64;
        let incarnation = executor.incarnation.clone();
        tell(&self.told, News::Executor(incarnation, cycle));
        self.look_at_topics(base_rate_hz)?;
        let commands = self.look_at_states()?;
        self.look_at_events()?;
        let devices: Vec<DeviceView> = self.client.get("/devices")?;
        let event = self.event.as_ref();
        self.tell_overview(CellOverview::new(&status, &commands, &devices, event));
        Ok(())
    }

    /// Publishes the overview if it is new, apart from the cycle, or if the last one is a second old.
    fn tell_overview(&mut self, overview: CellOverview) {
        let is_known = |(told, last): &(Instant, CellOverview)| {
            let cycle = overview.cycle;
            let last = CellOverview {
                cycle,
                ..last.clone()
            };
            told.elapsed() < OVERVIEW_EVERY && last == overview
        };
        if !self.overview.as_ref().is_some_and(is_known) {
            tell(&self.told, News::Overview(Box::new(overview.clone())));
            self.overview = Some((Instant::now(), overview));
        }
    }

    /// The loader, or its executor, does not answer.
    fn lost(&mut self, error: &RequestError) {
        let words = error.to_string();
        if self.problem != words {
            tracing::warn!("cell `{}`: {words}", self.cell);
            self.problem.clone_from(&words);
        }
        tell(&self.told, News::NoExecutor);
        self.tell_overview(CellOverview::of_problem(&words));
        self.end_readers();
        self.states.clear();
    }

    fn end_readers(&mut self) {
        self.readers.end();
        let gone = std::mem::take(&mut self.topics);
        if !gone.is_empty() {
            tell(&self.told, News::Gone(gone.into_iter().collect()));
        }
    }

    fn look_at_topics(&mut self, base_rate_hz: f64) -> Result<(), RequestError> {
        let views: Vec<TopicView> = self.client.get("/topics")?;
        let mut published = PublishedTopic::all(&views);
        published.retain(|topic| leaves(&topic.topic, &self.publish));
        if published == self.topics {
            self.readers.restart_ended();
            return Ok(());
        }
        let names = |topics: &BTreeSet<PublishedTopic>| -> BTreeSet<String> {
            topics.iter().map(|topic| topic.topic.clone()).collect()
        };
        let now = names(&published);
        let gone = self
            .topics
            .iter()
            .filter(|topic| !now.contains(&topic.topic));
        let gone: Vec<PublishedTopic> = gone.cloned().collect();
        let topics = published.iter().map(|topic| (topic.id, topic.clone()));
        let (streams, left_out) = streams(topics);
        if left_out > 0 {
            tracing::warn!(
                "topics of {left_out} nets do not leave the cell: too many nets publish"
            );
        }
        let readers = streams.into_iter().map(|topics| ValueReader {
            cell: self.cell.clone(),
            topics: Arc::new(topics),
            rate_hz: self.rate_hz.min(base_rate_hz),
            told: self.told.clone(),
        });
        self.readers.replace(readers.collect());
        self.topics = published;
        if !gone.is_empty() {
            tell(&self.told, News::Gone(gone));
        }
        Ok(())
    }

    fn look_at_states(&mut self) -> Result<Vec<CommandView>, RequestError> {
        let commands: Vec<CommandView> = self.client.get("/commands")?;
        let mut states = BTreeMap::new();
        // A text that is being loaded may have no name yet, and so no key.
        for command in commands.iter().filter(|command| !command.net.is_empty()) {
            let state = command.state.clone();
            if self.states.get(&command.id) != Some(&state) {
                tell(&self.told, News::State(Box::new(command.clone())));
            }
            states.insert(command.id, state);
        }
        self.states = states;
        Ok(commands)
    }

    /// Passes on the events since the last look; at the first one only its position and the newest event are taken.
    fn look_at_events(&mut self) -> Result<(), RequestError> {
        let path = match &self.after {
            None => "/events?limit=1".to_owned(),
            Some(after) => format!("/events?after={after}&limit={EVENTS_MAX}"),
        };
        let mut page: EventPage = self.client.get(&path)?;
        self.event = page.events.last().cloned().or(self.event.take());
        if self.after.is_none() {
            page.events.clear();
        }
        for event in page.events {
            tell(&self.told, News::Event(Box::new(event)));
        }
        self.after = Some(page.next);
        Ok(())
    }
}

/// Returns true for a topic that matches a pattern and can be a key.
fn leaves(topic: &str, patterns: &[String]) -> bool {
    is_topic(topic) && patterns.iter().any(|pattern| wildcard(pattern, topic))
}
