//! The checks: each is a function in the file of its topic, and a row of the table; pure functions of the facts, tested
//! on good and bad facts. Run by the main thread in the order of the table.

use super::HealthFinding;
use super::facts::MachineFacts;

mod cells;
mod cpu;
mod kernel;
mod latency;
mod link;
mod memory;
mod real_time;

/// A check: a pure function of the facts.
type CheckFunction = fn(&MachineFacts) -> Vec<HealthFinding>;

/// Name and function of every check.
pub const CHECKS: &[(&str, CheckFunction)] = &[
    ("fifo", real_time::fifo),
    ("rttime", real_time::run_time),
    ("memory-lock", memory::memory_lock),
    ("throttling", real_time::throttling),
    ("core", cpu::core),
    ("isolation", cpu::isolation),
    ("interrupts", cpu::interrupts),
    ("power", cpu::power),
    ("kernel", kernel::kernel),
    ("clock", kernel::clock),
    ("virtual-machine", kernel::virtual_machine),
    ("wake-up", latency::wake_up),
    ("stale-after", latency::stale_after),
    ("shared-memory", memory::shared_memory),
    ("runtime-folder", cells::runtime_folder),
    ("open-files", cells::open_files),
    ("session", memory::session),
    ("swap", memory::swap),
    ("cells", cells::cells),
    ("leftovers", cells::leftovers),
    ("link", link::link),
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
    let numbers: Vec<String> = all.iter().map(usize::to_string).collect();
    numbers.join(", ")
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
