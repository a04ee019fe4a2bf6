//! `rcc-probe`: listens to one device for a while, as its driver would, and prints what it received as JSON; it never
//! answers, so nothing moves and no output changes.
//! Run by the main thread; used by `rcc-cli doctor` when no driver runs.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io::Write;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Parser;
use rcc_drivers::driver::{DriverError, Exchange, Inputs, LinkError};
use rcc_drivers::drivers;
use rcc_drivers::host::reason;
use rcc_process::{CellArguments, ExitError, exit};
use serde_json::{Value, json};

/// Longest wait for one datagram.
const STEP: Duration = Duration::from_millis(10);

/// Listens to one device of a cell and prints what it received as JSON.
#[derive(Debug, Parser)]
#[command(name = "rcc-probe", version = rcc_protocol::version::version())]
struct Options {
    #[command(flatten)]
    cell: CellArguments,
    /// Name of the device
    #[arg(long)]
    device: String,
    /// How long to listen, ms
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u64).range(1..=600_000))]
    milliseconds: u64,
}

fn main() -> ExitCode {
    let options = Options::parse();
    exit::conclude(run(&options))
}

fn run(options: &Options) -> Result<(), ExitError> {
    let config = options.cell.load()?;
    let (_, device) = config.device(&options.device).ok_or_else(|| {
        ExitError::configuration(&format!(
            "device `{}` not found in the configuration",
            options.device
        ))
    })?;
    let told = match drivers::find(device)
        .and_then(|row| (row.open)(device).map(|driver| (row, driver)))
    {
        Err(error) => refused(&error),
        Ok((row, mut driver)) => {
            let mut last = None;
            let mut inputs = Inputs::NONE;
            let mut exchanges = 0_u64;
            let end = Instant::now() + Duration::from_millis(options.milliseconds);
            while Instant::now() < end {
                let result = driver.receive(STEP, &mut inputs);
                exchanges += u64::from(result.is_ok());
                // Silence between two datagrams is normal.
                if last.is_none() || result != Err(LinkError::Silent) {
                    last = Some(result);
                }
            }
            let link = driver.diagnosis().map(|diagnosis| diagnosis.link());
            json!({
                "schema": 1,
                "opened": true,
                "milliseconds": options.milliseconds,
                "exchanges": exchanges,
                "last": last.map(|last| outcome(last, row.reasons)),
                "link": link,
            })
        }
    };
    // This line is the result: without it the probe has failed.
    writeln!(std::io::stdout(), "{told}")?;
    Ok(())
}

fn outcome(last: Result<Exchange, LinkError>, reasons: &'static [reason::Reason]) -> Value {
    let (number, quality) = match last {
        Ok(exchange) => (exchange.reason, Some(exchange.quality_permille)),
        Err(LinkError::Silent) => (reason::SILENT, None),
        Err(LinkError::Lost { reason }) => (reason, None),
    };
    let words = if number == 0 {
        ""
    } else {
        reason::meaning(number, reasons)
    };
    json!({"reason": number, "reason_words": words, "quality_permille": quality})
}

fn refused(error: &DriverError) -> Value {
    let errno = match error {
        DriverError::System { source, .. } => source.raw_os_error(),
        _ => None,
    };
    json!({"schema": 1, "opened": false, "error": error.to_string(), "errno": errno})
}
