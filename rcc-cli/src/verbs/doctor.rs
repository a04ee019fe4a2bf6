//! `doctor`: what this machine grants and how punctual it really is; or why a device is not connected.

use std::path::Path;
use std::time::Duration;

use rcc_ipc::cell::base_dir;
use rcc_loader::server::codes::{self, exit};

use crate::context::{Context, Format};
use crate::doctor::Level;
use crate::doctor::clean::clean;
use crate::doctor::facts::{self, Facts, cpu, system::System};
use crate::doctor::link::{LinkReport, gather::gather};
use crate::doctor::measure::{Plan, measure};
use crate::doctor::record::Record;
use crate::doctor::report::Report;
use crate::doctor::trial::try_all;
use crate::doctor::wish::{self, Chosen, Wish};
use crate::failure::Failure;
use crate::output::{remark, say};

/// What to look at. `--cell` is a cell's name or its file.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// How long wake-ups are measured; 0 leaves it out.
    #[arg(long, default_value = "5s", value_parser = length)]
    measure: Duration,
    /// Remove what dead cells left, instead of looking.
    #[arg(long)]
    clean: bool,
    /// With --clean: also shared memory that nobody uses, of cells in other folders (RCC_RUNTIME_DIR).
    #[arg(long, requires = "clean")]
    strays: bool,
    #[command(subcommand)]
    what: Option<What>,
}

/// One device instead of the machine.
#[derive(clap::Subcommand, Debug)]
pub enum What {
    /// Why a device is not connected, stage after stage.
    #[command(visible_aliases = ["fri", "modbus"])]
    Device {
        /// Name of the device.
        name: String,
    },
}

fn length(text: &str) -> Result<Duration, String> {
    if text.trim() == "0" || text.trim() == "0s" {
        return Ok(Duration::ZERO);
    }
    super::duration(text)
}

/// Does it.
///
/// # Errors
/// Exit code 1 when a finding prevents a cell from running; 3 for a configuration that is not valid.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if arguments.clean {
        return remove(context, arguments.strays);
    }
    let chosen = wish::choose(context)?;
    if let Some(What::Device { name }) = &arguments.what {
        return device(context, chosen, name);
    }
    let wish = chosen
        .as_ref()
        .map_or_else(Wish::default, |chosen| Wish::of(&chosen.config));
    let facts = look(context, wish, arguments.measure);
    let mut report = Report::of(&facts);
    if let Some(measured) = &facts.measured {
        match Record::of(measured).store() {
            Ok(path) => report.kept_in = Some(path.display().to_string()),
            Err(error) => remark(&format!("the grade is not kept for `status`: {error}")),
        }
    }
    context.print(&report, Report::human);
    if report.worst == Level::Fail {
        return Err(Failure::said(exit::FAILED));
    }
    Ok(())
}

fn device(context: &Context, chosen: Option<Chosen>, name: &str) -> Result<(), Failure> {
    let chosen = chosen.ok_or_else(|| {
        let what = format!("no process of a cell '{}' runs", context.cell_name());
        Failure::new(
            codes::NO_LOADER,
            what,
            "start it (rcc-cli up FILE), or name its file: --cell FILE.yaml",
        )
    })?;
    let config = &chosen.config;
    let (_, device) = config.device(name).ok_or_else(|| {
        let names: Vec<&str> = config
            .devices
            .iter()
            .map(|device| device.name.as_str())
            .collect();
        let what = format!("{} has no device '{name}'", config.source.display());
        Failure::new(
            codes::BAD_REQUEST,
            what,
            format!("it has: {}", names.join(", ")),
        )
    })?;
    let report = LinkReport::of(&gather(&chosen, device));
    context.print(&report, LinkReport::human);
    match report.failed {
        Some(_) => Err(Failure::said(exit::FAILED)),
        None => Ok(()),
    }
}

fn look(context: &Context, wish: Wish, length: Duration) -> Facts {
    let system = System::at(Path::new("/"));
    let trial = try_all(wish.priority);
    let mut facts = facts::read(&system, wish);
    facts.trial = trial;
    if length.is_zero() {
        return facts;
    }
    let executors = facts
        .cells
        .iter()
        .filter(|cell| cell.executor.is_some())
        .count();
    let wish = &facts.wish;
    // A running executor comes first, also before this measurement.
    let priority = wish.priority.saturating_sub(u8::from(executors > 0)).max(1);
    let plan = Plan {
        priority: facts.trial.fifo.is_ok().then_some(priority),
        core: wish.core,
        period_ns: wish.period_ns,
        length,
    };
    if context.format == Format::Human {
        remark(&format!(
            "measuring wake-ups for {} s …",
            length.as_secs_f64()
        ));
    }
    let before = cpu::counters(&system, plan.core);
    match measure(plan) {
        Ok(measured) => facts.measured = Some(measured),
        Err(error) => facts.not_measured = Some(error.to_string()),
    }
    facts.during = cpu::between(&before, &cpu::counters(&system, plan.core));
    facts
}

fn remove(context: &Context, strays: bool) -> Result<(), Failure> {
    let cleaned = clean(&base_dir(), strays.then_some(Path::new("/dev/shm")));
    if context.format == Format::Json {
        context.print(&cleaned, |_| String::new());
    } else {
        for line in &cleaned.removed {
            say(&format!("removed  {line}"));
        }
        for line in &cleaned.refused {
            say(&format!("left     {line}"));
        }
        if cleaned.removed.is_empty() && cleaned.refused.is_empty() {
            say("nothing is left of dead cells");
        }
    }
    if cleaned.refused.is_empty() {
        Ok(())
    } else {
        Err(Failure::said(exit::FAILED))
    }
}
