//! The error of a request: a row of the table of codes, a message, and a remedy. Created by the server's threads and
//! sent as the answer, or by a program that does the same work without a server.

use crate::bodies::{ErrorBody, Finding};
use crate::codes::ErrorCode;

/// The reason why a request was refused.
#[derive(Clone, Debug, PartialEq)]
pub struct ApiError {
    /// Code, HTTP status and exit code.
    pub code: ErrorCode,
    /// The error and its location, for people.
    pub message: String,
    /// The remedy.
    pub help: String,
    /// Errors and warnings of a text, if the request is about one.
    pub diagnostics: Vec<Finding>,
}

impl ApiError {
    /// Creates an error without diagnostics.
    pub fn new(code: ErrorCode, message: impl Into<String>, help: impl Into<String>) -> ApiError {
        ApiError {
            code,
            message: message.into(),
            help: help.into(),
            diagnostics: Vec::new(),
        }
    }

    /// Returns the JSON body.
    #[must_use]
    pub fn body(&self) -> ErrorBody {
        ErrorBody {
            code: self.code.code.to_owned(),
            message: self.message.clone(),
            help: (!self.help.is_empty()).then(|| self.help.clone()),
            diagnostics: self.diagnostics.clone(),
        }
    }

    /// Returns the error as a finding, for a command that was rejected because of it.
    #[must_use]
    pub fn finding(&self) -> Finding {
        let (code, message, help) = (self.code.code, &self.message, &self.help);
        Finding {
            code: code.to_owned(),
            severity: "error".to_owned(),
            message: message.clone(),
            place: None,
            used_at: None,
            help: (!help.is_empty()).then(|| help.clone()),
            rendered: format!("Error {code}: {message}\n  help: {help}\n"),
        }
    }
}
