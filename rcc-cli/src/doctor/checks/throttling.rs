//! Throttling of real-time threads: the system's own brake for a thread that never sleeps.
//! Pure.

use crate::doctor::Finding;
use crate::doctor::facts::Facts;

/// The share that Linux leaves to real-time threads by default, percent.
const USUAL_PERCENT: i64 = 95;

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let (Some(run), Some(period)) = (facts.kernel.rt_runtime_us, facts.kernel.rt_period_us) else {
        return Vec::new();
    };
    if run < 0 {
        return vec![Finding::note(
            "throttling of real-time threads is off: a thread that never sleeps would stop the machine",
        )
        .fix("sudo sysctl -w kernel.sched_rt_runtime_us=950000 unless you know why it is off")];
    }
    let percent = run.saturating_mul(100) / period.max(1);
    if percent < USUAL_PERCENT {
        let what = format!(
            "real-time threads may run only {percent} % of the time ({run} of {period} µs)"
        );
        return vec![
            Finding::warn(what, "sudo sysctl -w kernel.sched_rt_runtime_us=950000")
                .cause("the executor is stopped for the rest of each period"),
        ];
    }
    vec![Finding::ok(format!(
        "throttling of real-time threads is on at {percent} %: it saves the machine, and the cycle needs less"
    ))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::Level;

    #[test]
    fn the_usual_share_is_fine_none_is_a_note_and_less_warns() {
        let mut facts = Facts::default();
        assert_eq!(check(&facts), []);
        facts.kernel.rt_period_us = Some(1_000_000);
        for (run, level) in [
            (950_000, Level::Ok),
            (-1, Level::Note),
            (500_000, Level::Warn),
            (0, Level::Warn),
        ] {
            facts.kernel.rt_runtime_us = Some(run);
            assert_eq!(check(&facts)[0].level, level, "{run}");
        }
    }
}
