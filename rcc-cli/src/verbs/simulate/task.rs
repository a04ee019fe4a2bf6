//! `simulate TASK`: runs nets and rules in virtual time and prints each rule that fires and each net that ends. Main
//! thread.

use rcc_api::bodies::{CommandList, CommandRef};
use rcc_api::codes::{self, exit};
use rcc_api::compile::compile;
use rcc_api::conditions;
use rcc_api::error::ApiError;
use rcc_api::messages::{self, NameResolver};
use rcc_config::CellConfig;
use rcc_core::message::{CommandState, EndReason};
use rcc_language::condition;
use rcc_language::names::Names;
use rcc_protocol::control::{Refusal, SWITCH_MAX};
use rcc_protocol::rules::{Rule, RuleState};
use serde::Serialize;

use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::follow::{read_net, read_text};
use crate::output::print_note;
use crate::scenario::SimulationScenario;
use crate::simulate::task::{self, SimulatedTask, TaskError, TaskEvent, TaskResult};
use crate::table;
use crate::task::TaskFile;

/// One line of the result.
#[derive(Debug, Serialize)]
struct Line {
    time_s: f64,
    what: String,
    words: String,
}

#[derive(Debug, Serialize)]
struct Report {
    task: String,
    time_s: f64,
    events: Vec<Line>,
}

/// A task with the names of its nets.
struct NamedTask {
    file: TaskFile,
    names: Vec<Names>,
}

/// Runs the task that the scenario names.
///
/// # Errors
/// Fails if a file is invalid, if something is refused, if a net ends otherwise than `finished` without a CANCEL, or if
/// the task has not ended after the given time.
pub fn run(context: &Context, scenario: &SimulationScenario) -> Result<(), Failure> {
    let file = TaskFile::read(&scenario.file)?;
    let source = read_text(&scenario.file)?;
    let (config, options) = scenario.cell_and_options(&source)?;
    let mut plans = Vec::new();
    let mut names = Vec::new();
    for net in &file.nets {
        let source = read_net(&net.file)?;
        let compiled = compile(&source.1, &source.0, &config).map_err(|diagnostics| {
            let what = format!("{} is invalid", source.0);
            Failure::invalid(&what, diagnostics, source.clone())
        })?;
        plans.push(compiled.plan);
        names.push(compiled.names);
    }
    let named = NamedTask { file, names };
    let from_api = |error: ApiError| Failure::from_server(error.body());
    let rules = named.rules().map_err(from_api)?;
    let start = named.file.start.iter().map(|name| named.id(name));
    let start = start.collect::<Result<Vec<u64>, ApiError>>();
    let simulated = SimulatedTask {
        plans,
        rules,
        start: start.map_err(from_api)?,
    };
    let result =
        task::run(&config, simulated, &options).map_err(|error| named.failure(&config, &error))?;
    let report = named.report(&config, &result);
    context.print(&report, human);
    judge(context, &result, scenario.cancel_at.is_some())
}

fn judge(context: &Context, result: &TaskResult, canceled: bool) -> Result<(), Failure> {
    let unwanted = result.events.iter().any(|(_, event)| match event {
        TaskEvent::Command {
            state: CommandState::Terminated,
            reason,
            ..
        } => {
            // A rule that stops a net ends it as ABORT does; that is what the task asked for.
            *reason == EndReason::Fault as u32
        }
        TaskEvent::Rule(status) => status.state == RuleState::Refused,
        TaskEvent::Command { .. } => false,
    });
    if result.unfinished {
        if context.format == OutputFormat::Human {
            print_note("still running at the end of the simulated time: extend it with --for TIME");
        }
        return Err(Failure::reported(exit::TIMEOUT));
    }
    match unwanted && !canceled {
        true => Err(Failure::reported(exit::FAILED)),
        false => Ok(()),
    }
}

