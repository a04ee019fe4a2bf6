//! What dead cells have left: folders, announcements, shared memory.
//! Pure.

use super::bytes;
use crate::doctor::Finding;
use crate::doctor::facts::Facts;

/// The command that removes all of it.
const FIX: &str = "rcc-cli doctor --clean   (or start the cell again: `up` cleans its own)";

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let mut found = Vec::new();
    for cell in &facts.cells {
        let gone = cell.living.is_empty() && cell.refused.is_none();
        if gone && cell.files + cell.dead.len() > 0 {
            let what = format!(
                "cell {} is dead and left {} files ({}) in shared memory and {} announcements in {}",
                cell.name,
                cell.files,
                bytes(cell.bytes),
                cell.dead.len(),
                cell.folder.display()
            );
            found.push(Finding::warn(what, FIX));
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
            Finding::note(format!("{what}, in use"))
        } else if stray.owner != facts.user.uid && facts.user.uid != 0 {
            Finding::note(format!("{what}, of user {}", stray.owner))
                .fix("that user (or root) removes it: rcc-cli doctor --clean --strays")
        } else {
            Finding::warn(
                format!("{what}, and nobody uses it"),
                "rcc-cli doctor --clean --strays",
            )
        });
    }
    if found.is_empty() {
        found.push(Finding::ok("nothing is left of dead cells"));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::Level;
    use crate::doctor::facts::cells::{CellFacts, Stray};

    #[test]
    fn what_the_dead_left_is_told_with_the_command_that_removes_it() {
        let mut facts = Facts::default();
        assert_eq!(check(&facts)[0].level, Level::Ok);
        facts.cells = vec![CellFacts {
            name: "demo".to_owned(),
            dead: vec!["executor/exec (pid 7)".to_owned()],
            files: 12,
            bytes: 3 << 20,
            ..CellFacts::default()
        }];
        let found = check(&facts);
        assert_eq!(found[0].level, Level::Warn);
        assert!(found[0].what.contains("12 files (3 MB)"), "{found:?}");
        assert!(
            found[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.contains("doctor --clean"))
        );
        facts.cells[0].living = vec!["loader/x (pid 9)".to_owned()];
        assert_eq!(check(&facts)[0].level, Level::Ok);
    }

    #[test]
    fn memory_in_use_or_of_others_is_only_told() {
        let mut facts = Facts::default();
        facts.user.uid = 1000;
        let stray = Stray {
            prefix: "rcc_0123456789_".to_owned(),
            owner: 1000,
            ..Stray::default()
        };
        for (used, owner, level) in [
            (false, 1000, Level::Warn),
            (true, 1000, Level::Note),
            (false, 0, Level::Note),
        ] {
            facts.strays = vec![Stray {
                used,
                owner,
                ..stray.clone()
            }];
            assert_eq!(check(&facts)[0].level, level, "{used} {owner}");
        }
    }
}
