//! Requests of an operator over the link: the list of cells, their messages, and what a cell is asked for. Run by the main
//! thread of `rcc-link`.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{SyncSender, channel, sync_channel};
use std::time::{Duration, Instant};

use rcc_config::link::TlsFiles;
use serde::de::DeserializeOwned;
use serde_json::Value;
use zenoh::handlers::FifoChannelHandler;
use zenoh::query::{ConsolidationMode, Reply};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::access::Role;
use crate::keys::{CellKeys, DeployStep, Operation};
use crate::named::is_named;
use crate::overview::CellOverview;
use crate::rights::CellRights;
use crate::screen::FleetNews;
use crate::session::{self, Identity, SessionError};

/// Longest wait for a first connection.
const CONNECT_MAX: Duration = Duration::from_secs(5);
/// Longest wait for connections to the other endpoints.
const OTHERS_MAX: Duration = Duration::from_secs(1);
/// Longest wait for answers.
const ANSWER_MAX: Duration = Duration::from_secs(3);
/// Longest wait for the answer to a text that is checked.
const CHECK_MAX: Duration = Duration::from_secs(20);
/// Longest wait for a net that is loaded: longer than its gateway waits for the loader.
const LOAD_MAX: Duration = Duration::from_secs(75);

/// Messages that wait for their reader.
const MESSAGES_MAX: usize = 1024;

/// Why nothing was learnt.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// The Zenoh session cannot be opened.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// Nothing answers at the endpoints.
    #[error(
        "nothing answers at {0}: check the address, that rcc-link listens there (`link: listen`), and with TLS that both certificates \
         are of one authority"
    )]
    NoConnection(String),
    /// The network refuses a request.
    #[error("the link cannot be asked: {0}")]
    Ask(String),
    /// The other cell does not answer.
    #[error(
        "{cell} does not answer: `rcc-link cells` lists the cells that are there; with TLS it drops what its `link: start`, \
         `deploy` and `configure` do not allow this certificate"
    )]
    NoAnswer {
        /// `SITE/CELL`.
        cell: String,
    },
    /// The other cell does not answer, although it would allow what is asked.
    #[error(
        "{cell} does not answer, although it allows this to `{peer}`: with TLS it drops what comes with another certificate, or through a \
         router; otherwise it is slow, and whether it was done is not known"
    )]
    Silent {
        /// `SITE/CELL`.
        cell: String,
        /// The peer as which it was asked.
        peer: String,
    },
    /// The other cell refuses.
    #[error("{cell}: {words}")]
    Refused {
        /// `SITE/CELL`.
        cell: String,
        /// Why.
        words: String,
    },
}

/// A cell of the link.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FoundCell {
    /// Its executor is alive.
    pub is_alive: bool,
    /// Its status as `GET /status` has it; `None` if it did not answer.
    pub status: Option<Value>,
}

/// Connects to the link through the first of these routers that answers.
///
/// # Errors
/// Fails if none answers.
pub fn connect_by_router(
    routers: &[String],
    tls: Option<&TlsFiles>,
) -> Result<Session, FleetError> {
    let role = Role::Operator;
    let identity = tls.map(|files| Identity { files, role });
    let (told, opened) = sync_channel(1);
    session::open_by_router(routers, identity, move |session| {
        // Without a receiver the wait was too long.
        let _ = told.send(session);
    })?;
    match opened.recv_timeout(CONNECT_MAX) {
        Ok(session) => Ok(session?),
        Err(_) => Err(FleetError::NoConnection(routers.join(", "))),
    }
}

/// Connects to the link, and waits for the first connection, and a moment for those to the other endpoints.
///
/// # Errors
/// Fails if nothing answers at any of them.
pub fn connect(endpoints: &[String], tls: Option<&TlsFiles>) -> Result<Session, FleetError> {
    let role = Role::Operator;
    let identity = tls.map(|files| Identity { files, role });
    let session = session::open(&[], endpoints, identity)?;
    // Not the session's list of connections: one stands in it before requests are sent over it.
    let (told, connections) = channel();
    let info = session.info();
    let links = info.link_events_listener().history(true);
    let links = links.callback(move |event| {
        if event.kind() == SampleKind::Put {
            // Nobody waits for connections that are made later.
            let _ = told.send(event.link().zid().to_string());
        }
    });
    links.background().wait().map_err(not_asked)?;
    let mut connected = BTreeSet::new();
    let mut until = Instant::now() + CONNECT_MAX;
    while connected.len() < endpoints.len()
        && let Ok(peer) = connections.recv_timeout(until.saturating_duration_since(Instant::now()))
    {
        if connected.is_empty() {
            until = Instant::now() + OTHERS_MAX;
        }
        connected.insert(peer);
    }
    match (connected.len(), endpoints.len()) {
        (0, _) => return Err(FleetError::NoConnection(endpoints.join(", "))),
        (count, all) if count < all => tracing::warn!("{count} of {all} endpoints answer"),
        _ => {}
    }
    Ok(session)
}

