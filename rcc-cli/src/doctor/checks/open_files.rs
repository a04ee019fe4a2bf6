//! Limit of open files: shared memory, sockets and clients take file descriptors. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Sufficient for a cell with 16 devices, 16 monitors and 64 connections to the loader.
const NEEDED: u64 = 1024;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::facts::limits::ResourceLimit;

    #[test]
    fn too_few_warn_with_the_remedy_that_the_hard_limit_allows() {
        let mut facts = MachineFacts::default();
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
        facts.limits.nofile = ResourceLimit {
            soft: Some(256),
            hard: Some(4096),
        };
        assert!(
            check(&facts)[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.starts_with("ulimit"))
        );
        facts.limits.nofile.hard = Some(256);
        assert!(
            check(&facts)[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.starts_with("LimitNOFILE"))
        );
        facts.limits.nofile.soft = Some(1024);
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
    }
}
