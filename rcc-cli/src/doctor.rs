//! Checks of the machine and its measured behaviour, as findings with causes and remedies. Run by the main thread of
//! `rcc-cli doctor`; only [`measure`] starts a thread of its own.
//!
//! [`facts`] are read once, [`checks`] are pure functions of them, and [`measure`] is the only part that takes time.

pub use rcc_api::findings::FindingLevel;
use serde::Serialize;

pub mod checks;
pub mod clean;
pub mod driver_status;
pub mod facts;
pub mod grade;
pub mod histogram;
pub mod link;
pub mod measure;
pub mod record;
pub mod report;
pub mod requirements;
pub mod trial;

/// Result of one check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct HealthFinding {
    /// Name of the check.
    pub check: &'static str,
    /// Severity.
    pub level: FindingLevel,
    /// The finding itself.
    pub what: String,
    /// Cause, if known.
    pub cause: Option<String>,
    /// Remedy.
    pub fix: Option<String>,
}

impl HealthFinding {
    fn new(level: FindingLevel, what: impl Into<String>) -> HealthFinding {
        HealthFinding {
            // Filled in by the table of checks.
            check: "",
            level,
            what: what.into(),
            cause: None,
            fix: None,
        }
    }

    /// Creates a finding that everything is as it should be.
    #[must_use]
    pub fn ok(what: impl Into<String>) -> HealthFinding {
        HealthFinding::new(FindingLevel::Ok, what)
    }

    /// Creates a finding worth knowing.
    #[must_use]
    pub fn note(what: impl Into<String>) -> HealthFinding {
        HealthFinding::new(FindingLevel::Note, what)
    }

    /// Creates a finding of something that works worse than possible.
    #[must_use]
    pub fn warn(what: impl Into<String>, fix: impl Into<String>) -> HealthFinding {
        HealthFinding::new(FindingLevel::Warn, what).fix(fix)
    }

    /// Creates a finding that prevents cells from running.
    #[must_use]
    pub fn fail(what: impl Into<String>, fix: impl Into<String>) -> HealthFinding {
        HealthFinding::new(FindingLevel::Fail, what).fix(fix)
    }

    /// Raises a warning to a failure if the cell requires what was refused (`executor: {rt: required}`).
    #[must_use]
    pub fn required(mut self, required: bool) -> HealthFinding {
        if required && self.level == FindingLevel::Warn {
            self.level = FindingLevel::Fail;
        }
        self
    }

    /// Adds the cause.
    #[must_use]
    pub fn cause(mut self, cause: impl Into<String>) -> HealthFinding {
        self.cause = Some(cause.into());
        self
    }

    /// Adds the remedy.
    #[must_use]
    pub fn fix(mut self, fix: impl Into<String>) -> HealthFinding {
        self.fix = Some(fix.into());
        self
    }
}

/// Returns the highest severity of some findings.
#[must_use]
pub fn worst(findings: &[HealthFinding]) -> FindingLevel {
    let levels = findings.iter().map(|finding| finding.level);
    levels.max().unwrap_or(FindingLevel::Ok)
}
