//! Shared by all viewers: updates on their way to the pages, the newest state for pages that have just been opened, and
//! the ports that pages want to see. Used by the serving thread and by the thread that reads records.
//!
//! Updates are kept in one bounded ring for all viewers: a page that reads too slowly, or whose browser was suspended,
//! loses the oldest, is told how many, and delays nobody.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use tokio::sync::{Notify, broadcast, watch};

use super::arms::Arms;
use super::locked::locked;
use super::values::{Collector, Column};

/// Number of updates that a viewer may be behind; at 25 batches a second, about four seconds.
const BEHIND_MAX: usize = 128;
/// Maximum number of pages at a time.
pub const VIEWERS_MAX: usize = 32;
/// Maximum number of ports or patterns that a page may watch.
pub const PORTS_MAX: usize = 64;
/// Highest rate of the loader's samples, Hz.
pub const RATE_MAX: f64 = 250.0;

/// An update on its way to the pages: the name of the event and its JSON, or values.
#[derive(Clone, Debug)]
pub enum Update {
    /// The same for every page.
    Shared(&'static str, Arc<str>),
    /// Values of ports; each page gets those that it watches.
    Values(Arc<Vec<Column>>),
}

/// Ports that a page subscribes to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Watch {
    /// `net/primitive.port` or `net#id/primitive.port`; `*` and `?` as wildcards.
    pub ports: Vec<String>,
    /// Values a second and port; monitored ports have at most their own rate.
    pub rate: f64,
    /// The arms' positions too.
    pub arms: bool,
}

/// The newest state, for pages that have just been opened.
#[derive(Debug, Default)]
pub struct Newest {
    /// Executor, devices, processes.
    pub cell: Option<Arc<str>>,
    /// Row of each net, by id.
    pub nets: std::collections::BTreeMap<u64, Arc<str>>,
    /// Events, oldest first.
    pub events: std::collections::VecDeque<Arc<str>>,
}

/// The shared state.
#[derive(Debug)]
pub struct Hub {
    updates: broadcast::Sender<Update>,
    viewers: Mutex<HashMap<u64, Watch>>,
    next_viewer: AtomicU64,
    watched: watch::Sender<u64>,
    newest: Mutex<Newest>,
    /// Values that are not sent yet.
    pub collector: Collector,
    /// The arms and the ports that show their positions.
    pub arms: Mutex<Arms>,
    /// Wakes the poll of the cell's state.
    pub poll: Notify,
    /// Newest known cycle.
    pub cycle: AtomicU64,
    /// Base period, ns.
    pub period_ns: AtomicU64,
    /// The server ends.
    pub ends: AtomicBool,
}

impl Default for Hub {
    fn default() -> Hub {
        Hub {
            updates: broadcast::Sender::new(BEHIND_MAX),
            viewers: Mutex::default(),
            next_viewer: AtomicU64::new(1),
            watched: watch::Sender::new(0),
            newest: Mutex::default(),
            collector: Collector::default(),
            arms: Mutex::default(),
            poll: Notify::new(),
            cycle: AtomicU64::new(0),
            period_ns: AtomicU64::new(1_000_000),
            ends: AtomicBool::new(false),
        }
    }
}

/// A connected page; it is forgotten when this is dropped.
#[derive(Debug)]
pub struct Viewer {
    hub: Arc<Hub>,
    /// Its number.
    pub id: u64,
}

impl Drop for Viewer {
    fn drop(&mut self) {
        locked(&self.hub.viewers).remove(&self.id);
        self.hub.touch();
    }
}

impl Hub {
    /// Registers a page; `None` if there are too many.
    pub fn connect(self: &Arc<Hub>) -> Option<(Viewer, broadcast::Receiver<Update>)> {
        let mut viewers = locked(&self.viewers);
        if viewers.len() >= VIEWERS_MAX {
            return None;
        }
        // Relaxed: the numbers only need to differ.
        let id = self.next_viewer.fetch_add(1, Ordering::Relaxed);
        viewers.insert(id, Watch::default());
        drop(viewers);
        let updates = self.updates.subscribe();
        self.poll.notify_one();
        let hub = Arc::clone(self);
        Some((Viewer { hub, id }, updates))
    }

