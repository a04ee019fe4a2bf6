//! The core of the cycle: its existence, isolation, interrupts, power saving. Pure.

use rcc_core::counted::Counted;

use super::cores;
use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// The configured core: whether it exists and may be used.
pub(super) fn core(facts: &MachineFacts) -> Vec<HealthFinding> {
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

/// Isolation of the configured core: isolcpus, nohz_full, and its SMT sibling.
pub(super) fn isolation(facts: &MachineFacts) -> Vec<HealthFinding> {
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

/// Number of interrupts that are named.
const NAMED: usize = 3;

/// Device interrupts on the configured core during the measurement.
pub(super) fn interrupts(facts: &MachineFacts) -> Vec<HealthFinding> {
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
        .map(|(name, count)| format!("{name} ({})", Counted(*count, "time")))
        .collect();
    let number = all[0].0.split(' ').next().unwrap_or("N");
    let what = format!("device interrupts on core {core}: {}", named.join(", "));
    let fix = format!(
        "move them to another core: echo 0 | sudo tee /proc/irq/{number}/smp_affinity_list; stop irqbalance, which would undo it"
    );
    vec![HealthFinding::warn(what, fix)]
}

/// Power saving: a core in deep sleep or at a low frequency wakes up late.
pub(super) fn power(facts: &MachineFacts) -> Vec<HealthFinding> {
    let cpu = &facts.cpu;
    let whose = facts
        .requirements
        .core
        .map_or_else(|| "cores".to_owned(), |core| format!("core {core}"));
    let mut found = Vec::new();
    let slow: Vec<&str> = cpu
        .governors
        .iter()
        .map(String::as_str)
        .filter(|governor| *governor != "performance")
        .collect();
    if !slow.is_empty() {
        found.push(HealthFinding::warn(
            format!("frequency governor of {whose}: {}", slow.join(", ")),
            "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor   \
             (or rcc-rt-setup.service, which does it at every start)",
        ));
    } else if !cpu.governors.is_empty() {
        found.push(HealthFinding::ok(format!(
            "frequency governor of {whose}: performance"
        )));
    }
    if cpu.deep_idle.is_empty() {
        return found;
    }
    let states: Vec<String> = cpu
        .deep_idle
        .iter()
        .map(|(name, latency_us)| format!("{name} ({latency_us} µs)"))
        .collect();
    let shortest = cpu
        .deep_idle
        .iter()
        .map(|(_, latency_us)| *latency_us)
        .min()
        .unwrap_or(0);
    if cpu.dma_latency_us.is_some_and(|asked| asked < shortest) {
        found.push(HealthFinding::ok(
            "deep idle states are disabled by a process that holds /dev/cpu_dma_latency open",
        ));
    } else {
        found.push(HealthFinding::warn(
            format!("idle states with a long exit latency are enabled: {}", states.join(", ")),
            "keep /dev/cpu_dma_latency open with 0 (rcc-rt-setup.service does), or the kernel parameter \
             processor.max_cstate=1 intel_idle.max_cstate=1",
        ));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::grade::tests::measured;

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
            assert_eq!(super::core(&facts)[0].level, level, "{core:?}");
        }
    }

    #[test]
    fn an_isolated_core_is_fine_and_a_shared_one_is_a_note() {
        let mut facts = MachineFacts::default();
        assert_eq!(isolation(&facts), []);
        facts.requirements.core = Some(3);
        assert_eq!(isolation(&facts)[0].level, FindingLevel::Note);
        facts.cpu.isolated = vec![3];
        assert_eq!(isolation(&facts), [HealthFinding::ok("core 3 is isolated")]);
        facts.cpu.siblings = vec![7];
        let found = isolation(&facts);
        assert!(
            found[1]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.contains("cpu7/online")),
            "{found:?}"
        );
    }

    #[test]
    fn interrupts_on_the_core_are_named_with_how_to_move_them() {
        let mut facts = MachineFacts::default();
        facts.requirements.core = Some(1);
        assert_eq!(interrupts(&facts), []);
        facts.measured = Some(measured(20, 30));
        assert_eq!(interrupts(&facts)[0].level, FindingLevel::Ok);
        facts.activity.interrupts = vec![
            ("36 virtio1-req.0".to_owned(), 1000),
            ("42 enp3s0".to_owned(), 7),
        ];
        let found = interrupts(&facts);
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

    #[test]
    fn governor_and_idle_states_warn_unless_they_are_disabled() {
        let mut facts = MachineFacts::default();
        assert_eq!(power(&facts), []);
        facts.cpu.governors = vec!["powersave".to_owned()];
        assert_eq!(power(&facts)[0].level, FindingLevel::Warn);
        facts.cpu.governors = vec!["performance".to_owned()];
        facts.cpu.deep_idle = vec![("C6".to_owned(), 133)];
        let found = power(&facts);
        assert_eq!(
            (found[0].level, found[1].level),
            (FindingLevel::Ok, FindingLevel::Warn)
        );
        facts.cpu.dma_latency_us = Some(0);
        assert_eq!(power(&facts)[1].level, FindingLevel::Ok);
    }
}
