//! Rules and leases by name: names of conditions become numbers, and lists of rules get their names back. Run by
//! blocking threads of the server.

use rcc_api::bodies::{
    CommandRef, Done, LeaseBody, LeaseCommands, LeaseDone, LeaseGranted, OnClientLoss, RecordBody,
    RecordedView, RuleBody, RuleNumber, RuleView, RulesBody, RulesInstalled, Start,
};
use rcc_api::codes;
use rcc_api::conditions;
use rcc_api::error::ApiError;
use rcc_core::message::CommandState;
use rcc_language::condition::{self, ConditionTerm};
use rcc_protocol::control::{Answer, Call, Refusal, SWITCH_MAX};
use rcc_protocol::events::event_text;
use rcc_protocol::rules::{
    ListedRule, NewRule, RULE_TERMS_MAX, RULE_TEXT_MAX, RULES_PER_REQUEST, Rule, RuleFault,
    RuleRecording,
};

use super::{Operation, Service, unexpected};
use crate::server::caller::Caller;
use crate::server::executor::ExecutorConnection;
use crate::server::store::CommandStore;

/// An attached executor, and the names of its commands.
struct Resolver<'a> {
    service: &'a Service,
    attached: &'a ExecutorConnection,
    store: &'a CommandStore,
}

impl Service {
    /// START, with rules and a lease.
    ///
    /// # Errors
    /// As for [`Service::operate`] and [`Service::install_rules`]; if START was refused, no rule is left.
    pub fn start(&self, caller: &Caller, name: &str, options: &Start) -> Result<Done, ApiError> {
        if options.rules.is_empty() && options.lease.is_none() {
            return self.operate(caller, name, Operation::START);
        }
        let (attached, store) = self.attach()?;
        let named = [CommandRef::Name(name.to_owned())];
        let ready = |state| Operation::START.suits(state);
        let start = self.named(&attached, &store, &named, ready)?;
        let lease = self.checked_lease(options.lease)?;
        let installed = self.rules_of_start(caller, &options.rules, options.lease)?;
        // By its id: the name could mean another command by now.
        let id = start.first().copied().unwrap_or_default().to_string();
        let started = self.operate(caller, &id, Operation::Start { lease });
        if let Err(error) = &started
            && is_refusal(error)
        {
            self.remove_rules(&installed);
        }
        started
    }

    /// Returns the number of a lease that comes with START or a hand-over; 0: none. The executor takes 0 for none, which
    /// clients must not say by mistake.
    pub(super) fn checked_lease(&self, lease: Option<u64>) -> Result<u64, ApiError> {
        match lease {
            Some(0) => {
                let (index, fault) = (0, RuleFault::LeaseUnknown);
                let refusal = Refusal::Rule { index, fault };
                Err(self.with_names(None, |names| names.refusal(0, refusal)))
            }
            lease => Ok(lease.unwrap_or(0)),
        }
    }

    /// Installs rules that come with START or a hand-over. Returns their numbers.
    pub(super) fn rules_of_start(
        &self,
        caller: &Caller,
        rules: &[RuleBody],
        lease: Option<u64>,
    ) -> Result<Vec<u64>, ApiError> {
        if rules.is_empty() {
            return Ok(Vec::new());
        }
        let body = RulesBody {
            rules: rules.to_vec(),
            lease,
        };
        let installed = self.install_rules(caller, &body)?;
        Ok(installed.rules.iter().map(|rule| rule.rule).collect())
    }

    /// Removes rules whose START was refused.
    pub(super) fn remove_rules(&self, rules: &[u64]) {
        for &id in rules {
            if let Err(error) = self.executor.call(&Call::RemoveRule { id }) {
                tracing::warn!(id, message = error.message, "cannot remove a rule");
            }
        }
    }

