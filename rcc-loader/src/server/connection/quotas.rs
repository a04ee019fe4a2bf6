//! Quotas of a listener: slots for connections whose head is awaited, for requests of authorized clients, and, apart
//! from both, for their CANCEL and ABORT. Used by the one thread that serves connections.

use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_process::log_throttle::LogThrottle;
use tokio::sync::oneshot;

/// Limits of a listener or of a class of requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// Maximum number of concurrent requests.
    pub connections: usize,
    /// Maximum number of concurrent requests of one peer.
    pub connections_of_peer: usize,
    /// Maximum average number of requests of one peer per second.
    pub rate: u32,
    /// Maximum burst of requests of one peer after an idle time.
    pub burst: u32,
}

/// Limits of the Unix socket, where a peer is a process.
pub const UNIX: ConnectionLimits = ConnectionLimits {
    connections: 64,
    connections_of_peer: 16,
    rate: 1000,
    burst: 2000,
};
/// Limits of TCP, where a peer is an address; they apply to requests with the right token.
pub const TCP: ConnectionLimits = ConnectionLimits {
    connections: 32,
    connections_of_peer: 8,
    rate: 100,
    burst: 200,
};
/// Limits of CANCEL and ABORT, for each listener; they are counted separately from all other requests.
pub const STOPS: ConnectionLimits = ConnectionLimits {
    connections: 32,
    connections_of_peer: 8,
    rate: 100,
    burst: 200,
};
/// Per second, and in a burst: requests of one address without the right token that get an answer; further ones are
/// closed.
pub const UNAUTHENTICATED: (u32, u32) = (5, 20);
/// Maximum number of connections of a listener whose head is awaited. A further one takes the slot of the oldest one of
/// the peer that has the most.
pub const HEADS_MAX: usize = 192;
/// Maximum number of known peers; beyond it, peers without a pending request are forgotten.
pub(super) const PEERS_MAX: usize = 1024;

/// The origin of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum ClientPeer {
    /// A process on the Unix socket.
    Process(i32),
    /// An address on TCP.
    Address(IpAddr),
}

impl fmt::Display for ClientPeer {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ClientPeer::Process(pid) => write!(formatter, "process {pid}"),
            ClientPeer::Address(address) => address.fmt(formatter),
        }
    }
}

/// The class that a request is counted in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum RequestClass {
    /// Any other request.
    Usual,
    /// A CANCEL or ABORT.
    Stop,
    /// A request without the right token.
    Unauthenticated,
}

/// Concurrent requests and remaining credit of one peer (token bucket).
struct PeerQuota {
    connections: usize,
    credit: f64,
    counted: Instant,
}

struct PendingHead {
    peer: ClientPeer,
    /// Dropping it ends the connection.
    _stay: oneshot::Sender<()>,
}

#[derive(Default)]
struct QuotaState {
    next: u64,
    heads: BTreeMap<u64, PendingHead>,
    usual: usize,
    stops: usize,
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
        let mut inner = self.inner();
        if inner.heads.len() >= HEADS_MAX {
            let mut counts: HashMap<ClientPeer, usize> = HashMap::new();
            for awaited in inner.heads.values() {
                *counts.entry(awaited.peer).or_default() += 1;
            }
            let most = counts.into_iter().max_by_key(|(_, count)| *count);
            let mut heads = inner.heads.iter();
            let oldest =
                heads.find(|(_, awaited)| most.is_some_and(|(peer, _)| awaited.peer == peer));
            if let Some(oldest) = oldest.map(|(number, _)| *number) {
                inner.heads.remove(&oldest);
            }
        }
        let number = inner.next;
        inner.next += 1;
        let (_stay, displaced) = oneshot::channel();
        inner.heads.insert(number, PendingHead { peer, _stay });
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
            RequestClass::Unauthenticated => ConnectionLimits {
                connections: usize::MAX,
                connections_of_peer: usize::MAX,
                rate: UNAUTHENTICATED.0,
                burst: UNAUTHENTICATED.1,
            },
        };
        let mut inner = self.inner();
        let open = match kind {
            RequestClass::Usual => inner.usual,
            RequestClass::Stop => inner.stops,
            RequestClass::Unauthenticated => 0,
        };
        let ConnectionLimits {
            connections,
            connections_of_peer,
            rate,
            burst,
        } = limits;
        if open >= connections {
            return Err(too_many(format!(
                "{connections} requests are being processed"
            )));
        }
        if inner.peers.len() >= PEERS_MAX {
            inner.peers.retain(|_, quota| quota.connections > 0);
        }
        let quota = inner.peers.entry((peer, kind)).or_insert(PeerQuota {
            connections: 0,
            credit: f64::from(burst),
            counted: now,
        });
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

