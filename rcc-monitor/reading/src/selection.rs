//! Selection of the recorded nets and ports by patterns. A pattern of ports remembers whether a monitor has matched it.
//! Used by the thread that writes.

use std::str::FromStr;

use rcc_protocol::pattern::{Pattern, PatternError};

use crate::names::MonitorInfo;

/// A pattern for ports, `net/primitive.port`; without `/` it means the port in any net.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortPattern {
    text: String,
    pattern: Pattern,
    matched: bool,
}

/// The text is not a pattern for whole ports.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PortPatternError {
    /// It is not a pattern.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// It selects an element.
    #[error("`{0}` selects one element: a port is recorded as a whole, so omit the index")]
    Element(String),
}

impl FromStr for PortPattern {
    type Err = PortPatternError;

    fn from_str(text: &str) -> Result<PortPattern, PortPatternError> {
        let pattern: Pattern = text.parse()?;
        match pattern.element {
            Some(_) => Err(PortPatternError::Element(text.to_owned())),
            None => Ok(PortPattern {
                text: text.to_owned(),
                pattern,
                matched: false,
            }),
        }
    }
}

/// The nets and ports that are recorded; an empty list selects all.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Names of nets.
    pub nets: Vec<Pattern>,
    /// Ports.
    pub ports: Vec<PortPattern>,
}

impl Selection {
    /// Returns true if this net is selected.
    #[must_use]
    pub fn has_net(&self, net: &str) -> bool {
        self.nets.is_empty() || self.nets.iter().any(|pattern| pattern.matches(net))
    }

    /// Returns the selected monitors of a net with their indices, and remembers which patterns they match.
    pub fn monitors<'a>(
        &mut self,
        net: &str,
        monitors: &'a [MonitorInfo],
    ) -> Vec<(u32, &'a MonitorInfo)> {
        let all = (0_u32..).zip(monitors);
        if self.ports.is_empty() {
            return all.collect();
        }
        let chosen = all.filter(|(_, monitor)| {
            let name = format!("{net}/{}", monitor.source);
            // Every pattern is asked: several may mean the same port.
            let mut found = false;
            for port in &mut self.ports {
                let matches = port.pattern.matches(&name);
                port.matched |= matches;
                found |= matches;
            }
            found
        });
        chosen.collect()
    }

    /// Returns the patterns for which no net had a monitor.
    #[must_use]
    pub fn unmatched(&self) -> Vec<String> {
        let ports = self.ports.iter().filter(|port| !port.matched);
        ports.map(|port| port.text.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_of_one_element_is_refused() {
        let refused = "line/ik.joints[2]".parse::<PortPattern>();
        assert!(matches!(refused, Err(PortPatternError::Element(_))));
        assert!("line/ik.joints[*]".parse::<PortPattern>().is_ok());
        assert!("".parse::<PortPattern>().is_err());
    }
}
