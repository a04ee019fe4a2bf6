//! Requests of peers. CANCEL is always passed on; START only for a net that the cell's configuration names for the peer that
//! asks. A thread of its own calls the loader, so that Zenoh's threads never wait for it; deployments, which take longer,
//! have another one, so that no CANCEL waits for them.

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use rcc_api::bodies::{Done, StatusView};
use rcc_client::{LoaderClient, segment};
use rcc_process::helpers;
use serde_json::{Value, json};
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

use super::deployment::Deployment;
use super::{GatewayError, GatewayOptions, loader};
use crate::keys::{CellKeys, Operation, RequestKey};
use crate::named::is_asked;
use crate::rights::CellRights;
use crate::session::SessionError;

/// Requests that wait; more are refused.
const WAITING_MAX: usize = 32;
/// Texts that wait; more are refused.
const TEXTS_MAX: usize = 4;

/// The declared queryables; dropping them ends the service.
pub(super) struct Requests {
    _operations: Queryable<()>,
    _status: Queryable<()>,
    _rights: Queryable<()>,
}

/// A request of a peer to the first thread.
enum Asked {
    Start(RequestKey),
    Cancel(RequestKey),
    Status,
}

impl Requests {
    /// Answers requests until it is dropped.
    pub fn serve(
        session: &Session,
        keys: &CellKeys,
        options: &GatewayOptions,
    ) -> Result<Requests, GatewayError> {
        let (asked, waiting) = sync_channel(WAITING_MAX);
        let declared = |error: zenoh::Error| SessionError::Declare(error.to_string());
        let (sent, texts) = sync_channel(TEXTS_MAX);
        let (of_operations, own) = (asked.clone(), keys.clone());
        let operations = session.declare_queryable(keys.requests());
        let operations = operations.callback(move |query| {
            let key = own.parse_request(query.key_expr().as_str());
            let Some(key) = key.filter(|_| is_asked(&query)) else {
                return refuse(&query, "no such request: use the same build on both sides");
            };
            match key.operation {
                Operation::Start => pass(&of_operations, Asked::Start(key), query),
                Operation::Cancel => pass(&of_operations, Asked::Cancel(key), query),
                Operation::Deploy(step) => pass(&sent, (step, key), query),
            }
        });
        let operations = operations.wait().map_err(declared)?;
        let status = session.declare_queryable(keys.status());
        let status = status.callback(move |query| pass(&asked, Asked::Status, query));
        let rights = CellRights::from(&options.link);
        let (rights_key, told) = (keys.rights(), json!(rights));
        let of_rights = session.declare_queryable(rights_key.clone());
        let of_rights = of_rights.callback(move |query| reply(&query, &rights_key, &told));
        let worker = Worker {
            loader: loader(&options.cell)?,
            rights,
            status_key: keys.status(),
        };
        helpers::thread("requests", move || worker.run(&waiting))?;
        let mut deployment = Deployment::new(options);
        helpers::thread("deployment", move || {
            for ((step, key), query) in texts {
                answer(&query, deployment.answer(step, &key, &payload(&query)));
            }
        })?;
        Ok(Requests {
            _operations: operations,
            _status: status.wait().map_err(declared)?,
            _rights: of_rights.wait().map_err(declared)?,
        })
    }
}

fn pass<T>(to: &SyncSender<(T, Query)>, asked: T, query: Query) {
    let sent = to.try_send((asked, query));
    if let Err(TrySendError::Full((_, query)) | TrySendError::Disconnected((_, query))) = sent {
        refuse(&query, "too many requests wait: try again");
    }
}

fn refuse(query: &Query, words: &str) {
    let body = json!({"error": words}).to_string();
    if let Err(error) = query.reply_err(body).wait() {
        tracing::debug!(%error, "not answered");
    }
}

struct Worker {
    loader: LoaderClient,
    rights: CellRights,
    /// Under it the status is answered; a query may ask for the status of all cells.
    status_key: String,
}

impl Worker {
    fn run(&self, waiting: &Receiver<(Asked, Query)>) {
        for (asked, query) in waiting {
            match asked {
                Asked::Start(key) => answer(&query, self.start(&key)),
                Asked::Cancel(key) => answer(&query, self.operate(&key)),
                Asked::Status => match self.loader.get::<StatusView>("/status") {
                    Ok(status) => reply(&query, &self.status_key, &json!(status)),
                    Err(error) => refuse(&query, &error.to_string()),
                },
            }
        }
    }

    fn start(&self, key: &RequestKey) -> Result<Value, String> {
        let RequestKey { peer, net, .. } = key;
        let Some(words) = self.rights.refusal(peer, Operation::Start, net) else {
            return self.operate(key);
        };
        tracing::warn!(peer, net, "START is refused: not in `link: start`");
        Err(words)
    }

    fn operate(&self, key: &RequestKey) -> Result<Value, String> {
        let RequestKey {
            peer,
            operation,
            net,
        } = key;
        let path = format!("/commands/{}/{}", segment(net), operation.name());
        let done: Result<Done, _> = self.loader.post(&path, String::new());
        match done {
            Ok(done) => {
                tracing::info!(
                    peer,
                    net,
                    operation = operation.name(),
                    cycle = done.cycle,
                    "done for a peer"
                );
                Ok(json!({"net": done.net, "id": done.id, "cycle": done.cycle}))
            }
            Err(error) => Err(error.to_string()),
        }
    }
}

/// Returns what came with a query.
fn payload(query: &Query) -> Vec<u8> {
    let payload = query.payload();
    payload.map_or_else(Vec::new, |bytes| bytes.to_bytes().into_owned())
}

fn answer(query: &Query, result: Result<Value, String>) {
    match result {
        Ok(answer) => reply(query, query.key_expr().as_str(), &answer),
        Err(words) => refuse(query, &words),
    }
}

fn reply(query: &Query, key: &str, answer: &Value) {
    let replied = query.reply(key, answer.to_string()).attachment(key).wait();
    if let Err(error) = replied {
        tracing::debug!(%error, "not answered");
    }
}
