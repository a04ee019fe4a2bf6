//! Quotas of a listener: slots for connections whose head is awaited, for requests of authorized clients, and, apart
//! from both, for their CANCEL and ABORT. Used by the serving thread and by `front`.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_process::log_throttle::LogThrottle;
use tokio::sync::oneshot;

use crate::server::peer::ClientPeer;
use crate::server::request_class::RequestClass;

/// Limits of a listener or of a class of requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// Maximum number of concurrent requests.
    pub connections: usize,
    /// Maximum number of concurrent requests of one peer.
    pub connections_of_peer: usize,
    /// Number of further concurrent requests, for peers that have no other one, so that a few clients cannot keep out
    /// all others.
    pub reserve: usize,
    /// Maximum average number of requests of one peer per second.
    pub rate: u32,
    /// Maximum burst of requests of one peer after an idle time.
    pub burst: u32,
}

/// Limits of the Unix socket, where a peer is a process.
pub const UNIX: ConnectionLimits = ConnectionLimits {
    connections: 64,
    connections_of_peer: 16,
    reserve: 32,
    rate: 1000,
    burst: 2000,
};
/// Limits of TCP, where a peer is an address; they apply to requests with the right token.
pub const TCP: ConnectionLimits = ConnectionLimits {
    connections: 32,
    connections_of_peer: 8,
    reserve: 16,
    rate: 100,
    burst: 200,
};
/// Limits of CANCEL and ABORT, for each listener; they are counted separately from all other requests.
pub const STOPS: ConnectionLimits = ConnectionLimits {
    connections: 32,
    connections_of_peer: 8,
    reserve: 16,
    rate: 100,
    burst: 200,
};
/// Limits of set-point channels and of streams of values, states and events, together, for each listener; see also
/// [`crate::server::routes::CHANNELS`] and [`crate::server::routes::STREAMS`]. They hold no place of other requests.
pub const STREAMS: ConnectionLimits = ConnectionLimits {
    connections: 12,
    connections_of_peer: 6,
    reserve: 6,
    rate: 10,
    burst: 20,
};
/// Per second, and in a burst: requests of one address without the right token that get an answer; further ones are
/// closed.
pub const UNAUTHENTICATED: (u32, u32) = (5, 20);
/// Maximum number of connections of a listener whose head is awaited, including idle ones. A further one takes the slot
/// of an idle one, if there are any: of the oldest one of the peer that has the most.
pub const HEADS_MAX: usize = 192;
/// Maximum number of known peers; beyond it, peers without a pending request are forgotten.
pub(super) const PEERS_MAX: usize = 1024;

/// Concurrent requests and remaining credit of one peer (token bucket).
struct PeerQuota {
    connections: usize,
    credit: f64,
    counted: Instant,
}

struct PendingHead {
    peer: ClientPeer,
    /// True if the connection has carried a request and none of the next one.
    is_idle: bool,
    /// Dropping it ends the connection.
    _stay: oneshot::Sender<()>,
}

#[derive(Default)]
struct QuotaState {
    next: u64,
    heads: BTreeMap<u64, PendingHead>,
    usual: usize,
    stops: usize,
    streams: usize,
    peers: HashMap<(ClientPeer, RequestClass), PeerQuota>,
    refusal_log: LogThrottle,
}

/// The quotas of one listener.
pub(super) struct Quotas {
    limits: ConnectionLimits,
    inner: Mutex<QuotaState>,
}

/// Holds a slot for a connection whose head is awaited.
pub(super) struct HeadPermit {
    quotas: Arc<Quotas>,
    number: u64,
    /// Resolves when another connection takes this slot.
    pub displaced: oneshot::Receiver<()>,
}

impl Drop for HeadPermit {
    fn drop(&mut self) {
        self.quotas.inner().heads.remove(&self.number);
    }
}

/// Counts a request until it is dropped.
pub(super) struct RequestPermit {
    quotas: Arc<Quotas>,
    peer: ClientPeer,
    kind: RequestClass,
}

impl Drop for RequestPermit {
    fn drop(&mut self) {
        let mut inner = self.quotas.inner();
        match self.kind {
            RequestClass::Usual => inner.usual -= 1,
            RequestClass::Stop => inner.stops -= 1,
            RequestClass::Stream => inner.streams -= 1,
            RequestClass::Unauthenticated => {}
        }
        if let Some(quota) = inner.peers.get_mut(&(self.peer, self.kind)) {
            quota.connections -= 1;
        }
    }
}

impl Quotas {
    pub(super) fn new(limits: ConnectionLimits) -> Arc<Quotas> {
        Arc::new(Quotas {
            limits,
            inner: Mutex::default(),
        })
    }

