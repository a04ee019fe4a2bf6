//! `--listen`: a driver's program listens to its device for a while, as the driver would, and prints what it received as
//! JSON; it never answers, so nothing moves and no output changes.
//! Run by the main thread; used by `rcc-cli doctor` when no driver runs.

use std::io::Write;
use std::time::{Duration, Instant};

use rcc_process::ExitError;
use serde_json::{Value, json};

use crate::driver::{Driver, DriverError, Exchange, Inputs, LinkError};
use crate::host::reason::{self, Reason};

/// Longest wait for one datagram.
const STEP: Duration = Duration::from_millis(10);

/// Listens to the device of an opened driver, or reports why it was not opened.
///
/// # Errors
/// Returns an error if the result cannot be printed.
pub fn listen(
    opened: Result<(Box<dyn Driver>, &'static [Reason]), DriverError>,
    time: Duration,
) -> Result<(), ExitError> {
    let told = match opened {
        Err(error) => refused(&error),
        Ok((mut driver, reasons)) => received(driver.as_mut(), reasons, time),
    };
    // This line is the result: without it the program has failed.
    writeln!(std::io::stdout(), "{told}")?;
    Ok(())
}

fn received(driver: &mut dyn Driver, reasons: &'static [Reason], time: Duration) -> Value {
    let mut last = None;
    let mut inputs = Inputs::NONE;
    let mut exchanges = 0_u64;
    let end = Instant::now() + time;
    while Instant::now() < end {
        let result = driver.receive(STEP, &mut inputs);
        exchanges += u64::from(result.is_ok());
        // Silence between two datagrams is normal.
        if last.is_none() || result != Err(LinkError::Silent) {
            last = Some(result);
        }
    }
    let reasons = driver.reasons().unwrap_or(reasons);
    json!({
        "schema": 1,
        "opened": true,
        "milliseconds": time.as_millis(),
        "exchanges": exchanges,
        "last": last.map(|last| outcome(last, reasons)),
        "link": driver.diagnosis().map(|diagnosis| diagnosis.link()),
    })
}

fn outcome(last: Result<Exchange, LinkError>, reasons: &'static [Reason]) -> Value {
    let (number, quality) = match last {
        Ok(exchange) => (exchange.reason, Some(exchange.quality_permille)),
        Err(LinkError::Silent) => (reason::SILENT, None),
        Err(LinkError::Lost { reason }) => (reason, None),
    };
    let words = match number {
        0 => "",
        _ => reason::meaning(number, reasons),
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
