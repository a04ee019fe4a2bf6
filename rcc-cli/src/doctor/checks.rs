//! The checks: each is one file and two lines; pure functions of the facts, tested on good and bad facts. Run by the
//! main thread in the order of the table.

use super::HealthFinding;
use super::facts::MachineFacts;

mod cells;
mod clock;
mod core;
mod fifo;
mod interrupts;
mod isolation;
mod kernel;
mod leftovers;
mod memory_lock;
mod open_files;
mod power;
mod run_time;
mod runtime_folder;
mod session;
mod shared_memory;
mod stale_after;
mod swap;
mod throttling;
mod virtual_machine;
mod wake_up;

/// A check: a pure function of the facts.
type CheckFunction = fn(&MachineFacts) -> Vec<HealthFinding>;

/// Name and function of every check.
pub const CHECKS: &[(&str, CheckFunction)] = &[
    ("fifo", fifo::check),
    ("rttime", run_time::check),
    ("memory-lock", memory_lock::check),
    ("throttling", throttling::check),
    ("core", core::check),
    ("isolation", isolation::check),
    ("interrupts", interrupts::check),
    ("power", power::check),
    ("kernel", kernel::check),
    ("clock", clock::check),
    ("virtual-machine", virtual_machine::check),
    ("wake-up", wake_up::check),
    ("stale-after", stale_after::check),
    ("shared-memory", shared_memory::check),
    ("runtime-folder", runtime_folder::check),
    ("open-files", open_files::check),
    ("session", session::check),
    ("swap", swap::check),
    ("cells", cells::check),
    ("leftovers", leftovers::check),
];

/// Runs all checks, in the order of the table.
#[must_use]
pub fn all(facts: &MachineFacts) -> Vec<HealthFinding> {
    let named = |(name, check): &(&'static str, fn(&MachineFacts) -> Vec<HealthFinding>)| {
        let name = *name;
        check(facts).into_iter().map(move |finding| HealthFinding {
            check: name,
            ..finding
        })
    };
    CHECKS.iter().flat_map(named).collect()
}

/// Formats a number of bytes.
fn bytes(amount: u64) -> String {
    match amount {
        0..1024 => format!("{amount} bytes"),
        1024..1_048_576 => format!("{} kB", amount >> 10),
        1_048_576..10_737_418_240 => format!("{} MB", amount >> 20),
        _ => format!("{} GB", amount >> 30),
    }
}

/// Formats core numbers.
fn cores(all: &[usize]) -> String {
    let words: Vec<String> = all.iter().map(usize::to_string).collect();
    words.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use std::collections::BTreeSet;

    #[test]
    fn every_check_has_one_name() {
        let names: BTreeSet<&str> = CHECKS.iter().map(|(name, _)| *name).collect();
        assert_eq!(names.len(), CHECKS.len());
    }

    #[test]
    fn every_problem_has_a_remedy() {
        // With unknown facts: every check must handle them.
        for finding in all(&MachineFacts::default()) {
            let needs = finding.level >= FindingLevel::Warn;
            assert!(!needs || finding.fix.is_some(), "{finding:?}");
            assert!(!finding.check.is_empty() && !finding.what.is_empty());
        }
    }

    #[test]
    fn every_check_is_in_the_documents() {
        let text = include_str!("../../../docs/doctor.md");
        for (name, _) in CHECKS {
            assert!(
                text.contains(&format!("| `{name}` |")),
                "docs/doctor.md has no row for {name}"
            );
        }
    }
}
