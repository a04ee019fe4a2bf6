//! The verdict on one file: nets are compiled with the loader's own library, cells and robots are read by the programs'
//! own reader, and libraries are parsed with the libraries that they use.

use std::path::Path;

use rcc_api::bodies::{Finding, RehearsalView};
use rcc_api::compile::findings;
use rcc_config::diagnostic::{DrawingStyle, Faults};
use rcc_config::{CellConfig, RobotConfig};
use rcc_language::Compiler;
use rcc_language::devices::DeviceTable;
use rcc_language::library::{FileLibraries, check_library};
use rcc_language::names::Names;
use rcc_protocol::control::PlanData;
use serde::Serialize;

use super::search::CheckedKind;
use crate::failure::Failure;
use crate::scenario::{require_valid_settings, with_names};
use crate::simulate::rehearse_at_start;
use crate::table::counted;
use crate::task::TaskFile;
use crate::task::compiled::CompiledTask;

/// Verdict on one file.
#[derive(Serialize)]
pub struct FileVerdict {
    /// The file.
    pub file: String,
    /// Its kind.
    pub kind: CheckedKind,
    /// False if it has errors or denied findings.
    pub valid: bool,
    /// Name of the net; empty for other files.
    pub net: String,
    /// Number of primitives of the net, as its text has them.
    pub primitives: u32,
    /// Result of the rehearsal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rehearsal: Option<RehearsalView>,
    /// Everything found.
    pub diagnostics: Vec<Finding>,
    /// Description of a valid file for people: `line is valid, 6 primitives`.
    #[serde(skip)]
    pub summary: String,
}

/// Conditions of a check.
pub struct CheckStage<'a> {
    /// Devices that the nets use.
    pub devices: &'a DeviceTable,
    /// Warnings are refused as well.
    pub denies_warnings: bool,
    /// The cell of these devices.
    pub config: &'a CellConfig,
    /// True if nets are also rehearsed, in this cell.
    pub rehearses: bool,
}

impl CheckStage<'_> {
    /// Judges a file by its name and text.
    pub fn judge(&self, kind: CheckedKind, source: &(String, String)) -> FileVerdict {
        let (name, text) = source;
        let mut verdict = FileVerdict {
            file: name.clone(),
            kind,
            valid: true,
            net: String::new(),
            primitives: 0,
            rehearsal: None,
            diagnostics: Vec::new(),
            summary: String::new(),
        };
        let read = match kind {
            CheckedKind::Net | CheckedKind::DirectIoNet => return self.net(verdict, source),
            CheckedKind::Task => {
                match self.task(source) {
                    Ok(summary) => verdict.summary = summary,
                    Err(failure) => verdict.diagnostics.extend(findings_of(&failure)),
                }
                return self.conclude(verdict);
            }
            CheckedKind::Library => library(text, name),
            CheckedKind::Cell => cell(text, name, &mut verdict.diagnostics),
            CheckedKind::Robot => robot(text, name),
        };
        match read {
            Ok(summary) => verdict.summary = summary,
            Err(faults) => verdict.diagnostics.extend(findings(&faults)),
        }
        self.conclude(verdict)
    }

    /// Reads a task, compiles its nets, and resolves everything that its rules name.
    fn task(&self, (name, text): &(String, String)) -> Result<String, Failure> {
        let folder = Path::new(name).parent().unwrap_or(Path::new(""));
        let task = TaskFile::of(name, text, folder)?;
        let compiled = CompiledTask::compile(task, self.config)?;
        compiled
            .check()
            .map_err(|error| Failure::from_server(error.body()))?;
        let task = &compiled.file;
        Ok(format!(
            "task {} is valid, {} and {}",
            task.name,
            counted(task.nets.len() as u64, "net"),
            counted(task.rules.len() as u64, "rule")
        ))
    }

    /// Refuses a file with errors, or with any finding if warnings are denied.
    fn conclude(&self, mut verdict: FileVerdict) -> FileVerdict {
        let mut found = verdict.diagnostics.iter();
        verdict.valid = !found.any(|finding| self.denies_warnings || finding.severity == "error");
        verdict
    }

    fn net(&self, mut verdict: FileVerdict, (name, text): &(String, String)) -> FileVerdict {
        let compiler = Compiler {
            libraries: &FileLibraries,
            ..rcc_directionet::compiler(self.devices)
        };
        let compiled = match compiler.compile(text, name) {
            Ok(compiled) => compiled,
            Err(faults) => {
                verdict.diagnostics = findings(&faults);
                return self.conclude(verdict);
            }
        };
        verdict.primitives = compiled.primitives;
        verdict.diagnostics = findings(&compiled.warnings);
        if self.rehearses {
            match rehearsed(self.config, compiled.plan, &compiled.names) {
                Ok(rehearsal) => verdict.rehearsal = rehearsal,
                Err(finding) => verdict.diagnostics.push(*finding),
            }
        }
        verdict.net = compiled.net;
        verdict.summary = format!(
            "{} is valid, {}",
            verdict.net,
            counted(u64::from(verdict.primitives), "primitive")
        );
        self.conclude(verdict)
    }
}

/// Rehearses a net; returns the result, or the limit that it would break.
fn rehearsed(
    config: &CellConfig,
    plan: PlanData,
    names: &Names,
) -> Result<Option<RehearsalView>, Box<Finding>> {
    let rehearsal = rehearse_at_start(config, plan);
    with_names(names, config, |namer| match rehearsal {
        Ok(rehearsed) => Ok(rehearsed.map(|rehearsed| namer.rehearsal(&rehearsed, names))),
        Err(refusal) => Err(Box::new(namer.refusal(1, refusal).finding())),
    })
}

/// The findings of a failure; one that has none becomes one itself.
fn findings_of(failure: &Failure) -> Vec<Finding> {
    if !failure.body.diagnostics.is_empty() {
        return failure.body.diagnostics.clone();
    }
    vec![Finding {
        code: failure.body.code.clone(),
        severity: "error".to_owned(),
        message: failure.body.message.clone(),
        help: failure.body.help.clone(),
        rendered: failure.human(DrawingStyle::default()),
        ..Finding::default()
    }]
}

fn library(text: &str, name: &str) -> Result<String, Faults> {
    let library = check_library(text, name, &FileLibraries)?;
    Ok(format!(
        "library {} is valid, {}; nets that use them check their links",
        library.name.name,
        counted(library.fragments.len() as u64, "fragment")
    ))
}

/// Reads a cell and the robots that it names; settings that only a simulation refuses are added to `found`.
fn cell(text: &str, name: &str, found: &mut Vec<Finding>) -> Result<String, Faults> {
    let base = Path::new(name).parent().unwrap_or(Path::new(""));
    let cell = CellConfig::parse_offline(text, name, base)?;
    if let Err(refused) = require_valid_settings(&cell) {
        found.extend(findings_of(&refused));
    }
    let devices: Vec<&str> = cell.devices.iter().map(|it| it.name.as_str()).collect();
    Ok(format!(
        "cell {} is valid, {}: {}",
        cell.name,
        counted(devices.len() as u64, "device"),
        devices.join(", ")
    ))
}

fn robot(text: &str, name: &str) -> Result<String, Faults> {
    let robot = RobotConfig::parse(text, name)?;
    let joints = robot.joints.len() as u64;
    Ok(format!(
        "robot {} is valid, {}",
        robot.name,
        counted(joints, "joint")
    ))
}
