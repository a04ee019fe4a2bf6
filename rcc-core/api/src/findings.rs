//! Findings of a diagnosis, as `rcc-link doctor --json` gives them to `rcc-cli doctor`.

use serde::{Deserialize, Serialize};

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FindingLevel {
    /// As it should be.
    Ok,
    /// Worth knowing, but not a problem.
    Note,
    /// Works, but worse than possible.
    Warn,
    /// Prevents cells from running, or a link from working.
    Fail,
}

impl FindingLevel {
    /// Returns the word printed before a finding.
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

/// A finding about the link of a cell.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkFinding {
    /// Severity.
    pub level: FindingLevel,
    /// `link`, or the name of a device.
    pub of: String,
    /// Description and remedy, on one line.
    pub what: String,
}
