//! The gateway: reads a cell through its loader, and publishes topics, events and states of its nets. One thread looks at
//! the cell, one for every eight nets reads values, and the thread that called [`run`] publishes. Zenoh's threads pass
//! requests of other cells to two threads of their own.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use rcc_api::bodies::{CommandView, EventView};
use rcc_client::published::PublishedTopic;
use rcc_client::{LoaderClient, RequestError, StreamValues};
use rcc_config::{CellConfig, LinkConfig};
use rcc_process::helpers;
use serde_json::{Value, json};
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};

use crate::access::Role;
use crate::keys::CellKeys;
use crate::message::{TopicMessage, VERSION};
use crate::overview::CellOverview;
use crate::session::{self, Identity, SessionError};
use cycles::CycleTime;
use observer::Observer;
use requests::Requests;

mod cycles;
mod deployment;
mod observer;
mod requests;
mod values;

/// Time limit of a request to the loader.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(5);
/// News that wait for the publishing thread; what does not fit is dropped, since newer values follow.
const NEWS_MAX: usize = 1024;
/// Longest time between two looks at the stop request.
const TURN: Duration = Duration::from_millis(100);

/// Options of the gateway.
#[derive(Clone, Debug)]
pub struct GatewayOptions {
    /// Name of the cell.
    pub cell: String,
    /// Its link.
    pub link: LinkConfig,
    /// Its configuration, which has that link.
    pub config: CellConfig,
}

