//! What every program of a cell has in common: arguments, log, signals, exit codes, helper threads, and words to its supervisor.
//! Used by main threads at start and end; [`notify`] has a thread of its own.

pub mod arguments;
pub mod ending;
pub mod helpers;
pub mod notify;
pub mod signals;

pub use arguments::CellArguments;
pub use ending::Ending;
pub use helpers::{Helper, Helpers};
pub use notify::{Notifier, Pulse};
pub use signals::Stop;

/// Sends the log to stderr, at level info (`RUST_LOG` is not read); colours only where a person reads.
/// Call it once, first.
pub fn log() {
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .with_target(false)
        .init();
}
