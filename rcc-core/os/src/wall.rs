//! The wall clock as numbers. It may jump and may show a time before 1970: no number here is negative and nothing
//! panics. Ages that matter are measured with the monotonic clock, not with this one.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Returns the wall-clock time since the epoch (1970-01-01 UTC); 0 while the clock shows an earlier time.
#[must_use]
pub fn since_epoch() -> Duration {
    time_of(SystemTime::now())
}

/// Returns the wall-clock time since the epoch in whole seconds; 0 while the clock shows an earlier time.
#[must_use]
pub fn seconds() -> u64 {
    since_epoch().as_secs()
}

/// Returns true while the wall clock shows a time before the epoch, which makes some libraries panic.
#[must_use]
pub fn is_before_epoch() -> bool {
    SystemTime::now() < UNIX_EPOCH
}

/// Returns the wall-clock time since `time`; `None` if `time` is in the future, so that the clock was set meanwhile.
#[must_use]
pub fn age(time: SystemTime) -> Option<Duration> {
    SystemTime::now().duration_since(time).ok()
}

fn time_of(time: SystemTime) -> Duration {
    time.duration_since(UNIX_EPOCH).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_before_1970_counts_as_1970() {
        let day = Duration::from_secs(86_400);
        assert_eq!(time_of(UNIX_EPOCH - day), Duration::ZERO);
        assert_eq!(time_of(UNIX_EPOCH + day), day);
        assert!(seconds() > 0 || SystemTime::now() <= UNIX_EPOCH + day);
    }

    #[test]
    fn a_time_in_the_future_has_no_age() {
        assert_eq!(age(SystemTime::now() + Duration::from_secs(3600)), None);
        assert!(age(UNIX_EPOCH - Duration::from_secs(1)) > age(UNIX_EPOCH));
    }
}
