//! A task whose nets are compiled: its rules with the places of what their conditions name. Pure.

use rcc_api::bodies::{CommandList, CommandRef, RuleBody};
use rcc_api::codes;
use rcc_api::compile::compile;
use rcc_api::conditions;
use rcc_api::error::ApiError;
use rcc_api::messages;
use rcc_config::CellConfig;
use rcc_language::condition::{self, ConditionTerm};
use rcc_language::devices::DeviceTable;
use rcc_language::names::Names;
use rcc_protocol::control::{PlanData, SWITCH_MAX};
use rcc_protocol::rules::Rule;

use super::TaskFile;
use super::analysis::title;
use crate::failure::Failure;
use crate::follow::read_net;

/// A task with its nets, whose ids are their places in it, from 1 on.
pub struct CompiledTask {
    /// The task.
    pub file: TaskFile,
    /// Its nets.
    pub plans: Vec<PlanData>,
    names: Vec<Names>,
}

impl CompiledTask {
    /// Compiles the nets of a task for a cell.
    ///
    /// # Errors
    /// Fails if a net cannot be read, or with the diagnostics of the first invalid one.
    pub fn compile(file: TaskFile, config: &CellConfig) -> Result<CompiledTask, Failure> {
        let mut plans = Vec::new();
        let mut names = Vec::new();
        let devices = DeviceTable::from(config);
        for net in &file.nets {
            let source = read_net(&net.file)?;
            let compiled = compile(&source.1, &source.0, &devices).map_err(|diagnostics| {
                let what = format!("{} is invalid", source.0);
                Failure::invalid(&what, diagnostics, source.clone())
            })?;
            plans.push(compiled.plan);
            names.push(compiled.names);
        }
        Ok(CompiledTask { file, plans, names })
    }

    /// Returns the id of a net by its name in the task.
    ///
    /// # Errors
    /// Returns an error with the name that is most like it if the task has no such net.
    pub fn id(&self, name: &str) -> Result<u64, ApiError> {
        let nets = || (0..self.names.len()).map(|index| self.name(index));
        let place = nets().position(|net| net == name);
        let unknown = || messages::unknown_among(name, nets());
        place.map(|place| place as u64 + 1).ok_or_else(unknown)
    }

    /// The name of a net in the task.
    fn name(&self, index: usize) -> &str {
        let given = self.file.nets.get(index).map(|net| net.name.as_str());
        let own = self.names.get(index).map(|names| names.net.as_str());
        given
            .filter(|name| !name.is_empty())
            .or(own)
            .unwrap_or_default()
    }

    /// Returns the name of a net in the task by its id; empty for an unknown one.
    #[must_use]
    pub fn title(&self, id: u64) -> String {
        let index = usize::try_from(id).ok().and_then(|id| id.checked_sub(1));
        index.map_or_else(String::new, |index| self.name(index).to_owned())
    }

    /// Returns the names within a net by its id.
    #[must_use]
    pub fn names(&self, id: u64) -> Names {
        let index = usize::try_from(id).ok().and_then(|id| id.checked_sub(1));
        let names = index.and_then(|index| self.names.get(index));
        names.cloned().unwrap_or_default()
    }

    /// Returns its rules with ids and places instead of names.
    ///
    /// # Errors
    /// Returns an error for a rule that names what the nets do not have.
    pub fn rules(&self) -> Result<Vec<Rule>, ApiError> {
        self.file.rules.iter().map(|body| self.rule(body)).collect()
    }

    /// Checks everything that the task names. The nets of a file with rules alone are those of the cell: their conditions
    /// are only parsed.
    ///
    /// # Errors
    /// Returns an error for the first name or condition that is wrong.
    pub fn check(&self) -> Result<(), ApiError> {
        if self.file.nets.is_empty() {
            return self
                .file
                .rules
                .iter()
                .try_for_each(|body| terms(body).map(drop));
        }
        self.rules()?;
        self.file
            .start
            .iter()
            .try_for_each(|name| self.id(name).map(drop))
    }

    fn rule(&self, body: &RuleBody) -> Result<Rule, ApiError> {
        let mut rule = Rule {
            stop: self.ids(&body.stop)?,
            cancel: self.ids(&body.cancel)?,
            start: self.ids(&body.start)?,
            // There is no client that could be lost.
            goes_on: true,
            ..Rule::EMPTY
        };
        let terms = terms(body)?;
        if terms.len() > rule.when.len() {
            let message = "its condition is too long".to_owned();
            return Err(bad(
                body,
                &message,
                "split it into several rules".to_owned(),
            ));
        }
        let command = |name: &str| self.id(name);
        let names = |id: u64| self.names(id);
        for (place, term) in rule.when.iter_mut().zip(&terms) {
            *place = Some(conditions::resolve(title(body), term, &command, &names)?);
        }
        Ok(rule)
    }

    fn ids(&self, list: &CommandList) -> Result<[u64; SWITCH_MAX], ApiError> {
        let mut ids = [0; SWITCH_MAX];
        if list.commands().len() > ids.len() {
            let message = format!("a rule names {} commands", list.commands().len());
            let help = format!("at most {SWITCH_MAX} in each list");
            return Err(ApiError::new(codes::RULE_REFUSED, message, help));
        }
        for (place, command) in ids.iter_mut().zip(list.commands()) {
            *place = match command {
                CommandRef::Id(id) => *id,
                CommandRef::Name(name) => self.id(name)?,
            };
        }
        Ok(ids)
    }
}

fn bad(rule: &RuleBody, message: &str, help: String) -> ApiError {
    let message = format!("rule `{}`: {message}", title(rule));
    ApiError::new(codes::BAD_CONDITION, message, help)
}

fn terms(rule: &RuleBody) -> Result<Vec<ConditionTerm>, ApiError> {
    condition::parse(&rule.when).map_err(|fault| bad(rule, &fault.to_string(), fault.help))
}