    /// Installs rules: all of them between the same two cycles, or none.
    ///
    /// # Errors
    /// Returns an error if there is no executor, a condition or a name is wrong, or the executor refuses.
    pub fn install_rules(
        &self,
        caller: &Caller,
        body: &RulesBody,
    ) -> Result<RulesInstalled, ApiError> {
        let (attached, store) = self.attach()?;
        self.require_agreement(&attached)?;
        if body.rules.is_empty() || body.rules.len() > RULES_PER_REQUEST {
            return Err(ApiError::new(
                codes::BAD_REQUEST,
                format!("the request has {} rules", body.rules.len()),
                format!("send 1 to {RULES_PER_REQUEST} rules at a time"),
            ));
        }
        let resolver = Resolver {
            service: self,
            attached: &attached,
            store: &store,
        };
        let rules = body
            .rules
            .iter()
            .map(|rule| resolver.rule(rule, body.lease));
        let rules = rules.collect::<Result<Vec<NewRule>, ApiError>>()?;
        let names: Vec<String> = rules.iter().map(|rule| rule.name.clone()).collect();
        let refused = |id, refusal| self.rule_refused(&store, &names, id, refusal);
        match self
            .executor
            .call_for(caller, &Call::InstallRules { rules })?
        {
            Answer::RulesInstalled { first, cycle } => {
                let numbered = (first..).zip(names);
                let rules = numbered.map(|(rule, name)| RuleNumber { rule, name });
                Ok(RulesInstalled {
                    cycle,
                    rules: rules.collect(),
                })
            }
            Answer::Refused(refusal) => Err(refused(0, refusal)),
            Answer::RefusedFor { id, refusal } => Err(refused(id, refusal)),
            _ => Err(unexpected()),
        }
    }

    /// The error for a refused installation: rules are named, and nothing was installed.
    fn rule_refused(
        &self,
        store: &CommandStore,
        names: &[String],
        id: u64,
        refusal: Refusal,
    ) -> ApiError {
        let index = match refusal {
            Refusal::Rule { index, .. } | Refusal::RuleCommand { index, .. } => Some(index),
            _ => None,
        };
        let mut error = self.with_names(Some(store), |names| names.refusal(id, refusal));
        let name = index.and_then(|index| names.get(index as usize));
        if let (Some(name), Some(index)) = (name, index) {
            let numbered = format!("rule {} of the request", index + 1);
            error.message = error
                .message
                .replacen(&numbered, &format!("rule `{name}`"), 1);
        }
        error.message.push_str("; no rule was installed");
        error
    }

    /// Lists all rules, sorted by number.
    ///
    /// # Errors
    /// Returns an error if there is no executor.
    pub fn rules(&self) -> Result<Vec<RuleView>, ApiError> {
        let (_, store) = self.attach()?;
        let mut rules = Vec::new();
        let mut after = 0;
        loop {
            let answer = self.executor.call(&Call::Rules { after })?;
            let Answer::Rules(listed) = answer else {
                return Err(unexpected());
            };
            let Some(last) = listed.last() else {
                return Ok(rules);
            };
            after = last.status.id;
            rules.extend(listed.iter().map(|rule| self.rule_view(&store, rule)));
        }
    }

    /// Returns one rule.
    ///
    /// # Errors
    /// Returns an error if there is no executor or no such rule.
    pub fn rule(&self, id: u64) -> Result<RuleView, ApiError> {
        let (_, store) = self.attach()?;
        let after = id.saturating_sub(1);
        match self.executor.call(&Call::Rules { after })? {
            Answer::Rules(listed) => {
                let found = listed.iter().find(|rule| rule.status.id == id);
                let found = found.ok_or(Refusal::UnknownRule);
                found
                    .map(|rule| self.rule_view(&store, rule))
                    .map_err(|refusal| self.with_names(None, |names| names.refusal(0, refusal)))
            }
            _ => Err(unexpected()),
        }
    }

    /// Removes a rule.
    ///
    /// # Errors
    /// Returns an error if there is no executor or no such rule.
    pub fn remove_rule(&self, caller: &Caller, id: u64) -> Result<RuleNumber, ApiError> {
        let name = self.rule(id)?.name;
        self.simple_call(caller, &Call::RemoveRule { id })?;
        Ok(RuleNumber { rule: id, name })
    }

    /// Grants a lease.
    ///
    /// # Errors
    /// Returns an error if there is no executor, the time is out of range, or all leases are in use.
    pub fn grant_lease(&self, caller: &Caller, body: &LeaseBody) -> Result<LeaseGranted, ApiError> {
        let expires_ms = body.expires_ms;
        let expires_ns = expires_ms.saturating_mul(1_000_000);
        let call = Call::GrantLease { expires_ns };
        match self.executor.call_for(caller, &call)? {
            Answer::Reserved { id: lease } => Ok(LeaseGranted { lease, expires_ms }),
            Answer::Refused(refusal) => {
                Err(self.with_names(None, |names| names.refusal(0, refusal)))
            }
            _ => Err(unexpected()),
        }
    }

