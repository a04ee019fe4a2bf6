//! The link to other cells, as `rcc-link doctor` has verified it. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Certificates, names and addresses of the cell's link, and who answers there; nothing for a cell without link.
pub(super) fn link(facts: &MachineFacts) -> Vec<HealthFinding> {
    facts.link.clone()
}
