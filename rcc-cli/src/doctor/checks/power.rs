//! Power saving: a core in deep sleep or at a low frequency wakes up late. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
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

    #[test]
    fn governor_and_idle_states_warn_unless_they_are_disabled() {
        let mut facts = MachineFacts::default();
        assert_eq!(check(&facts), []);
        facts.cpu.governors = vec!["powersave".to_owned()];
        assert_eq!(check(&facts)[0].level, FindingLevel::Warn);
        facts.cpu.governors = vec!["performance".to_owned()];
        facts.cpu.deep_idle = vec![("C6".to_owned(), 133)];
        let found = check(&facts);
        assert_eq!(
            (found[0].level, found[1].level),
            (FindingLevel::Ok, FindingLevel::Warn)
        );
        facts.cpu.dma_latency_us = Some(0);
        assert_eq!(check(&facts)[1].level, FindingLevel::Ok);
    }
}
