//! Requests of an operator over the link: the list of cells, and START and CANCEL of their nets. Run by the main thread of
//! `rcc-link`.

use std::collections::BTreeMap;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

use rcc_config::link::TlsFiles;
use serde_json::Value;
use zenoh::query::ConsolidationMode;
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

use crate::access::Role;
use crate::keys::{CellKeys, Operation};
use crate::session::{self, Identity, SessionError};

/// Longest wait for a first connection.
const CONNECT_MAX: Duration = Duration::from_secs(5);
/// Interval at which it is looked for.
const LOOK: Duration = Duration::from_millis(20);
/// Longest wait for answers.
const ANSWER_MAX: Duration = Duration::from_secs(3);

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
        "{cell} does not answer: `rcc-link cells` lists the cells that are there; with TLS it drops START of a net that its `link: \
         start` does not give to this certificate"
    )]
    NoAnswer {
        /// `SITE/CELL`.
        cell: String,
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

/// Connects to the link, and waits for the first connection.
///
/// # Errors
/// Fails if nothing answers.
pub fn connect(endpoints: &[String], tls: Option<&TlsFiles>) -> Result<Session, FleetError> {
    let role = Role::Operator;
    let identity = tls.map(|files| Identity { files, role });
    let session = session::open(&[], endpoints, identity)?;
    let until = Instant::now() + CONNECT_MAX;
    while session.info().peers_zid().wait().next().is_none()
        && session.info().routers_zid().wait().next().is_none()
    {
        if Instant::now() > until {
            return Err(FleetError::NoConnection(endpoints.join(", ")));
        }
        // A connection has no event of its own.
        std::thread::sleep(LOOK);
    }
    Ok(session)
}

/// Returns the cells of a site, `*` for all, by `SITE/CELL`.
///
/// # Errors
/// Fails if the network refuses the request.
pub fn cells(session: &Session, site: &str) -> Result<BTreeMap<String, FoundCell>, FleetError> {
    let ask = |error: zenoh::Error| FleetError::Ask(error.to_string());
    let all = CellKeys::new(site, "*");
    let mut found: BTreeMap<String, FoundCell> = BTreeMap::new();
    let tokens = session.liveliness().get(all.alive("*")).timeout(ANSWER_MAX);
    for reply in tokens.wait().map_err(ask)? {
        if let Some(cell) = reply
            .result()
            .ok()
            .and_then(|sample| cell_of(sample.key_expr().as_str()))
        {
            found.entry(cell).or_default().is_alive = true;
        }
    }
    let answers = session
        .get(all.status())
        .timeout(ANSWER_MAX)
        .consolidation(ConsolidationMode::None);
    for reply in answers.wait().map_err(ask)? {
        let Ok(sample) = reply.result() else { continue };
        let status = serde_json::from_slice(&sample.payload().to_bytes()).ok();
        if let Some(cell) = cell_of(sample.key_expr().as_str()) {
            found.entry(cell).or_default().status = status;
        }
    }
    Ok(found)
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
    let ask = |error: zenoh::Error| FleetError::Ask(error.to_string());
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
        subscriber.background().wait().map_err(ask)?;
    }
    drop(told);
    while let Ok(message) = messages.recv() {
        if !each(message) {
            return Ok(());
        }
    }
    Err(FleetError::Ask("the session has ended".to_owned()))
}

fn message(sample: &Sample) -> Option<CellMessage> {
    let key = sample.key_expr().as_str();
    let name = key.splitn(5, '/').nth(4)?.to_owned();
    Some(CellMessage {
        cell: cell_of(key)?,
        name,
        body: serde_json::from_slice(&sample.payload().to_bytes()).ok()?,
    })
}

/// Asks a cell for START or CANCEL of a net, as `peer`; returns its answer.
///
/// # Errors
/// Fails if the cell refuses, or does not answer.
pub fn ask(
    session: &Session,
    (peer, cell): (&str, &str),
    operation: Operation,
    net: &str,
) -> Result<Value, FleetError> {
    let key = CellKeys::of(cell).request(peer, operation, net);
    let answers = session.get(key).timeout(ANSWER_MAX).wait();
    let answers = answers.map_err(|error| FleetError::Ask(error.to_string()))?;
    let cell = cell.to_owned();
    let Some(reply) = answers.iter().next() else {
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

/// Returns `SITE/CELL` of a key.
fn cell_of(key: &str) -> Option<String> {
    let mut parts = key.split('/').skip(1);
    Some(format!("{}/{}", parts.next()?, parts.next()?))
}
