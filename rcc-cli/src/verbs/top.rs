//! `top`: shows where the time of the cycles goes: nets, histograms, primitives, late cycles; live in a terminal, or
//! once as text. Reads from the loader, and acknowledges on request; it has no other effect on the real-time thread.

use ratatui::Frame;
use rcc_api::bodies::{Acknowledged, CommandView, StatusView, TimingView};
use rcc_api::codes;
use rcc_config::diagnostic::DrawingStyle;
use rcc_terminal::live::{self, LiveView};
use serde::Serialize;

use super::duration;
use super::status::acknowledged;
use crate::client::LoaderClient;
use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::interrupt::Interrupts;

mod screen;
mod text;

/// Arguments of `top`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Print once as text; implied without a terminal and by --output json
    #[arg(long)]
    once: bool,
    /// Refresh interval
    #[arg(long, value_name = "DURATION", default_value = "500ms")]
    every: String,
}

/// The displayed data.
#[derive(Clone, Debug, Default, Serialize)]
struct TopSnapshot {
    status: StatusView,
    nets: Vec<CommandView>,
    timing: TimingView,
}

impl TopSnapshot {
    fn take(client: &LoaderClient) -> Result<TopSnapshot, Failure> {
        Ok(TopSnapshot {
            status: client.get("/status")?,
            nets: client.get("/commands")?,
            timing: client.get("/timing")?,
        })
    }
}

/// Runs the verb; q, Escape or Ctrl-C end the live view.
///
/// # Errors
/// Fails if the loader cannot be reached at the start, or if the terminal cannot be used.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let every = duration(&arguments.every)
        .map_err(|message| Failure::new(codes::BAD_REQUEST, message, ""))?;
    let client = context.client()?;
    let snapshot = TopSnapshot::take(&client)?;
    if arguments.once || !live::is_possible() || context.format == OutputFormat::Json {
        context.print(&snapshot, text::text);
        return Ok(());
    }
    let interrupts = Interrupts::listen()?;
    let mut view = TopView {
        client: &client,
        snapshot,
        message: String::new(),
    };
    let shown = live::show(&mut view, every, || interrupts.asked());
    shown.map_err(|error| {
        let help = "use `rcc-cli top --once` for plain text";
        Failure::new(
            codes::PROCESS_FAILED,
            format!("cannot use the terminal: {error}"),
            help,
        )
    })
}

/// The live view. If the cell stops answering, the error appears below the last data.
struct TopView<'a> {
    client: &'a LoaderClient,
    snapshot: TopSnapshot,
    message: String,
}

impl LiveView for TopView<'_> {
    fn draw(&self, frame: &mut Frame<'_>) {
        screen::draw(frame, &self.snapshot, &self.message);
    }

    fn refresh(&mut self) {
        match TopSnapshot::take(self.client) {
            Ok(new) => self.snapshot = new,
            Err(failure) => {
                self.message = failure.human(DrawingStyle::default()).replace('\n', " ");
            }
        }
    }

    fn key(&mut self, key: char) -> bool {
        let acknowledges = key == 'a';
        if acknowledges {
            self.message = acknowledge(self.client);
        }
        acknowledges
    }
}

fn acknowledge(client: &LoaderClient) -> String {
    let done = client.post::<Acknowledged>("/status/acknowledge", String::new());
    match done {
        Ok(done) => acknowledged(&done),
        Err(failure) => failure.human(DrawingStyle::default()).replace('\n', " "),
    }
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use rcc_core::printable::first_unprintable;
    use rcc_terminal::live::make_printable;

    use super::*;

    #[test]
    fn a_hostile_name_does_not_control_the_terminal() {
        let mut terminal = Terminal::new(TestBackend::new(120, 40)).unwrap();
        let hostile = "\x1b[2Ja\u{202e}b\u{9b}31m\u{200b}";
        let net = CommandView {
            net: hostile.into(),
            state: hostile.into(),
            uses: vec![hostile.into()],
            ..CommandView::default()
        };
        let mut snapshot = TopSnapshot {
            nets: vec![net],
            ..TopSnapshot::default()
        };
        snapshot.status.cell = hostile.into();
        snapshot.status.executor.grade = hostile.into();
        let draw = |frame: &mut Frame<'_>, clean: bool| {
            screen::draw(frame, &snapshot, hostile);
            if clean {
                make_printable(frame.buffer_mut());
            }
        };
        let mut bad = |clean| {
            let done = terminal.draw(|frame| draw(frame, clean)).unwrap();
            let cells = done.buffer.content.iter();
            cells
                .filter(|cell| first_unprintable(cell.symbol()).is_some())
                .count()
        };
        assert_eq!(bad(true), 0);
    }
}
