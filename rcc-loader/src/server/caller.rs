//! Who waits for a request: until when, and whether still. What a client gave up is not begun any more, because it has
//! told its user that it was not done; CANCEL and ABORT are the exception, see [`super::executor`].
//! Made by the thread that serves connections, asked by blocking threads just before the executor is.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::codes;
use super::error::ApiError;

/// The line of a request's head that says how long its client waits, in milliseconds.
pub const TIMEOUT_HEADER: &str = "rcc-timeout-ms";

/// Somebody who waits for an answer.
#[derive(Clone, Debug, Default)]
pub struct Caller {
    deadline: Option<Instant>,
    gone: Arc<AtomicBool>,
}

impl Caller {
    /// Waits until then, or as long as it takes.
    #[must_use]
    pub fn until(deadline: Option<Instant>) -> Caller {
        Caller {
            deadline,
            gone: Arc::default(),
        }
    }

    /// Keep it as long as the client's connection is open; dropped, the caller is gone.
    #[must_use]
    pub fn guard(&self) -> CallerGuard {
        CallerGuard(Arc::clone(&self.gone))
    }

    /// How long the executor may be waited for at most.
    ///
    /// # Errors
    /// Nobody waits any more.
    pub fn remaining_time(&self, most: Duration) -> Result<Duration, ApiError> {
        let left = self.deadline.map_or(most, |deadline| {
            deadline.saturating_duration_since(Instant::now())
        });
        // Pairs with `CallerGuard::drop`; only the flag itself is told.
        if left.is_zero() || self.gone.load(Ordering::Relaxed) {
            return Err(ApiError::new(
                codes::GIVEN_UP,
                "the client stopped waiting before this was begun, so it is not done",
                "ask again, with more time: `--timeout`",
            ));
        }
        Ok(left.min(most))
    }
}

/// The connection of a caller.
#[derive(Debug)]
pub struct CallerGuard(Arc<AtomicBool>);

impl Drop for CallerGuard {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOST: Duration = Duration::from_secs(5);

    #[test]
    fn a_caller_whose_time_is_over_or_who_is_gone_waits_no_more() {
        assert_eq!(Caller::default().remaining_time(MOST), Ok(MOST));
        let soon = Caller::until(Some(Instant::now() + Duration::from_secs(2)));
        assert!(soon.remaining_time(MOST).is_ok_and(|left| left < MOST));
        let over = Caller::until(Some(Instant::now()));
        assert_eq!(
            over.remaining_time(MOST).map_err(|error| error.code),
            Err(codes::GIVEN_UP)
        );
        let caller = Caller::default();
        drop(caller.guard());
        assert!(caller.remaining_time(MOST).is_err());
    }
}