/// Returns the cells of a site, `*` for all, by `SITE/CELL`.
///
/// # Errors
/// Fails if the network refuses the request.
pub fn cells(session: &Session, site: &str) -> Result<BTreeMap<String, FoundCell>, FleetError> {
    let all = CellKeys::new(site, "*");
    let mut found: BTreeMap<String, FoundCell> = BTreeMap::new();
    let tokens = session.liveliness().get(all.alive("*")).timeout(ANSWER_MAX);
    for reply in tokens.wait().map_err(not_asked)? {
        if let Some(cell) = reply
            .result()
            .ok()
            .and_then(|sample| cell_of(sample.key_expr().as_str()))
        {
            found.entry(cell).or_default().is_alive = true;
        }
    }
    for (cell, status) in answers(session, &all.status())? {
        found.entry(cell).or_default().status = Some(status);
    }
    Ok(found)
}

/// Returns the answers of all cells to a key that is asked for, by `SITE/CELL`.
fn answers<T: DeserializeOwned>(
    session: &Session,
    key: &str,
) -> Result<BTreeMap<String, T>, FleetError> {
    let get = session.get(key).attachment(key).timeout(ANSWER_MAX);
    let replies = get.consolidation(ConsolidationMode::None).wait();
    let replies = replies.map_err(not_asked)?;
    let answers = replies.iter().filter_map(|reply| {
        let sample = reply.result().ok().filter(|sample| is_named(sample))?;
        let cell = cell_of(sample.key_expr().as_str())?;
        let body = serde_json::from_slice(&sample.payload().to_bytes()).ok()?;
        Some((cell, body))
    });
    Ok(answers.collect())
}

/// Asks a cell, or all of a pattern, what their peers may do, by `SITE/CELL`.
///
/// # Errors
/// Fails if the network refuses the request.
pub fn rights(session: &Session, cell: &str) -> Result<BTreeMap<String, CellRights>, FleetError> {
    answers(session, &CellKeys::of(cell).rights())
}

/// A message of a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct CellMessage {
    /// `SITE/CELL`.
    pub cell: String,
    /// Kind of an event, or name of a net or topic.
    pub name: String,
    /// The message.
    pub body: Value,
}

/// Calls `each` with every message of these keys, as `rcc/SITE/CELL/KIND/NAME`, until it returns false.
///
/// # Errors
/// Fails if the network refuses the subscription, or ends it.
pub fn follow(
    session: &Session,
    keys: &[String],
    mut each: impl FnMut(CellMessage) -> bool,
) -> Result<(), FleetError> {
    let (told, messages) = sync_channel(MESSAGES_MAX);
    for key in keys {
        let told = told.clone();
        let subscriber = session.declare_subscriber(key).callback(move |sample| {
            let Some(message) = message(&sample) else {
                return;
            };
            // Zenoh's thread waits while the reader is behind; the reader that has ended needs nothing more.
            let _ = told.send(message);
        });
        subscriber.background().wait().map_err(not_asked)?;
    }
    drop(told);
    while let Ok(message) = messages.recv() {
        if !each(message) {
            return Ok(());
        }
    }
    Err(FleetError::Ask("the session has ended".to_owned()))
}

/// Sends what is learnt of the cells of a site, `*` for all: first which are there, then every change.
///
/// # Errors
/// Fails if the network refuses the subscriptions.
pub fn watch(
    session: &Session,
    site: &str,
    told: &SyncSender<FleetNews>,
) -> Result<(), FleetError> {
    let all = CellKeys::new(site, "*");
    let sender = told.clone();
    let overviews = session
        .declare_subscriber(all.overview())
        .callback(move |sample| {
            if !is_named(&sample) {
                return;
            }
            let overview = CellOverview::read(&sample.payload().to_bytes());
            let cell = cell_of(sample.key_expr().as_str());
            if let (Some(cell), Some(overview)) = (cell, overview) {
                // The next one follows in a second, whether the reader is behind or has ended.
                let _ = sender.try_send(FleetNews::Overview(cell, Box::new(overview)));
            }
        });
    overviews.background().wait().map_err(not_asked)?;
    let sender = told.clone();
    let tokens = session
        .liveliness()
        .declare_subscriber(all.alive("*"))
        .history(true);
    let tokens = tokens.callback(move |sample| {
        let key = sample.key_expr().as_str();
        let incarnation = key.rsplit('/').next().unwrap_or_default().to_owned();
        if let Some(cell) = cell_of(key) {
            let news = match sample.kind() {
                SampleKind::Put => FleetNews::Alive(cell, incarnation),
                SampleKind::Delete => FleetNews::Gone(cell, incarnation),
            };
            // Not repeated: Zenoh's thread waits for the reader; one that has ended needs nothing more.
            let _ = sender.send(news);
        }
    });
    tokens.background().wait().map_err(not_asked)
}