    /// Replaces what a page wants to see; false if it is not connected.
    pub fn watch(&self, viewer: u64, wanted: Watch) -> bool {
        let mut viewers = locked(&self.viewers);
        let Some(watch) = viewers.get_mut(&viewer) else {
            return false;
        };
        let changed = *watch != wanted;
        *watch = wanted;
        drop(viewers);
        if changed {
            self.touch();
        }
        true
    }

    /// Returns what a page wants to see.
    pub fn watch_of(&self, viewer: u64) -> Watch {
        locked(&self.viewers)
            .get(&viewer)
            .cloned()
            .unwrap_or_default()
    }

    /// Returns what all pages together want to see; ports in order and each once.
    pub fn wanted(&self) -> Watch {
        let viewers = locked(&self.viewers);
        let mut ports: Vec<String> = viewers
            .values()
            .flat_map(|watch| watch.ports.clone())
            .collect();
        let arms = viewers.values().any(|watch| watch.arms);
        let watching = viewers.values().filter(|watch| !watch.ports.is_empty());
        let rate = watching.map(|watch| watch.rate).fold(0.0, f64::max);
        drop(viewers);
        let mut rate = rate;
        if arms {
            let arm_ports = locked(&self.arms).patterns();
            if !arm_ports.is_empty() {
                rate = rate.max(super::arms::RATE);
            }
            ports.extend(arm_ports);
        }
        ports.sort();
        ports.dedup();
        Watch { ports, rate, arms }
    }

    /// Returns true if a page is connected.
    pub fn is_viewed(&self) -> bool {
        !locked(&self.viewers).is_empty()
    }

    /// Announces that the wanted ports may have changed.
    pub fn touch(&self) {
        self.watched.send_modify(|changes| *changes += 1);
        self.poll.notify_one();
    }

    /// Returns a receiver of the number of such changes.
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.watched.subscribe()
    }

    /// Sends an update to all pages; without pages it is lost.
    pub fn send(&self, update: Update) {
        let _ = self.updates.send(update);
    }

    /// Changes or reads the newest state.
    pub fn newest<T>(&self, change: impl FnOnce(&mut Newest) -> T) -> T {
        change(&mut locked(&self.newest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_that_reads_nothing_loses_the_oldest_updates_and_holds_nothing_else() {
        let hub = Arc::new(Hub::default());
        let Some((_viewer, mut updates)) = hub.connect() else {
            panic!("no room");
        };
        for _ in 0..1000 {
            hub.send(Update::Shared("cell", "{}".into()));
        }
        let lagged = updates.try_recv();
        let expected = 1000 - BEHIND_MAX as u64;
        assert!(
            matches!(lagged, Err(broadcast::error::TryRecvError::Lagged(lost)) if lost == expected),
            "{lagged:?}"
        );
    }

    #[test]
    fn the_number_of_pages_is_bounded_and_a_closed_one_makes_room() {
        let hub = Arc::new(Hub::default());
        let mut all: Vec<_> = (0..VIEWERS_MAX).filter_map(|_| hub.connect()).collect();
        assert_eq!(all.len(), VIEWERS_MAX);
        assert!(hub.connect().is_none());
        all.pop();
        assert!(hub.connect().is_some());
    }

    #[test]
    fn wanted_ports_are_those_of_all_pages_at_the_highest_rate() {
        let hub = Arc::new(Hub::default());
        let (Some((one, _)), Some((other, _))) = (hub.connect(), hub.connect()) else {
            panic!("no room");
        };
        let watch = |ports: &[&str], rate| Watch {
            ports: ports.iter().map(|port| (*port).to_owned()).collect(),
            rate,
            arms: false,
        };
        assert!(hub.watch(one.id, watch(&["b/x.out", "a/y.out"], 20.0)));
        assert!(hub.watch(other.id, watch(&["b/x.out"], 50.0)));
        assert_eq!(hub.wanted(), watch(&["a/y.out", "b/x.out"], 50.0));
        drop(other);
        assert_eq!(hub.wanted().rate, 20.0);
        assert!(!hub.watch(999, Watch::default()));
    }
}
