//! Fair queue for work of which few pieces run at a time, such as compiling: peers are served in rotation, so that a
//! peer with many pieces hardly delays the others. Used by the serving thread.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

use super::peer::ClientPeer;

/// The queue of one kind of work.
#[derive(Debug)]
pub(super) struct FairQueue(Mutex<Rotation>);

#[derive(Debug)]
struct Rotation {
    /// Number of pieces that may start now.
    free: usize,
    /// Peers that wait, in the order of their next turns, each with its pieces in the order of arrival.
    peers: VecDeque<(ClientPeer, VecDeque<oneshot::Sender<WorkPermit>>)>,
}

/// Permit for one piece of work; when it is dropped, the next piece may start.
#[derive(Debug)]
pub(super) struct WorkPermit(Arc<FairQueue>);

impl FairQueue {
    /// Creates a queue for this many pieces at a time.
    pub fn new(at_a_time: usize) -> Arc<FairQueue> {
        Arc::new(FairQueue(Mutex::new(Rotation {
            free: at_a_time,
            peers: VecDeque::new(),
        })))
    }

    fn rotation(&self) -> MutexGuard<'_, Rotation> {
        // A panic in another thread leaves the queue intact.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for the peer's turn.
    pub async fn take(self: &Arc<FairQueue>, peer: ClientPeer) -> WorkPermit {
        let turn = {
            let mut rotation = self.rotation();
            if rotation.free > 0 {
                rotation.free -= 1;
                return WorkPermit(Arc::clone(self));
            }
            rotation.wait(peer)
        };
        match turn.await {
            Ok(turn) => turn,
            // Senders are dropped only after they have sent, and with all turns.
            Err(_) => std::future::pending().await,
        }
    }
}

impl Rotation {
    fn wait(&mut self, peer: ClientPeer) -> oneshot::Receiver<WorkPermit> {
        let (sender, turn) = oneshot::channel();
        match self.peers.iter_mut().find(|(other, _)| *other == peer) {
            Some((_, pieces)) => pieces.push_back(sender),
            None => self.peers.push_back((peer, VecDeque::from([sender]))),
        }
        turn
    }

    fn next(&mut self) -> Option<oneshot::Sender<WorkPermit>> {
        let (peer, mut pieces) = self.peers.pop_front()?;
        let next = pieces.pop_front();
        if !pieces.is_empty() {
            self.peers.push_back((peer, pieces));
        }
        next
    }
}

impl Drop for WorkPermit {
    /// Passes the turn on. A receiver that is gone drops the turn that was sent to it, which passes it on again.
    fn drop(&mut self) {
        let next = {
            let mut rotation = self.0.rotation();
            let next = rotation.next();
            rotation.free += usize::from(next.is_none());
            next
        };
        if let Some(next) = next {
            // A turn that could not be sent is dropped here.
            drop(next.send(WorkPermit(Arc::clone(&self.0))));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::pin::pin;
    use std::task::{Context, Poll, Waker};

    fn peer(pid: i32) -> ClientPeer {
        ClientPeer::Process(pid)
    }

    #[test]
    fn peers_take_turns_in_rotation_and_each_in_the_order_of_arrival() {
        let turns = FairQueue::new(1);
        let mut context = Context::from_waker(Waker::noop());
        let wishes = [1, 1, 1, 1, 2, 3, 2];
        let mut waiting: Vec<_> = wishes
            .iter()
            .enumerate()
            .map(|(number, pid)| (number, Box::pin(turns.take(peer(*pid)))))
            .collect();
        let mut order = Vec::new();
        while !waiting.is_empty() {
            let mut current = None;
            waiting.retain_mut(|(number, turn)| match turn.as_mut().poll(&mut context) {
                Poll::Ready(turn) => {
                    assert!(current.is_none(), "two turns at a time");
                    order.push(*number);
                    current = Some(turn);
                    false
                }
                Poll::Pending => true,
            });
            assert!(current.is_some(), "nobody has the turn after {order:?}");
        }
        assert_eq!(order, [0, 1, 4, 5, 2, 6, 3]);
    }

    #[test]
    fn as_many_pieces_as_there_are_turns_are_done_at_a_time() {
        let turns = FairQueue::new(2);
        let mut context = Context::from_waker(Waker::noop());
        let mut take = |pid| Box::pin(turns.take(peer(pid))).as_mut().poll(&mut context);
        let (first, second) = (take(1), take(1));
        assert!(first.is_ready() && second.is_ready() && take(2).is_pending());
        drop((first, second));
        drop(take(2));
        assert_eq!(turns.rotation().free, 2);
    }

    #[test]
    fn a_piece_that_is_given_up_passes_its_turn_on() {
        let turns = FairQueue::new(1);
        let mut context = Context::from_waker(Waker::noop());
        let Poll::Ready(first) = pin!(turns.take(peer(1))).poll(&mut context) else {
            panic!("the turn is free");
        };
        let mut gone = Box::pin(turns.take(peer(2)));
        let mut also_gone = Box::pin(turns.take(peer(2)));
        let mut last = Box::pin(turns.take(peer(3)));
        assert!(gone.as_mut().poll(&mut context).is_pending());
        assert!(also_gone.as_mut().poll(&mut context).is_pending());
        assert!(last.as_mut().poll(&mut context).is_pending());
        drop(gone);
        drop(first);
        // It has been sent its turn, but not taken it.
        drop(also_gone);
        assert!(last.as_mut().poll(&mut context).is_ready());
    }
}
