//! Common parts of all programs of a cell: arguments, log, signals, exit codes, helper threads, and notifications to
//! the supervisor. Used by main threads at start and end; [`notify`] has a thread of its own.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

use std::io::{self, Write};

use rcc_core::printable::{Coloured, Printable};

pub mod arguments;
pub mod exit;
pub mod health;
pub mod helpers;
pub mod log_throttle;
pub mod notify;
pub mod oom;
pub mod priority;
pub mod readers;
pub mod signals;

pub use arguments::CellArguments;
pub use exit::ExitError;
pub use health::HealthReport;
pub use helpers::{Helper, Helpers};
pub use notify::Notifier;
pub use signals::Stop;

/// Begins a program that runs for long. Its timed waits end when their time is over. The log goes to stderr at level info
/// (`RUST_LOG` is not read), coloured only on a terminal; a line that cannot be written (full disk, no reader) is lost, without
/// further effect. Call it once, before any thread starts.
pub fn begin() {
    rcc_os::clock::exact_sleeps();
    let colours = io::IsTerminal::is_terminal(&io::stderr());
    tracing_subscriber::fmt()
        .with_writer(move || LogWriter { colours })
        .with_ansi(colours)
        .with_target(false)
        // It would report errors with `eprintln`, which panics if stderr fails.
        .log_internal_errors(false)
        .init();
}

/// Writer of the log to stderr that escapes terminal control sequences. It is given whole events.
struct LogWriter {
    /// Keeps the colours of the log itself; messages contain none, because the log escapes them.
    colours: bool,
}

impl Write for LogWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        let text = if self.colours {
            Coloured(&text).to_string()
        } else {
            Printable(&text).to_string()
        };
        io::stderr().write_all(text.as_bytes())?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}

/// Prints a line on stdout for the program that started this one. A failed write is ignored.
pub fn say(text: &str) {
    let mut out = io::stdout().lock();
    let _ = out
        .write_all(format!("{}\n", Printable(text)).as_bytes())
        .and_then(|()| out.flush());
}

/// Prints a line on stderr that is not part of the log; a line that cannot be written is lost.
pub fn remark(text: &str) {
    let _ = io::stderr().write_all(format!("{}\n", Printable(text)).as_bytes());
}

#[cfg(test)]
mod tests {
    use rcc_core::printable::first_unprintable;

    /// Logs hostile text in a child process and checks what it prints.
    #[test]
    fn nothing_that_is_logged_commands_a_terminal() {
        const CHILD: &str = "RCC_TEST_LOGS";
        let hostile = "a\x1b[2J\u{9b}31m\u{202e}\x07b";
        if std::env::var_os(CHILD).is_some() {
            super::begin();
            tracing::warn!(device = hostile, error = %hostile, "{hostile}");
            return;
        }
        let output = std::process::Command::new(std::env::current_exe().expect("this test"))
            .args([
                "--exact",
                "tests::nothing_that_is_logged_commands_a_terminal",
                "--nocapture",
            ])
            .env(CHILD, "1")
            .output()
            .expect("the child runs");
        let text = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(text.contains("WARN") && text.contains("[2J"), "{text:?}");
        assert_eq!(first_unprintable(&text), None, "{text:?}");
    }
}
