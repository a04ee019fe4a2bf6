//! The clock source behind CLOCK_MONOTONIC; steps of the wall clock do not matter. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Clock sources that are read in some ten nanoseconds, without a device access or a hypercall.
const FAST_SOURCES: [&str; 5] = [
    "tsc",
    "arch_sys_counter",
    "kvm-clock",
    "hyperv_clocksource_tsc_page",
    "timebase",
];

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let Some(name) = &facts.kernel.clock_source else {
        return Vec::new();
    };
    if FAST_SOURCES.contains(&name.as_str()) {
        return vec![HealthFinding::ok(format!("clock source {name}"))];
    }
    let fix = "check `dmesg` for the reason the TSC was marked unstable (often the BIOS); if it is stable, boot with tsc=reliable";
    vec![HealthFinding::warn(
        format!("clock source {name}: reading the time takes microseconds"),
        fix,
    )]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;

    #[test]
    fn a_slow_clock_warns() {
        let mut facts = MachineFacts::default();
        assert_eq!(check(&facts), []);
        for (name, level) in [
            ("tsc", FindingLevel::Ok),
            ("hpet", FindingLevel::Warn),
            ("acpi_pm", FindingLevel::Warn),
        ] {
            facts.kernel.clock_source = Some(name.to_owned());
            assert_eq!(check(&facts)[0].level, level, "{name}");
        }
    }
}
