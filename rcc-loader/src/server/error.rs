//! Errors as answers to requests, and the errors of calls to the executor. Created by the server's threads.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_ipc::CallError;

/// An error as the answer to a request.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorResponse(pub ApiError);

impl From<ApiError> for ErrorResponse {
    fn from(error: ApiError) -> ErrorResponse {
        ErrorResponse(error)
    }
}

impl IntoResponse for ErrorResponse {
    fn into_response(self) -> Response {
        // The table contains only statuses from 400 to 599; a test checks this.
        let status =
            StatusCode::from_u16(self.0.code.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        (status, Json(self.0.body())).into_response()
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
        CallError::ServerGone { .. } => no_executor(cell),
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
