//! Admission: nets that run together are expected to need no more of a cycle than the cell's budget. Real-time thread.

use rcc_core::message::COMMANDS_MAX;
use rcc_core::plan::Rate;
use rcc_ipc::control::Refusal;

use super::{Engine, PendingTransition, is_active};

impl Engine {
    /// The same engine with a limit to what nets may need together in one cycle, ns; 0 = none.
    #[must_use]
    pub fn with_budget(mut self, budget_ns: u64) -> Engine {
        self.status.budget_ns = budget_ns;
        self
    }

    /// The net in `row` fits beside those that run and those in `start`, when those in `leave` are gone. Bit r of both:
    /// row r. Nets of which no cycle has both do not count together; all others do, whatever their rates.
    ///
    /// This is enough: a cycle that is fuller than the budget has a net that was started last, and then it was refused.
    pub(super) fn check_budget(&self, row: usize, start: u64, leave: u64) -> Result<(), Refusal> {
        let (needed_ns, budget_ns) = (self.expected_ns(row), self.status.budget_ns);
        let in_use_ns = (0..COMMANDS_MAX)
            .filter(|other| *other != row && leave >> other & 1 == 0)
            .filter(|other| start >> other & 1 == 1 || self.is_evaluated(*other))
            .filter(|other| meet(self.rate(row), self.rate(*other)))
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

    /// It is evaluated, or will be from its first cycle on.
    fn is_evaluated(&self, row: usize) -> bool {
        let entry = self.tables.commands.get(row);
        match self.pending.get(row) {
            Some(PendingTransition::Start { .. }) => true,
            Some(PendingTransition::Nothing) => entry.is_some_and(|entry| is_active(entry.state)),
            _ => false,
        }
    }
}

/// There are cycles in which both are due.
fn meet(a: Rate, b: Rate) -> bool {
    let (mut common, mut rest) = (a.every.max(1), b.every.max(1));
    // Euclid: at most 46 steps for 32 bits.
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
                        assert_eq!(meet(a, b), seen, "{a:?} {b:?}");
                    }
                }
            }
        }
    }
}
