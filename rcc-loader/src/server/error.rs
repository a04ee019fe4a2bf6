//! The server's error type: a row of the table of codes, a message, and a remedy. Created by the server's threads and
//! sent as the answer.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use rcc_ipc::CallError;

use super::api::{ErrorBody, Finding};
use super::codes::{self, ErrorCode};

/// The reason why a request was refused.
#[derive(Clone, Debug, PartialEq)]
pub struct ApiError {
    /// Code, HTTP status and exit code.
    pub code: ErrorCode,
    /// What is wrong, and where.
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

    /// Returns the error for an executor that is not running.
    #[must_use]
    pub fn no_executor(cell: &str) -> ApiError {
        ApiError::new(
            codes::NO_EXECUTOR,
            format!("the executor of cell '{cell}' cannot be reached"),
            "a supervisor restarts it within a second; without one, run `rcc-cli up FILE`",
        )
    }

    /// Converts the failure of a call to the executor.
    #[must_use]
    pub fn of_call(cell: &str, error: &CallError) -> ApiError {
        match error {
            CallError::Timeout { waited, .. } => ApiError::new(
                codes::EXECUTOR_SILENT,
                format!("the executor of cell '{cell}' did not answer within {waited:?}"),
                "it may or may not have carried out the request: check with `rcc-cli state`",
            ),
            CallError::TooLarge { size, max } => ApiError::new(
                codes::TOO_LARGE,
                format!("the plan has {size} bytes; the maximum is {max}"),
                "split the net into several nets",
            ),
            CallError::OutOfSharedMemory(room) => ApiError::new(
                codes::NO_SPACE,
                room.to_string(),
                "free shared memory, then try again",
            ),
            CallError::SpillFile(fault) => ApiError::new(
                codes::NOT_STORED,
                fault.to_string(),
                "free shared memory, then try again",
            ),
            CallError::ServerGone { .. } => ApiError::no_executor(cell),
            CallError::Unanswered { .. } => ApiError::new(
                codes::OTHER_BUILD,
                format!("the executor of cell '{cell}' refused a request that it could not decode"),
                "see its log for the reason; install loader and executor from the same build and restart them",
            ),
            CallError::Failed { cause, .. } => ApiError::new(
                codes::NO_EXECUTOR,
                format!("the executor of cell '{cell}' cannot be called: {cause}"),
                "try again; if the error persists, restart the loader",
            ),
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

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        // The table contains only statuses from 400 to 599; a test checks this.
        let status =
            StatusCode::from_u16(self.code.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        (status, Json(self.body())).into_response()
    }
}
