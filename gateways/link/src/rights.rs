//! The rights of a cell's peers (START, deploy, configure), published as JSON: access control drops a request without a reply, so the
//! peer reads here which right is missing. Pure.

use std::collections::BTreeMap;

use rcc_config::LinkRights;
use rcc_config::link::LinkConfig;
use serde::{Deserialize, Serialize};

use crate::keys::{DeployStep, Operation};

/// Rights of other cells and people on a cell; reading and CANCEL are always allowed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct CellRights {
    /// For each peer, `SITE/NAME`, the nets that it may start.
    pub start: BTreeMap<String, Vec<String>>,
    /// Peers that may load and unload nets.
    pub deploy: Vec<String>,
    /// Peers that may replace the cell's file.
    pub configure: Vec<String>,
    /// Patterns of the topics that leave the cell.
    pub publish: Vec<String>,
}

impl From<&LinkConfig> for CellRights {
    fn from(link: &LinkConfig) -> CellRights {
        let LinkRights {
            start,
            deploy,
            configure,
        } = link.rights.clone();
        CellRights {
            start,
            deploy,
            configure,
            publish: link.publish.clone(),
        }
    }
}

impl CellRights {
    /// Returns the reason why `peer` may not ask for an operation on a net, or nothing if it may.
    #[must_use]
    pub fn refusal(&self, peer: &str, operation: Operation, net: &str) -> Option<String> {
        let named = |peers: &[String]| peers.iter().any(|one| one == peer);
        let (may, asked, key) = match operation {
            // Nothing changes by a check, and stopping is always allowed.
            Operation::Cancel | Operation::Deploy(DeployStep::Check) => return None,
            Operation::Start => {
                let nets = self.start.get(peer);
                let may = nets.is_some_and(|nets| nets.iter().any(|one| one == net));
                (
                    may,
                    format!("start `{net}`"),
                    format!("start: {{{peer}: [{net}]}}"),
                )
            }
            Operation::Deploy(DeployStep::Load | DeployStep::Unload) => (
                named(&self.deploy),
                "deploy here".to_owned(),
                format!("deploy: [{peer}]"),
            ),
            Operation::Deploy(DeployStep::Replace) => (
                named(&self.configure),
                "configure here".to_owned(),
                format!("configure: [{peer}]"),
            ),
        };
        // A peer has either the right to start or those to change.
        let (starts, changes) = (
            self.start.contains_key(peer),
            named(&self.deploy) || named(&self.configure),
        );
        let words = || match (operation, starts, changes) {
            (Operation::Start, _, true) => {
                format!(
                    "{peer} must not {asked}: it may change what is started here, and nobody may do both"
                )
            }
            (Operation::Deploy(_), true, _) => {
                format!("{peer} must not {asked}: it may start nets here, and nobody may do both")
            }
            _ => format!(
                "{peer} must not {asked}: the cell's configuration allows it by `link: {{{key}}}`"
            ),
        };
        (!may).then(words)
    }

    /// Returns a line for each peer that may do something, or one that says that nobody may.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut may: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for (peer, nets) in &self.start {
            let nets = nets.join(", ");
            may.entry(peer).or_default().push(format!("start {nets}"));
        }
        for (what, peers) in [("deploy", &self.deploy), ("configure", &self.configure)] {
            for peer in peers {
                may.entry(peer).or_default().push(what.to_owned());
            }
        }
        if may.is_empty() {
            return vec!["nobody may start, deploy or configure".to_owned()];
        }
        let lines = may.into_iter();
        lines
            .map(|(peer, what)| format!("{peer} may {}", what.join(" and ")))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rights() -> CellRights {
        CellRights {
            start: [("lab/feeder".to_owned(), vec!["close-door".to_owned()])].into(),
            deploy: vec!["lab/office".to_owned()],
            configure: vec!["lab/office".to_owned()],
            publish: vec!["*".to_owned()],
        }
    }

    #[test]
    fn what_no_key_allows_is_refused_with_that_key() {
        let refusal = |peer, operation, net| rights().refusal(peer, operation, net);
        assert_eq!(refusal("lab/feeder", Operation::Start, "close-door"), None);
        let words = "lab/feeder must not start `open-door`: the cell's configuration allows it by \
                     `link: {start: {lab/feeder: [open-door]}}`";
        assert_eq!(
            refusal("lab/feeder", Operation::Start, "open-door").as_deref(),
            Some(words)
        );
        for (step, key) in [
            (DeployStep::Load, "deploy"),
            (DeployStep::Unload, "deploy"),
            (DeployStep::Replace, "configure"),
        ] {
            let operation = Operation::Deploy(step);
            assert_eq!(refusal("lab/office", operation, "line"), None);
            let words = refusal("lab/visitor", operation, "line").expect("refused");
            assert!(
                words.contains(&format!("{{{key}: [lab/visitor]}}")),
                "{words}"
            );
            let both = refusal("lab/feeder", operation, "line").expect("refused");
            assert!(both.ends_with("and nobody may do both"), "{both}");
        }
        let both = refusal("lab/office", Operation::Start, "line").expect("refused");
        assert!(both.ends_with("and nobody may do both"), "{both}");
        for operation in [Operation::Cancel, Operation::Deploy(DeployStep::Check)] {
            assert_eq!(refusal("lab/anyone", operation, "line"), None);
        }
    }

    #[test]
    fn each_peer_has_a_line() {
        let lines = [
            "lab/feeder may start close-door",
            "lab/office may deploy and configure",
        ];
        assert_eq!(rights().lines(), lines);
        let nobody = CellRights::default().lines();
        assert_eq!(nobody, ["nobody may start, deploy or configure"]);
        let read: CellRights =
            serde_json::from_str(&serde_json::to_string(&rights()).expect("JSON")).expect("rights");
        assert_eq!(read, rights());
    }
}
