//! Admission: the expected durations of nets that run in the same cycle must fit the cell's budget. Real-time thread.

use rcc_core::plan::Rate;
use rcc_protocol::control::Refusal;

use super::Engine;
use super::handover::HandoverRows;
use crate::boards::DeviceBoards;
use crate::rows::RowIndex;

impl<B: DeviceBoards> Engine<B> {
    /// Sets the budget: the time that nets may need together in one cycle, ns; 0: unlimited.
    #[must_use]
    pub fn with_budget(mut self, budget_ns: u64) -> Engine<B> {
        self.status.budget_ns = budget_ns;
        self
    }

    /// Checks that the net in `row` fits beside the running nets and those that the hand-over starts, without those that
    /// it stops. Durations of nets that are never due in the same cycle are not added; all others are, whatever their
    /// rates.
    ///
    /// Checking each net when it starts is sufficient: if a cycle exceeded the budget, the last net started in it would
    /// have been refused.
    pub(super) fn check_budget(&self, row: RowIndex, sets: HandoverRows) -> Result<(), Refusal> {
        let command = &self.commands[row];
        let (needed_ns, budget_ns) = (command.expected_ns(), self.status.budget_ns);
        let in_use_ns = RowIndex::all()
            .filter(|other| *other != row && !sets.stop.contains(*other))
            .map(|other| (sets.start.contains(other), &self.commands[other]))
            .filter(|(starts, other)| *starts || other.is_evaluated())
            .filter(|(_, other)| coincide(command.rate(), other.rate()))
            .fold(0, |sum: u64, (_, other)| {
                sum.saturating_add(other.expected_ns())
            });
        if budget_ns == 0 || needed_ns.saturating_add(in_use_ns) <= budget_ns {
            return Ok(());
        }
        Err(Refusal::Budget {
            needed_ns,
            in_use_ns,
            budget_ns,
        })
    }
}

/// Returns true if there are cycles in which both rates are due.
fn coincide(a: Rate, b: Rate) -> bool {
    let (mut common, mut rest) = (a.every.max(1), b.every.max(1));
    // Euclid's algorithm: at most 46 steps for 32 bits.
    for _ in 0..64 {
        let Some(next) = common.checked_rem(rest) else {
            break;
        };
        (common, rest) = (rest, next);
    }
    let apart = a.phase.abs_diff(b.phase);
    apart.checked_rem(common) == Some(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(every: u32, phase: u32) -> Rate {
        Rate { every, phase }
    }

    #[test]
    fn nets_meet_if_some_cycle_has_both() {
        for every in 1..=12 {
            for phase in 0..every {
                for other in 1..=12 {
                    for shift in 0..other {
                        let (a, b) = (rate(every, phase), rate(other, shift));
                        let seen = (0..1000).any(|cycle| a.is_due(cycle) && b.is_due(cycle));
                        assert_eq!(coincide(a, b), seen, "{a:?} {b:?}");
                    }
                }
            }
        }
    }
}
