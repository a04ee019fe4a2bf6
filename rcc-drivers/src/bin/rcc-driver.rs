//! `rcc-driver`: hosts the driver of one device of a cell until it is asked to stop.
//! The main thread exchanges with the device; one thread waits for signals, one watches the announcements.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Parser;
use rcc_config::{CellConfig, DeviceConfig};
use rcc_drivers::drivers;
use rcc_drivers::host::Host;
use rcc_drivers::priority::rise;
use rcc_drivers::sim::process::Stop;
use rcc_ipc::Cell;

/// Exit code of a configuration that cannot be used (sysexits' EX_CONFIG).
const CONFIGURATION: u8 = 78;

/// Set by the signal thread; the host reads it.
static STOP: AtomicBool = AtomicBool::new(false);

/// Hosts the driver of one device of a cell.
#[derive(Debug, Parser)]
#[command(name = "rcc-driver", version)]
struct Options {
    /// Name of the cell
    #[arg(long)]
    cell: String,
    /// The cell's configuration
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Name of the device
    #[arg(long)]
    device: String,
    /// Number of a port that the configuration leaves open
    #[arg(long, value_name = "NAME=NUMBER", value_parser = port)]
    port: Vec<(String, u16)>,
    /// SCHED_FIFO priority of the thread that exchanges with the device; below the executor's
    #[arg(long, value_name = "1..99", value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: Option<u8>,
    /// Stops when the thread that started it ends
    #[arg(long)]
    parent_death: bool,
}

fn port(text: &str) -> Result<(String, u16), String> {
    let pair = text
        .split_once('=')
        .and_then(|(name, number)| Some((name.to_owned(), number.parse().ok()?)));
    pair.ok_or_else(|| format!("'{text}' is not NAME=NUMBER, such as fri=49938"))
}

fn main() -> ExitCode {
    let options = Options::parse();
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .with_target(false)
        .init();
    match run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err((code, words)) => {
            eprintln!("rcc-driver {}: {words}", options.device);
            ExitCode::from(code)
        }
    }
}

fn run(options: &Options) -> Result<(), (u8, String)> {
    let other = |words: &dyn std::fmt::Display| (1, words.to_string());
    let wrong = |words: &dyn std::fmt::Display| (CONFIGURATION, words.to_string());
    // Before the first thread, so that all threads leave the signals to the one that waits for them.
    let signals = Stop::prepare(options.parent_death).map_err(|error| other(&error))?;
    let ports: BTreeMap<String, u16> = options.port.iter().cloned().collect();
    let config = CellConfig::load(&options.config, &ports).map_err(|faults| wrong(&faults))?;
    let device = device(&config, &options.device).map_err(|words| wrong(&words))?;
    let row = drivers::find(device).map_err(|error| wrong(&error))?;
    let driver = (row.open)(device).map_err(|error| match error {
        rcc_drivers::driver::DriverError::System { .. } => other(&error),
        _ => wrong(&error),
    })?;
    let cell = Cell::new(&options.cell).map_err(|error| other(&error))?;
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || {
            // A refusal ends the driver as well: nobody could stop it otherwise.
            if let Err(error) = signals.wait() {
                tracing::error!(%error, "cannot wait for signals");
            }
            STOP.store(true, Ordering::Relaxed);
        })
        .map_err(|error| other(&error))?;
    let mut host = Host::join(&cell, (&config, device), (driver, row.reasons))
        .map_err(|error| other(&error))?;
    // After the helper threads have been started, which would inherit it.
    if let Some(priority) = options.priority {
        rise(priority);
    }
    host.run(&STOP);
    Ok(())
}

fn device<'a>(config: &'a CellConfig, name: &str) -> Result<&'a DeviceConfig, String> {
    config
        .device(name)
        .map(|(_, device)| device)
        .ok_or_else(|| {
            let names: Vec<&str> = config.devices.iter().map(|one| one.name.as_str()).collect();
            format!(
                "{} has no device '{name}'; it has: {}",
                config.source.display(),
                names.join(", ")
            )
        })
}
