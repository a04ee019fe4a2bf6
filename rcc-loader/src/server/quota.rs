//! Quotas of a limited resource, such as concurrent loads or memory for texts: no peer can use all of it, and a reserve
//! is kept for peers that use little. Used by the serving thread and, when shares end, by blocking threads.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::peer::ClientPeer;

/// Limits of a resource: in total, per peer, and the reserve; in pieces or bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QuotaLimits {
    /// All together, without the reserve.
    pub all: usize,
    /// Of one peer.
    pub of_peer: usize,
    /// For peers that use at most `small`, beyond what all others use.
    pub reserve: usize,
    /// Greatest use by a peer that takes from the reserve.
    pub small: usize,
}

impl QuotaLimits {
    /// Everything that may be in use at a time.
    #[must_use]
    pub const fn most(self) -> usize {
        self.all + self.reserve
    }
}

/// Use of a limited resource.
#[derive(Debug)]
pub struct Quota {
    limits: QuotaLimits,
    used: Mutex<Used>,
}

#[derive(Debug, Default)]
struct Used {
    all: usize,
    of_peers: HashMap<ClientPeer, usize>,
}

impl Quota {
    /// Creates shares of which none is taken.
    #[must_use]
    pub fn new(limits: QuotaLimits) -> Arc<Quota> {
        Arc::new(Quota {
            limits,
            used: Mutex::default(),
        })
    }

    /// Returns the limits.
    #[must_use]
    pub fn limits(&self) -> QuotaLimits {
        self.limits
    }

    /// Takes a share for a peer; `None` if too much is used.
    #[must_use]
    pub fn take(self: &Arc<Quota>, peer: ClientPeer, amount: usize) -> Option<QuotaPermit> {
        let mut share = QuotaPermit {
            shares: Arc::clone(self),
            peer,
            amount: 0,
        };
        share.grow(amount).then_some(share)
    }

    fn used(&self) -> MutexGuard<'_, Used> {
        // A panic in another thread leaves these numbers consistent.
        self.used.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A share, until it is dropped.
#[derive(Debug)]
pub struct QuotaPermit {
    shares: Arc<Quota>,
    peer: ClientPeer,
    amount: usize,
}

impl QuotaPermit {
    /// Takes more; returns false, and takes nothing, if too much is used.
    #[must_use]
    pub fn grow(&mut self, more: usize) -> bool {
        let limits = self.shares.limits;
        let mut used = self.shares.used();
        let of_peer = used.of_peers.get(&self.peer).copied().unwrap_or(0) + more;
        let all = used.all + more;
        let is_free = all <= limits.all || of_peer <= limits.small && all <= limits.most();
        if of_peer > limits.of_peer || !is_free {
            return false;
        }
        used.all = all;
        used.of_peers.insert(self.peer, of_peer);
        self.amount += more;
        true
    }

    /// Returns its size.
    #[must_use]
    pub fn amount(&self) -> usize {
        self.amount
    }
}

impl Drop for QuotaPermit {
    fn drop(&mut self) {
        let mut used = self.shares.used();
        used.all -= self.amount;
        let of_peer = used.of_peers.get(&self.peer).copied().unwrap_or(0);
        match of_peer - self.amount {
            0 => used.of_peers.remove(&self.peer),
            left => used.of_peers.insert(self.peer, left),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: QuotaLimits = QuotaLimits {
        all: 10,
        of_peer: 6,
        reserve: 4,
        small: 2,
    };

    fn peer(pid: i32) -> ClientPeer {
        ClientPeer::Process(pid)
    }

    #[test]
    fn no_peer_takes_everything_and_others_get_their_share() {
        let shares = Quota::new(LIMITS);
        let held: Vec<_> = (0..10).map_while(|_| shares.take(peer(1), 1)).collect();
        assert_eq!(held.len(), LIMITS.of_peer);
        assert!(
            shares
                .take(peer(2), 4)
                .is_some_and(|share| share.amount() == 4)
        );
        drop(held);
        assert!(shares.take(peer(1), 6).is_some());
        assert!(shares.used().of_peers.is_empty() && shares.used().all == 0);
    }

    #[test]
    fn a_peer_that_uses_little_is_served_when_others_have_taken_the_rest() {
        let shares = Quota::new(LIMITS);
        let _flood = (shares.take(peer(1), 6), shares.take(peer(2), 4));
        assert!(shares.take(peer(2), 1).is_none() && shares.take(peer(3), 3).is_none());
        let mut small = shares.take(peer(3), 1).expect("a share of the reserve");
        assert!(small.grow(1) && !small.grow(1));
        assert!(shares.take(peer(4), 2).is_some());
    }

    #[test]
    fn the_reserve_is_limited_too() {
        let shares = Quota::new(LIMITS);
        let _flood = (shares.take(peer(1), 6), shares.take(peer(2), 4));
        let held: Vec<_> = (3..100)
            .map_while(|pid| shares.take(peer(pid), 1))
            .collect();
        assert_eq!(held.len(), LIMITS.reserve);
    }
}