    /// Renews a lease.
    ///
    /// # Errors
    /// Returns an error if there is no executor or no such lease.
    pub fn renew_lease(&self, caller: &Caller, lease: u64) -> Result<LeaseDone, ApiError> {
        let cycle = self.simple_call(caller, &Call::RenewLease { lease })?;
        Ok(LeaseDone { lease, cycle })
    }

    /// Ends a lease now, as if it had expired.
    ///
    /// # Errors
    /// Returns an error if there is no executor or no such lease.
    pub fn end_lease(&self, caller: &Caller, lease: u64) -> Result<LeaseDone, ApiError> {
        let cycle = self.simple_call(caller, &Call::EndLease { lease })?;
        Ok(LeaseDone { lease, cycle })
    }

    /// Binds commands to a lease.
    ///
    /// # Errors
    /// Returns an error if there is no executor, no such lease or command, or one that has ended.
    pub fn bind_lease(
        &self,
        caller: &Caller,
        lease: u64,
        body: &LeaseCommands,
    ) -> Result<LeaseDone, ApiError> {
        let (attached, store) = self.attach()?;
        let lives = |state: CommandState| state == CommandState::Ready || state.is_active();
        let commands = self.named(&attached, &store, body.commands.commands(), lives)?;
        let cycle = self.bind(caller, lease, commands)?;
        Ok(LeaseDone { lease, cycle })
    }

    fn bind(&self, caller: &Caller, lease: u64, commands: Vec<u64>) -> Result<u64, ApiError> {
        self.simple_call(caller, &Call::BindLease { lease, commands })
    }

    /// Makes a call that is done or refused; returns the cycle.
    fn simple_call(&self, caller: &Caller, call: &Call) -> Result<u64, ApiError> {
        match self.executor.call_for(caller, call)? {
            Answer::Done { cycle } => Ok(cycle),
            Answer::Refused(refusal) => {
                Err(self.with_names(None, |names| names.refusal(0, refusal)))
            }
            _ => Err(unexpected()),
        }
    }

    fn rule_view(&self, store: &CommandStore, listed: &ListedRule) -> RuleView {
        let ListedRule {
            rule,
            status,
            name,
            when,
        } = listed;
        let named = |ids: &[u64]| {
            let ids = ids.iter().filter(|id| **id != 0);
            ids.map(|id| match self.net(store, *id) {
                net if net.is_empty() => format!("#{id}"),
                net => format!("{net}#{id}"),
            })
            .collect()
        };
        let end = self.with_names(Some(store), |names| names.rule_end(status));
        let (code, words) = end.unzip();
        RuleView {
            rule: status.id,
            name: name.clone(),
            when: when.clone(),
            stop: named(&rule.stop),
            cancel: named(&rule.cancel),
            start: named(&rule.start),
            record: rule.record.map(|record| RecordBody {
                times: record.times,
                distance_ms: record.distance_ns / 1_000_000,
                edge: record.edge,
            }),
            recorded: rule.record.map(|_| RecordedView {
                recordings: status.recordings,
                skipped: status.skipped,
                cycle: (status.recordings > 0).then_some(status.recorded_cycle),
            }),
            state: status.state.name().to_owned(),
            cycle: status.cycle,
            lease: (status.lease != 0).then_some(status.lease),
            on_client_loss: match status.goes_on {
                true => OnClientLoss::GoOn,
                false => OnClientLoss::Cancel,
            },
            code: code.flatten(),
            words,
        }
    }
}

