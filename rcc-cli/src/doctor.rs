//! What the machine grants and how it really behaves, as findings with causes and remedies.
//! Run by the main thread of `rcc-cli doctor`; only [`measure`] starts a thread of its own.
//!
//! [`facts`] are read once, [`checks`] are pure functions of them, [`measure`] is the one that takes its time.

use serde::Serialize;

pub mod checks;
pub mod clean;
pub mod facts;
pub mod grade;
pub mod histogram;
pub mod link;
pub mod measure;
pub mod processes;
pub mod record;
pub mod report;
pub mod driver_status;
pub mod trial;
pub mod requirements;

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FindingLevel {
    /// As it should be.
    Ok,
    /// Worth knowing; nothing is wrong because of it.
    Note,
    /// It works, but worse than it could.
    Warn,
    /// It prevents a cell from running.
    Fail,
}

impl FindingLevel {
    /// As printed before a finding.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            FindingLevel::Ok => "ok",
            FindingLevel::Note => "note",
            FindingLevel::Warn => "WARN",
            FindingLevel::Fail => "FAIL",
        }
    }
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct HealthFinding {
    /// Which check found it.
    pub check: &'static str,
    /// How bad it is.
    pub level: FindingLevel,
    /// What is so.
    pub what: String,
    /// Why, where it is known.
    pub cause: Option<String>,
    /// What to do.
    pub fix: Option<String>,
}

impl HealthFinding {
    fn new(level: FindingLevel, what: impl Into<String>) -> HealthFinding {
        HealthFinding {
            // The table of checks writes it in.
            check: "",
            level,
            what: what.into(),
            cause: None,
            fix: None,
        }
    }

    /// As it should be.
    #[must_use]
    pub fn ok(what: impl Into<String>) -> HealthFinding {
        HealthFinding::new(FindingLevel::Ok, what)
    }

    /// Worth knowing.
    #[must_use]
    pub fn note(what: impl Into<String>) -> HealthFinding {
        HealthFinding::new(FindingLevel::Note, what)
    }

    /// It works, but worse than it could.
    #[must_use]
    pub fn warn(what: impl Into<String>, fix: impl Into<String>) -> HealthFinding {
        HealthFinding::new(FindingLevel::Warn, what).fix(fix)
    }

    /// It prevents a cell from running.
    #[must_use]
    pub fn fail(what: impl Into<String>, fix: impl Into<String>) -> HealthFinding {
        HealthFinding::new(FindingLevel::Fail, what).fix(fix)
    }

    /// Worse if the cell's file requires what was refused (`executor: {rt: required}`).
    #[must_use]
    pub fn required(mut self, required: bool) -> HealthFinding {
        if required && self.level == FindingLevel::Warn {
            self.level = FindingLevel::Fail;
        }
        self
    }

    /// Why it is so.
    #[must_use]
    pub fn cause(mut self, cause: impl Into<String>) -> HealthFinding {
        self.cause = Some(cause.into());
        self
    }

    /// What to do.
    #[must_use]
    pub fn fix(mut self, fix: impl Into<String>) -> HealthFinding {
        self.fix = Some(fix.into());
        self
    }
}

/// The worst level among findings.
#[must_use]
pub fn worst(findings: &[HealthFinding]) -> FindingLevel {
    let levels = findings.iter().map(|finding| finding.level);
    levels.max().unwrap_or(FindingLevel::Ok)
}
