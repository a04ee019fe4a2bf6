//! The complete report: findings and measurement, as text and as JSON. Pure.

use rcc_core::counted::Counted;
use serde::Serialize;

use super::facts::MachineFacts;
use super::grade::Grade;
use super::measure::WakeUpMeasurement;
use super::{FindingLevel, HealthFinding, checks, worst};
use crate::table::time;

/// Version of the JSON format.
const SCHEMA: u32 = 1;
/// Indentation that fits every level's word.
const MARGIN: &str = "       ";

/// Output of `doctor --output json`; keys are only ever added.
#[derive(Clone, Debug, Serialize)]
pub struct DoctorReport {
    /// Version of the format, 1.
    pub schema: u32,
    /// The cell's requirements.
    pub asked: RequirementsView,
    /// Highest severity of the findings.
    pub worst: FindingLevel,
    /// Grade, if measured.
    pub grade: Option<Grade>,
    /// Shortest `stale_after` that the grade allows, ns.
    pub stale_after_min_ns: Option<u64>,
    /// Measured wake-up latency.
    pub measured: Option<WakeUpMeasurement>,
    /// All findings.
    pub findings: Vec<HealthFinding>,
    /// File in which the grade was stored for `status`.
    pub kept_in: Option<String>,
}

/// Requirements on the machine.
#[derive(Clone, Debug, Serialize)]
pub struct RequirementsView {
    /// Where they are configured.
    pub source: String,
    /// SCHED_FIFO priority.
    pub priority: u8,
    /// Core.
    pub core: Option<usize>,
    /// Period, ns.
    pub period_ns: u64,
    /// `stale_after`, ns.
    pub stale_after_ns: Option<u64>,
}

impl DoctorReport {
    /// Runs all checks on these facts.
    #[must_use]
    pub fn of(facts: &MachineFacts) -> DoctorReport {
        let findings = checks::all(facts);
        let grade = facts.measured.as_ref().map(Grade::of);
        DoctorReport {
            schema: SCHEMA,
            asked: RequirementsView {
                source: facts.requirements.source.clone(),
                priority: facts.requirements.priority,
                core: facts.requirements.core,
                period_ns: facts.requirements.period_ns,
                stale_after_ns: facts.requirements.stale_after_ns,
            },
            worst: worst(&findings),
            grade,
            stale_after_min_ns: grade
                .zip(facts.measured.as_ref())
                .map(|(grade, measured)| grade.stale_after_ns(measured.max_ns, measured.period_ns)),
            measured: facts.measured.clone(),
            findings,
            kept_in: None,
        }
    }

    /// Formats the report for people.
    #[must_use]
    pub fn human(&self) -> String {
        let mut text = format!("requirements from: {}\n", self.asked.source);
        for finding in &self.findings {
            text.push_str(&lines(finding));
            if finding.check == "wake-up"
                && let Some(measured) = &self.measured
            {
                for line in measured.drawing.lines() {
                    text.push_str(&format!("{MARGIN}{line}\n"));
                }
            }
        }
        text.push_str(&self.verdict());
        text
    }

    fn verdict(&self) -> String {
        let count = |level| {
            self.findings
                .iter()
                .filter(|finding| finding.level == level)
                .count()
        };
        let machine = match (self.grade, self.stale_after_min_ns) {
            (Some(grade), Some(stale_ns)) => format!(
                "grade {grade}: {}; stale_after of {} or more",
                grade.suitable_for(),
                time(stale_ns)
            ),
            _ => "not graded: wake-up latency was not measured".to_owned(),
        };
        let rest = match (count(FindingLevel::Fail), count(FindingLevel::Warn)) {
            (0, 0) => "no problems found".to_owned(),
            (0, warnings) => format!("cells can run here; {}", Counted::of(warnings, "warning")),
            (fails, warnings) => format!(
                "{} {} cells from running as configured; {}",
                Counted::of(fails, "problem"),
                if fails == 1 { "prevents" } else { "prevent" },
                Counted::of(warnings, "warning")
            ),
        };
        format!("{machine}\n{rest}\n")
    }
}

/// Formats a finding in one to three lines.
#[must_use]
pub fn lines(finding: &HealthFinding) -> String {
    let mut text = format!(" {:<5} {}\n", finding.level.word(), finding.what);
    if let Some(cause) = &finding.cause {
        text.push_str(&format!("{MARGIN}cause  {cause}\n"));
    }
    if let Some(fix) = &finding.fix {
        text.push_str(&format!("{MARGIN}fix    {fix}\n"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::grade::tests::measured;

    #[test]
    fn the_keys_of_the_json_are_stable() -> Result<(), serde_json::Error> {
        let facts = MachineFacts {
            measured: Some(measured(21, 38)),
            ..MachineFacts::default()
        };
        let value = serde_json::to_value(DoctorReport::of(&facts))?;
        let keys = |value: &serde_json::Value| -> Vec<String> {
            value
                .as_object()
                .map(|object| object.keys().cloned().collect())
                .unwrap_or_default()
        };
        assert_eq!(
            keys(&value),
            [
                "schema",
                "asked",
                "worst",
                "grade",
                "stale_after_min_ns",
                "measured",
                "findings",
                "kept_in"
            ]
        );
        assert_eq!(
            keys(&value["asked"]),
            ["source", "priority", "core", "period_ns", "stale_after_ns"]
        );
        assert_eq!(
            keys(&value["measured"]),
            [
                "priority",
                "core",
                "period_ns",
                "cycles",
                "min_ns",
                "p50_ns",
                "p99_ns",
                "p999_ns",
                "max_ns",
                "missed",
                "preempted",
                "histogram"
            ]
        );
        assert_eq!(
            keys(&value["findings"][0]),
            ["check", "level", "what", "cause", "fix"]
        );
        assert_eq!(
            (&value["grade"], &value["schema"]),
            (&"A".into(), &1.into())
        );
        Ok(())
    }

    #[test]
    fn a_finding_shows_level_cause_and_remedy() {
        let finding = HealthFinding::warn("it limps", "carry it").cause("a stone");
        assert_eq!(
            lines(&finding),
            " WARN  it limps\n       cause  a stone\n       fix    carry it\n"
        );
    }

    #[test]
    fn failures_are_counted_in_the_verdict() {
        // With unknown facts /dev/shm is not writable.
        let report = DoctorReport::of(&MachineFacts::default());
        assert_eq!(report.worst, FindingLevel::Fail);
        assert!(
            report.human().contains("cells from running"),
            "{}",
            report.human()
        );
    }
}
