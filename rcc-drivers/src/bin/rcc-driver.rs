//! `rcc-driver`: hosts the driver of one device of a cell until it is asked to stop.
//! The main thread exchanges with the device; one thread waits for signals, one watches the announcements. All threads
//! are created before the driver reports that it is ready; if a helper thread panics, the device is brought to rest and
//! the driver ends.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Parser;
use rcc_config::{CellConfig, DeviceConfig};
use rcc_drivers::driver::DriverError;
use rcc_drivers::drivers;
use rcc_drivers::host::Host;
use rcc_drivers::priority::set_realtime_priority;
use rcc_ipc::Cell;
use rcc_process::{CellArguments, ExitError, Notifier, Stop, exit, helpers};
use rcc_protocol::events::EventKind;

/// Set by the signal thread; the host reads it.
static STOP: AtomicBool = AtomicBool::new(false);

/// Hosts the driver of one device of a cell.
#[derive(Debug, Parser)]
#[command(name = "rcc-driver", version = rcc_protocol::version::version())]
struct Options {
    #[command(flatten)]
    cell: CellArguments,
    /// Name of the device
    #[arg(long, env = "RCC_DEVICE")]
    device: String,
    /// SCHED_FIFO priority of the thread that exchanges with the device; below the executor's
    #[arg(long, env = "RCC_PRIORITY", value_name = "1..99", value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: Option<u8>,
}

fn main() -> ExitCode {
    let options = Options::parse();
    rcc_process::log();
    exit::conclude(run(&options))
}

fn run(options: &Options) -> Result<(), ExitError> {
    // Before the first thread, so that all threads leave signals to the one that waits for them.
    let signals = Stop::prepare(options.cell.parent_death)?;
    let config = options.cell.load()?;
    let device = device(&config, &options.device)?;
    let wrong = |error: &dyn std::error::Error| {
        ExitError::configuration(&format!("rcc-driver {}: {error}", options.device))
    };
    let row = drivers::find(device).map_err(|error| wrong(&error))?;
    let driver = (row.open)(device).map_err(|error| match error {
        DriverError::System { .. } => ExitError::from(error),
        _ => wrong(&error),
    })?;
    let cell = Cell::new(&options.cell.cell)?;
    cell.make_state(config.recorder.folder.as_deref())?;
    let mut host = Host::join(&cell, (&config, device), (driver, row.reasons))?;
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
    if let Some(priority) = options.priority {
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
