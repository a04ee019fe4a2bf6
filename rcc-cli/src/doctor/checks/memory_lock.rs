//! Memory locking: a page fault in a cycle can cost milliseconds. Pure.

use super::bytes;
use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let limit = facts.limits.memlock.soft;
    // Like the executor: under a finite limit only root locks memory.
    let privileged = facts.user.uid == 0;
    match (facts.trial.lock, limit) {
        (Ok(()), _) if privileged => vec![HealthFinding::ok("memory can be locked (root)")],
        (Ok(()), None) => vec![HealthFinding::ok(
            "memory can be locked (the memlock limit is unlimited)",
        )],
        (Ok(()), Some(limit)) => {
            let what = format!("memory can be locked only up to {}", bytes(limit));
            vec![HealthFinding::warn(what, fix(facts)).required(facts.requirements.required).cause(
                "the executor does not lock memory under a finite limit: a later allocation would fail while it runs",
            )]
        }
        (Err(errno), limit) => {
            let limit = limit.map_or_else(|| "unlimited".to_owned(), bytes);
            let what = format!("cannot lock memory: {}", errno.desc());
            vec![
                HealthFinding::warn(what, fix(facts))
                    .required(facts.requirements.required)
                    .cause(format!("the memlock limit is {limit}")),
            ]
        }
    }
}

fn fix(facts: &MachineFacts) -> String {
    if facts.user.container.is_some() {
        return "start the container with --ulimit memlock=-1".to_owned();
    }
    match facts.user.service() {
        Some(service) => format!("LimitMEMLOCK=infinity in {service}, then restart it"),
        None if facts.limits.memlock.hard.is_none() => "ulimit -S -l unlimited   in this shell".to_owned(),
        None => "add `@rcc - memlock unlimited` to /etc/security/limits.d/rcc.conf, join the group rcc, then log out of \
                 all sessions and in again"
            .to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::facts::limits::ResourceLimit;
    use nix::errno::Errno;

    #[test]
    fn root_and_unlimited_are_fine_and_a_finite_limit_is_not() {
        let mut facts = MachineFacts::default();
        facts.user.uid = 1000;
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
        facts.limits.memlock = ResourceLimit {
            soft: Some(8 << 20),
            hard: Some(8 << 20),
        };
        let found = check(&facts);
        assert_eq!(found[0].level, FindingLevel::Warn);
        assert!(found[0].what.contains("8 MB"), "{found:?}");
        facts.user.uid = 0;
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
    }

    #[test]
    fn a_refusal_names_the_limit_and_the_remedy_that_suits_the_place() {
        let mut facts = MachineFacts::default();
        facts.user.uid = 1000;
        facts.trial.lock = Err(Errno::ENOMEM);
        facts.limits.memlock = ResourceLimit {
            soft: Some(65_536),
            hard: None,
        };
        let fix = |facts: &MachineFacts| check(facts)[0].fix.clone().unwrap_or_default();
        assert!(fix(&facts).starts_with("ulimit -S -l"));
        facts.limits.memlock.hard = Some(65_536);
        assert!(fix(&facts).contains("limits.d/rcc.conf"));
        facts.user.cgroup = "/system.slice/rcc-executor.service".to_owned();
        assert!(fix(&facts).contains("LimitMEMLOCK"));
    }
}
