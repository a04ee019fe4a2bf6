//! Answers to pages: refused requests, and what the loader answers. Run by the serving thread.

use axum::Json;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use hyper::Method;
use rcc_api::bodies::ErrorBody;
use rcc_api::codes::{self, ErrorCode};
use rcc_api::error::ApiError;

use super::Server;

/// The answer to a refused request.
pub struct Refused(ErrorBody);

impl Refused {
    /// Creates the answer of an error.
    pub fn new(code: ErrorCode, message: impl Into<String>, help: &str) -> Refused {
        Refused(ApiError::new(code, message, help).body())
    }
}

impl From<ErrorBody> for Refused {
    fn from(body: ErrorBody) -> Refused {
        Refused(body)
    }
}

impl IntoResponse for Refused {
    fn into_response(self) -> Response {
        let known = codes::TABLE.iter().find(|row| row.code == self.0.code);
        let status = known.and_then(|row| StatusCode::from_u16(row.status).ok());
        (status.unwrap_or(StatusCode::BAD_GATEWAY), Json(self.0)).into_response()
    }
}

/// The answer to a request.
pub type Answered = Result<Response, Refused>;

/// Passes the loader's answer on, with its status.
pub async fn passed(server: &Server, method: Method, path: &str, body: String) -> Answered {
    let answer = server.loader.request(method, path, body).await?;
    let status = StatusCode::from_u16(answer.status).unwrap_or(StatusCode::BAD_GATEWAY);
    server.hub.poll.notify_one();
    Ok((
        status,
        [(header::CONTENT_TYPE, "application/json")],
        answer.body,
    )
        .into_response())
}
