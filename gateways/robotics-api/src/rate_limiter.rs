//! Rate limit for the requests of all clients together: the loader accepts 1000 requests per second from one process,
//! and a part of them is reserved for the engine. Shared by the threads of connections.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Mean time between two requests.
const EVERY: Duration = Duration::from_millis(2);
/// Requests that may come at once after a pause.
const BURST: u32 = 200;

/// The rate limiter.
#[derive(Debug, Default)]
pub struct RateLimiter {
    /// Time at which the next request would be due without a burst.
    next: Mutex<Option<Instant>>,
}

impl RateLimiter {
    /// Waits until a request may be sent.
    pub fn wait(&self) {
        let due = {
            let mut next = self.next.lock().unwrap_or_else(PoisonError::into_inner);
            self::due(&mut next, Instant::now())
        };
        std::thread::sleep(due);
    }
}

/// Takes the next place; returns the time until it is due.
fn due(next: &mut Option<Instant>, now: Instant) -> Duration {
    let burst = EVERY * BURST;
    let earliest = now.checked_sub(burst).unwrap_or(now);
    let place = next.map_or(earliest, |next| next.max(earliest)) + EVERY;
    *next = Some(place);
    place.saturating_duration_since(now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_passes_and_then_the_mean_rate() {
        let mut next = None;
        let now = Instant::now() + Duration::from_secs(3600);
        let waits: Vec<Duration> = (0..BURST + 100).map(|_| due(&mut next, now)).collect();
        assert!(
            waits.iter().take(BURST as usize).all(Duration::is_zero),
            "{waits:?}"
        );
        assert_eq!(waits.last(), Some(&(EVERY * 100)));
        assert_eq!(
            due(&mut next, now + Duration::from_secs(10)),
            Duration::ZERO
        );
    }
}
