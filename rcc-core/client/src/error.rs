//! Errors of a client. Plain data.

use std::time::Duration;

use rcc_api::bodies::ErrorBody;
use rcc_api::codes::{self, ErrorCode};

use crate::outcome::Outcome;

/// A request that failed: refused by the loader, or not answered.
#[derive(Clone, Debug, PartialEq)]
pub struct RequestError {
    /// Exit code for a program that ends because of it.
    pub exit: u8,
    /// Code, message, remedy, and the diagnostics of a text.
    pub body: Box<ErrorBody>,
}

impl RequestError {
    /// Creates an error with a code of the table.
    pub fn new(
        code: ErrorCode,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> RequestError {
        let help = help.into();
        RequestError {
            exit: code.exit,
            body: Box::new(ErrorBody {
                code: code.code.to_owned(),
                message: message.into(),
                help: (!help.is_empty()).then_some(help),
                diagnostics: Vec::new(),
            }),
        }
    }

    /// Converts the loader's error answer.
    #[must_use]
    pub fn from_server(body: ErrorBody) -> RequestError {
        RequestError {
            exit: codes::exit_code(&body.code),
            body: Box::new(body),
        }
    }
}

impl std::fmt::Display for RequestError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}: {}", self.body.code, self.body.message)?;
        for finding in &self.body.diagnostics {
            write!(formatter, "\n{}", finding.rendered.trim_end())?;
        }
        match &self.body.help {
            Some(help) => write!(formatter, "\nhelp: {help}"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for RequestError {}

/// The reason why an operation of a client did not succeed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ClientError {
    /// A request was refused or not answered.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// The net has errors; they are the diagnostics of the error.
    #[error("net {net} is not valid: {error}")]
    Rejected {
        /// The net's name.
        net: String,
        /// The diagnostics.
        error: RequestError,
    },
    /// The net ended otherwise than as `finished`: what should follow must not begin.
    #[error("{0}")]
    NotFinished(Outcome),
    /// The net has not ended in this time; it goes on.
    #[error("the net has not ended within {0:?}")]
    Timeout(Duration),
    /// The loader ended a stream that was not complete.
    #[error("the cell ended its stream: see `rcc-cli status`")]
    StreamEnded,
    /// A line of a stream is not understood.
    #[error(
        "the cell's answer is not understood: {0}; use this program with a cell of its version"
    )]
    NotUnderstood(String),
}

impl Outcome {
    /// Returns itself if the net finished by itself.
    ///
    /// # Errors
    /// Returns [`ClientError::NotFinished`] for every other reason.
    pub fn finished(self) -> Result<Outcome, ClientError> {
        match self.reason.as_str() {
            "finished" => Ok(self),
            _ => Err(ClientError::NotFinished(self)),
        }
    }
}
