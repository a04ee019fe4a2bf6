//! The measured wake-up latency, and what it allows. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;
use crate::doctor::grade::{Grade, STALE_DEFAULT_NS};
use crate::doctor::measure::WakeUpMeasurement;
use crate::table::{grouped, time};

/// The grade: measured wake-up latency and what it allows.
pub(super) fn wake_up(facts: &MachineFacts) -> Vec<HealthFinding> {
    let measured = match (&facts.measured, &facts.not_measured) {
        (Some(measured), _) => measured,
        (None, Some(why)) => {
            let fix = "set executor.core to a core of this machine, or remove it";
            return vec![HealthFinding::fail(
                format!("cannot measure wake-up latency: {why}"),
                fix,
            )];
        }
        (None, None) => {
            return vec![
                HealthFinding::note("wake-up latency was not measured")
                    .fix("rcc-cli doctor --measure 10s"),
            ];
        }
    };
    let grade = Grade::of(measured);
    let what = format!(
        "{} → grade {grade} for {}",
        summary(measured),
        time(measured.period_ns)
    );
    vec![match grade {
        Grade::A | Grade::B => HealthFinding::ok(what),
        Grade::C | Grade::D => HealthFinding::warn(what, remedy(facts, measured)),
    }]
}

/// Describes a measurement in one line.
fn summary(measured: &WakeUpMeasurement) -> String {
    let how = match measured.priority {
        Some(priority) => format!("SCHED_FIFO {priority}"),
        None => "without SCHED_FIFO".to_owned(),
    };
    let core_text = match measured.core {
        Some(core) => format!("core {core}"),
        None => "any core".to_owned(),
    };
    let missed = match measured.missed {
        0 => String::new(),
        missed => format!(", {missed} after the next deadline"),
    };
    format!(
        "wake-up latency on {core_text}, {how}, {} cycles: p50 {} p99 {} p99.9 {} max {}{missed}",
        grouped(measured.cycles),
        time(measured.p50_ns),
        time(measured.p99_ns),
        time(measured.p999_ns),
        time(measured.max_ns)
    )
}

fn remedy(facts: &MachineFacts, measured: &WakeUpMeasurement) -> String {
    let mut ways = Vec::new();
    if measured.priority.is_none() {
        ways.push("obtain SCHED_FIFO (above)");
    }
    if measured.core.is_none() {
        ways.push("give the executor a core of its own (executor.core, isolcpus)");
    }
    if facts.kernel.virtual_machine.is_some() {
        ways.push("run outside of the virtual machine");
    }
    if !facts.kernel.preempt_rt {
        ways.push("use a kernel with PREEMPT_RT");
    }
    if measured.cycles < crate::doctor::grade::CYCLES_MIN {
        ways.push("measure longer (--measure 60s)");
    }
    if ways.is_empty() {
        ways.push(
            "resolve the warnings above and below, and check the BIOS (power management, SMI)",
        );
    }
    ways.join("; ")
}

/// The cell's `stale_after` compared with the measured latency: if it is too short, mere lateness counts as a lost
/// device.
pub(super) fn stale_after(facts: &MachineFacts) -> Vec<HealthFinding> {
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
    fn a_good_machine_is_graded_for_its_period() {
        let facts = MachineFacts {
            measured: Some(measured(21, 38)),
            ..MachineFacts::default()
        };
        let found = wake_up(&facts);
        assert_eq!(found[0].level, FindingLevel::Ok);
        assert!(
            found[0].what.contains("max 38.0 µs → grade A for 1.0 ms"),
            "{found:?}"
        );
    }

    #[test]
    fn a_bad_machine_gets_remedies() {
        let mut facts = MachineFacts::default();
        facts.kernel.virtual_machine = Some("QEMU".to_owned());
        facts.measured = Some(WakeUpMeasurement {
            priority: None,
            core: None,
            ..measured(700, 17_800)
        });
        let found = wake_up(&facts);
        assert_eq!(found[0].level, FindingLevel::Warn);
        assert!(
            found[0].what.contains("without SCHED_FIFO") && found[0].what.contains("grade D"),
            "{found:?}"
        );
        let fix = found[0].fix.clone().unwrap_or_default();
        for word in [
            "SCHED_FIFO",
            "executor.core",
            "virtual machine",
            "PREEMPT_RT",
        ] {
            assert!(fix.contains(word), "{fix}");
        }
    }

    #[test]
    fn an_impossible_measurement_is_a_failure() {
        let mut facts = MachineFacts::default();
        assert_eq!(wake_up(&facts)[0].level, FindingLevel::Note);
        facts.not_measured = Some("Invalid argument".to_owned());
        assert_eq!(wake_up(&facts)[0].level, FindingLevel::Fail);
    }

    #[test]
    fn too_short_warns_and_needlessly_long_is_a_note() {
        let mut facts = MachineFacts {
            measured: Some(measured(700, 9_100)),
            ..MachineFacts::default()
        };
        assert_eq!(stale_after(&facts), []);
        facts.requirements.stale_after_ns = Some(3_000_000);
        let found = stale_after(&facts);
        assert_eq!(found[0].level, FindingLevel::Warn);
        assert!(
            found[0]
                .fix
                .as_deref()
                .is_some_and(|fix| fix.starts_with("stale_after: 19 ms")),
            "{found:?}"
        );
        facts.requirements.stale_after_ns = Some(50_000_000);
        assert_eq!(stale_after(&facts)[0].level, FindingLevel::Ok);
        facts.measured = Some(measured(20, 30));
        assert_eq!(stale_after(&facts)[0].level, FindingLevel::Note);
        facts.requirements.stale_after_ns = Some(3_000_000);
        assert_eq!(stale_after(&facts)[0].level, FindingLevel::Ok);
    }
}
