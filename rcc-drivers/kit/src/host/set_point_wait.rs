//! Waits for the set-point of the present exchange while the executor's clock follows the device: the driver answers as
//! soon as it is there, and at the latest at a fixed part of the period.
//! Run by the host's thread.

use rcc_core::message::{CommandHead, MAGIC};
use rcc_os::clock::{monotonic_ns, sleep_until};

/// Part of the device's period, in thousandths, after which the driver answers in any case: the answer must reach the
/// device within its period.
const ANSWER_BY_PERMILLE: u64 = 600;
/// Polling interval of the board, ns.
const POLL_NS: u64 = 20_000;
/// Time before the expected arrival at which polling starts, ns.
const EARLY_NS: u64 = 40_000;
/// Most polls per answer.
const POLLS_MAX: usize = 64;
/// The driver does not wait for an executor that has not written for this number of periods (its own or the device's,
/// whichever is longer).
const STALE_PERIODS: u64 = 3;

/// State of the set-point for an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SetPointStatus {
    /// The newest set-point was computed from this exchange, in the cycle that began at `written_ns` (CLOCK_MONOTONIC).
    Current { written_ns: u64 },
    /// The set-point has not arrived yet.
    Pending,
    /// The set-point will not arrive in time: the executor has stopped, or its period differs.
    Unavailable,
}

impl SetPointStatus {
    /// Returns whether the newest set-point was computed from the measurement `sequence` of a device with this period.
    pub(super) fn of(
        head: &CommandHead,
        sequence: u64,
        now_ns: u64,
        period_ns: u64,
    ) -> SetPointStatus {
        let longest_ns = head.period_ns.max(period_ns);
        let stale = now_ns.abs_diff(head.stamp_ns) > STALE_PERIODS.saturating_mul(longest_ns);
        if head.magic != MAGIC || stale || head.period_ns > period_ns + period_ns / 1000 {
            return SetPointStatus::Unavailable;
        }
        if head.seen == sequence {
            SetPointStatus::Current {
                written_ns: head.stamp_ns,
            }
        } else {
            SetPointStatus::Pending
        }
    }
}

/// Estimate of when the executor's set-point arrives.
#[derive(Clone, Copy, Debug)]
pub(super) struct SetPointWait {
    /// Expected time from a packet to its set-point, from earlier exchanges, ns.
    ///
    /// Estimated from the times at which set-points were written, not from those at which they were read: otherwise a
    /// late read would raise the estimate, which delays the next read, up to the latest time of an answer.
    expected_ns: u64,
}

impl SetPointWait {
    /// Estimate for an executor whose cycles start `offset_ns` after a packet.
    pub(super) fn after(offset_ns: u64) -> SetPointWait {
        SetPointWait {
            expected_ns: offset_ns,
        }
    }

    /// Waits until `look` returns [`SetPointStatus::Current`]; returns false if the set-point is unavailable or late.
    pub(super) fn wait(
        &mut self,
        arrived_ns: u64,
        period_ns: u64,
        mut look: impl FnMut(u64) -> SetPointStatus,
    ) -> bool {
        let by_ns = arrived_ns + period_ns / 1000 * ANSWER_BY_PERMILLE;
        let mut at_ns = arrived_ns + self.expected_ns.saturating_sub(EARLY_NS);
        for _ in 0..POLLS_MAX {
            sleep_until(at_ns.min(by_ns));
            let now_ns = monotonic_ns();
            match look(now_ns) {
                SetPointStatus::Current { written_ns } => {
                    let took_ns = written_ns.saturating_sub(arrived_ns);
                    // Moving average with weight 1/8, so that one late cycle does not delay all others.
                    self.expected_ns = self.expected_ns - self.expected_ns / 8 + took_ns / 8;
                    return true;
                }
                SetPointStatus::Unavailable => return false,
                SetPointStatus::Pending if now_ns >= by_ns => return false,
                SetPointStatus::Pending => at_ns = now_ns + POLL_NS,
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;
    use rcc_core::message::CommandImage;

    use super::*;

    const MS: u64 = 1_000_000;

    fn head(seen: u64) -> CommandHead {
        let mut head = CommandImage::new(1, MS).head;
        (head.stamp_ns, head.seen) = (10 * MS, seen);
        head
    }

    #[test]
    fn only_a_set_point_computed_from_this_exchange_is_current() {
        let look = |seen| SetPointStatus::of(&head(seen), 7, 10 * MS + 100, MS);
        assert_eq!(
            [6, 7, 8].map(look),
            [
                SetPointStatus::Pending,
                SetPointStatus::Current {
                    written_ns: 10 * MS
                },
                SetPointStatus::Pending
            ]
        );
    }

    #[test]
    fn does_not_wait_for_an_executor_that_stopped_or_is_slower_than_the_device() {
        assert_eq!(
            SetPointStatus::of(&head(6), 7, 14 * MS, MS),
            SetPointStatus::Unavailable
        );
        assert_eq!(
            SetPointStatus::of(&head(6), 7, 10 * MS, MS / 2),
            SetPointStatus::Unavailable
        );
        assert_eq!(
            SetPointStatus::of(&CommandHead::zeroed(), 7, 0, MS),
            SetPointStatus::Unavailable
        );
    }

    #[test]
    fn waits_until_it_is_current_and_no_longer_than_a_part_of_the_period() {
        let mut answer = SetPointWait::after(200_000);
        let mut looks = 0;
        let found = answer.wait(monotonic_ns(), 1_000 * MS, |_| {
            looks += 1;
            if looks == 5 {
                SetPointStatus::Current {
                    written_ns: monotonic_ns(),
                }
            } else {
                SetPointStatus::Pending
            }
        });
        assert_eq!((found, looks), (true, 5));
        let long_ago_ns = monotonic_ns() - 10 * MS;
        let found = answer.wait(long_ago_ns, MS, |_| SetPointStatus::Pending);
        assert!(!found, "the time for this answer is over");
    }

    #[test]
    fn a_driver_that_looks_late_does_not_expect_the_set_points_later() {
        let mut answer = SetPointWait::after(200_000);
        for _ in 0..50 {
            // Each set-point was written 150 µs after its packet, and is found more than 400 µs after it.
            let arrived_ns = monotonic_ns() - 400_000;
            let written_ns = arrived_ns + 150_000;
            let found = answer.wait(arrived_ns, 1_000 * MS, |_| SetPointStatus::Current {
                written_ns,
            });
            assert!(found);
        }
        assert!(answer.expected_ns <= 200_000, "{} ns", answer.expected_ns);
    }
}
