//! `watch NET PORT…`: values of any ports of a net, again and again, without touching the net or its text.
//! Each sample is of one cycle; nothing is registered anywhere, so that a watcher that dies leaves nothing behind.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use rcc_loader::server::api::ValuesView;
use rcc_loader::server::codes::{self, RequestedEnd, exit};

use super::state::shown;
use crate::client::Client;
use crate::context::{Context, Format};
use crate::failure::Failure;
use crate::follow;
use crate::interrupt::Interrupts;
use crate::output::{print_line, reprint};
use crate::value::Style;

/// More samples a second are not taken: for every cycle there is `Monitor`.
const RATE_MAX: f64 = 100.0;

/// What is watched.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Id, name of the net (then the newest of that name), or name#id.
    net: String,
    /// Ports like move.pose, ik.joints[2] or 'a/filter.*', inputs too; * and ? stand for any characters. All outputs without.
    ports: Vec<String>,
    /// Samples a second, at most 100.
    #[arg(long, default_value_t = 10.0, value_name = "HZ")]
    rate: f64,
    /// End after this many samples.
    #[arg(long)]
    count: Option<u64>,
    /// Angles in degrees.
    #[arg(long)]
    deg: bool,
    /// A line of JSON a sample, as with `--output json`.
    #[arg(long)]
    json: bool,
}

/// Does it, until the net is over.
///
/// # Errors
/// Not reachable, no such net or port, Ctrl-C, or a net that ended otherwise than `finished`.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if !(arguments.rate > 0.0 && arguments.rate <= RATE_MAX) {
        let message = format!("invalid rate: {} samples per second", arguments.rate);
        let help = "must be more than 0 and at most 100; a Monitor in the net records every cycle";
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    }
    let interrupts = Interrupts::listen()?;
    let client = context.client()?;
    let mut screen = Screen {
        format: if arguments.json {
            Format::Json
        } else {
            context.format
        },
        style: Style {
            degrees: arguments.deg,
        },
        lines: 0,
    };
    let mut values = client.values(&arguments.net, &arguments.ports)?;
    // From now on it is that command, whatever is loaded under its name.
    let id = values.id.to_string();
    let every = Duration::from_secs_f64(1.0 / arguments.rate);
    let mut next = Instant::now();
    let mut samples = 0;
    let mut last = None;
    loop {
        let sample = (values.cycle, values.state.clone());
        if last.as_ref() != Some(&sample) {
            screen.show(&values);
            last = Some(sample);
            samples += 1;
        }
        if values.state == "terminated" {
            return screen.over(&client, &id);
        }
        if arguments.count.is_some_and(|count| samples >= count) {
            return Ok(());
        }
        next = (next + every).max(Instant::now());
        while Instant::now() < next {
            if interrupts.asked() {
                return Err(Failure::said(exit::INTERRUPTED));
            }
            let left = next.saturating_duration_since(Instant::now());
            std::thread::sleep(left.min(follow::POLL));
        }
        values = client.values(&id, &arguments.ports)?;
    }
}

struct Screen {
    format: Format,
    style: Style,
    /// Lines of the sample before, which the next one replaces on a terminal.
    lines: usize,
}

impl Screen {
    fn show(&mut self, values: &ValuesView) {
        match self.format {
            Format::Human => {
                let text = shown(values, self.style);
                let lines = text.lines().count();
                reprint(self.lines, &text);
                self.lines = if std::io::stdout().is_terminal() {
                    lines
                } else {
                    0
                };
            }
            Format::Json => {
                let mut values = values.clone();
                for view in &mut values.values {
                    let (value, unit) = (self.style.value(view), self.style.unit(view));
                    view.value = value;
                    view.unit = view.unit.as_ref().map(|_| unit);
                }
                // Values of ours have string keys and finite numbers.
                print_line(&serde_json::to_string(&values).unwrap_or_default());
            }
        }
    }

    /// The net is over: how it ended, in words and as the exit code. In JSON the last line says that its state is
    /// `terminated`.
    fn over(&self, client: &Client, id: &str) -> Result<(), Failure> {
        let command = follow::brief(client, id)?;
        if matches!(self.format, Format::Human) {
            print_line(&format!(
                "{}  {}",
                follow::title(&command),
                follow::state_words(&command)
            ));
        }
        follow::judge(&command, RequestedEnd::Finish)
    }
}
