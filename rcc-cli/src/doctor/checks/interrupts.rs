//! Device interrupts on the configured core during the measurement. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Number of interrupts that are named.
const NAMED: usize = 3;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let (Some(core), Some(_)) = (facts.requirements.core, &facts.measured) else {
        return Vec::new();
    };
    let all = &facts.activity.interrupts;
    if all.is_empty() {
        return vec![HealthFinding::ok(format!(
            "no device interrupts on core {core} during the measurement"
        ))];
    }
    let named: Vec<String> = all
        .iter()
        .take(NAMED)
        .map(|(name, count)| format!("{name} ({count} times)"))
        .collect();
    let number = all[0].0.split(' ').next().unwrap_or("N");
    let what = format!("device interrupts on core {core}: {}", named.join(", "));
    let fix = format!(
        "move them to another core: echo 0 | sudo tee /proc/irq/{number}/smp_affinity_list; stop irqbalance, which would undo it"
    );
    vec![HealthFinding::warn(what, fix)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::grade::tests::measured;

    #[test]
    fn interrupts_on_the_core_are_named_with_how_to_move_them() {
        let mut facts = MachineFacts::default();
        facts.requirements.core = Some(1);
        assert_eq!(check(&facts), []);
        facts.measured = Some(measured(20, 30));
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
        facts.activity.interrupts = vec![
            ("36 virtio1-req.0".to_owned(), 1000),
            ("42 enp3s0".to_owned(), 7),
        ];
        let found = check(&facts);
        assert_eq!(found[0].level, FindingLevel::Warn);
        assert!(
            found[0]
                .what
                .contains("virtio1-req.0 (1000 times), 42 enp3s0 (7 times)"),
            "{found:?}"
        );
        assert!(
            found[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.contains("/proc/irq/36/")),
            "{found:?}"
        );
    }
}
