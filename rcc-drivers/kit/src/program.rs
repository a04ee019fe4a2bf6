//! The program of a driver: hosts the driver of one device of a cell until it is asked to stop.
//! The main thread exchanges with the device; one thread waits for signals, one watches the announcements. All threads
//! are created before the driver reports that it is ready; if a helper thread panics, the device is brought to rest and
//! the driver ends.

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::{CommandFactory, FromArgMatches, Parser};
use rcc_config::{CellConfig, DeviceConfig};
use rcc_ipc::Cell;
use rcc_process::{CellArguments, ExitError, Notifier, Stop, exit, helpers};
use rcc_protocol::events::EventKind;

use crate::driver::{Driver, DriverEntry, DriverError};
use crate::host::Host;
use crate::host::reason::Reason;
use crate::listen::listen;
use crate::priority::set_realtime_priority;

/// Set by the signal thread; the host reads it.
static STOP: AtomicBool = AtomicBool::new(false);

/// Hosts the driver of one device of a cell.
#[derive(Debug, Parser)]
#[command(version = rcc_protocol::version::version())]
struct Options {
    #[command(flatten)]
    driver: Arguments,
}

/// What every program of a driver is started with, after the `arguments` of the cell's configuration; to be flattened into
/// the arguments of a program that has some of its own.
#[derive(Clone, Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    cell: CellArguments,
    /// Name of the device
    #[arg(long, env = "RCC_DEVICE")]
    device: String,
    /// SCHED_FIFO priority of the thread that exchanges with the device; below the executor's
    #[arg(long, env = "RCC_PRIORITY", value_name = "1..99", value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: Option<u8>,
    /// Only listen to the device for this time, ms, and print what it sends as JSON: nothing is sent to it
    #[arg(long, value_name = "MILLISECONDS", value_parser = clap::value_parser!(u64).range(1..=600_000))]
    listen: Option<u64>,
}

/// Is the whole program `name`: reads its arguments, and hosts the driver that the configuration of the device names.
#[must_use]
pub fn main(name: &'static str, drivers: &[DriverEntry]) -> ExitCode {
    let matches = Options::command().name(name).get_matches();
    match Options::from_arg_matches(&matches) {
        Ok(Options { driver }) => run(&driver, drivers),
        Err(error) => error.exit(),
    }
}

/// Hosts one of these drivers until the program is asked to stop; for programs with arguments of their own.
#[must_use]
pub fn run(arguments: &Arguments, drivers: &[DriverEntry]) -> ExitCode {
    let result = match arguments.listen {
        Some(milliseconds) => listen_only(arguments, drivers, Duration::from_millis(milliseconds)),
        None => {
            rcc_process::begin();
            host(arguments, drivers)
        }
    };
    exit::conclude(result)
}

fn listen_only(
    arguments: &Arguments,
    drivers: &[DriverEntry],
    time: Duration,
) -> Result<(), ExitError> {
    let config = arguments.cell.load()?;
    listen(open(drivers, device(&config, &arguments.device)?), time)
}

fn open(
    drivers: &[DriverEntry],
    device: &DeviceConfig,
) -> Result<(Box<dyn Driver>, &'static [Reason]), DriverError> {
    let entry = DriverEntry::find(drivers, device)?;
    Ok(((entry.open)(device)?, entry.reasons))
}

fn host(arguments: &Arguments, drivers: &[DriverEntry]) -> Result<(), ExitError> {
    // Before the first thread, so that all threads leave signals to the one that waits for them.
    let signals = Stop::prepare(arguments.cell.parent_death)?;
    let config = arguments.cell.load()?;
    let device = device(&config, &arguments.device)?;
    let driver = open(drivers, device).map_err(|error| match error {
        DriverError::System { .. } => ExitError::from(error),
        _ => ExitError::configuration(&format!("driver {}: {error}", arguments.device)),
    })?;
    let cell = Cell::new(&arguments.cell.cell)?;
    cell.make_state(config.recorder.folder.as_deref())?;
    let mut host = Host::join(&cell, (&config, device), driver)?;
    let health = host.health();
    let helpers = host.helpers().clone();
    let recorder = host.recorder().clone();
    let mut hangs = helpers.watch(move |hang| {
        tracing::error!("{hang}");
        recorder.tell(EventKind::HelperHangs {
            helper: hang.helper.to_owned(),
            silent_ms: hang.silent.as_millis().try_into().unwrap_or(u64::MAX),
            limit_ms: hang.limit.as_millis().try_into().unwrap_or(u64::MAX),
        });
    });
    // READY is sent once the host runs, when all threads exist.
    let supervisor = Notifier::start(&helpers, move || hangs.check(health.report()))?;
    let failed = helpers.clone();
    helpers::thread("signals", move || {
        signals.wait();
        // A driver that ends because of an internal failure stays under the watchdog until its device is at rest.
        if failed.failure().is_none() {
            supervisor.stopping();
        }
        STOP.store(true, Ordering::Relaxed);
    })?;
    // After the helper threads have been started, since they would inherit the priority.
    if let Some(priority) = arguments.priority {
        set_realtime_priority(priority);
    }
    host.run(&STOP);
    helpers.conclude()
}

fn device<'a>(config: &'a CellConfig, name: &str) -> Result<&'a DeviceConfig, ExitError> {
    config
        .device(name)
        .map(|(_, device)| device)
        .ok_or_else(|| {
            let names: Vec<&str> = config.devices.iter().map(|one| one.name.as_str()).collect();
            ExitError::configuration(&format!(
                "{} has no device `{name}`; available devices: {}",
                config.source.display(),
                names.join(", ")
            ))
        })
}
