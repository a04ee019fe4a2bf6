//! The kernel, its clock, and the machine below it. Pure.

use rcc_core::counted::Counted;

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;
use crate::doctor::grade::Grade;

/// Preemption model of the kernel; the measured latency counts more than the kernel's name.
pub(super) fn kernel(facts: &MachineFacts) -> Vec<HealthFinding> {
    let kernel = &facts.kernel;
    if kernel.preempt_rt {
        return vec![HealthFinding::ok(format!(
            "kernel {} with PREEMPT_RT",
            kernel.release
        ))];
    }
    let grade = facts.measured.as_ref().map(Grade::of);
    let kind = if kernel.preemption.is_empty() {
        "no preemption"
    } else {
        &kernel.preemption
    };
    let what = format!("kernel {} without PREEMPT_RT ({kind})", kernel.release);
    match grade {
        Some(Grade::A | Grade::B) => vec![HealthFinding::note(format!(
            "{what}; the measured latency is good under this load, and counts more"
        ))],
        _ => vec![HealthFinding::note(what).fix(
            "install a kernel with PREEMPT_RT (Debian: linux-image-rt-amd64; Ubuntu: pro enable realtime-kernel) \
             for a real robot",
        )],
    }
}

/// Clock sources that are read in some ten nanoseconds, without a device access or a hypercall.
const FAST_SOURCES: [&str; 5] = [
    "tsc",
    "arch_sys_counter",
    "kvm-clock",
    "hyperv_clocksource_tsc_page",
    "timebase",
];

/// The clock source behind CLOCK_MONOTONIC; steps of the wall clock do not matter.
pub(super) fn clock(facts: &MachineFacts) -> Vec<HealthFinding> {
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

/// Processor time lost to a hypervisor or the firmware.
pub(super) fn virtual_machine(facts: &MachineFacts) -> Vec<HealthFinding> {
    let mut found = Vec::new();
    let late = facts.measured.as_ref().map(Grade::of) >= Some(Grade::C);
    let steal_ms = facts.activity.steal_ms;
    if let Some(name) = &facts.kernel.virtual_machine {
        let what = format!("running in a virtual machine ({name})");
        let stolen =
            format!("its host took {steal_ms} ms of processor time during the measurement");
        let fix = "no setting in the guest helps: use a physical machine for a real robot, or dedicate host cores to this one";
        found.push(match (late, steal_ms) {
            (true, 0) => HealthFinding::warn(what, fix)
                .cause("the host does not report steal time; it probably causes the late wake-ups"),
            (true, _) => HealthFinding::warn(what, fix).cause(stolen),
            (false, 0) => HealthFinding::note(what),
            (false, _) => HealthFinding::note(what).cause(stolen),
        });
    }
    if let Some(smi @ 1..) = facts.activity.smi {
        let what = format!(
            "the firmware interrupted the core {} (SMI); no operating system can prevent that",
            Counted(smi, "time")
        );
        found.push(HealthFinding::warn(
            what,
            "disable USB legacy support, power management and error reporting in the BIOS",
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
    fn a_good_measurement_counts_more_than_the_name_of_the_kernel() {
        let mut facts = MachineFacts::default();
        facts.kernel.preempt_rt = true;
        assert_eq!(kernel(&facts)[0].level, FindingLevel::Ok);
        facts.kernel.preempt_rt = false;
        assert!(kernel(&facts)[0].fix.is_some());
        facts.measured = Some(measured(20, 30));
        assert!(kernel(&facts)[0].fix.is_none());
    }

    #[test]
    fn a_slow_clock_warns() {
        let mut facts = MachineFacts::default();
        assert_eq!(clock(&facts), []);
        for (name, level) in [
            ("tsc", FindingLevel::Ok),
            ("hpet", FindingLevel::Warn),
            ("acpi_pm", FindingLevel::Warn),
        ] {
            facts.kernel.clock_source = Some(name.to_owned());
            assert_eq!(clock(&facts)[0].level, level, "{name}");
        }
    }

    #[test]
    fn a_virtual_machine_is_blamed_only_when_wake_ups_were_late() {
        let mut facts = MachineFacts::default();
        assert_eq!(virtual_machine(&facts), []);
        facts.kernel.virtual_machine = Some("QEMU".to_owned());
        assert_eq!(virtual_machine(&facts)[0].level, FindingLevel::Note);
        facts.measured = Some(measured(700, 9_100));
        assert_eq!(virtual_machine(&facts)[0].level, FindingLevel::Warn);
        facts.activity.steal_ms = 120;
        assert!(
            virtual_machine(&facts)[0]
                .cause
                .as_deref()
                .is_some_and(|cause| cause.contains("120 ms"))
        );
    }

    #[test]
    fn firmware_interrupts_are_reported() {
        let mut facts = MachineFacts::default();
        facts.activity.smi = Some(0);
        assert_eq!(virtual_machine(&facts), []);
        facts.activity.smi = Some(4);
        assert!(virtual_machine(&facts)[0].what.contains("4 times"));
    }
}
