//! Data that threads of the dashboard share, locked for a moment.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks data that no panic can leave half-written.
pub fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
