//! `watch NET PORT…`: shows values of a net's ports periodically, without changing the net or its text. Each sample is
//! of one cycle. Nothing is registered in the cell, so a watcher that dies leaves nothing behind.

use std::time::{Duration, Instant};

use rcc_api::bodies::{CommandView, ValuesView};
use rcc_api::codes::{self, RequestedEnd, exit};

use super::state::shown;
use crate::client::LoaderClient;
use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::follow;
use crate::interrupt::Interrupts;
use crate::output::{print_line, print_record, reprint};
use crate::value::Style;

/// Highest sampling rate, Hz; a `Monitor` in the net records every cycle.
const RATE_MAX: f64 = 100.0;
/// Lowest sampling rate, Hz: one sample in about 17 minutes. The interval of much lower ones is not a valid duration.
const RATE_MIN: f64 = 1e-3;

/// Arguments of `watch`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Net: id, name (the newest with that name), or name#id
    net: String,
    /// Ports, including inputs, such as move.pose, ik.joints[2] or 'a/filter.*', with * and ? as wildcards [default:
    /// all outputs]
    ports: Vec<String>,
    /// Samples per second, 0.001 to 100
    #[arg(long, default_value_t = 10.0, value_name = "HZ")]
    rate: f64,
    /// End after this many samples
    #[arg(long)]
    count: Option<u64>,
    /// Show angles in degrees
    #[arg(long)]
    deg: bool,
    /// Print one line of JSON per sample, like --output json
    #[arg(long)]
    json: bool,
}

/// Runs the verb until the net ends.
///
/// # Errors
/// Fails if the loader cannot be reached, the net or port does not exist, Ctrl-C was pressed, or the net ended
/// otherwise than `finished`.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let every = interval(arguments.rate)?;
    let interrupts = Interrupts::listen()?;
    let client = context.client()?;
    let mut screen = Screen {
        format: if arguments.json {
            OutputFormat::Json
        } else {
            context.format
        },
        style: Style {
            degrees: arguments.deg,
        },
        rows: 0,
    };
    let mut values = match sample(&client, &arguments.net, &arguments.ports)? {
        Sample::Values(values) => values,
        Sample::Unloaded(command) => return screen.report_end(&command),
    };
    // From now on this command is watched, whatever is loaded under its name.
    let id = values.id.to_string();
    let mut next = Instant::now();
    let mut samples = 0;
    let mut last = None;
    loop {
        let now = (values.cycle, values.state.clone());
        if last.as_ref() != Some(&now) {
            screen.show(&values);
            last = Some(now);
            samples += 1;
        }
        if values.state == "terminated" {
            return screen.report_end(&follow::even_unloaded(&client, &id)?);
        }
        if arguments.count.is_some_and(|count| samples >= count) {
            return Ok(());
        }
        next = (next + every).max(Instant::now());
        while Instant::now() < next {
            if interrupts.asked() {
                return Err(Failure::reported(exit::INTERRUPTED));
            }
            let left = next.saturating_duration_since(Instant::now());
            std::thread::sleep(left.min(follow::POLL_INTERVAL));
        }
        values = match sample(&client, &id, &arguments.ports)? {
            Sample::Values(values) => values,
            Sample::Unloaded(command) => return screen.report_end(&command),
        };
    }
}

/// Returns the interval between two samples at a rate in Hz.
fn interval(rate: f64) -> Result<Duration, Failure> {
    if (RATE_MIN..=RATE_MAX).contains(&rate) {
        return Ok(Duration::from_secs_f64(1.0 / rate));
    }
    let message = format!("invalid rate: {rate} samples per second");
    let help = "must be 0.001 to 100; a Monitor in the net records every cycle";
    Err(Failure::new(codes::BAD_REQUEST, message, help))
}

enum Sample {
    Values(ValuesView),
    /// The net has ended, and somebody unloaded it.
    Unloaded(Box<CommandView>),
}

fn sample(client: &LoaderClient, net: &str, ports: &[String]) -> Result<Sample, Failure> {
    client
        .values(net, ports)
        .map(Sample::Values)
        .or_else(|failure| match follow::even_unloaded(client, net) {
            Ok(command) if follow::is_over(&command) => Ok(Sample::Unloaded(Box::new(command))),
            _ => Err(failure),
        })
}

struct Screen {
    format: OutputFormat,
    style: Style,
    /// Rows of the previous sample, which the next one overwrites on a terminal.
    rows: usize,
}

impl Screen {
    fn show(&mut self, values: &ValuesView) {
        match self.format {
            OutputFormat::Human => {
                // The net's line and the headings of its values stay in view.
                self.rows = reprint(self.rows, &shown(values, self.style), 2);
            }
            OutputFormat::Json => {
                let mut values = values.clone();
                for view in &mut values.values {
                    let (value, unit) = (self.style.value(view), self.style.unit(view));
                    view.value = value;
                    view.unit = view.unit.as_ref().map(|_| unit);
                }
                // Our values have string keys and finite numbers, so serialisation cannot fail.
                print_record(&serde_json::to_string(&values).unwrap_or_default());
            }
        }
    }

    /// Reports how the net ended, as text and as the exit code. In JSON, the last line has the state `terminated`.
    fn report_end(&self, command: &CommandView) -> Result<(), Failure> {
        if matches!(self.format, OutputFormat::Human) {
            print_line(&format!(
                "{}  {}",
                follow::title(command),
                follow::state_text(command)
            ));
        }
        follow::exit_result(command, RequestedEnd::Finish)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_without_a_valid_interval_is_refused() {
        assert_eq!(interval(10.0).unwrap(), Duration::from_millis(100));
        assert_eq!(interval(0.001).unwrap(), Duration::from_secs(1000));
        for rate in [1e-30, 0.0, -1.0, 100.1, f64::NAN, f64::INFINITY] {
            let refused = interval(rate).unwrap_err();
            assert_eq!(refused.exit, exit::USAGE, "{rate}");
        }
    }
}
