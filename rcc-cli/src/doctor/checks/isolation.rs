//! The configured core for itself: isolcpus, nohz_full, and the sibling that shares its hardware.
//! Pure.

use super::cores;
use crate::doctor::Finding;
use crate::doctor::facts::Facts;

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let Some(core) = facts.wish.core else {
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
        found.push(Finding::ok(format!("core {core} is isolated{tick}")));
    } else {
        found.push(
            Finding::note(format!("core {core} is shared with everything else that runs here"))
                .fix(format!(
                    "kernel parameters isolcpus={core} nohz_full={core} rcu_nocbs={core}; it matters when the grade is not A"
                )),
        );
    }
    if !cpu.siblings.is_empty() {
        found.push(
            Finding::note(format!(
                "core {core} shares its hardware with {} (SMT)",
                cores(&cpu.siblings)
            ))
            .fix(format!(
                "switch it off: echo 0 | sudo tee /sys/devices/system/cpu/cpu{}/online",
                cpu.siblings[0]
            )),
        );
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::Level;

    #[test]
    fn an_isolated_core_is_fine_and_a_shared_one_is_a_note() {
        let mut facts = Facts::default();
        assert_eq!(check(&facts), []);
        facts.wish.core = Some(3);
        assert_eq!(check(&facts)[0].level, Level::Note);
        facts.cpu.isolated = vec![3];
        assert_eq!(check(&facts), [Finding::ok("core 3 is isolated")]);
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