impl NamedTask {
    fn id(&self, name: &str) -> Result<u64, ApiError> {
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

    fn title(&self, id: u64) -> String {
        let index = usize::try_from(id).ok().and_then(|id| id.checked_sub(1));
        index.map_or_else(String::new, |index| self.name(index).to_owned())
    }

    fn names(&self, id: u64) -> Names {
        let index = usize::try_from(id).ok().and_then(|id| id.checked_sub(1));
        let names = index.and_then(|index| self.names.get(index));
        names.cloned().unwrap_or_default()
    }

    fn rules(&self) -> Result<Vec<Rule>, ApiError> {
        self.file
            .rules
            .iter()
            .map(|body| {
                let name = body.name.as_deref().unwrap_or(&body.when);
                if body.record.is_some() {
                    return Err(ApiError::new(
                        codes::NO_RECORDER,
                        format!("rule `{name}` records, and a simulation has no flight recorder"),
                        "remove the rule to simulate the task; `rcc-cli simulate NET --csv FILE` shows every cycle of one net",
                    ));
                }
                let mut rule = Rule {
                    stop: self.ids(&body.stop)?,
                    cancel: self.ids(&body.cancel)?,
                    start: self.ids(&body.start)?,
                    // There is no client that could be lost.
                    goes_on: true,
                    ..Rule::EMPTY
                };
                let bad = |message: String, help: String| {
                    ApiError::new(
                        codes::BAD_CONDITION,
                        format!("rule `{name}`: {message}"),
                        help,
                    )
                };
                let terms = condition::parse(&body.when)
                    .map_err(|fault| bad(fault.to_string(), fault.help))?;
                if terms.len() > rule.when.len() {
                    return Err(bad(
                        "its condition is too long".to_owned(),
                        "split it into several rules".to_owned(),
                    ));
                }
                let command = |name: &str| self.id(name);
                let names = |id: u64| self.names(id);
                for (place, term) in rule.when.iter_mut().zip(&terms) {
                    *place = Some(conditions::resolve(name, term, &command, &names)?);
                }
                Ok(rule)
            })
            .collect()
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

    fn with_resolver<T>(
        &self,
        config: &CellConfig,
        what: impl FnOnce(&NameResolver<'_>) -> T,
    ) -> T {
        what(&NameResolver {
            config,
            disagreement: &|_| None,
            net: &|id| self.title(id),
            names: &|id| self.names(id),
            reason: &|_, _| String::new(),
        })
    }

    fn failure(&self, config: &CellConfig, error: &TaskError) -> Failure {
        match error {
            TaskError::Refused(id, refusal) => self.refused(config, *id, *refusal),
            TaskError::Engine(error) => Failure::new(
                codes::PROCESS_FAILED,
                error.to_string(),
                "report it as a bug",
            ),
        }
    }

    fn refused(&self, config: &CellConfig, id: u64, refusal: Refusal) -> Failure {
        let error = self.with_resolver(config, |names| names.refusal(id, refusal));
        Failure::from_server(error.body())
    }

    fn report(&self, config: &CellConfig, result: &TaskResult) -> Report {
        let lines = result.events.iter().map(|(time_s, event)| {
            let (what, words) = self.line(config, event);
            Line {
                time_s: *time_s,
                what,
                words,
            }
        });
        Report {
            task: self.file.name.clone(),
            time_s: result.time_s,
            events: lines.collect(),
        }
    }

    fn line(&self, config: &CellConfig, event: &TaskEvent) -> (String, String) {
        match *event {
            TaskEvent::Command {
                id,
                state,
                reason,
                outcome,
            } => {
                let names = self.names(id);
                let reason = EndReason::from_number(reason);
                let words = match (reason, names.outcome(outcome)) {
                    (EndReason::None, _) => state.name().to_owned(),
                    (reason, Some(outcome)) => format!("{}: {outcome}", reason.name()),
                    (reason, None) => reason.name().to_owned(),
                };
                (self.title(id), words)
            }
            TaskEvent::Rule(status) => {
                let index = usize::try_from(status.id)
                    .ok()
                    .and_then(|id| id.checked_sub(1));
                let body = index.and_then(|index| self.file.rules.get(index));
                let name = body.map_or("", |body| body.name.as_deref().unwrap_or(&body.when));
                let end = self.with_resolver(config, |names| names.rule_end(&status));
                let words = match end {
                    Some((_, words)) => format!("{}: {words}", status.state.name()),
                    None => status.state.name().to_owned(),
                };
                (format!("rule `{name}`"), words)
            }
        }
    }
}

fn human(report: &Report) -> String {
    let mut rows = table::table(&["TIME", "WHAT", ""]);
    for line in &report.events {
        rows.add_row([
            format!("{:.3} s", line.time_s),
            line.what.clone(),
            line.words.clone(),
        ]);
    }
    let end = format!(
        "{} ended after {:.3} s of logical time",
        report.task, report.time_s
    );
    format!("{}\n{end}", table::text(&rows))
}
