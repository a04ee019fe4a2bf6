//! The link to other cells, as `rcc-link doctor` has verified it. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Certificates, names and addresses of the cell's link, and who answers there; nothing for a cell without link.
pub(super) fn link(facts: &MachineFacts) -> Vec<HealthFinding> {
    match &facts.not_verified {
        None => facts.link.clone(),
        Some(reason) => vec![HealthFinding::warn(
            format!("the link to other cells cannot be verified: {reason}"),
            "build `rcc-link` (`cargo build --release -p rcc-link`) and put it beside rcc-cli",
        )],
    }
}