impl Resolver<'_> {
    fn rule(&self, body: &RuleBody, lease: Option<u64>) -> Result<NewRule, ApiError> {
        let name = body.name.as_deref().unwrap_or(&body.when);
        let name = shortened(&event_text(name));
        let bad = |message: String, help: &str| {
            let message = format!("rule `{name}`: {message}");
            ApiError::new(codes::BAD_CONDITION, message, help)
        };
        let terms = condition::parse_short(&body.when)
            .map_err(|fault| bad(fault.to_string(), &fault.help))?;
        if terms.len() > RULE_TERMS_MAX {
            let help =
                "split it into several rules, or let a net compute a part of it as a Bool output";
            let message = format!(
                "its condition has {} terms and operators, at most {RULE_TERMS_MAX} are possible",
                terms.len()
            );
            return Err(bad(message, help));
        }
        let mut rule = Rule {
            stop: self.ids(body.stop.commands(), CommandState::is_active)?,
            cancel: self.ids(body.cancel.commands(), CommandState::is_active)?,
            start: self.ids(body.start.commands(), |state| Operation::START.suits(state))?,
            lease: self.service.checked_lease(body.lease.or(lease))?,
            goes_on: body.on_client_loss == OnClientLoss::GoOn,
            record: body.record.map(|record| RuleRecording {
                times: record.times,
                distance_ns: record.distance_ms.saturating_mul(1_000_000),
                edge: record.edge,
            }),
            ..Rule::EMPTY
        };
        let command = |command: &str| self.command(command);
        let names = |id: u64| {
            let file = self.store.read(id);
            file.and_then(|file| file.names).unwrap_or_default()
        };
        for (place, term) in rule.when.iter_mut().zip(&terms) {
            let command_of = |command_name: &str| match output(term) {
                Some((primitive, port)) if command_name.is_empty() => {
                    self.command_with(&name, primitive, port)
                }
                _ => command(command_name),
            };
            *place = Some(conditions::resolve(&name, term, &command_of, &names)?);
        }
        Ok(NewRule {
            rule,
            when: shortened(&event_text(&body.when)),
            name,
        })
    }

    fn ids(
        &self,
        commands: &[CommandRef],
        suits: impl Fn(CommandState) -> bool,
    ) -> Result<[u64; SWITCH_MAX], ApiError> {
        let ids = self
            .service
            .named(self.attached, self.store, commands, suits)?;
        let mut list = [0; SWITCH_MAX];
        list.iter_mut().zip(ids).for_each(|(place, id)| *place = id);
        Ok(list)
    }

    /// The one command that has this output: among those that are active, or else among those that are ready.
    fn command_with(&self, rule: &str, primitive: &str, port: &str) -> Result<u64, ApiError> {
        let rows = self.attached.tables().commands;
        let with_output = |suits: &dyn Fn(CommandState) -> bool| -> Vec<u64> {
            let rows = rows
                .iter()
                .filter(|row| suits(CommandState::from_number(row.state)));
            let has = |id: &u64| {
                let names = self.store.read(*id).and_then(|file| file.names);
                names.is_some_and(|names| conditions::has_output(&names, primitive, port))
            };
            rows.map(|row| row.id).filter(has).collect()
        };
        let mut found = with_output(&CommandState::is_active);
        if found.is_empty() {
            found = with_output(&|state| state == CommandState::Ready);
        }
        let output = format!("{primitive}.{port}");
        let (message, help) = match found.as_slice() {
            [id] => return Ok(*id),
            [] => (
                format!("no net that runs or is ready has the output `{output}`"),
                "load the net first; `rcc-cli watch` lists the outputs of a net".to_owned(),
            ),
            several => {
                let named = several
                    .iter()
                    .map(|id| format!("{}#{id}", self.service.net(self.store, *id)));
                (
                    format!("several nets have the output `{output}`"),
                    format!(
                        "write the net before it, `NET.{output}`: {}",
                        named.collect::<Vec<_>>().join(", ")
                    ),
                )
            }
        };
        let message = format!("rule `{rule}`: {message}");
        Err(ApiError::new(codes::BAD_CONDITION, message, help))
    }

    fn command(&self, name: &str) -> Result<u64, ApiError> {
        let lives = |state: CommandState| state == CommandState::Ready || state.is_active();
        let name = name.strip_prefix('#').unwrap_or(name);
        let tables = || self.attached.tables();
        self.service.resolve(tables, self.store, name, lives)
    }
}

/// Returns true unless the executor may have carried the call out: an answer that did not arrive in time says nothing.
pub(super) fn is_refusal(error: &ApiError) -> bool {
    error.code != codes::EXECUTOR_SILENT
}

/// Primitive and port of a term that looks at an output.
fn output(term: &ConditionTerm) -> Option<(&str, &str)> {
    match term {
        ConditionTerm::Value {
            primitive, port, ..
        }
        | ConditionTerm::Compare {
            primitive, port, ..
        } => Some((primitive, port)),
        _ => None,
    }
}

/// A text that fits into a rule.
fn shortened(text: &str) -> String {
    if text.len() <= RULE_TEXT_MAX {
        return text.to_owned();
    }
    let end = (0..=RULE_TEXT_MAX - '…'.len_utf8())
        .rev()
        .find(|end| text.is_char_boundary(*end));
    format!("{}…", &text[..end.unwrap_or(0)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_text_is_cut_between_characters() {
        let text = "ä".repeat(RULE_TEXT_MAX);
        let cut = shortened(&text);
        assert!(cut.len() <= RULE_TEXT_MAX && cut.ends_with('…'));
        assert_eq!(shortened("short"), "short");
    }
}
