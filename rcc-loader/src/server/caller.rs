//! The client that waits for a request: its deadline, and whether it is still connected. Work that a client has given
//! up is not started, because the client has told its user that it was not done; CANCEL and ABORT are the exception,
//! see [`super::executor`]. Created by the thread that serves connections, checked by blocking threads just before they
//! call the executor.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rcc_api::codes;
use rcc_api::error::ApiError;

/// A client that waits for an answer.
#[derive(Clone, Debug, Default)]
pub struct Caller {
    deadline: Option<Instant>,
    gone: Arc<AtomicBool>,
}

impl Caller {
    /// Creates a caller that waits until `deadline`, or indefinitely.
    #[must_use]
    pub fn until(deadline: Option<Instant>) -> Caller {
        Caller {
            deadline,
            gone: Arc::default(),
        }
    }

    /// Returns a guard to be kept while the client's connection is open; dropping it marks the caller as gone.
    #[must_use]
    pub fn guard(&self) -> CallerGuard {
        CallerGuard(Arc::clone(&self.gone))
    }

    /// Returns the time for which the executor may be waited for: the time left, at most `most`.
    ///
    /// # Errors
    /// Returns [`codes::GIVEN_UP`] if the client is gone or its deadline has passed.
    pub fn remaining_time(&self, most: Duration) -> Result<Duration, ApiError> {
        let left = self.deadline.map_or(most, |deadline| {
            deadline.saturating_duration_since(Instant::now())
        });
        // Pairs with `CallerGuard::drop`. Relaxed, because only the flag itself is communicated.
        if left.is_zero() || self.gone.load(Ordering::Relaxed) {
            return Err(ApiError::new(
                codes::GIVEN_UP,
                "the client stopped waiting before the request was started, so nothing was done",
                "try again with more time: `--timeout`",
            ));
        }
        Ok(left.min(most))
    }
}

/// Represents the open connection of a caller.
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
    fn an_expired_or_disconnected_caller_does_not_wait() {
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
