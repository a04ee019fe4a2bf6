//! How a program of a cell ends: its last message and an exit code that tells a supervisor whether to start it again.
//! Made and told by the main thread.

use std::fmt::Display;
use std::process::ExitCode;

/// Something went wrong; starting again may help.
pub const FAILED: u8 = 1;
/// Wrong arguments.
pub const USAGE: u8 = 2;
/// The system does not grant what the configuration requires (sysexits.h EX_NOPERM).
pub const NOT_PERMITTED: u8 = 77;
/// The configuration is not valid (sysexits.h EX_CONFIG).
pub const CONFIGURATION: u8 = 78;

/// Exit codes after which starting again cannot help, with what they mean and what to do.
pub const FINAL: [(u8, &str, &str); 3] = [
    (
        USAGE,
        "wrong arguments",
        "all programs must be of one version: build or install them again",
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

/// The end of a program that did not succeed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExitError {
    /// Exit code.
    pub code: u8,
    /// For people: what, where, what to do.
    pub message: String,
}

impl ExitError {
    /// The configuration cannot be used.
    pub fn configuration(message: &impl Display) -> ExitError {
        ExitError {
            code: CONFIGURATION,
            message: message.to_string(),
        }
    }

    /// The system does not grant what is required.
    pub fn not_permitted(message: &impl Display) -> ExitError {
        ExitError {
            code: NOT_PERMITTED,
            message: message.to_string(),
        }
    }
}

/// Everything else is a failure after which starting again may help.
impl<E: std::error::Error> From<E> for ExitError {
    fn from(error: E) -> ExitError {
        ExitError {
            code: FAILED,
            message: error.to_string(),
        }
    }
}

/// Tells the last message on stderr, where the log goes as well.
pub fn conclude(result: Result<(), ExitError>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(ExitError { code, message }) => {
            if code == CONFIGURATION {
                // Several lines with drawings: they speak for themselves.
                crate::remark(&message);
            } else {
                tracing::error!("{message}");
            }
            ExitCode::from(code)
        }
    }
}
