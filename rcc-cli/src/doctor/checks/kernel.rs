//! Preemption model of the kernel; the measured latency counts more than the kernel's name. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;
use crate::doctor::grade::Grade;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::grade::tests::measured;

    #[test]
    fn a_good_measurement_counts_more_than_the_name_of_the_kernel() {
        let mut facts = MachineFacts::default();
        facts.kernel.preempt_rt = true;
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
        facts.kernel.preempt_rt = false;
        assert!(check(&facts)[0].fix.is_some());
        facts.measured = Some(measured(20, 30));
        assert!(check(&facts)[0].fix.is_none());
    }
}
