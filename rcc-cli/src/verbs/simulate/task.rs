//! `simulate TASK`: runs nets and rules in virtual time and prints each rule that fires and each net that ends. Main
//! thread.

use rcc_api::codes::{self, exit};
use rcc_api::error::ApiError;
use rcc_api::messages::NameResolver;
use rcc_config::CellConfig;
use rcc_core::message::{CommandState, EndReason};
use rcc_protocol::control::Refusal;
use rcc_protocol::rules::RuleState;
use serde::Serialize;

use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::follow::read_text;
use crate::output::print_note;
use crate::scenario::{DevicesOf, SimulationScenario};
use crate::simulate::task::{self, SimulatedTask, TaskError, TaskEvent, TaskResult};
use crate::table;
use crate::task::TaskFile;
use crate::task::compiled::CompiledTask;

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

/// Runs the task that the scenario names.
///
/// # Errors
/// Fails if a file is invalid, if something is refused, if a net ends otherwise than `finished` without a CANCEL, or if
/// the task has not ended after the given time.
pub fn run(context: &Context, scenario: &SimulationScenario) -> Result<(), Failure> {
    let file = TaskFile::read(&scenario.file)?;
    let source = read_text(&scenario.file)?;
    let (config, options) = scenario.cell_and_options(&source)?;
    let mut named = CompiledTask::compile(file, &config).inspect_err(|failure| {
        DevicesOf::option(scenario.config.as_deref()).note(&failure.body.diagnostics);
    })?;
    require_no_recording(&named)?;
    let from_api = |error: ApiError| Failure::from_server(error.body());
    let rules = named.rules().map_err(from_api)?;
    let start = named.file.start.iter().map(|name| named.id(name));
    let start = start.collect::<Result<Vec<u64>, ApiError>>();
    let simulated = SimulatedTask {
        plans: std::mem::take(&mut named.plans),
        rules,
        start: start.map_err(from_api)?,
    };
    let named = NamedTask(named);
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

/// A simulation has no flight recorder.
fn require_no_recording(task: &CompiledTask) -> Result<(), Failure> {
    let Some(rule) = task.file.rules.iter().find(|rule| rule.record.is_some()) else {
        return Ok(());
    };
    let name = rule.name.as_deref().unwrap_or(&rule.when);
    Err(Failure::new(
        codes::NO_RECORDER,
        format!("rule `{name}` records, and a simulation has no flight recorder"),
        "remove the rule to simulate the task; `rcc-cli simulate NET --csv FILE` shows every cycle of one net",
    ))
}

/// The task with the words for what happens in it.
struct NamedTask(CompiledTask);

impl NamedTask {
    fn with_resolver<T>(
        &self,
        config: &CellConfig,
        what: impl FnOnce(&NameResolver<'_>) -> T,
    ) -> T {
        what(&NameResolver {
            config,
            disagreement: &|_| None,
            net: &|id| self.0.title(id),
            names: &|id| self.0.names(id),
            reason: &|_, _| String::new(),
            condition: &|_| None,
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
            task: self.0.file.name.clone(),
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
                let names = self.0.names(id);
                let reason = EndReason::from_number(reason);
                let words = match (reason, names.outcome(outcome)) {
                    (EndReason::None, _) => state.name().to_owned(),
                    (reason, Some(outcome)) => format!("{}: {outcome}", reason.name()),
                    (reason, None) => reason.name().to_owned(),
                };
                (self.0.title(id), words)
            }
            TaskEvent::Rule(status) => {
                let index = usize::try_from(status.id)
                    .ok()
                    .and_then(|id| id.checked_sub(1));
                let body = index.and_then(|index| self.0.file.rules.get(index));
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
