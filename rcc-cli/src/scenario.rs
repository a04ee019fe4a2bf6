//! A net and the configuration of a cell without a running one: read, compiled and named for `check`, `simulate` and
//! `plot`. Run by the main thread.

use std::path::{Path, PathBuf};
use std::time::Duration;

use rcc_api::bodies::Finding;
use rcc_api::codes::{self, RequestedEnd, exit};
use rcc_api::compile::compile;
use rcc_api::messages::NameResolver;
use rcc_config::{CellConfig, auto_ports};
use rcc_core::message::EndReason;
use rcc_language::devices::DeviceTable;
use rcc_language::names::Names;
use rcc_protocol::control::PlanData;

use self::inputs::{ScenarioInputs, wrong};
use crate::context::Context;
use crate::duration::duration;
use crate::failure::{Failure, draw};
use crate::follow::read_net;
use crate::output::{print_diagnostics, print_note};
use crate::result_file::not_written;
use crate::simulate::script::{ArmOption, ScriptStep};
use crate::simulate::settings::first_invalid_setting;
use crate::simulate::{SimulateError, SimulationOptions};
use crate::supervisor::paths;

mod inputs;

/// Default limit of logical time.
const LIMIT: Duration = Duration::from_secs(60);

/// Net, devices and events of a simulation.
#[derive(clap::Args, Debug)]
pub struct SimulationScenario {
    /// Net or task (YAML or JSON); - reads standard input
    pub file: String,
    /// Cell configuration whose devices are simulated [default: the demo cell's]
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// End after this logical time; without it, a net that still runs after 60s is an error
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    pub limit: Option<Duration>,
    /// Cancel after this time; a net without Cancel is aborted
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub cancel_at: Option<Duration>,
    /// Set an input, without a time from the start: of a device (io.door_closed=true@2s, io.temperature=300K), what an
    /// arm measures (lwr.fz=20@1s), by the name of the primitive that reads it (ft.fz=20@1s, door.out=true), or an
    /// Input of the net (speed=0.1@2s)
    #[arg(long, value_name = "NAME=VALUE[@TIME]")]
    pub input: Vec<String>,
    /// Place a wall in an arm's way: a point (m), the normal to the free side, stiffness (N/m), damping (N·s/m)
    #[arg(
        long,
        value_name = "[DEVICE:]PX,PY,PZ,NX,NY,NZ[,K,D][@TIME]",
        allow_hyphen_values = true
    )]
    pub wall: Vec<String>,
    /// Push the flange of an arm: force (N) and torque (N·m), axes of the base
    #[arg(
        long,
        value_name = "[DEVICE:]FX,FY,FZ[,TX,TY,TZ][@TIME]",
        allow_hyphen_values = true
    )]
    pub force: Vec<String>,
    /// Load the flange of an arm with a mass (kg) that its controller does not know about; its centre is in the flange
    /// frame (m)
    #[arg(
        long,
        value_name = "[DEVICE:]KG[,X,Y,Z][@TIME]",
        allow_hyphen_values = true
    )]
    pub load: Vec<String>,
}

/// The devices for which a file is judged without a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DevicesOf {
    /// Those of the configuration that the user named.
    Given,
    /// Those of the demo cell, because the user named none.
    Demo,
}

impl DevicesOf {
    /// Returns whose devices the option `--config` means.
    #[must_use]
    pub fn option(config: Option<&Path>) -> DevicesOf {
        config.map_or(DevicesOf::Demo, |_| DevicesOf::Given)
    }

    /// Tells the user for which cell was judged, if a device is unknown that another cell may have.
    pub fn note(self, findings: &[Finding]) {
        let unknown = [
            rcc_language::codes::UNKNOWN_DEVICE,
            rcc_language::codes::UNKNOWN_CHANNEL,
        ];
        let is_unknown = |finding: &Finding| unknown.contains(&finding.code.as_str());
        if self == DevicesOf::Demo && findings.iter().any(is_unknown) {
            print_note(
                "judged for the devices of the demo cell: name the configuration of another cell with --config FILE",
            );
        }
    }
}

/// Returns the configuration that the user named, or that of the demo cell.
///
/// # Errors
/// Fails if the demo cell's configuration cannot be found.
pub fn config_or_demo(config: Option<&Path>) -> Result<PathBuf, Failure> {
    match config {
        Some(path) => Ok(path.to_owned()),
        None => paths::config("cells/demo.yaml"),
    }
}

/// A scenario whose files have been read.
pub struct PreparedScenario {
    /// Configuration of the cell.
    pub config: CellConfig,
    /// Plan of the net.
    pub plan: PlanData,
    /// Names of its ports.
    pub names: Names,
    /// Events and limits.
    pub options: SimulationOptions,
}

impl SimulationScenario {
    /// Returns true if anything besides the file is given.
    #[must_use]
    pub fn has_options(&self) -> bool {
        let lists = [&self.input, &self.wall, &self.force, &self.load];
        self.config.is_some()
            || self.limit.is_some()
            || self.cancel_at.is_some()
            || lists.iter().any(|list| !list.is_empty())
    }

