//! Cells: the folder they are in, the running ones, leftovers of dead ones, open files. Pure.

use rcc_core::counted::Counted;

use super::bytes;
use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;
use crate::doctor::facts::cells::CellFacts;
use crate::table::{counted, grouped, time};

/// Group and others may not write; a group may read if the cell's file grants it access.
const OTHERS_WRITE: u32 = 0o022;

/// The runtime folder: owned by this user, usable, and not writable by others.
pub(super) fn runtime_folder(facts: &MachineFacts) -> Vec<HealthFinding> {
    let folder = &facts.runtime_folder;
    let path = folder.path.display();
    let uid = facts.user.uid;
    match folder.owner {
        Some(owner) if owner != uid => {
            let what = format!(
                "the runtime folder {path} belongs to user {owner}, but you are user {uid}"
            );
            vec![HealthFinding::fail(
                what,
                "set RCC_RUNTIME_DIR to a folder of your own",
            )]
        }
        _ if !folder.usable => {
            let what = format!("the runtime folder {path} is not usable");
            vec![HealthFinding::fail(
                what,
                "set RCC_RUNTIME_DIR to a writable folder",
            )]
        }
        Some(_) if folder.mode & OTHERS_WRITE != 0 => {
            let what = format!(
                "the runtime folder {path} is writable by others (mode {:o})",
                folder.mode
            );
            vec![
                HealthFinding::warn(what, format!("chmod 0700 {path}"))
                    .cause("another user could place a socket or file there"),
            ]
        }
        Some(_) => vec![HealthFinding::ok(format!(
            "runtime folder {path}, mode {:o}",
            folder.mode
        ))],
        None => vec![HealthFinding::ok(format!(
            "runtime folder {path}, not created yet"
        ))],
    }
}

/// Sufficient for a cell with 16 devices, 16 monitors and 64 connections to the loader.
const NEEDED: u64 = 1024;

/// Limit of open files: shared memory, sockets and clients take file descriptors.
pub(super) fn open_files(facts: &MachineFacts) -> Vec<HealthFinding> {
    match facts.limits.nofile.soft {
        Some(limit) if limit < NEEDED => {
            let what = format!("the open-files limit is only {limit}");
            let fix = if facts.limits.nofile.can_reach(NEEDED) {
                format!("ulimit -S -n {NEEDED}   in this shell")
            } else {
                "LimitNOFILE=4096 in the unit, or `@rcc - nofile 4096` in /etc/security/limits.d/rcc.conf".to_owned()
            };
            vec![
                HealthFinding::warn(what, fix)
                    .cause(format!("{NEEDED} suffice for the largest cell")),
            ]
        }
        Some(limit) => vec![HealthFinding::ok(format!(
            "the open-files limit is {limit}"
        ))],
        None => vec![HealthFinding::ok("the open-files limit is unlimited")],
    }
}

/// Running cells and their health.
pub(super) fn cells(facts: &MachineFacts) -> Vec<HealthFinding> {
    let alive = facts
        .cells
        .iter()
        .filter(|cell| !cell.living.is_empty() || cell.refused.is_some());
    alive.flat_map(cell_findings).collect()
}

fn cell_findings(cell: &CellFacts) -> Vec<HealthFinding> {
    let name = &cell.name;
    if let Some(reason) = &cell.refused {
        let fix = format!("ask its owner, or inspect {}", cell.folder.display());
        return vec![HealthFinding::warn(
            format!("cannot inspect cell {name}: {reason}"),
            fix,
        )];
    }
    let mut found = Vec::new();
    if !cell.dead.is_empty() {
        let what = format!(
            "cell {name}: dead processes that were not restarted: {}",
            cell.dead.join(", ")
        );
        found.push(HealthFinding::warn(
            what,
            "see `rcc-cli events` and the cell's supervisor (`rcc-cli up`, or systemctl status 'rcc*')",
        ));
    }
    match &cell.executor {
        None => {
            let what = format!(
                "cell {name} runs ({}), but its loader or executor does not answer",
                Counted::of(cell.living.len(), "process")
            );
            found.push(HealthFinding::warn(
                what,
                format!("run `rcc-cli --cell {name} status` and start what is missing"),
            ));
        }
        Some(executor) if executor.late > 0 => {
            let what = format!(
                "cell {name} runs: cycle {}, {} (last {}), worst wake-up latency {}",
                grouped(executor.cycle),
                counted(executor.late, "late cycle"),
                grouped(executor.last_late.as_ref().map_or(0, |late| late.cycle)),
                time(executor.worst_wake_ns)
            );
            found.push(HealthFinding::note(what).cause(executor.grade.clone()));
        }
        Some(executor) => {
            let what = format!(
                "cell {name} runs: cycle {}, no late cycles",
                grouped(executor.cycle)
            );
            found.push(HealthFinding::ok(what).cause(executor.grade.clone()));
        }
    }
    found
}

