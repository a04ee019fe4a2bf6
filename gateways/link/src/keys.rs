//! Names in the key space of the link: `rcc/SITE/CELL/…`. Pure.

/// First part of every key.
const ROOT: &str = "rcc";

/// The keys of one cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellKeys {
    /// `rcc/SITE/CELL`.
    base: String,
}

/// An operation that a peer asks a cell for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// START: only nets that the configuration names for that peer.
    Start,
    /// CANCEL: always.
    Cancel,
    /// A step of a deployment; only of peers that the configuration names.
    Deploy(DeployStep),
}

/// A step of a deployment; the text comes with the request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeployStep {
    /// Says whether the cell would take a net, or another file of its configuration.
    Check,
    /// LOAD of a net.
    Load,
    /// UNLOAD of `NET#ID`, which was loaded in this way.
    Unload,
    /// Replaces the file of the cell's configuration.
    Replace,
}

impl Operation {
    /// All of them.
    const ALL: [Operation; 6] = [
        Operation::Start,
        Operation::Cancel,
        Operation::Deploy(DeployStep::Check),
        Operation::Deploy(DeployStep::Load),
        Operation::Deploy(DeployStep::Unload),
        Operation::Deploy(DeployStep::Replace),
    ];

    /// Returns its name in keys; that of START and CANCEL is also that of the loader's route.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Operation::Start => "start",
            Operation::Cancel => "cancel",
            Operation::Deploy(DeployStep::Check) => "check",
            Operation::Deploy(DeployStep::Load) => "load",
            Operation::Deploy(DeployStep::Unload) => "unload",
            Operation::Deploy(DeployStep::Replace) => "replace",
        }
    }
}

/// A request as its key says it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RequestKey {
    /// The cell that asks, `SITE/CELL`.
    pub peer: String,
    /// The requested operation.
    pub operation: Operation,
    /// Name of the net, or of the cell whose configuration it is.
    pub net: String,
}

impl CellKeys {
    /// Returns the keys of a cell.
    #[must_use]
    pub fn new(site: &str, cell: &str) -> CellKeys {
        CellKeys::of(&format!("{site}/{cell}"))
    }

    /// Returns the keys of `SITE/CELL`.
    #[must_use]
    pub fn of(cell: &str) -> CellKeys {
        CellKeys {
            base: format!("{ROOT}/{cell}"),
        }
    }

    /// Returns the key of a topic; `None` if its name cannot be a key: with an empty part between two `/`.
    #[must_use]
    pub fn topic(&self, topic: &str) -> Option<String> {
        is_topic(topic).then(|| format!("{}/topic/{topic}", self.base))
    }

    /// Returns the key of an event of this kind.
    #[must_use]
    pub fn event(&self, kind: &str) -> String {
        format!("{}/event/{kind}", self.base)
    }

    /// Returns the key of the states of nets of this name.
    #[must_use]
    pub fn net(&self, net: &str) -> String {
        format!("{}/net/{net}", self.base)
    }

    /// Returns the key of the status, which is asked for.
    #[must_use]
    pub fn status(&self) -> String {
        format!("{}/status", self.base)
    }

    /// Returns the key of what the cell lets its peers do, which is asked for.
    #[must_use]
    pub fn rights(&self) -> String {
        format!("{}/rights", self.base)
    }

    /// Returns the key of the overview, which is published once a second.
    #[must_use]
    pub fn overview(&self) -> String {
        format!("{}/overview", self.base)
    }

    /// Returns the key of the liveliness token of an executor; a part that begins with `@` is matched by no `*`.
    #[must_use]
    pub fn alive(&self, incarnation: &str) -> String {
        format!("{}/@alive/{incarnation}", self.base)
    }

    /// Returns the key expressions of everything below the cell: a part that begins with `@` is matched by no `**`.
    #[must_use]
    pub fn all(&self) -> [String; 2] {
        [format!("{}/**", self.base), self.alive("**")]
    }

    /// Returns the key expression of all events.
    #[must_use]
    pub fn events(&self) -> String {
        self.event("*")
    }

    /// Returns the key expression of all states of nets.
    #[must_use]
    pub fn nets(&self) -> String {
        self.net("*")
    }

    /// Returns the key expression of topics, as `*` or `**` for a part or all parts of a name have it.
    #[must_use]
    pub fn topics(&self, pattern: &str) -> String {
        format!("{}/topic/{pattern}", self.base)
    }

    /// Returns the key expression of the requests of all peers.
    #[must_use]
    pub fn requests(&self) -> String {
        format!("{}/request/*/*/*/*", self.base)
    }

    /// Returns the key with which `peer` (`SITE/CELL`) asks this cell.
    #[must_use]
    pub fn request(&self, peer: &str, operation: Operation, net: &str) -> String {
        format!("{}/request/{peer}/{}/{net}", self.base, operation.name())
    }

    /// Reads a request's key; `None` if it is no request to this cell.
    #[must_use]
    pub fn parse_request(&self, key: &str) -> Option<RequestKey> {
        let rest = key.strip_prefix(&self.base)?.strip_prefix("/request/")?;
        let parts: Vec<&str> = rest.split('/').collect();
        let &[site, cell, operation, net] = parts.as_slice() else {
            return None;
        };
        let operation = Operation::ALL
            .into_iter()
            .find(|known| known.name() == operation)?;
        Some(RequestKey {
            peer: format!("{site}/{cell}"),
            operation,
            net: net.to_owned(),
        })
    }
}

/// Returns true if the name of a topic can be a part of a key.
#[must_use]
pub fn is_topic(topic: &str) -> bool {
    let is_valid = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    let is_part = |part: &str| !part.is_empty() && part.chars().all(is_valid);
    topic.len() <= 64 && topic.split('/').all(is_part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_read_as_it_was_written() {
        let keys = CellKeys::new("lab", "press");
        let key = keys.request("hall-2/feeder", Operation::Start, "close-door");
        assert_eq!(key, "rcc/lab/press/request/hall-2/feeder/start/close-door");
        let read = keys.parse_request(&key).expect("a request");
        assert_eq!(
            read,
            RequestKey {
                peer: "hall-2/feeder".to_owned(),
                operation: Operation::Start,
                net: "close-door".to_owned()
            }
        );
        for other in [
            "rcc/lab/pres/request/a/b/start/n",
            "rcc/lab/press/request/a/b/abort/n",
            "rcc/lab/press/request/a/b/start",
            "rcc/lab/press/request/a/b/start/n/m",
            "rcc/lab/press2/request/a/b/start/n",
        ] {
            assert_eq!(keys.parse_request(other), None, "{other}");
        }
    }

    #[test]
    fn a_topic_that_cannot_be_a_key_has_none() {
        let keys = CellKeys::new("lab", "press");
        assert_eq!(
            keys.topic("door/open").as_deref(),
            Some("rcc/lab/press/topic/door/open")
        );
        for bad in [
            "", "a//b", "a/", "/a", "a/*", "a b", "a/@b", "a$", "a#", "a?",
        ] {
            assert_eq!(keys.topic(bad), None, "{bad}");
        }
    }
}
