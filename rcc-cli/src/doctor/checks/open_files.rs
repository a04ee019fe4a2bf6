//! Open files: shared memory, sockets and clients take descriptors.
//! Pure.

use crate::doctor::Finding;
use crate::doctor::facts::Facts;

/// A cell with 16 devices, 16 monitors and 64 connections to the loader has room here.
const NEEDED: u64 = 1024;

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    match facts.limits.nofile.soft {
        Some(limit) if limit < NEEDED => {
            let what = format!("only {limit} files may be open in a process");
            let fix = if facts.limits.nofile.could(NEEDED) {
                format!("ulimit -S -n {NEEDED}   in this shell")
            } else {
                "LimitNOFILE=4096 in the unit, or `@rcc - nofile 4096` in /etc/security/limits.d/rcc.conf".to_owned()
            };
            vec![
                Finding::warn(what, fix).cause(format!("{NEEDED} are enough for the largest cell")),
            ]
        }
        Some(limit) => vec![Finding::ok(format!(
            "{limit} files may be open in a process"
        ))],
        None => vec![Finding::ok("any number of files may be open in a process")],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::Level;
    use crate::doctor::facts::limits::Limit;

    #[test]
    fn too_few_warn_with_the_remedy_that_the_hard_limit_allows() {
        let mut facts = Facts::default();
        assert_eq!(check(&facts)[0].level, Level::Ok);
        facts.limits.nofile = Limit {
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
        assert_eq!(check(&facts)[0].level, Level::Ok);
    }
}
