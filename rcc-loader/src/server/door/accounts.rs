//! Who may use a door at a time, and how often: places for connections whose head is awaited, for requests of those who
//! may come in, and, apart from both, for their CANCEL and ABORT. Used by the one thread that serves connections.

use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use rcc_ipc::seldom::Seldom;
use tokio::sync::oneshot;

use super::super::codes;
use super::super::error::ApiError;

/// How much a door lets in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Requests at a time.
    pub connections: usize,
    /// Requests of one peer at a time.
    pub connections_of_peer: usize,
    /// Requests of one peer a second, on average.
    pub rate: u32,
    /// Requests of one peer at once, after a quiet time.
    pub burst: u32,
}

/// A peer on the Unix socket is a process.
pub const UNIX: Limits = Limits {
    connections: 64,
    connections_of_peer: 16,
    rate: 1000,
    burst: 2000,
};
/// A peer on TCP is an address; these are requests with the right token.
pub const TCP: Limits = Limits {
    connections: 32,
    connections_of_peer: 8,
    rate: 100,
    burst: 200,
};
/// CANCEL and ABORT, at each door; they count nowhere else, and nothing else counts here.
pub const STOPS: Limits = Limits {
    connections: 32,
    connections_of_peer: 8,
    rate: 100,
    burst: 200,
};
/// Requests of one address a second, and at once, that are told that their token is not right; others are only closed.
pub const STRANGERS: (u32, u32) = (5, 20);
/// Connections of a door whose head is awaited; a further one takes the place of the oldest one of the peer that has most.
pub const HEADS_MAX: usize = 192;
/// Peers that are remembered; beyond, those without a request are forgotten.
pub(super) const PEERS_MAX: usize = 1024;

/// Who comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Peer {
    /// On the Unix socket.
    Process(i32),
    /// On TCP.
    Address(IpAddr),
}

impl fmt::Display for Peer {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Peer::Process(pid) => write!(formatter, "process {pid}"),
            Peer::Address(address) => address.fmt(formatter),
        }
    }
}

/// What a request is counted as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Kind {
    /// Everything else.
    Usual,
    /// CANCEL or ABORT.
    Stop,
    /// Without the right token.
    Stranger,
}

/// Requests that a peer may still make at once.
struct Account {
    connections: usize,
    credit: f64,
    counted: Instant,
}

struct Awaited {
    peer: Peer,
    /// Dropped, the connection ends.
    _stay: oneshot::Sender<()>,
}

#[derive(Default)]
struct Inner {
    next: u64,
    heads: BTreeMap<u64, Awaited>,
    usual: usize,
    stops: usize,
    peers: HashMap<(Peer, Kind), Account>,
    complaints: Seldom,
}

/// The accounts of a door.
pub(super) struct Accounts {
    limits: Limits,
    inner: Mutex<Inner>,
}

/// A connection whose head is awaited, until this is dropped.
pub(super) struct HeadPlace {
    accounts: Arc<Accounts>,
    number: u64,
    /// Ends when another connection takes this place.
    pub displaced: oneshot::Receiver<()>,
}

impl Drop for HeadPlace {
    fn drop(&mut self) {
        self.accounts.inner().heads.remove(&self.number);
    }
}

/// A request that is counted until this is dropped.
pub(super) struct Place {
    accounts: Arc<Accounts>,
    peer: Peer,
    kind: Kind,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut inner = self.accounts.inner();
        match self.kind {
            Kind::Usual => inner.usual -= 1,
            Kind::Stop => inner.stops -= 1,
            Kind::Stranger => {}
        }
        if let Some(account) = inner.peers.get_mut(&(self.peer, self.kind)) {
            account.connections -= 1;
        }
    }
}

