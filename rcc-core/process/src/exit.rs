//! How a program of a cell ends: its last message, and an exit code that tells a supervisor whether to restart it.
//! Created and reported by the main thread.

use std::fmt::Display;
use std::process::ExitCode;

/// A failure; restarting may help.
pub const FAILED: u8 = 1;
/// Invalid arguments.
pub const USAGE: u8 = 2;
/// The system does not grant what the configuration requires (sysexits.h EX_NOPERM).
pub const NOT_PERMITTED: u8 = 77;
/// The configuration is not valid (sysexits.h EX_CONFIG).
pub const CONFIGURATION: u8 = 78;

/// Exit codes for which a restart cannot help, with their meaning and remedy.
pub const FINAL: [(u8, &str, &str); 3] = [
    (
        USAGE,
        "wrong arguments",
        "all programs must be of the same version: build or install them again",
    ),
    (
        NOT_PERMITTED,
        "the system does not grant what the configuration requires",
        "grant it as the lines above say, or set `executor: {rt: best-effort}`",
    ),
    (
        CONFIGURATION,
        "configuration error",
        "correct the configuration as the lines above say",
    ),
];

/// An error that ends a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExitError {
    /// Exit code.
    pub code: u8,
    /// Message for people: what, where, remedy.
    pub message: String,
}

impl ExitError {
    /// Error for a configuration that cannot be used.
    pub fn configuration(message: &impl Display) -> ExitError {
        ExitError {
            code: CONFIGURATION,
            message: message.to_string(),
        }
    }

    /// Error for permissions that the system does not grant.
    pub fn not_permitted(message: &impl Display) -> ExitError {
        ExitError {
            code: NOT_PERMITTED,
            message: message.to_string(),
        }
    }
}

/// All other errors are failures after which a restart may help.
impl<E: std::error::Error> From<E> for ExitError {
    fn from(error: E) -> ExitError {
        ExitError {
            code: FAILED,
            message: error.to_string(),
        }
    }
}

/// Reports the error on stderr, like the log, and returns the exit code.
pub fn conclude(result: Result<(), ExitError>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(ExitError { code, message }) => {
            if code == CONFIGURATION {
                // Diagnostics with excerpts on several lines need no log prefix.
                crate::remark(&message);
            } else {
                tracing::error!("{message}");
            }
            ExitCode::from(code)
        }
    }
}
