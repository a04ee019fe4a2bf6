//! The one error of the server: a row of the table of codes, what happened, and what to do.
//! Made and answered by the server's threads.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use rcc_ipc::CallError;

use super::api::{ErrorBody, Finding};
use super::codes::{self, Code};

/// Why a request was refused.
#[derive(Clone, Debug, PartialEq)]
pub struct ApiError {
    /// Code, HTTP status and exit code.
    pub code: Code,
    /// What is wrong, and where.
    pub message: String,
    /// What to do.
    pub help: String,
    /// Faults of a text, if it is about one.
    pub diagnostics: Vec<Finding>,
}

impl ApiError {
    /// An error without diagnostics.
    pub fn new(code: Code, message: impl Into<String>, help: impl Into<String>) -> ApiError {
        ApiError {
            code,
            message: message.into(),
            help: help.into(),
            diagnostics: Vec::new(),
        }
    }

    /// The executor is not there.
    #[must_use]
    pub fn no_executor(cell: &str) -> ApiError {
        ApiError::new(
            codes::NO_EXECUTOR,
            format!("the executor of cell '{cell}' cannot be reached"),
            "a supervisor starts it again within a second; without one: `rcc-cli up FILE`",
        )
    }

    /// A call to the executor that has no answer.
    #[must_use]
    pub fn of_call(cell: &str, error: &CallError) -> ApiError {
        match error {
            CallError::Timeout { waited, .. } => ApiError::new(
                codes::EXECUTOR_SILENT,
                format!("the executor of cell '{cell}' did not answer within {waited:?}"),
                "whether it did what was asked is not known: look at `rcc-cli state`",
            ),
            CallError::TooLarge { size, max } => ApiError::new(
                codes::TOO_LARGE,
                format!("the plan has {size} bytes, {max} are the most"),
                "divide the net into several",
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
                format!("the executor of cell '{cell}' refused the bytes of a request"),
                "its log says why; install loader and executor from one build and restart them",
            ),
            CallError::Failed { cause, .. } => ApiError::new(
                codes::NO_EXECUTOR,
                format!("the executor of cell '{cell}' cannot be asked: {cause}"),
                "try again; if it stays so, restart the loader",
            ),
        }
    }

    /// As it travels.
    #[must_use]
    pub fn body(&self) -> ErrorBody {
        ErrorBody {
            code: self.code.code.to_owned(),
            message: self.message.clone(),
            help: (!self.help.is_empty()).then(|| self.help.clone()),
            diagnostics: self.diagnostics.clone(),
        }
    }

    /// As one finding of a command that became rejected.
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
        // The table holds only statuses from 400 to 599, by test.
        let status =
            StatusCode::from_u16(self.code.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        (status, Json(self.body())).into_response()
    }
}