fn too_many(what: String) -> ApiError {
    let message = format!("{what}; this one is refused");
    ApiError::new(
        codes::TOO_MANY,
        message,
        "try again in a moment, at a lower rate",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const LIMITS: ConnectionLimits = ConnectionLimits {
        connections: 3,
        connections_of_peer: 2,
        rate: 10,
        burst: 5,
    };

    fn usual(
        quotas: &Arc<Quotas>,
        peer: ClientPeer,
        now: Instant,
    ) -> Result<RequestPermit, ApiError> {
        quotas.admit(peer, RequestClass::Usual, now)
    }

    #[test]
    fn the_requests_of_a_peer_are_limited_and_others_keep_their_share() {
        let (listener, now) = (Quotas::new(LIMITS), Instant::now());
        let one = usual(&listener, ClientPeer::Process(1), now);
        let _two = usual(&listener, ClientPeer::Process(1), now);
        assert!(usual(&listener, ClientPeer::Process(1), now).is_err());
        let _other = usual(&listener, ClientPeer::Process(2), now);
        assert!(
            usual(&listener, ClientPeer::Process(3), now).is_err(),
            "all slots are taken"
        );
        drop(one);
        assert!(usual(&listener, ClientPeer::Process(3), now).is_ok());
    }

    #[test]
    fn a_peer_that_has_used_up_its_quota_can_still_cancel() {
        let (listener, now) = (Quotas::new(LIMITS), Instant::now());
        let peer = ClientPeer::Process(1);
        let held: Vec<_> = (0..2).map(|_| usual(&listener, peer, now)).collect();
        while usual(&listener, ClientPeer::Process(2), now).is_ok() {}
        assert!(held.iter().all(Result::is_ok) && usual(&listener, peer, now).is_err());
        let stops: Vec<_> = (0..10)
            .map(|_| listener.admit(peer, RequestClass::Stop, now))
            .collect();
        let admitted = stops.iter().filter(|stop| stop.is_ok()).count();
        assert_eq!(admitted, STOPS.connections_of_peer);
        assert!(
            listener
                .admit(ClientPeer::Process(2), RequestClass::Stop, now)
                .is_ok()
        );
    }

    #[test]
    fn the_request_rate_of_a_peer_is_limited_and_others_keep_theirs() {
        let (listener, now) = (Quotas::new(LIMITS), Instant::now());
        let peer = ClientPeer::Address(IpAddr::from([127, 0, 0, 1]));
        let admitted = |now| {
            (0..100)
                .filter(|_| usual(&listener, peer, now).is_ok())
                .count()
        };
        assert_eq!(admitted(now), 5, "the burst");
        assert_eq!(admitted(now + Duration::from_millis(200)), 2, "10 a second");
        assert!(usual(&listener, ClientPeer::Process(2), now).is_ok());
        let much_later = now + Duration::from_secs(3600);
        assert_eq!(admitted(much_later), 5, "no more than the burst");
    }

    #[test]
    fn unauthenticated_requests_take_nothing_from_token_holders_at_the_same_address() {
        let (listener, now) = (Quotas::new(LIMITS), Instant::now());
        let peer = ClientPeer::Address(IpAddr::from([127, 0, 0, 1]));
        let reported = (0..1000).filter(|_| {
            listener
                .admit(peer, RequestClass::Unauthenticated, now)
                .is_ok()
        });
        assert_eq!(reported.count(), UNAUTHENTICATED.1 as usize);
        assert!(usual(&listener, peer, now).is_ok());
    }

    #[test]
    fn peers_without_requests_are_forgotten() {
        let (listener, now) = (Quotas::new(LIMITS), Instant::now());
        let _kept = usual(&listener, ClientPeer::Process(-1), now);
        for pid in 0..3000 {
            drop(usual(&listener, ClientPeer::Process(pid), now));
        }
        let inner = listener.inner();
        assert!(inner.peers.len() <= PEERS_MAX && inner.usual == 1);
        assert!(
            inner
                .peers
                .contains_key(&(ClientPeer::Process(-1), RequestClass::Usual))
        );
    }

    #[test]
    fn one_head_too_many_displaces_the_oldest_one_of_the_peer_with_most() {
        let listener = Quotas::new(LIMITS);
        let mut quiet = listener.await_head(ClientPeer::Process(1));
        let mut held: Vec<_> = (1..HEADS_MAX)
            .map(|_| listener.await_head(ClientPeer::Process(2)))
            .collect();
        let _new = listener.await_head(ClientPeer::Process(3));
        let open = |permit: &mut HeadPermit| {
            matches!(
                permit.displaced.try_recv(),
                Err(oneshot::error::TryRecvError::Empty)
            )
        };
        assert!(open(&mut quiet) && !open(&mut held[0]) && open(&mut held[1]));
        drop(held);
        assert_eq!(listener.inner().heads.len(), 2);
    }
}
