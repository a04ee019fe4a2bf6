//! Tests of the quotas. Run by the test harness.

use super::*;
use std::net::IpAddr;
use std::time::Duration;

const LIMITS: ConnectionLimits = ConnectionLimits {
    connections: 3,
    connections_of_peer: 2,
    reserve: 1,
    rate: 10,
    burst: 5,
};

fn usual(quotas: &Arc<Quotas>, peer: ClientPeer, now: Instant) -> Result<RequestPermit, ApiError> {
    quotas.admit(peer, RequestClass::Usual, now)
}

#[test]
fn the_requests_of_a_peer_are_limited_and_others_keep_their_share() {
    let (listener, now) = (Quotas::new(LIMITS), Instant::now());
    let one = usual(&listener, ClientPeer::Process(1), now);
    let _two = usual(&listener, ClientPeer::Process(1), now);
    assert!(usual(&listener, ClientPeer::Process(1), now).is_err());
    let other = usual(&listener, ClientPeer::Process(2), now);
    assert!(
        usual(&listener, ClientPeer::Process(2), now).is_err(),
        "all slots are taken"
    );
    drop((one, other));
    assert!(usual(&listener, ClientPeer::Process(3), now).is_ok());
}

#[test]
fn a_peer_without_requests_is_served_when_a_few_others_have_taken_all_places() {
    let (listener, now) = (Quotas::new(LIMITS), Instant::now());
    let flood = [1, 1, 2].map(|pid| usual(&listener, ClientPeer::Process(pid), now));
    assert!(flood.iter().all(Result::is_ok));
    assert!(usual(&listener, ClientPeer::Process(2), now).is_err());
    let first = usual(&listener, ClientPeer::Process(3), now);
    assert!(first.is_ok());
    assert!(
        usual(&listener, ClientPeer::Process(3), now).is_err(),
        "only its first request takes a place of the reserve"
    );
    assert!(
        usual(&listener, ClientPeer::Process(4), now).is_err(),
        "the reserve is limited"
    );
}

#[test]
fn a_peer_that_has_used_up_its_quota_can_still_cancel() {
    let (listener, now) = (Quotas::new(LIMITS), Instant::now());
    let peer = ClientPeer::Process(1);
    let held: Vec<_> = (0..2).map(|_| usual(&listener, peer, now)).collect();
    let more: Vec<_> = (2..9)
        .map(|pid| usual(&listener, ClientPeer::Process(pid), now))
        .collect();
    assert_eq!(more.iter().filter(|one| one.is_ok()).count(), 2);
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

#[test]
fn an_idle_connection_gives_way_before_any_that_sends_a_head() {
    let listener = Quotas::new(LIMITS);
    let mut idle = listener.await_next(ClientPeer::Process(1));
    let mut heads: Vec<_> = (1..HEADS_MAX)
        .map(|_| listener.await_head(ClientPeer::Process(2)))
        .collect();
    let _new = listener.await_head(ClientPeer::Process(3));
    assert!(matches!(
        idle.displaced.try_recv(),
        Err(oneshot::error::TryRecvError::Closed)
    ));
    let is_open = |permit: &mut HeadPermit| {
        matches!(
            permit.displaced.try_recv(),
            Err(oneshot::error::TryRecvError::Empty)
        )
    };
    assert!(heads.iter_mut().all(is_open));
}

#[test]
fn streams_take_no_place_of_other_requests() {
    let (listener, now) = (Quotas::new(LIMITS), Instant::now());
    let peer = ClientPeer::Process(1);
    let streams: Vec<_> = (0..20)
        .map(|_| listener.admit(peer, RequestClass::Stream, now))
        .collect();
    let admitted = streams.iter().filter(|stream| stream.is_ok()).count();
    assert_eq!(admitted, STREAMS.connections_of_peer);
    assert!(usual(&listener, peer, now).is_ok());
}
