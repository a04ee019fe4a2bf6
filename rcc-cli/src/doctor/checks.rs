//! The checks: one file and one line each; pure functions of the facts, each with tests on good and bad ones.
//! Run by the main thread, in this order.

use super::Finding;
use super::facts::Facts;

macro_rules! checks {
    ($($(#[doc = $doc:literal])* $module:ident = $name:literal;)*) => {
        $(mod $module;)*

        /// Name and function of every check.
        pub const CHECKS: &[(&str, fn(&Facts) -> Vec<Finding>)] = &[$(($name, $module::check)),*];
    };
}

checks! {
    fifo = "fifo";
    run_time = "rttime";
    memory_lock = "memory-lock";
    throttling = "throttling";
    core = "core";
    isolation = "isolation";
    interrupts = "interrupts";
    power = "power";
    kernel = "kernel";
    clock = "clock";
    virtual_machine = "virtual-machine";
    wake_up = "wake-up";
    stale_after = "stale-after";
    shared_memory = "shared-memory";
    runtime_folder = "runtime-folder";
    open_files = "open-files";
    session = "session";
    swap = "swap";
    cells = "cells";
    leftovers = "leftovers";
}

/// All findings, in the order of the table.
#[must_use]
pub fn all(facts: &Facts) -> Vec<Finding> {
    let named = |(name, check): &(&'static str, fn(&Facts) -> Vec<Finding>)| {
        let name = *name;
        check(facts).into_iter().map(move |finding| Finding {
            check: name,
            ..finding
        })
    };
    CHECKS.iter().flat_map(named).collect()
}

/// Bytes for people.
fn bytes(amount: u64) -> String {
    match amount {
        0..1024 => format!("{amount} bytes"),
        1024..1_048_576 => format!("{} kB", amount >> 10),
        1_048_576..10_737_418_240 => format!("{} MB", amount >> 20),
        _ => format!("{} GB", amount >> 30),
    }
}

/// Core numbers for people.
fn cores(all: &[usize]) -> String {
    let words: Vec<String> = all.iter().map(usize::to_string).collect();
    words.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::Level;
    use std::collections::BTreeSet;

    #[test]
    fn every_check_has_one_name() {
        let names: BTreeSet<&str> = CHECKS.iter().map(|(name, _)| *name).collect();
        assert_eq!(names.len(), CHECKS.len());
    }

    #[test]
    fn whatever_is_wrong_says_what_to_do() {
        // Nothing is known: every check must cope with it.
        for finding in all(&Facts::default()) {
            let needs = finding.level >= Level::Warn;
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
