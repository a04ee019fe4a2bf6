//! The configured core: whether it exists and may be used. Pure.

use super::cores;
use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let cpu = &facts.cpu;
    let Some(core) = facts.requirements.core else {
        return vec![HealthFinding::note("no core is configured: the scheduler may move the cycle between cores").fix(
            "set `executor: {core: N}` in the cell's file, with N an isolated core (see `isolation`)",
        )];
    };
    if !cpu.online.is_empty() && !cpu.online.contains(&core) {
        let what = format!(
            "core {core} does not exist; available cores: {}",
            cores(&cpu.online)
        );
        return vec![HealthFinding::fail(
            what,
            "set executor.core to one of them",
        )];
    }
    if !cpu.allowed.is_empty() && !cpu.allowed.contains(&core) {
        return vec![HealthFinding::note(format!(
            "core {core} is not in this process's affinity mask ({}); binding works unless a cpuset forbids it",
            cores(&cpu.allowed)
        ))];
    }
    vec![HealthFinding::ok(format!("core {core} exists"))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;

    #[test]
    fn a_missing_core_fails_and_an_unset_core_is_a_note() {
        let mut facts = MachineFacts::default();
        facts.cpu.online = vec![0, 1];
        facts.cpu.allowed = vec![0];
        for (core, level) in [
            (None, FindingLevel::Note),
            (Some(0), FindingLevel::Ok),
            (Some(1), FindingLevel::Note),
            (Some(3), FindingLevel::Fail),
        ] {
            facts.requirements.core = core;
            assert_eq!(check(&facts)[0].level, level, "{core:?}");
        }
    }
}
