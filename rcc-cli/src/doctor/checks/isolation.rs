//! Isolation of the configured core: isolcpus, nohz_full, and its SMT sibling. Pure.

use super::cores;
use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let Some(core) = facts.requirements.core else {
        return Vec::new();
    };
    let cpu = &facts.cpu;
    let mut found = Vec::new();
    if cpu.isolated.contains(&core) {
        let tick = if cpu.nohz_full.contains(&core) {
            ", and has no clock tick"
        } else {
            ""
        };
        found.push(HealthFinding::ok(format!("core {core} is isolated{tick}")));
    } else {
        found.push(
            HealthFinding::note(format!("core {core} is shared with all other processes"))
                .fix(format!(
                    "kernel parameters isolcpus={core} nohz_full={core} rcu_nocbs={core}; needed only when the grade is not A"
                )),
        );
    }
    if !cpu.siblings.is_empty() {
        found.push(
            HealthFinding::note(format!(
                "core {core} shares its physical core with {} (SMT)",
                cores(&cpu.siblings)
            ))
            .fix(format!(
                "disable the sibling: echo 0 | sudo tee /sys/devices/system/cpu/cpu{}/online",
                cpu.siblings[0]
            )),
        );
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;

    #[test]
    fn an_isolated_core_is_fine_and_a_shared_one_is_a_note() {
        let mut facts = MachineFacts::default();
        assert_eq!(check(&facts), []);
        facts.requirements.core = Some(3);
        assert_eq!(check(&facts)[0].level, FindingLevel::Note);
        facts.cpu.isolated = vec![3];
        assert_eq!(check(&facts), [HealthFinding::ok("core 3 is isolated")]);
        facts.cpu.siblings = vec![7];
        let found = check(&facts);
        assert!(
            found[1]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.contains("cpu7/online")),
            "{found:?}"
        );
    }
}