/// Remedy: the command that removes all leftovers.
const FIX: &str = "rcc-cli doctor --clean   (or start the cell again: `up` cleans up its own cell)";

/// Leftovers of dead cells: folders, announcements, shared memory.
pub(super) fn leftovers(facts: &MachineFacts) -> Vec<HealthFinding> {
    let mut found = Vec::new();
    for cell in &facts.cells {
        let gone = cell.living.is_empty() && cell.refused.is_none();
        if gone && cell.files + cell.dead.len() > 0 {
            let what = format!(
                "cell {} is dead and left behind {} ({}) in shared memory and {} in {}",
                cell.name,
                Counted::of(cell.files, "file"),
                bytes(cell.bytes),
                Counted::of(cell.dead.len(), "announcement"),
                cell.folder.display()
            );
            found.push(HealthFinding::warn(what, FIX));
        }
    }
    for stray in &facts.strays {
        let what = format!(
            "shared memory {}* of a cell in another folder: {} ({})",
            stray.prefix,
            Counted::of(stray.paths.len(), "file"),
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
    use crate::doctor::facts::cells::{FolderFacts, StrayMemory};
    use crate::doctor::facts::limits::ResourceLimit;
    use rcc_api::bodies::ExecutorView;

    #[test]
    fn the_runtime_folder_must_be_owned_usable_and_private() {
        let mut facts = MachineFacts::default();
        facts.user.uid = 1000;
        let cases = [
            (Some(1000), 0o700, true, FindingLevel::Ok),
            (Some(1000), 0o750, true, FindingLevel::Ok),
            (None, 0, true, FindingLevel::Ok),
            (Some(1000), 0o777, true, FindingLevel::Warn),
            (Some(0), 0o700, false, FindingLevel::Fail),
            (None, 0, false, FindingLevel::Fail),
        ];
        for (owner, mode, usable, level) in cases {
            facts.runtime_folder = FolderFacts {
                path: "/run/x".into(),
                owner,
                mode,
                usable,
            };
            assert_eq!(
                runtime_folder(&facts)[0].level,
                level,
                "{owner:?} {mode:o} {usable}"
            );
        }
    }

    #[test]
    fn too_few_warn_with_the_remedy_that_the_hard_limit_allows() {
        let mut facts = MachineFacts::default();
        assert_eq!(open_files(&facts)[0].level, FindingLevel::Ok);
        facts.limits.nofile = ResourceLimit {
            soft: Some(256),
            hard: Some(4096),
        };
        assert!(
            open_files(&facts)[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.starts_with("ulimit"))
        );
        facts.limits.nofile.hard = Some(256);
        assert!(
            open_files(&facts)[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.starts_with("LimitNOFILE"))
        );
        facts.limits.nofile.soft = Some(1024);
        assert_eq!(open_files(&facts)[0].level, FindingLevel::Ok);
    }

    #[test]
    fn a_running_cell_is_reported_with_its_health() {
        let cell = CellFacts {
            name: "demo".to_owned(),
            living: vec!["executor/exec (pid 7)".to_owned()],
            executor: Some(ExecutorView {
                cycle: 81_422,
                ..ExecutorView::default()
            }),
            ..CellFacts::default()
        };
        let mut facts = MachineFacts {
            cells: vec![cell],
            ..MachineFacts::default()
        };
        assert!(
            cells(&facts)[0]
                .what
                .contains("cycle 81 422, no late cycles")
        );
        facts.cells[0].executor = None;
        assert_eq!(cells(&facts)[0].level, FindingLevel::Warn);
        facts.cells[0].dead = vec!["driver/lwr (pid 8)".to_owned()];
        assert!(cells(&facts)[0].what.contains("driver/lwr"));
    }

    #[test]
    fn a_dead_cell_is_left_to_the_leftovers_check() {
        let cell = CellFacts {
            name: "demo".to_owned(),
            files: 3,
            ..CellFacts::default()
        };
        let facts = MachineFacts {
            cells: vec![cell],
            ..MachineFacts::default()
        };
        assert_eq!(cells(&facts), []);
    }

    #[test]
    fn leftovers_are_reported_with_the_command_that_removes_them() {
        let mut facts = MachineFacts::default();
        assert_eq!(leftovers(&facts)[0].level, FindingLevel::Ok);
        facts.cells = vec![CellFacts {
            name: "demo".to_owned(),
            dead: vec!["executor/exec (pid 7)".to_owned()],
            files: 12,
            bytes: 3 << 20,
            ..CellFacts::default()
        }];
        let found = leftovers(&facts);
        assert_eq!(found[0].level, FindingLevel::Warn);
        assert!(found[0].what.contains("12 files (3 MB)"), "{found:?}");
        assert!(
            found[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.contains("doctor --clean"))
        );
        facts.cells[0].living = vec!["loader/x (pid 9)".to_owned()];
        assert_eq!(leftovers(&facts)[0].level, FindingLevel::Ok);
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
            assert_eq!(leftovers(&facts)[0].level, level, "{used} {owner}");
        }
    }
}
