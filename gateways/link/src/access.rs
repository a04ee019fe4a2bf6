//! Permissions to send over a link with mutual TLS: Zenoh's access control, by the common names of certificates. Pure.
//!
//! Everything that no rule allows is dropped in silence; the other side sees no answer.

use rcc_config::LinkRights;
use serde_json::{Value, json};

use crate::keys::{CellKeys, DeployStep, Operation};

/// Role of a process on the link.
#[derive(Clone, Copy, Debug)]
pub enum Role<'a> {
    /// Carries this cell.
    Gateway {
        /// The cell, `SITE/CELL`; the certificate must have this common name.
        cell: &'a str,
        /// Rights of its peers.
        rights: &'a LinkRights,
    },
    /// Takes topics of this cell, `SITE/CELL`, from a process with its certificate only.
    Device {
        /// The cell.
        peer: &'a str,
    },
    /// Asks, and publishes nothing.
    Operator,
}

/// Messages of one who publishes.
const GIVES: [&str; 5] = [
    "put",
    "delete",
    "reply",
    "liveliness_token",
    "declare_queryable",
];
/// Messages of one who reads.
const TAKES: [&str; 4] = [
    "declare_subscriber",
    "declare_liveliness_subscriber",
    "liveliness_query",
    "query",
];
/// Id of the subject that stands for every certificate of the authority.
const ANYONE: &str = "anyone";

/// Rules under construction.
#[derive(Default)]
struct Rules {
    rules: Vec<Value>,
    policies: Vec<Value>,
    peers: Vec<String>,
}

impl Rules {
    /// Allows messages from (`ingress`) or to (`egress`) processes with the common name `peer`, or to all.
    fn allow(&mut self, flow: &str, peer: Option<&str>, messages: &[&str], keys: &[String]) {
        let id = format!("{}", self.rules.len());
        self.rules.push(json!({
            "id": id, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys,
        }));
        let subject = peer.unwrap_or(ANYONE);
        if let Some(peer) = peer
            && !self.peers.iter().any(|known| known == peer)
        {
            self.peers.push(peer.to_owned());
        }
        self.policies
            .push(json!({"rules": [id], "subjects": [subject]}));
    }

    fn json(self) -> Value {
        let peers = self.peers.iter();
        let subjects = peers.map(|peer| json!({"id": peer, "cert_common_names": [peer]}));
        let subjects: Vec<Value> = subjects.chain([json!({"id": ANYONE})]).collect();
        json!({
            "enabled": true,
            "default_permission": "deny",
            "rules": self.rules,
            "subjects": subjects,
            "policies": self.policies,
        })
    }
}

