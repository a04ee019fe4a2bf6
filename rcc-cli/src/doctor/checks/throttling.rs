//! Real-time throttling: the kernel's protection against real-time threads that never sleep. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Linux's default share for real-time threads, percent.
const DEFAULT_PERCENT: i64 = 95;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let (Some(run), Some(period)) = (facts.kernel.rt_runtime_us, facts.kernel.rt_period_us) else {
        return Vec::new();
    };
    if run < 0 {
        return vec![
            HealthFinding::note(
                "real-time throttling is off: a thread that never sleeps would freeze the machine",
            )
            .fix("sudo sysctl -w kernel.sched_rt_runtime_us=950000, unless it is off on purpose"),
        ];
    }
    let percent = run.saturating_mul(100) / period.max(1);
    if percent < DEFAULT_PERCENT {
        let what = format!(
            "real-time threads may run only {percent} % of the time ({run} of {period} µs)"
        );
        return vec![
            HealthFinding::warn(what, "sudo sysctl -w kernel.sched_rt_runtime_us=950000")
                .cause("the kernel stops the executor for the rest of each period"),
        ];
    }
    vec![HealthFinding::ok(format!(
        "real-time throttling is on at {percent} %: it protects the machine, and the cycle needs less"
    ))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;

    #[test]
    fn the_usual_share_is_fine_none_is_a_note_and_less_warns() {
        let mut facts = MachineFacts::default();
        assert_eq!(check(&facts), []);
        facts.kernel.rt_period_us = Some(1_000_000);
        for (run, level) in [
            (950_000, FindingLevel::Ok),
            (-1, FindingLevel::Note),
            (500_000, FindingLevel::Warn),
            (0, FindingLevel::Warn),
        ] {
            facts.kernel.rt_runtime_us = Some(run);
            assert_eq!(check(&facts)[0].level, level, "{run}");
        }
    }
}
