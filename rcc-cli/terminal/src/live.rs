//! A live view: draws the whole screen, refreshes it at an interval, and passes keys on, until somebody ends it. Run by the
//! main thread.

use std::io::{self, IsTerminal as _};
use std::time::{Duration, Instant};

use ratatui::buffer::Buffer;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyModifiers};
use ratatui::{DefaultTerminal, Frame};
use rcc_core::printable::first_unprintable;

/// Interval between two checks for keys.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// The content of a live view.
pub trait LiveView {
    /// Draws the whole screen.
    fn draw(&self, frame: &mut Frame<'_>);
    /// Fetches new data.
    fn refresh(&mut self);
    /// Does what a key asks for; false if it asks for nothing.
    fn key(&mut self, key: char) -> bool;
}

/// Returns true if there are a screen and keys: both stdout and stdin are a terminal.
#[must_use]
pub fn is_possible() -> bool {
    io::stdout().is_terminal() && io::stdin().is_terminal()
}

/// Shows the view until q, Escape or Ctrl-C, or until `is_interrupted`. The terminal is restored however it ends.
///
/// # Errors
/// Fails if the terminal cannot be used.
pub fn show(
    view: &mut impl LiveView,
    every: Duration,
    is_interrupted: impl Fn() -> bool,
) -> io::Result<()> {
    // This also restores the terminal if the program panics.
    let terminal = ratatui::try_init();
    let shown = terminal.and_then(|terminal| run(terminal, view, every, is_interrupted));
    // Runs however the view ended; a failure means that the terminal is gone.
    let _ = ratatui::try_restore();
    shown
}

fn run(
    mut terminal: DefaultTerminal,
    view: &mut impl LiveView,
    every: Duration,
    is_interrupted: impl Fn() -> bool,
) -> io::Result<()> {
    let mut taken = Instant::now();
    loop {
        terminal.draw(|frame| {
            view.draw(frame);
            make_printable(frame.buffer_mut());
        })?;
        let mut changed = false;
        while !changed {
            if is_interrupted() {
                return Ok(());
            }
            if event::poll(POLL_INTERVAL)? {
                changed = match key_action(&event::read()?) {
                    KeyAction::End => return Ok(()),
                    KeyAction::Key(key) => view.key(key),
                    KeyAction::Draw => true,
                    KeyAction::Nothing => false,
                };
            }
            if taken.elapsed() >= every {
                taken = Instant::now();
                view.refresh();
                changed = true;
            }
        }
    }
}

/// Replaces characters that would reorder or hide text; control characters are not drawn anyway.
pub fn make_printable(picture: &mut Buffer) {
    for cell in &mut picture.content {
        if first_unprintable(cell.symbol()).is_some() {
            cell.set_symbol("\u{fffd}");
        }
    }
}

/// Action requested by a key or a resize of the terminal.
#[derive(Debug, PartialEq, Eq)]
enum KeyAction {
    End,
    Key(char),
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
            KeyCode::Char(key) => KeyAction::Key(*key),
            _ => KeyAction::Nothing,
        },
        _ => KeyAction::Nothing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_reorder_or_hide_text_is_not_drawn() {
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
            KeyAction::Key('c')
        );
        assert_eq!(
            key(KeyCode::Char('a'), KeyModifiers::NONE),
            KeyAction::Key('a')
        );
        assert_eq!(key(KeyCode::Left, KeyModifiers::NONE), KeyAction::Nothing);
        assert_eq!(key_action(&Event::Resize(80, 25)), KeyAction::Draw);
    }
}
