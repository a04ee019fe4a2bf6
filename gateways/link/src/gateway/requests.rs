//! START and CANCEL of other cells. CANCEL is always passed on; START only for a net that the cell's configuration names for
//! the cell that asks. A thread of its own calls the loader, so that Zenoh's threads never wait for it.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use rcc_api::bodies::{Done, StatusView};
use rcc_client::{LoaderClient, segment};
use rcc_process::helpers;
use serde_json::{Value, json};
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

use super::{GatewayError, GatewayOptions, loader};
use crate::keys::{CellKeys, Operation, RequestKey};
use crate::session::SessionError;

/// Requests that wait; more are refused.
const WAITING_MAX: usize = 32;

/// The declared queryables; dropping them ends the service.
pub(super) struct Requests {
    _operations: Queryable<()>,
    _status: Queryable<()>,
}

/// A request of a peer.
enum Asked {
    Operation(RequestKey, Query),
    Status(Query),
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
        let (of_operations, own) = (asked.clone(), keys.clone());
        let operations =
            session
                .declare_queryable(keys.requests())
                .callback(
                    move |query| match own.parse_request(query.key_expr().as_str()) {
                        Some(key) => pass(&of_operations, Asked::Operation(key, query)),
                        None => refuse(&query, "no such request: RCC knows `start` and `cancel`"),
                    },
                );
        let operations = operations.wait().map_err(declared)?;
        let status = session.declare_queryable(keys.status());
        let status = status.callback(move |query| pass(&asked, Asked::Status(query)));
        let worker = Worker {
            loader: loader(&options.cell)?,
            start: options.link.start.clone(),
            status_key: keys.status(),
        };
        helpers::thread("requests", move || worker.run(&waiting))?;
        Ok(Requests {
            _operations: operations,
            _status: status.wait().map_err(declared)?,
        })
    }
}

fn pass(to: &SyncSender<Asked>, asked: Asked) {
    if let Err(TrySendError::Full(asked) | TrySendError::Disconnected(asked)) = to.try_send(asked) {
        let (Asked::Operation(_, query) | Asked::Status(query)) = asked;
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
    start: BTreeMap<String, Vec<String>>,
    /// Under it the status is answered; a query may ask for the status of all cells.
    status_key: String,
}

impl Worker {
    fn run(&self, waiting: &Receiver<Asked>) {
        for asked in waiting {
            match asked {
                Asked::Operation(key, query) => match self.operate(&key) {
                    Ok(answer) => reply(&query, query.key_expr().as_str(), &answer),
                    Err(words) => refuse(&query, &words),
                },
                Asked::Status(query) => match self.loader.get::<StatusView>("/status") {
                    Ok(status) => reply(&query, &self.status_key, &json!(status)),
                    Err(error) => refuse(&query, &error.to_string()),
                },
            }
        }
    }

    fn operate(&self, key: &RequestKey) -> Result<Value, String> {
        let RequestKey {
            peer,
            operation,
            net,
        } = key;
        if *operation == Operation::Start && !self.may_start(peer, net) {
            tracing::warn!(peer, net, "START is refused: not in `link: start`");
            return Err(format!(
                "{peer} must not start `{net}`: the cell's configuration allows it by `link: {{start: {{{peer}: [{net}]}}}}`"
            ));
        }
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

    fn may_start(&self, peer: &str, net: &str) -> bool {
        self.start
            .get(peer)
            .is_some_and(|nets| nets.iter().any(|name| name == net))
    }
}

fn reply(query: &Query, key: &str, answer: &Value) {
    let replied = query.reply(key, answer.to_string()).wait();
    if let Err(error) = replied {
        tracing::debug!(%error, "not answered");
    }
}
