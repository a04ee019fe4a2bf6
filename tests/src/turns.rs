//! Cells of several tests run beside each other, except those of a test that needs the machine alone. Used by the threads
//! of the test harness, each of which runs one test: the cells of a test are made by its own thread.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::ThreadId;

static TURNS: Mutex<Turns> = Mutex::new(Turns {
    beside: Vec::new(),
    alone: None,
    waiting: 0,
});
static CHANGED: Condvar = Condvar::new();

/// The tests that have cells, by their threads.
struct Turns {
    /// The thread of each permit that allows others beside it.
    beside: Vec<ThreadId>,
    /// The thread that has the machine alone.
    alone: Option<ThreadId>,
    /// Number of threads that wait for that.
    waiting: usize,
}

/// Permission to run a cell; ends when dropped.
#[derive(Debug)]
pub struct Permit(ThreadId);

/// Waits until no other test has cells, and keeps their cells waiting until the permit is dropped: for a test that loads the
/// machine, or that measures times. Taken before the first cell of a test.
#[must_use]
pub fn alone() -> Permit {
    let own = std::thread::current().id();
    let mut turns = turns();
    assert!(
        !turns.beside.contains(&own),
        "this test has a cell already: call alone() before"
    );
    turns.waiting += 1;
    let is_taken = |turns: &mut Turns| !turns.beside.is_empty() || turns.alone.is_some();
    let mut turns = CHANGED
        .wait_while(turns, is_taken)
        .unwrap_or_else(PoisonError::into_inner);
    turns.waiting -= 1;
    turns.alone = Some(own);
    Permit(own)
}

/// Waits while another test has the machine alone, or waits for it. A test that has a permit gets further ones at once.
pub(crate) fn beside() -> Permit {
    let own = std::thread::current().id();
    let must_wait = |turns: &mut Turns| {
        let has_one = turns.beside.contains(&own) || turns.alone == Some(own);
        !has_one && (turns.alone.is_some() || turns.waiting > 0)
    };
    let mut turns = CHANGED
        .wait_while(turns(), must_wait)
        .unwrap_or_else(PoisonError::into_inner);
    turns.beside.push(own);
    Permit(own)
}

impl Drop for Permit {
    fn drop(&mut self) {
        let mut turns = turns();
        match turns.beside.iter().position(|thread| *thread == self.0) {
            Some(index) => drop(turns.beside.swap_remove(index)),
            None => turns.alone = None,
        }
        CHANGED.notify_all();
    }
}

/// A test that fails with a permit leaves the turns valid.
fn turns() -> MutexGuard<'static, Turns> {
    TURNS.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::{alone, beside};

    #[test]
    fn cells_of_other_tests_wait_while_one_test_is_alone() {
        let (told, order) = channel();
        let own = alone();
        // Its own cells do not wait, and the end of one is not the end of its turn.
        drop(beside());
        let first = beside();
        let late = told.clone();
        let (asks, asked) = channel();
        let other = std::thread::spawn(move || {
            asks.send(()).expect("the test listens");
            let permits = [beside(), beside()];
            late.send("other").expect("the test listens");
            drop(permits);
        });
        asked.recv().expect("it asks");
        told.send("own").expect("it listens itself");
        drop(first);
        drop(own);
        other.join().expect("it ends");
        assert_eq!(order.try_iter().collect::<Vec<_>>(), ["own", "other"]);
    }
}