/// Returns the access control of a role as Zenoh's configuration has it; `None` for one that receives answers only.
#[must_use]
pub fn access_control(role: Role<'_>) -> Option<Value> {
    let mut rules = Rules::default();
    match role {
        Role::Operator => return None,
        Role::Gateway { cell, rights } => {
            let keys = CellKeys::of(cell);
            rules.allow("egress", None, &GIVES, &keys.all());
            let [reads, query] = [&TAKES[..3], &TAKES[3..]];
            rules.allow("ingress", None, reads, &CellKeys::of("*/*").all());
            let asked = [
                CellKeys::of("*/*").status(),
                // So that one whose request is dropped learns why.
                CellKeys::of("*/*").rights(),
                keys.request("*/*", Operation::Cancel, "*"),
                // Nothing changes by it. The gateway answers who may not deploy; a dropped request would have no words.
                keys.request("*/*", Operation::Deploy(DeployStep::Check), "*"),
            ];
            rules.allow("ingress", None, query, &asked);
            let start = rights.start.iter();
            let start = start.flat_map(|(peer, nets)| nets.iter().map(move |net| (peer, net)));
            for (peer, net) in start {
                let asked = keys.request(peer, Operation::Start, net);
                rules.allow("ingress", Some(peer), query, &[asked]);
            }
            for peer in &rights.deploy {
                let asked = [DeployStep::Load, DeployStep::Unload]
                    .map(|step| keys.request(peer, Operation::Deploy(step), "*"));
                rules.allow("ingress", Some(peer), query, &asked);
            }
            for peer in &rights.configure {
                let asked = keys.request(peer, Operation::Deploy(DeployStep::Replace), "*");
                rules.allow("ingress", Some(peer), query, &[asked]);
            }
        }
        Role::Device { peer } => {
            let all = CellKeys::of(peer).all();
            rules.allow("egress", None, &TAKES, &all);
            rules.allow("ingress", Some(peer), &GIVES, &all);
        }
    }
    Some(rules.json())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the keys with which processes of this subject may send a message.
    fn keys(control: &Value, subject: &str, flow: &str, message: &str) -> Vec<String> {
        let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
        let policies = list(&control["policies"]);
        let of_subject = policies
            .iter()
            .filter(|it| list(&it["subjects"]).contains(&json!(subject)));
        let ids: Vec<Value> = of_subject.flat_map(|it| list(&it["rules"])).collect();
        let rules = list(&control["rules"]);
        let allowed = rules.iter().filter(|rule| {
            ids.contains(&rule["id"])
                && list(&rule["flows"]).contains(&json!(flow))
                && list(&rule["messages"]).contains(&json!(message))
        });
        let keys = allowed.flat_map(|rule| list(&rule["key_exprs"]));
        keys.filter_map(|key| key.as_str().map(str::to_owned))
            .collect()
    }

    #[test]
    fn nets_and_configuration_come_from_the_certificates_of_those_who_may_only() {
        let rights = LinkRights {
            deploy: vec!["lab/office".to_owned()],
            configure: vec!["lab/office".to_owned(), "lab/chief".to_owned()],
            ..LinkRights::default()
        };
        let role = Role::Gateway {
            cell: "lab/press",
            rights: &rights,
        };
        let control = access_control(role).expect("rules");
        let key =
            |peer: &str, operation: &str| format!("rcc/lab/press/request/{peer}/{operation}/*");
        assert_eq!(
            keys(&control, "lab/office", "ingress", "query"),
            ["load", "unload", "replace"].map(|operation| key("lab/office", operation))
        );
        assert_eq!(
            keys(&control, "lab/chief", "ingress", "query"),
            [key("lab/chief", "replace")]
        );
        let anyone = keys(&control, ANYONE, "ingress", "query");
        for operation in ["load", "unload", "replace", "start"] {
            assert!(
                !anyone
                    .iter()
                    .any(|key| key.contains(&format!("/{operation}/"))),
                "{anyone:?}"
            );
        }
    }

    #[test]
    fn a_net_is_started_by_the_certificate_of_its_peer_only_and_canceled_by_anyone() {
        let nets = vec!["close-door".to_owned()];
        let rights = LinkRights {
            start: [("lab/feeder".to_owned(), nets)].into(),
            ..LinkRights::default()
        };
        let role = Role::Gateway {
            cell: "lab/press",
            rights: &rights,
        };
        let control = access_control(role).expect("rules");
        assert_eq!(control["default_permission"], "deny");
        assert_eq!(
            keys(&control, "lab/feeder", "ingress", "query"),
            ["rcc/lab/press/request/lab/feeder/start/close-door"]
        );
        assert_eq!(
            keys(&control, ANYONE, "ingress", "query"),
            [
                "rcc/*/*/status",
                "rcc/*/*/rights",
                "rcc/lab/press/request/*/*/cancel/*",
                "rcc/lab/press/request/*/*/check/*"
            ]
        );
        assert!(keys(&control, ANYONE, "ingress", "put").is_empty());
        assert!(keys(&control, ANYONE, "egress", "put").contains(&"rcc/lab/press/**".to_owned()));
    }

    #[test]
    fn a_device_takes_values_of_its_peer_from_the_peers_certificate_only() {
        let control = access_control(Role::Device { peer: "lab/press" }).expect("rules");
        assert!(keys(&control, ANYONE, "ingress", "put").is_empty());
        let allowed = keys(&control, "lab/press", "ingress", "put");
        assert_eq!(allowed, ["rcc/lab/press/**", "rcc/lab/press/@alive/**"]);
        assert_eq!(access_control(Role::Operator), None);
    }
}