/// Why the gateway ends.
#[derive(Debug, thiserror::Error)]
pub enum GatewayError {
    /// The Zenoh session cannot be opened.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The system refuses a thread, or random bits.
    #[error("cannot start: {0}")]
    System(#[from] io::Error),
    /// The loader's client cannot be made.
    #[error(transparent)]
    Client(#[from] RequestError),
    /// A thread ended that must not.
    #[error("the thread that looks at the cell has ended")]
    Ended,
}

/// A message to the publishing thread.
pub(crate) enum News {
    /// Values of a net, and its topics.
    Values(Arc<Vec<PublishedTopic>>, Box<StreamValues>),
    /// Nobody publishes these topics any more.
    Gone(Vec<PublishedTopic>),
    /// The executor, and its newest cycle at a time.
    Executor(String, CycleTime),
    /// The executor or the loader does not answer.
    NoExecutor,
    /// An event.
    Event(Box<EventView>),
    /// The new state of a command.
    State(Box<CommandView>),
    /// The state of the cell.
    Overview(Box<CellOverview>),
}

/// Publishes until `stop`.
///
/// # Errors
/// Fails if the endpoints of the link cannot be opened.
pub fn run(options: &GatewayOptions, stop: &Arc<AtomicBool>) -> Result<(), GatewayError> {
    let cell = format!("{}/{}", options.link.site, options.cell);
    let keys = CellKeys::of(&cell);
    let link = &options.link;
    let (cell, rights) = (cell.as_str(), &link.rights);
    let role = Role::Gateway { cell, rights };
    let identity = link.tls.as_ref().map(|files| Identity { files, role });
    let Some(session) = opened(link, identity, stop)? else {
        return Ok(());
    };
    let requests = Requests::serve(&session, &keys, options)?;
    let (told, news) = sync_channel(NEWS_MAX);
    let observer = Observer::new(loader(&options.cell)?, options, told, Arc::clone(stop));
    helpers::thread("observer", move || observer.run())?;
    let mut publisher = LinkPublisher {
        session: session.clone(),
        keys,
        sender: new_sender()?,
        origin: Instant::now(),
        sequences: BTreeMap::new(),
        cycle: None,
        alive: None,
    };
    let result = publisher.serve(&news, stop);
    drop(publisher);
    drop(requests);
    // The process ends; an error would only say that the other side is gone.
    let _ = session.close().wait();
    result
}

/// Opens the session; `None` if the gateway is told to end before a router answers.
fn opened(
    link: &LinkConfig,
    identity: Option<Identity<'_>>,
    stop: &AtomicBool,
) -> Result<Option<Session>, GatewayError> {
    if link.router.is_empty() {
        return Ok(Some(session::open(&link.listen, &link.connect, identity)?));
    }
    let (told, opened) = sync_channel(1);
    session::open_by_router(&link.router, identity, move |session| {
        // Without a receiver the gateway has ended.
        let _ = told.send(session);
    })?;
    // Acquire pairs with the release of the thread that waits for signals.
    while !stop.load(Ordering::Acquire) {
        match opened.recv_timeout(TURN) {
            Ok(session) => return Ok(Some(session?)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Err(GatewayError::Ended),
        }
    }
    Ok(None)
}

/// Returns the name of this life of the gateway, 16 hexadecimal digits. Random: without a real-time clock, process id and time
/// may recur after a power cycle, and readers would drop all values as those of an earlier life.
fn new_sender() -> io::Result<String> {
    let mut bits = [0; 8];
    File::open("/dev/urandom")?.read_exact(&mut bits)?;
    Ok(format!("{:016x}", u64::from_ne_bytes(bits)))
}

/// Returns a client of the loader of a cell, which need not run.
pub(crate) fn loader(cell: &str) -> Result<LoaderClient, RequestError> {
    LoaderClient::local(cell, TIMEOUT)
}

struct LinkPublisher {
    session: Session,
    keys: CellKeys,
    /// This life of the gateway.
    sender: String,
    origin: Instant,
    sequences: BTreeMap<String, u64>,
    cycle: Option<CycleTime>,
    /// Incarnation of the executor, and its token.
    alive: Option<(String, LivelinessToken)>,
}

impl LinkPublisher {
    fn serve(&mut self, news: &Receiver<News>, stop: &AtomicBool) -> Result<(), GatewayError> {
        // Acquire pairs with the release of the thread that waits for signals.
        while !stop.load(Ordering::Acquire) {
            match news.recv_timeout(TURN) {
                Ok(news) => self.publish(news),
                Err(RecvTimeoutError::Timeout) => {}
                // The observer may see the stop request first.
                Err(RecvTimeoutError::Disconnected) if stop.load(Ordering::Acquire) => break,
                Err(RecvTimeoutError::Disconnected) => return Err(GatewayError::Ended),
            }
        }
        Ok(())
    }

    fn publish(&mut self, news: News) {
        match news {
            News::Values(topics, values) => self.values(&topics, &values),
            News::Gone(topics) => {
                for topic in &topics {
                    self.topic(topic, Value::Null, 0);
                }
            }
            News::Executor(incarnation, cycle) => {
                self.cycle = Some(cycle);
                self.is_alive(incarnation);
            }
            News::NoExecutor => (self.cycle, self.alive) = (None, None),
            News::Overview(overview) => self.put(&self.keys.overview(), &json!(overview)),
            News::Event(event) => self.put(&self.keys.event(&event.kind), &json!(event)),
            News::State(state) => {
                let state = *state;
                let row = json!({
                    "id": state.id, "net": state.net, "state": state.state, "reason": state.reason,
                    "outcome": state.outcome, "words": state.words, "cycles": state.cycles,
                });
                self.put(&self.keys.net(&state.net), &row);
            }
        }
    }

    fn values(&mut self, topics: &[PublishedTopic], values: &StreamValues) {
        // Without an executor the age is not known, and a value of unknown age must not leave.
        let Some(cycle) = self.cycle else { return };
        let age_ns = cycle.age_ns(values.cycle, Instant::now());
        for topic in topics.iter().filter(|topic| topic.id == values.id) {
            let port = topic.port();
            if let Some(value) = values.values.get(&port) {
                self.topic(topic, value.clone(), age_ns);
            }
        }
    }

    /// Publishes one value; drops it if the network is congested, since a newer one follows.
    fn topic(&mut self, topic: &PublishedTopic, value: Value, age_ns: u64) {
        let Some(key) = self.keys.topic(&topic.topic) else {
            return;
        };
        let sequence = self.sequences.entry(topic.topic.clone()).or_insert(0);
        *sequence += 1;
        let message = TopicMessage {
            version: VERSION,
            sender: self.sender.clone(),
            sequence: *sequence,
            sent_ns: u64::try_from(self.origin.elapsed().as_nanos()).unwrap_or(u64::MAX),
            age_ns,
            ty: topic.ty.clone(),
            unit: topic.unit.clone(),
            value,
        };
        match message.bytes() {
            Ok(bytes) => self.send(&key, bytes),
            Err(error) => tracing::warn!(topic = topic.topic, %error, "not published"),
        }
    }

    fn put(&self, key: &str, value: &Value) {
        self.send(key, value.to_string().into_bytes());
    }

    fn send(&self, key: &str, bytes: Vec<u8>) {
        let put = self.session.put(key, bytes);
        let put = put
            .attachment(key)
            .congestion_control(CongestionControl::Drop)
            .express(true);
        if let Err(error) = put.wait() {
            tracing::warn!(key, %error, "not published");
        }
    }

    /// Declares the token of this executor; that of the last one is undeclared.
    fn is_alive(&mut self, incarnation: String) {
        if self
            .alive
            .as_ref()
            .is_some_and(|(known, _)| *known == incarnation)
        {
            return;
        }
        self.alive = None;
        let token = self
            .session
            .liveliness()
            .declare_token(self.keys.alive(&incarnation));
        match token.wait() {
            Ok(token) => self.alive = Some((incarnation, token)),
            Err(error) => tracing::warn!(%error, "the liveliness of the cell cannot be declared"),
        }
    }
}

/// Sends news, unless the publishing thread is behind: then it is dropped and counted by nobody, as newer ones follow.
pub(crate) fn tell(to: &SyncSender<News>, news: News) {
    if to.try_send(news).is_err() {
        tracing::debug!("the publishing thread is behind");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both lives have this process id, and nearly the same time.
    #[test]
    fn each_life_of_the_gateway_has_another_name() {
        let lives = [(); 2].map(|()| new_sender().expect("random bits"));
        assert_ne!(lives[0], lives[1]);
        for life in lives {
            assert_eq!(life.len(), 16, "{life}");
            assert!(u64::from_str_radix(&life, 16).is_ok(), "{life}");
        }
    }
}
