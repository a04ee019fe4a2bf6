//! Connections to other ports that could not be established, and when to try again. iceoryx2 tries once for each change in
//! the list of ports: without this, a moment without memory or file descriptors would cut off a living process for good.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use iceoryx2::port::{DegradationAction, DegradationCause, DegradationInfo};

/// Minimum time between two attempts. A peer that died half-way fails each of them until it is cleaned up.
const RETRY_EVERY: Duration = Duration::from_millis(100);

/// The failed connections of one port.
#[derive(Debug, Default)]
pub(crate) struct FailedConnections {
    is_one: Arc<AtomicBool>,
    tried: Mutex<Option<Instant>>,
}

impl FailedConnections {
    /// Returns the handler for a port's builder. A failed connection cuts off no other one.
    pub fn handler(
        &self,
    ) -> impl Fn(DegradationCause, &DegradationInfo) -> DegradationAction + Send + 'static {
        let is_one = Arc::clone(&self.is_one);
        move |_, _| {
            // Relaxed: a flag; nothing else is passed with it.
            is_one.store(true, Ordering::Relaxed);
            DegradationAction::Ignore
        }
    }

    /// Returns true if a connection has failed since the last attempt, and the next attempt is due.
    pub fn take_due(&self) -> bool {
        if !self.is_one.load(Ordering::Relaxed) {
            return false;
        }
        let mut tried = self.tried.lock().unwrap_or_else(PoisonError::into_inner);
        if tried.is_some_and(|tried| tried.elapsed() < RETRY_EVERY) {
            return false;
        }
        *tried = Some(Instant::now());
        self.is_one.store(false, Ordering::Relaxed);
        true
    }
}