    /// Judges the result by what was requested, with the exit codes of `run`.
    ///
    /// # Errors
    /// Fails if the net ended otherwise than `finished` without a requested CANCEL, or did not end and no time was
    /// given.
    pub fn judge(&self, reason: EndReason) -> Result<(), Failure> {
        let asked = match self.cancel_at {
            Some(_) => RequestedEnd::Cancel,
            None => RequestedEnd::Finish,
        };
        let code = match (reason, self.limit) {
            (EndReason::None, Some(_)) => exit::OK,
            (EndReason::None, None) => {
                print_note(&format!(
                    "still running after {LIMIT:?}: set the simulated time with --for TIME"
                ));
                exit::TIMEOUT
            }
            _ => codes::outcome(asked, Some(reason.name())),
        };
        match code {
            exit::OK => Ok(()),
            code => Err(Failure::reported(code)),
        }
    }

    /// Reads the cell and the net and compiles it; prints warnings.
    ///
    /// # Errors
    /// Fails if a file cannot be read or is invalid, or if an input cannot be parsed.
    pub fn prepare(&self) -> Result<PreparedScenario, Failure> {
        let config = self.cell()?;
        let source = read_net(&self.file)?;
        let devices = DeviceTable::from(&config);
        let compiled = compile(&source.1, &source.0, &devices).map_err(|diagnostics| {
            DevicesOf::option(self.config.as_deref()).note(&diagnostics);
            let what = format!("{} is invalid", source.0);
            Failure::invalid(&what, diagnostics, source.clone())
        })?;
        let inputs = ScenarioInputs {
            config: &config,
            source: &source,
            names: &compiled.names,
        };
        let options = self.options(&inputs)?;
        print_diagnostics(&draw(&compiled.warnings, Some(&source), Context::drawing()));
        Ok(PreparedScenario {
            config,
            plan: compiled.plan,
            names: compiled.names,
            options,
        })
    }

    /// Reads the cell, and the options of a text that is not one net.
    ///
    /// # Errors
    /// As for [`SimulationScenario::prepare`].
    pub fn cell_and_options(
        &self,
        source: &(String, String),
    ) -> Result<(CellConfig, SimulationOptions), Failure> {
        let config = self.cell()?;
        let options = self.options(&ScenarioInputs {
            config: &config,
            source,
            names: &Names::default(),
        })?;
        Ok((config, options))
    }

    /// Reads the configuration of the cell.
    fn cell(&self) -> Result<CellConfig, Failure> {
        let config = load_config(&config_or_demo(self.config.as_deref())?)?;
        require_valid_settings(&config)?;
        Ok(config)
    }

    fn options(&self, inputs: &ScenarioInputs<'_>) -> Result<SimulationOptions, Failure> {
        let ns = |time: Duration| time.as_nanos().try_into().unwrap_or(u64::MAX);
        let mut options = SimulationOptions {
            limit_ns: ns(self.limit.unwrap_or(LIMIT)),
            cancel_at_ns: self.cancel_at.map(ns),
            ..SimulationOptions::default()
        };
        for text in &self.input {
            inputs.add(text, &mut options)?;
        }
        for (option, texts) in [
            (ArmOption::Wall, &self.wall),
            (ArmOption::Force, &self.force),
            (ArmOption::Load, &self.load),
        ] {
            for text in texts {
                let step = ScriptStep::of_arm(option, text, inputs.config);
                options.steps.push(step.map_err(|error| wrong(&error))?);
            }
        }
        Ok(options)
    }
}

/// Loads a configuration for compiling nets; automatic ports get a dummy number.
pub fn load_config(path: &Path) -> Result<CellConfig, Failure> {
    let invalid = |faults| Failure::from_faults("invalid configuration", &faults);
    let ports = auto_ports(path).map_err(invalid)?;
    let ports = ports.into_iter().map(|(name, _)| (name, 1)).collect();
    CellConfig::load(path, &ports).map_err(invalid)
}

/// Fails if the configuration has settings that a simulation would have to ignore.
pub fn require_valid_settings(config: &CellConfig) -> Result<(), Failure> {
    let Some(wrong) = first_invalid_setting(config) else {
        return Ok(());
    };
    let mut failure = Failure::new(
        codes::BAD_REQUEST,
        format!("{}: {wrong}", config.source.display()),
        "correct it in the cell's configuration; `rcc-cli up` rejects it as well",
    );
    failure.exit = exit::INVALID;
    Err(failure)
}

/// Calls `what` with the names of this net, as command 1 of the cell.
pub fn with_names<T>(
    names: &Names,
    config: &CellConfig,
    what: impl FnOnce(&NameResolver<'_>) -> T,
) -> T {
    what(&NameResolver {
        disagreement: &|_| None,
        config,
        net: &|_| names.net.clone(),
        names: &|_| names.clone(),
        reason: &|_, _| String::new(),
        condition: &|_| None,
    })
}

/// Returns the failure of a simulation; `csv` is the table that it writes.
#[must_use]
pub fn failure(
    error: &SimulateError,
    net: &Names,
    config: &CellConfig,
    csv: Option<&Path>,
) -> Failure {
    match error {
        SimulateError::Refused(refusal) => {
            let refused = with_names(net, config, |names| names.refusal(1, *refusal));
            Failure::from_server(refused.body())
        }
        SimulateError::Write(error) => not_written(csv.unwrap_or(Path::new("the table")), error),
        SimulateError::Silent => Failure::new(
            codes::PROCESS_FAILED,
            error.to_string(),
            "report it as a bug",
        ),
    }
}