    fn inner(&self) -> MutexGuard<'_, QuotaState> {
        // A panic in another task leaves these numbers consistent.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a slot for a connection whose head is awaited. No connection is refused: a client that sends its head at
    /// once has it read before its connection is the oldest.
    pub(super) fn await_head(self: &Arc<Quotas>, peer: ClientPeer) -> HeadPermit {
        self.await_bytes(peer, false)
    }

    /// Takes a slot for a connection that has carried a request and is kept open.
    pub(super) fn await_next(self: &Arc<Quotas>, peer: ClientPeer) -> HeadPermit {
        self.await_bytes(peer, true)
    }

    fn await_bytes(self: &Arc<Quotas>, peer: ClientPeer, is_idle: bool) -> HeadPermit {
        let mut inner = self.inner();
        if inner.heads.len() >= HEADS_MAX {
            let displaced = displaced(&inner.heads);
            inner.heads.retain(|number, _| Some(*number) != displaced);
        }
        let number = inner.next;
        inner.next += 1;
        let (_stay, displaced) = oneshot::channel();
        let head = PendingHead {
            peer,
            is_idle,
            _stay,
        };
        inner.heads.insert(number, head);
        HeadPermit {
            quotas: Arc::clone(self),
            number,
            displaced,
        }
    }

    /// Takes a slot for a request, if the limits allow it.
    pub(super) fn admit(
        self: &Arc<Quotas>,
        peer: ClientPeer,
        kind: RequestClass,
        now: Instant,
    ) -> Result<RequestPermit, ApiError> {
        let limits = match kind {
            RequestClass::Usual => self.limits,
            RequestClass::Stop => STOPS,
            RequestClass::Stream => STREAMS,
            RequestClass::Unauthenticated => ConnectionLimits {
                connections: usize::MAX,
                connections_of_peer: usize::MAX,
                reserve: 0,
                rate: UNAUTHENTICATED.0,
                burst: UNAUTHENTICATED.1,
            },
        };
        let mut inner = self.inner();
        let open = match kind {
            RequestClass::Usual => inner.usual,
            RequestClass::Stop => inner.stops,
            RequestClass::Stream => inner.streams,
            RequestClass::Unauthenticated => 0,
        };
        let ConnectionLimits {
            connections,
            connections_of_peer,
            reserve,
            rate,
            burst,
        } = limits;
        if inner.peers.len() >= PEERS_MAX {
            inner.peers.retain(|_, quota| quota.connections > 0);
        }
        let quota = inner.peers.entry((peer, kind)).or_insert(PeerQuota {
            connections: 0,
            credit: f64::from(burst),
            counted: now,
        });
        let is_free = open < connections
            || quota.connections == 0 && open < connections.saturating_add(reserve);
        if !is_free {
            return Err(too_many(format!("{open} requests are being processed")));
        }
        if quota.connections >= connections_of_peer {
            return Err(too_many(format!(
                "{connections_of_peer} requests of {peer} are being processed"
            )));
        }
        let earned = now.saturating_duration_since(quota.counted).as_secs_f64() * f64::from(rate);
        quota.credit = (quota.credit + earned).min(f64::from(burst));
        quota.counted = now;
        if quota.credit < 1.0 {
            return Err(too_many(format!(
                "{peer} sends more than {rate} requests per second"
            )));
        }
        quota.credit -= 1.0;
        quota.connections += 1;
        match kind {
            RequestClass::Usual => inner.usual += 1,
            RequestClass::Stop => inner.stops += 1,
            RequestClass::Stream => inner.streams += 1,
            RequestClass::Unauthenticated => {}
        }
        Ok(RequestPermit {
            quotas: Arc::clone(self),
            peer,
            kind,
        })
    }

    /// Returns the number of unlogged refusals if one more may be logged now.
    pub(super) fn log_refusal(&self, now: Instant) -> Option<u64> {
        self.inner().refusal_log.admit(now)
    }
}

/// Returns the number of the connection whose slot the next one takes.
fn displaced(heads: &BTreeMap<u64, PendingHead>) -> Option<u64> {
    let any_idle = heads.values().any(|head| head.is_idle);
    let eligible = || {
        let heads = heads.iter();
        heads.filter(|(_, head)| head.is_idle || !any_idle)
    };
    let mut counts: HashMap<ClientPeer, usize> = HashMap::new();
    for (_, head) in eligible() {
        *counts.entry(head.peer).or_default() += 1;
    }
    let (most, _) = counts.into_iter().max_by_key(|(_, count)| *count)?;
    let oldest = eligible().find(|(_, head)| head.peer == most);
    oldest.map(|(number, _)| *number)
}

fn too_many(what: String) -> ApiError {
    let message = format!("{what}; this one is refused");
    ApiError::new(
        codes::TOO_MANY,
        message,
        "try again in a moment, at a lower rate",
    )
}

#[cfg(test)]
mod tests;
