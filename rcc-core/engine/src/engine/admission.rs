//! Admission: the expected durations of nets that run in the same cycle must fit the cell's budget. Real-time thread.

use rcc_core::message::COMMANDS_MAX;
use rcc_core::plan::Rate;
use rcc_protocol::control::Refusal;

use super::{Engine, PendingTransition, is_active};

impl Engine {
    /// Sets the budget: the time that nets may need together in one cycle, ns; 0: unlimited.
    #[must_use]
    pub fn with_budget(mut self, budget_ns: u64) -> Engine {
        self.status.budget_ns = budget_ns;
        self
    }

    /// Checks that the net in `row` fits beside the running nets and those in `start`, without those in `leave` (bit r:
    /// row r). Durations of nets that are never due in the same cycle are not added; all others are, whatever their
    /// rates.
    ///
    /// Checking each net when it starts is sufficient: if a cycle exceeded the budget, the last net started in it would
    /// have been refused.
    pub(super) fn check_budget(&self, row: usize, start: u64, leave: u64) -> Result<(), Refusal> {
        let (needed_ns, budget_ns) = (self.expected_ns(row), self.status.budget_ns);
        let in_use_ns = (0..COMMANDS_MAX)
            .filter(|other| *other != row && leave >> other & 1 == 0)
            .filter(|other| start >> other & 1 == 1 || self.is_evaluated(*other))
            .filter(|other| coincide(self.rate(row), self.rate(*other)))
            .fold(0, |sum: u64, other| {
                sum.saturating_add(self.expected_ns(other))
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

    fn expected_ns(&self, row: usize) -> u64 {
        let net = self.nets.get(row).and_then(Option::as_ref);
        net.map_or(0, |net| net.expected_ns)
    }

    /// Returns true if the net is evaluated, or will be from its first cycle on.
    fn is_evaluated(&self, row: usize) -> bool {
        let entry = self.tables.commands.get(row);
        match self.pending.get(row) {
            Some(PendingTransition::Start { .. }) => true,
            Some(PendingTransition::Nothing) => entry.is_some_and(|entry| is_active(entry.state)),
            _ => false,
        }
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
