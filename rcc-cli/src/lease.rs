//! A lease of the command line: it counts as present while it renews the lease, and shows what its rules do. Main
//! thread.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use rcc_api::bodies::{CommandView, LeaseBody, LeaseDone, LeaseGranted, RuleView};
use rcc_api::codes;

use crate::client::LoaderClient;
use crate::failure::Failure;

/// Time after which the lease expires; longer than a loader needs to be restarted.
const EXPIRES: Duration = Duration::from_secs(3);
/// Interval between two renewals.
const RENEW_EVERY: Duration = Duration::from_millis(250);

/// A lease that was granted.
#[derive(Debug)]
pub struct HeldLease {
    /// Its number.
    pub number: u64,
    renewed: Instant,
}

impl HeldLease {
    /// Asks for a lease.
    ///
    /// # Errors
    /// Fails if the loader cannot be reached, or all leases are in use.
    pub fn grant(client: &LoaderClient) -> Result<HeldLease, Failure> {
        let expires_ms = EXPIRES.as_millis() as u64;
        let body = text(&LeaseBody { expires_ms })?;
        let granted: LeaseGranted = client.post("/leases", body)?;
        Ok(HeldLease {
            number: granted.lease,
            renewed: Instant::now(),
        })
    }

    /// Renews the lease if it is time. A loader that does not answer is asked again until the lease has expired.
    ///
    /// # Errors
    /// Fails if the lease is lost.
    pub fn renew(&mut self, client: &LoaderClient) -> Result<(), Failure> {
        if self.renewed.elapsed() < RENEW_EVERY {
            return Ok(());
        }
        let path = format!("/leases/{}/renew", self.number);
        match client.post::<LeaseDone>(&path, String::new()) {
            Ok(_) => self.renewed = Instant::now(),
            Err(failure) if failure.exit == codes::exit::UNREACHABLE => {}
            Err(failure) if failure.exit == codes::exit::TIMEOUT => {}
            Err(failure) => return Err(failure),
        }
        match self.renewed.elapsed() < EXPIRES {
            true => Ok(()),
            false => Err(Failure::new(
                codes::LOADER_SILENT,
                format!("the loader did not answer for {EXPIRES:?}, so the lease is lost"),
                "its rules are disarmed and its commands are canceled; start the loader and try again",
            )),
        }
    }

    /// Ends the lease; what is bound to it is canceled.
    pub fn end(self, client: &LoaderClient) {
        // If the loader cannot be reached, the lease expires by itself.
        let _ = client.delete::<LeaseDone>(&format!("/leases/{}", self.number));
    }
}

/// A body of a request as text.
///
/// # Errors
/// Fails if a name is not UTF-8.
pub fn text<T: serde::Serialize>(body: &T) -> Result<String, Failure> {
    serde_json::to_string(body)
        .map_err(|error| Failure::new(codes::BAD_REQUEST, error.to_string(), "use UTF-8 names"))
}

/// The state of each rule, by id, that was shown last.
#[derive(Debug, Default)]
pub struct ShownRules {
    states: BTreeMap<u64, String>,
}

impl ShownRules {
    /// Returns a line for each of these rules that has changed its state.
    pub fn changes(&mut self, rules: &[&RuleView]) -> Vec<String> {
        let mut lines = Vec::new();
        for rule in rules {
            let shown = self.states.insert(rule.rule, rule.state.clone());
            if shown.as_deref() != Some(rule.state.as_str()) && rule.state != "armed" {
                lines.push(line(rule));
            }
        }
        lines
    }
}

/// Returns true if the rule may still fire.
#[must_use]
pub fn may_fire(rule: &RuleView) -> bool {
    rule.state == "armed" || rule.state == "due"
}

/// Returns true if one of the rules may still fire, or one of the commands that they started is active.
#[must_use]
pub fn is_busy(rules: &[&RuleView], commands: &[CommandView], loaded: &[u64]) -> bool {
    let started = |command: &&CommandView| {
        let name = format!("{}#{}", command.net, command.id);
        loaded.contains(&command.id) || rules.iter().any(|rule| rule.start.contains(&name))
    };
    let mut started = commands.iter().filter(started);
    started.any(CommandView::is_active) || rules.iter().any(|rule| may_fire(rule))
}

/// Formats a rule that has changed its state.
#[must_use]
pub fn line(rule: &RuleView) -> String {
    let what = match &rule.words {
        Some(words) => format!("{}: {words}", rule.state),
        None => format!("{} in cycle {}", rule.state, rule.cycle),
    };
    format!("rule {} `{}`  {what}", rule.rule, rule.name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rule_is_shown_once_in_each_state() {
        let mut shown = ShownRules::default();
        let mut rule = RuleView {
            rule: 3,
            name: "lift".to_owned(),
            state: "armed".to_owned(),
            start: vec!["lift#7".to_owned()],
            ..RuleView::default()
        };
        assert!(shown.changes(&[&rule]).is_empty());
        assert!(is_busy(&[&rule], &[], &[]));
        (rule.state, rule.cycle) = ("fired".to_owned(), 42);
        assert_eq!(
            shown.changes(&[&rule]),
            ["rule 3 `lift`  fired in cycle 42"]
        );
        assert!(shown.changes(&[&rule]).is_empty());
        let running = CommandView {
            id: 7,
            net: "lift".to_owned(),
            state: "running".to_owned(),
            ..CommandView::default()
        };
        assert!(is_busy(&[&rule], std::slice::from_ref(&running), &[]));
        let over = CommandView {
            state: "terminated".to_owned(),
            ..running
        };
        assert!(!is_busy(&[&rule], &[over], &[7]));
    }
}