impl Accounts {
    pub(super) fn new(limits: Limits) -> Arc<Accounts> {
        Arc::new(Accounts {
            limits,
            inner: Mutex::default(),
        })
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        // A panic in another task leaves numbers, and those are whole.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for a connection whose head is awaited. Nobody is refused: whoever sends his head at once has it read before
    /// he is the oldest.
    pub(super) fn await_head(self: &Arc<Accounts>, peer: Peer) -> HeadPlace {
        let mut inner = self.inner();
        if inner.heads.len() >= HEADS_MAX {
            let mut counts: HashMap<Peer, usize> = HashMap::new();
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
        inner.heads.insert(number, Awaited { peer, _stay });
        HeadPlace {
            accounts: Arc::clone(self),
            number,
            displaced,
        }
    }

    /// A place for a request, if this peer has one left.
    pub(super) fn admit(
        self: &Arc<Accounts>,
        peer: Peer,
        kind: Kind,
        now: Instant,
    ) -> Result<Place, ApiError> {
        let limits = match kind {
            Kind::Usual => self.limits,
            Kind::Stop => STOPS,
            Kind::Stranger => Limits {
                connections: usize::MAX,
                connections_of_peer: usize::MAX,
                rate: STRANGERS.0,
                burst: STRANGERS.1,
            },
        };
        let mut inner = self.inner();
        let open = match kind {
            Kind::Usual => inner.usual,
            Kind::Stop => inner.stops,
            Kind::Stranger => 0,
        };
        let Limits {
            connections,
            connections_of_peer,
            rate,
            burst,
        } = limits;
        if open >= connections {
            return Err(too_many(format!("{connections} requests are under way")));
        }
        if inner.peers.len() >= PEERS_MAX {
            inner.peers.retain(|_, account| account.connections > 0);
        }
        let account = inner.peers.entry((peer, kind)).or_insert(Account {
            connections: 0,
            credit: f64::from(burst),
            counted: now,
        });
        if account.connections >= connections_of_peer {
            return Err(too_many(format!(
                "{connections_of_peer} requests of {peer} are under way"
            )));
        }
        let earned = now.saturating_duration_since(account.counted).as_secs_f64() * f64::from(rate);
        account.credit = (account.credit + earned).min(f64::from(burst));
        account.counted = now;
        if account.credit < 1.0 {
            return Err(too_many(format!(
                "{peer} asks more than {rate} times a second"
            )));
        }
        account.credit -= 1.0;
        account.connections += 1;
        match kind {
            Kind::Usual => inner.usual += 1,
            Kind::Stop => inner.stops += 1,
            Kind::Stranger => {}
        }
        Ok(Place {
            accounts: Arc::clone(self),
            peer,
            kind,
        })
    }

    /// Whether to tell of one more that is cut off: then how many were not told of.
    pub(super) fn complain(&self, now: Instant) -> Option<u64> {
        self.inner().complaints.say(now)
    }
}

fn too_many(what: String) -> ApiError {
    let message = format!("{what}, more are not taken");
    ApiError::new(
        codes::TOO_MANY,
        message,
        "try again in a moment, less often",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const LIMITS: Limits = Limits {
        connections: 3,
        connections_of_peer: 2,
        rate: 10,
        burst: 5,
    };

    fn usual(accounts: &Arc<Accounts>, peer: Peer, now: Instant) -> Result<Place, ApiError> {
        accounts.admit(peer, Kind::Usual, now)
    }

    #[test]
    fn a_peer_has_so_many_requests_and_others_still_have_theirs() {
        let (door, now) = (Accounts::new(LIMITS), Instant::now());
        let one = usual(&door, Peer::Process(1), now);
        let _two = usual(&door, Peer::Process(1), now);
        assert!(usual(&door, Peer::Process(1), now).is_err());
        let _other = usual(&door, Peer::Process(2), now);
        assert!(
            usual(&door, Peer::Process(3), now).is_err(),
            "the door is full"
        );
        drop(one);
        assert!(usual(&door, Peer::Process(3), now).is_ok());
    }

    #[test]
    fn whoever_has_used_up_everything_can_still_cancel() {
        let (door, now) = (Accounts::new(LIMITS), Instant::now());
        let peer = Peer::Process(1);
        let held: Vec<_> = (0..2).map(|_| usual(&door, peer, now)).collect();
        while usual(&door, Peer::Process(2), now).is_ok() {}
        assert!(held.iter().all(Result::is_ok) && usual(&door, peer, now).is_err());
        let stops: Vec<_> = (0..10).map(|_| door.admit(peer, Kind::Stop, now)).collect();
        let admitted = stops.iter().filter(|stop| stop.is_ok()).count();
        assert_eq!(admitted, STOPS.connections_of_peer);
        assert!(door.admit(Peer::Process(2), Kind::Stop, now).is_ok());
    }

    #[test]
    fn a_peer_makes_so_many_requests_a_second_and_others_theirs() {
        let (door, now) = (Accounts::new(LIMITS), Instant::now());
        let peer = Peer::Address(IpAddr::from([127, 0, 0, 1]));
        let admitted = |now| (0..100).filter(|_| usual(&door, peer, now).is_ok()).count();
        assert_eq!(admitted(now), 5, "the burst");
        assert_eq!(admitted(now + Duration::from_millis(200)), 2, "10 a second");
        assert!(usual(&door, Peer::Process(2), now).is_ok());
        let much_later = now + Duration::from_secs(3600);
        assert_eq!(admitted(much_later), 5, "no more than the burst");
    }

    #[test]
    fn strangers_cost_the_holders_of_their_address_nothing() {
        let (door, now) = (Accounts::new(LIMITS), Instant::now());
        let peer = Peer::Address(IpAddr::from([127, 0, 0, 1]));
        let told = (0..1000).filter(|_| door.admit(peer, Kind::Stranger, now).is_ok());
        assert_eq!(told.count(), STRANGERS.1 as usize);
        assert!(usual(&door, peer, now).is_ok());
    }

    #[test]
    fn peers_without_requests_are_forgotten() {
        let (door, now) = (Accounts::new(LIMITS), Instant::now());
        let _kept = usual(&door, Peer::Process(-1), now);
        for pid in 0..3000 {
            drop(usual(&door, Peer::Process(pid), now));
        }
        let inner = door.inner();
        assert!(inner.peers.len() <= PEERS_MAX && inner.usual == 1);
        assert!(inner.peers.contains_key(&(Peer::Process(-1), Kind::Usual)));
    }

    #[test]
    fn a_head_too_many_displaces_the_oldest_of_whoever_has_most() {
        let door = Accounts::new(LIMITS);
        let mut quiet = door.await_head(Peer::Process(1));
        let mut held: Vec<_> = (1..HEADS_MAX)
            .map(|_| door.await_head(Peer::Process(2)))
            .collect();
        let _new = door.await_head(Peer::Process(3));
        let open = |place: &mut HeadPlace| {
            matches!(
                place.displaced.try_recv(),
                Err(oneshot::error::TryRecvError::Empty)
            )
        };
        assert!(open(&mut quiet) && !open(&mut held[0]) && open(&mut held[1]));
        drop(held);
        assert_eq!(door.inner().heads.len(), 2);
    }
}