fn message(sample: &Sample) -> Option<CellMessage> {
    if !is_named(sample) {
        return None;
    }
    let key = sample.key_expr().as_str();
    let name = key.splitn(5, '/').nth(4)?.to_owned();
    Some(CellMessage {
        cell: cell_of(key)?,
        name,
        body: serde_json::from_slice(&sample.payload().to_bytes()).ok()?,
    })
}

/// A request of a peer to a cell.
#[derive(Clone, Copy, Debug)]
pub struct CellRequest<'a> {
    /// The peer that asks, `SITE/NAME`.
    pub peer: &'a str,
    /// The cell that is asked, `SITE/CELL`.
    pub cell: &'a str,
    /// The requested operation.
    pub operation: Operation,
    /// Name of the net, or of the cell whose configuration it is.
    pub net: &'a str,
    /// The text that a deployment sends; empty for others.
    pub text: &'a str,
}

/// The answers to a request that was sent.
pub struct PendingAnswer {
    cell: String,
    answers: FifoChannelHandler<Reply>,
}

impl CellRequest<'_> {
    /// Sends the request.
    ///
    /// # Errors
    /// Fails if the network refuses it.
    pub fn send(&self, session: &Session) -> Result<PendingAnswer, FleetError> {
        let key = CellKeys::of(self.cell).request(self.peer, self.operation, self.net);
        let limit = match self.operation {
            Operation::Start | Operation::Cancel => ANSWER_MAX,
            Operation::Deploy(DeployStep::Load) => LOAD_MAX,
            Operation::Deploy(_) => CHECK_MAX,
        };
        let get = session.get(&key).attachment(&key).timeout(limit);
        let answers = match self.text {
            "" => get.wait(),
            text => get.payload(text).wait(),
        };
        Ok(PendingAnswer {
            cell: self.cell.to_owned(),
            answers: answers.map_err(not_asked)?,
        })
    }

    /// Sends the request and returns the answer of the cell. If the request times out, asks for the rights of the peer to explain why.
    ///
    /// # Errors
    /// Fails if the cell refuses, or does not answer.
    pub fn ask(&self, session: &Session) -> Result<Value, FleetError> {
        match self.send(session)?.answer() {
            Err(FleetError::NoAnswer { cell }) => Err(self.unanswered(session, cell)),
            answer => answer,
        }
    }

    fn unanswered(&self, session: &Session, cell: String) -> FleetError {
        let rights = rights(session, self.cell).unwrap_or_default();
        let Some(rights) = rights.get(self.cell) else {
            return FleetError::NoAnswer { cell };
        };
        match rights.refusal(self.peer, self.operation, self.net) {
            Some(words) => FleetError::Refused { cell, words },
            None => FleetError::Silent {
                cell,
                peer: self.peer.to_owned(),
            },
        }
    }
}

impl PendingAnswer {
    /// Waits for the answer of the cell.
    ///
    /// # Errors
    /// Fails if the cell refuses, or does not answer.
    pub fn answer(self) -> Result<Value, FleetError> {
        let PendingAnswer { cell, answers } = self;
        let is_answer = |reply: &Reply| reply.result().map_or(true, is_named);
        let Some(reply) = answers.iter().find(is_answer) else {
            return Err(FleetError::NoAnswer { cell });
        };
        let read = |bytes: &[u8]| serde_json::from_slice(bytes).unwrap_or(Value::Null);
        match reply.result() {
            Ok(sample) => Ok(read(&sample.payload().to_bytes())),
            Err(error) => {
                let body: Value = read(&error.payload().to_bytes());
                match body["error"].as_str() {
                    Some(words) => Err(FleetError::Refused {
                        cell,
                        words: words.to_owned(),
                    }),
                    None => Err(FleetError::NoAnswer { cell }),
                }
            }
        }
    }
}

/// The network refuses a request.
fn not_asked(error: zenoh::Error) -> FleetError {
    FleetError::Ask(error.to_string())
}

/// Returns `SITE/CELL` of a key.
fn cell_of(key: &str) -> Option<String> {
    let mut parts = key.split('/').skip(1);
    Some(format!("{}/{}", parts.next()?, parts.next()?))
}
