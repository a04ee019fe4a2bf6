//! Leftovers of dead cells: folders, announcements, shared memory. Pure.

use super::bytes;
use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Remedy: the command that removes all leftovers.
const FIX: &str = "rcc-cli doctor --clean   (or start the cell again: `up` cleans up its own cell)";

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let mut found = Vec::new();
    for cell in &facts.cells {
        let gone = cell.living.is_empty() && cell.refused.is_none();
        if gone && cell.files + cell.dead.len() > 0 {
            let what = format!(
                "cell {} is dead and left behind {} files ({}) in shared memory and {} announcements in {}",
                cell.name,
                cell.files,
                bytes(cell.bytes),
                cell.dead.len(),
                cell.folder.display()
            );
            found.push(HealthFinding::warn(what, FIX));
        }
    }
    for stray in &facts.strays {
        let what = format!(
            "shared memory {}* of a cell in another folder: {} files ({})",
            stray.prefix,
            stray.paths.len(),
            bytes(stray.bytes)
        );
        found.push(if stray.used {
            HealthFinding::note(format!("{what}, in use"))
        } else if stray.owner != facts.user.uid && facts.user.uid != 0 {
            HealthFinding::note(format!("{what}, of user {}", stray.owner))
                .fix("that user (or root) removes it: rcc-cli doctor --clean --strays")
        } else {
            HealthFinding::warn(format!("{what}, unused"), "rcc-cli doctor --clean --strays")
        });
    }
    if found.is_empty() {
        found.push(HealthFinding::ok("no leftovers of dead cells"));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::facts::cells::{CellFacts, StrayMemory};

    #[test]
    fn leftovers_are_reported_with_the_command_that_removes_them() {
        let mut facts = MachineFacts::default();
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
        facts.cells = vec![CellFacts {
            name: "demo".to_owned(),
            dead: vec!["executor/exec (pid 7)".to_owned()],
            files: 12,
            bytes: 3 << 20,
            ..CellFacts::default()
        }];
        let found = check(&facts);
        assert_eq!(found[0].level, FindingLevel::Warn);
        assert!(found[0].what.contains("12 files (3 MB)"), "{found:?}");
        assert!(
            found[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.contains("doctor --clean"))
        );
        facts.cells[0].living = vec!["loader/x (pid 9)".to_owned()];
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
    }

    #[test]
    fn memory_in_use_or_of_other_users_is_only_noted() {
        let mut facts = MachineFacts::default();
        facts.user.uid = 1000;
        let stray = StrayMemory {
            prefix: "rcc_0123456789_".to_owned(),
            owner: 1000,
            ..StrayMemory::default()
        };
        for (used, owner, level) in [
            (false, 1000, FindingLevel::Warn),
            (true, 1000, FindingLevel::Note),
            (false, 0, FindingLevel::Note),
        ] {
            facts.strays = vec![StrayMemory {
                used,
                owner,
                ..stray.clone()
            }];
            assert_eq!(check(&facts)[0].level, level, "{used} {owner}");
        }
    }
}
