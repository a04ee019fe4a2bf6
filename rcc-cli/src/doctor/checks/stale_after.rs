//! The cell's `stale_after` compared with the measured latency: if it is too short, mere lateness counts as a lost
//! device. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;
use crate::doctor::grade::{Grade, STALE_DEFAULT_NS};
use crate::table::time;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let (Some(stale_ns), Some(measured)) = (facts.requirements.stale_after_ns, &facts.measured)
    else {
        return Vec::new();
    };
    let grade = Grade::of(measured);
    let least_ns = grade.stale_after_ns(measured.max_ns, measured.period_ns);
    let source = &facts.requirements.source;
    if stale_ns < least_ns {
        let what = format!(
            "stale_after is {}, too short for grade {grade}",
            time(stale_ns)
        );
        let fix = format!(
            "stale_after: {} ms or more in {source}",
            least_ns.div_ceil(1_000_000)
        );
        return vec![
            HealthFinding::warn(what, fix).cause(
                "devices count as lost, and their nets end, when this machine is merely late",
            ),
        ];
    }
    if grade <= Grade::B && stale_ns >= STALE_DEFAULT_NS {
        return vec![
            HealthFinding::note(format!(
                "stale_after is {}; this machine allows {}",
                time(stale_ns),
                time(least_ns)
            ))
            .fix(format!(
                "stale_after: {} ms in {source}: a dead driver is noticed sooner",
                least_ns / 1_000_000
            )),
        ];
    }
    vec![HealthFinding::ok(format!(
        "stale_after is {}; at least {} is required",
        time(stale_ns),
        time(least_ns)
    ))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::grade::tests::measured;

    #[test]
    fn too_short_warns_and_needlessly_long_is_a_note() {
        let mut facts = MachineFacts {
            measured: Some(measured(700, 9_100)),
            ..MachineFacts::default()
        };
        assert_eq!(check(&facts), []);
        facts.requirements.stale_after_ns = Some(3_000_000);
        let found = check(&facts);
        assert_eq!(found[0].level, FindingLevel::Warn);
        assert!(
            found[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.starts_with("stale_after: 19 ms")),
            "{found:?}"
        );
        facts.requirements.stale_after_ns = Some(50_000_000);
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
        facts.measured = Some(measured(20, 30));
        assert_eq!(check(&facts)[0].level, FindingLevel::Note);
        facts.requirements.stale_after_ns = Some(3_000_000);
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
    }
}
