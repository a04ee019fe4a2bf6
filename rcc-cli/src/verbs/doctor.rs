//! `doctor`: checks what this machine grants and how punctual it is; or diagnoses the connection of a device.

use std::path::Path;
use std::time::Duration;

use rcc_api::codes::{self, exit};
use rcc_ipc::cell::base_dir;

use crate::context::{Context, OutputFormat};
use crate::doctor::FindingLevel;
use crate::doctor::clean::clean;
use crate::doctor::facts::{self, MachineFacts, cpu, system::SystemRoot};
use crate::doctor::link::{LinkReport, gather::gather};
use crate::doctor::measure::{MeasurementPlan, measure};
use crate::doctor::record::GradeRecord;
use crate::doctor::report::DoctorReport;
use crate::doctor::requirements::{self, MachineRequirements, SelectedCell};
use crate::doctor::trial::try_all;
use crate::failure::Failure;
use crate::output::{print_line, print_note};

/// Arguments of `doctor`. `--cell` takes a cell's name or its file.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Time for which wake-up latency is measured; 0 skips it
    #[arg(long, default_value = "5s", value_parser = length)]
    measure: Duration,
    /// Remove leftovers of dead cells instead of checking
    #[arg(long)]
    clean: bool,
    /// With --clean: also remove unused shared memory of cells in other folders (RCC_RUNTIME_DIR)
    #[arg(long, requires = "clean")]
    strays: bool,
    #[command(subcommand)]
    what: Option<DoctorCommand>,
}

/// Diagnoses one device instead of the machine.
#[derive(clap::Subcommand, Debug)]
pub enum DoctorCommand {
    /// Diagnose the connection of a device, stage by stage
    #[command(visible_aliases = ["fri", "modbus", "ethercat", "link"])]
    Device {
        /// Name of the device
        name: String,
    },
}

fn length(text: &str) -> Result<Duration, String> {
    if text.trim() == "0" || text.trim() == "0s" {
        return Ok(Duration::ZERO);
    }
    super::duration(text)
}

/// Runs the verb.
///
/// # Errors
/// Fails with exit code 1 if a finding prevents cells from running, and with 3 for an invalid configuration.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if arguments.clean {
        return remove_leftovers(context, arguments.strays);
    }
    let selected = requirements::select(context)?;
    if let Some(DoctorCommand::Device { name }) = &arguments.what {
        return device(context, selected, name);
    }
    let requirements = selected
        .as_ref()
        .map_or_else(MachineRequirements::default, |selected| {
            MachineRequirements::of(&selected.config)
        });
    let mut facts = collect_facts(context, requirements, arguments.measure);
    if let Some(selected) = &selected {
        facts.link = facts::link::read(selected);
    }
    let mut report = DoctorReport::of(&facts);
    if let Some(measured) = &facts.measured {
        match GradeRecord::of(measured).store() {
            Ok(path) => report.kept_in = Some(path.display().to_string()),
            Err(error) => print_note(&format!("cannot store the grade for `status`: {error}")),
        }
    }
    context.print(&report, DoctorReport::human);
    if report.worst == FindingLevel::Fail {
        return Err(Failure::reported(exit::FAILED));
    }
    Ok(())
}

fn device(context: &Context, selected: Option<SelectedCell>, name: &str) -> Result<(), Failure> {
    let selected = selected.ok_or_else(|| {
        let what = format!("cell `{}` does not run", context.cell_name());
        Failure::new(
            codes::NO_LOADER,
            what,
            "start it (`rcc-cli up FILE`), or select its file: --cell FILE.yaml",
        )
    })?;
    let config = &selected.config;
    let (_, device) = config.device(name).ok_or_else(|| {
        let names: Vec<&str> = config
            .devices
            .iter()
            .map(|device| device.name.as_str())
            .collect();
        let what = format!("{} has no device `{name}`", config.source.display());
        Failure::new(
            codes::BAD_REQUEST,
            what,
            format!("available devices: {}", names.join(", ")),
        )
    })?;
    let report = LinkReport::of(&gather(&selected, device));
    context.print(&report, LinkReport::human);
    match report.failed {
        Some(_) => Err(Failure::reported(exit::FAILED)),
        None => Ok(()),
    }
}

fn collect_facts(
    context: &Context,
    requirements: MachineRequirements,
    length: Duration,
) -> MachineFacts {
    let system = SystemRoot::at(Path::new("/"));
    let trial = try_all(requirements.priority);
    let mut facts = facts::read(&system, requirements);
    facts.trial = trial;
    if length.is_zero() {
        return facts;
    }
    let executors = facts
        .cells
        .iter()
        .filter(|cell| cell.executor.is_some())
        .count();
    let requirements = &facts.requirements;
    // The measurement yields to a running executor.
    let priority = requirements
        .priority
        .saturating_sub(u8::from(executors > 0))
        .max(1);
    let plan = MeasurementPlan {
        priority: facts.trial.fifo.is_ok().then_some(priority),
        core: requirements.core,
        period_ns: requirements.period_ns,
        length,
    };
    if context.format == OutputFormat::Human {
        print_note(&format!(
            "measuring wake-up latency for {} s …",
            length.as_secs_f64()
        ));
    }
    let before = cpu::counters(&system, plan.core);
    match measure(plan) {
        Ok(measured) => facts.measured = Some(measured),
        Err(error) => facts.not_measured = Some(error.to_string()),
    }
    facts.activity = cpu::between(&before, &cpu::counters(&system, plan.core));
    facts
}

fn remove_leftovers(context: &Context, strays: bool) -> Result<(), Failure> {
    let cleaned = clean(&base_dir(), strays.then_some(Path::new("/dev/shm")));
    if context.format == OutputFormat::Json {
        context.print(&cleaned, |_| String::new());
    } else {
        for line in &cleaned.removed {
            print_line(&format!("removed  {line}"));
        }
        for line in &cleaned.refused {
            print_line(&format!("left     {line}"));
        }
        if cleaned.removed.is_empty() && cleaned.refused.is_empty() {
            print_line("no leftovers of dead cells");
        }
    }
    if cleaned.refused.is_empty() {
        Ok(())
    } else {
        Err(Failure::reported(exit::FAILED))
    }
}
