//! The runtime folder: owned by this user, usable, and not writable by others. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Group and others may not write; a group may read if the cell's file grants it access.
const OTHERS_WRITE: u32 = 0o022;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::facts::runtime_folder::FolderFacts;

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
            assert_eq!(check(&facts)[0].level, level, "{owner:?} {mode:o} {usable}");
        }
    }
}
