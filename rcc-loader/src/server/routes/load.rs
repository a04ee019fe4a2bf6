//! The route of LOAD: the answer is an id, and the text is compiled afterwards. Run by the serving thread; reserving and
//! compiling are the work of blocking threads.

use std::sync::Arc;

use axum::Json;
use axum::body::Bytes;
use axum::extract::{Extension, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
#[cfg(test)]
use rcc_api::bodies::ErrorBody;
use rcc_api::bodies::Loaded;
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_core::printable::Printable;
use serde::Deserialize;
use tokio::sync::oneshot;

use super::interface::Query;
use super::requests::{blocking, text_of, too_many_of};
use super::{LOADING, ServerState};
use crate::server::bodies::{LONG_TEXT, TextMemory};
use crate::server::caller::Caller;
use crate::server::error::ErrorResponse;
use crate::server::peer::ClientPeer;
use crate::server::service::Service;

#[derive(Deserialize)]
pub(super) struct LoadQuery {
    /// File name for diagnostics.
    #[serde(default)]
    file: Option<String>,
}

/// LOAD: the body is the text of a net, YAML or JSON. Answers at once; the command's state then changes from `loading`
/// to `ready` or `rejected`.
#[cfg_attr(test, utoipa::path(post, path = "/commands", operation_id = "loadCommand", tag = "commands", request_body(content((Object = "application/json"), (String = "application/yaml")), description = "a net"),
    params(("file" = Option<String>, Query, description = "file name for diagnostics")),
    responses((status = 202, body = Loaded), (status = 409, body = ErrorBody), (status = 503, body = ErrorBody))))]
pub(super) async fn load(
    State(state): State<ServerState>,
    Query(query): Query<LoadQuery>,
    Extension(caller): Extension<Caller>,
    Extension(memory): Extension<TextMemory>,
    Extension(peer): Extension<ClientPeer>,
    body: Bytes,
) -> Result<Response, ErrorResponse> {
    let place = state.loading.take(peer, 1);
    let place = place.ok_or_else(|| too_many_of(LOADING, "texts are being compiled"))?;
    // The name appears in every source snippet.
    let file = Printable(query.file.as_deref().unwrap_or("net")).to_string();
    let (answer, answered) = oneshot::channel();
    // It goes on if the client goes: an id that is reserved then is given back.
    tokio::spawn(async move {
        load_text(state, (caller, peer), (body, file), answer).await;
        drop((place, memory));
    });
    let id = answered.await.unwrap_or_else(|_| Err(not_loaded()))?;
    let state = "loading".to_owned();
    Ok((StatusCode::ACCEPTED, Json(Loaded { id, state })).into_response())
}

/// Reserves an id, answers, and compiles the text.
async fn load_text(
    state: ServerState,
    (caller, peer): (Caller, ClientPeer),
    (body, file): (Bytes, String),
    answer: oneshot::Sender<Result<u64, ApiError>>,
) {
    let turns = Arc::clone(match body.len() > LONG_TEXT {
        true => &state.compiling_long,
        false => &state.compiling,
    });
    let reserve = move |service: &Service| service.reserve(&caller, text_of(body, "the text is")?);
    let reserved = blocking(state.clone(), reserve).await;
    let id = reserved.as_ref().ok().copied();
    let is_awaited = answer.send(reserved).is_ok();
    let Some(id) = id else { return };
    let service = Arc::clone(&state.service);
    if !is_awaited {
        // Nobody knows the id. On a panic, which the panic hook reports, `maintain` finds it.
        let _ = tokio::task::spawn_blocking(move || service.discard(id)).await;
        return;
    }
    let _turn = turns.take(peer).await;
    let compiled = tokio::task::spawn_blocking(move || service.install(id, &file));
    if let Err(error) = compiled.await {
        tracing::error!(id, %error, "a load panicked");
        let service = state.service;
        // On a panic, which the panic hook reports, `maintain` finds it.
        let _ = tokio::task::spawn_blocking(move || service.fail(id)).await;
    }
}

fn not_loaded() -> ApiError {
    ApiError::new(
        codes::PROCESS_FAILED,
        "the loader failed to load the text",
        "this is a bug in the loader: report it",
    )
}
