//! Processor time lost to a hypervisor or the firmware. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;
use crate::doctor::grade::Grade;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
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
            "the firmware interrupted the core {smi} times (SMI); no operating system can prevent that"
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
    fn a_virtual_machine_is_blamed_only_when_wake_ups_were_late() {
        let mut facts = MachineFacts::default();
        assert_eq!(check(&facts), []);
        facts.kernel.virtual_machine = Some("QEMU".to_owned());
        assert_eq!(check(&facts)[0].level, FindingLevel::Note);
        facts.measured = Some(measured(700, 9_100));
        assert_eq!(check(&facts)[0].level, FindingLevel::Warn);
        facts.activity.steal_ms = 120;
        assert!(
            check(&facts)[0]
                .cause
                .as_deref()
                .is_some_and(|cause| cause.contains("120 ms"))
        );
    }

    #[test]
    fn firmware_interrupts_are_reported() {
        let mut facts = MachineFacts::default();
        facts.activity.smi = Some(0);
        assert_eq!(check(&facts), []);
        facts.activity.smi = Some(4);
        assert!(check(&facts)[0].what.contains("4 times"));
    }
}
