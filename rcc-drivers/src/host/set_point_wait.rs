//! When a driver answers its device if the executor's clock follows it: as soon as the set-point is there that was computed
//! from this exchange's measurement, and in any case in good time. Run by the host's thread.

use rcc_core::message::{CommandHead, MAGIC};
use rcc_ipc::{monotonic_ns, sleep_until};

/// The part of the device's period after which it is answered with what there is, in thousandths: an answer has to reach
/// it within its period.
const ANSWER_BY_PERMILLE: u64 = 600;
/// From one look at the board to the next, ns.
const POLL_NS: u64 = 20_000;
/// How much earlier than expected the first look is, ns.
const EARLY_NS: u64 = 40_000;
/// Most looks for one answer.
const POLLS_MAX: usize = 64;
/// An executor that has not written for so many of its periods, or of the device's, is not waited for.
const STALE_PERIODS: u64 = 3;

/// What a look at the commands says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SetPointStatus {
    /// It has seen this exchange.
    Current,
    /// It has not yet.
    Pending,
    /// It will not in time: it has stopped, or has another rhythm.
    Unavailable,
}

impl SetPointStatus {
    /// Whether the newest set-point was computed from the measurement `sequence` of a device with this period.
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
            SetPointStatus::Current
        } else {
            SetPointStatus::Pending
        }
    }
}

/// When the answers of the executor come.
#[derive(Clone, Copy, Debug)]
pub(super) struct SetPointWait {
    /// After a packet, by what has been seen so far; ns.
    expected_ns: u64,
}

impl SetPointWait {
    /// Cycles begin `offset_ns` after a packet.
    pub(super) fn after(offset_ns: u64) -> SetPointWait {
        SetPointWait {
            expected_ns: offset_ns,
        }
    }

    /// Waits until `look` says [`SetPointStatus::Current`]; false if that takes too long.
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
                SetPointStatus::Current => {
                    let took_ns = now_ns.saturating_sub(arrived_ns);
                    // An eighth of what is new: one late cycle does not make all others wait.
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
    fn only_a_set_point_that_was_computed_from_this_exchange_is_here() {
        let look = |seen| SetPointStatus::of(&head(seen), 7, 10 * MS + 100, MS);
        assert_eq!(
            [6, 7, 8].map(look),
            [
                SetPointStatus::Pending,
                SetPointStatus::Current,
                SetPointStatus::Pending
            ]
        );
    }

    #[test]
    fn nobody_waits_for_an_executor_that_stopped_or_is_slower_than_the_device() {
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
    fn waits_until_it_is_here_and_no_longer_than_a_part_of_the_period() {
        let mut answer = SetPointWait::after(200_000);
        let mut looks = 0;
        let found = answer.wait(monotonic_ns(), 1_000 * MS, |_| {
            looks += 1;
            if looks == 5 {
                SetPointStatus::Current
            } else {
                SetPointStatus::Pending
            }
        });
        assert_eq!((found, looks), (true, 5));
        let long_ago_ns = monotonic_ns() - 10 * MS;
        let found = answer.wait(long_ago_ns, MS, |_| SetPointStatus::Pending);
        assert!(!found, "the time for this answer is over");
    }
}
