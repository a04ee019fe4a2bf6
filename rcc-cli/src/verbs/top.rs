//! `top`: shows where the time of the cycles goes: nets, histograms, primitives, late cycles; live in a terminal, or
//! once as text. Reads from the loader, and acknowledges on request; it has no other effect on the real-time thread.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::buffer::Buffer;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyModifiers};
use rcc_api::bodies::{Acknowledged, CommandView, StatusView, TimingView};
use rcc_api::codes;
use rcc_config::diagnostic::DrawingStyle;
use rcc_core::printable::first_unprintable;
use serde::Serialize;

use super::duration;
use super::status::acknowledged;
use crate::client::LoaderClient;
use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::interrupt::Interrupts;

mod columns;
mod screen;
mod text;

/// Interval between two checks for keys.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

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
    let terminal = io::stdout().is_terminal() && io::stdin().is_terminal();
    if arguments.once || !terminal || context.format == OutputFormat::Json {
        context.print(&snapshot, text::text);
        return Ok(());
    }
    let interrupts = Interrupts::listen()?;
    // This also restores the terminal if the program panics.
    let terminal = ratatui::try_init();
    let shown =
        terminal.and_then(|terminal| run_live(terminal, &client, snapshot, every, &interrupts));
    // Runs however the view ended; a failure means that the terminal is gone.
    let _ = ratatui::try_restore();
    shown.map_err(|error| {
        let help = "use `rcc-cli top --once` for plain text";
        Failure::new(
            codes::PROCESS_FAILED,
            format!("cannot use the terminal: {error}"),
            help,
        )
    })
}

/// Shows the live view until it is closed. If the cell stops answering, the error appears below the last data.
fn run_live(
    mut terminal: DefaultTerminal,
    client: &LoaderClient,
    mut snapshot: TopSnapshot,
    every: Duration,
    interrupts: &Interrupts,
) -> io::Result<()> {
    let mut message = String::new();
    let mut taken = Instant::now();
    loop {
        terminal.draw(|frame| {
            screen::draw(frame, &snapshot, &message);
            make_printable(frame.buffer_mut());
        })?;
        let mut changed = false;
        while !changed {
            if interrupts.asked() {
                return Ok(());
            }
            if event::poll(POLL_INTERVAL)? {
                match key_action(&event::read()?) {
                    KeyAction::End => return Ok(()),
                    KeyAction::Acknowledge => message = acknowledge(client),
                    KeyAction::Draw => {}
                    KeyAction::Nothing => continue,
                }
                changed = true;
            }
            if taken.elapsed() >= every {
                taken = Instant::now();
                match TopSnapshot::take(client) {
                    Ok(new) => snapshot = new,
                    Err(failure) => {
                        message = failure.human(DrawingStyle::default()).replace('\n', " ")
                    }
                }
                changed = true;
            }
        }
    }
}

/// Replaces characters that would reorder or hide text; control characters are not drawn anyway.
fn make_printable(picture: &mut Buffer) {
    for cell in &mut picture.content {
        if first_unprintable(cell.symbol()).is_some() {
            cell.set_symbol("\u{fffd}");
        }
    }
}

fn acknowledge(client: &LoaderClient) -> String {
    let done = client.post::<Acknowledged>("/status/acknowledge", String::new());
    match done {
        Ok(done) => acknowledged(&done),
        Err(failure) => failure.human(DrawingStyle::default()).replace('\n', " "),
    }
}

/// Action requested by a key or a resize of the terminal.
#[derive(Debug, PartialEq, Eq)]
enum KeyAction {
    End,
    Acknowledge,
    Draw,
    Nothing,
}

fn key_action(event: &Event) -> KeyAction {
    match event {
        Event::Resize(..) => KeyAction::Draw,
        Event::Key(KeyEvent {
            code, modifiers, ..
        }) => match code {
            KeyCode::Char('c') if modifiers.contains(KeyModifiers::CONTROL) => KeyAction::End,
            KeyCode::Char('q') | KeyCode::Esc => KeyAction::End,
            KeyCode::Char('a') => KeyAction::Acknowledge,
            _ => KeyAction::Nothing,
        },
        _ => KeyAction::Nothing,
    }
}

#[cfg(test)]
mod tests {
    use ratatui::backend::TestBackend;
    use ratatui::{Frame, Terminal};

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
        let mut picture = Buffer::empty(ratatui::layout::Rect::new(0, 0, 1, 1));
        picture.content[0].set_symbol("a\u{202e}");
        make_printable(&mut picture);
        assert_eq!(picture.content[0].symbol(), "\u{fffd}");
    }

    #[test]
    fn q_escape_and_control_c_end_it() {
        let key = |code, modifiers| key_action(&Event::Key(KeyEvent::new(code, modifiers)));
        assert_eq!(key(KeyCode::Char('q'), KeyModifiers::NONE), KeyAction::End);
        assert_eq!(key(KeyCode::Esc, KeyModifiers::NONE), KeyAction::End);
        assert_eq!(
            key(KeyCode::Char('c'), KeyModifiers::CONTROL),
            KeyAction::End
        );
        assert_eq!(
            key(KeyCode::Char('c'), KeyModifiers::NONE),
            KeyAction::Nothing
        );
        assert_eq!(
            key(KeyCode::Char('a'), KeyModifiers::NONE),
            KeyAction::Acknowledge
        );
        assert_eq!(key_action(&Event::Resize(80, 25)), KeyAction::Draw);
    }
}
