//! The routes of texts. LOAD answers with an id, and the text is compiled meanwhile; a check compiles it and loads nothing.
//! Run by the serving thread; reserving and compiling are the work of blocking threads.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::body::Bytes;
use axum::extract::{Extension, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use rcc_api::bodies::Loaded;
#[cfg(test)]
use rcc_api::bodies::{Checked, ErrorBody};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_core::message::CommandState;
use rcc_core::printable::Printable;
use serde::Deserialize;
use tokio::sync::oneshot;
use tokio::task::JoinError;

use super::interface::Query;
use super::requests::{blocking, text_of, too_many_of};
use super::{LOADING, ServerState};
use crate::server::bodies::{LONG_TEXT, TextMemory};
use crate::server::caller::Caller;
use crate::server::error::ErrorResponse;
use crate::server::fair_queue::FairQueue;
use crate::server::peer::ClientPeer;
use crate::server::service::{CompiledText, Service};

/// Longest time that the answer to LOAD waits, ms.
const WAIT_MAX_MS: u64 = 5000;

#[derive(Deserialize)]
pub(super) struct LoadQuery {
    /// File name for diagnostics.
    #[serde(default)]
    file: Option<String>,
    /// Time for which the answer waits for the net to be ready or rejected, ms.
    #[serde(default)]
    wait_ms: u64,
}

#[derive(Deserialize)]
pub(super) struct CheckQuery {
    /// File name for diagnostics.
    #[serde(default)]
    file: Option<String>,
}

/// LOAD: the body is the text of a net, YAML or JSON. Answers at once, or, with `wait_ms`, when the net is ready or rejected;
/// the command's state changes from `loading` to `ready` or `rejected`.
#[cfg_attr(test, utoipa::path(post, path = "/commands", operation_id = "loadCommand", tag = "commands", request_body(content((Object = "application/json"), (String = "application/yaml")), description = "a net"),
    params(("file" = Option<String>, Query, description = "file name for diagnostics"),
        ("wait_ms" = Option<u64>, Query, description = "answer when the net is ready or rejected, at the latest after this time; at most 5000")),
    responses((status = 202, body = Loaded), (status = 400, body = ErrorBody), (status = 409, body = ErrorBody), (status = 503, body = ErrorBody))))]
pub(super) async fn load(
    State(state): State<ServerState>,
    Query(query): Query<LoadQuery>,
    Extension(caller): Extension<Caller>,
    Extension(memory): Extension<TextMemory>,
    Extension(peer): Extension<ClientPeer>,
    body: Bytes,
) -> Result<Response, ErrorResponse> {
    if query.wait_ms > WAIT_MAX_MS {
        return Err(too_long_a_wait(query.wait_ms).into());
    }
    let place = state.loading.take(peer, 1);
    let place = place.ok_or_else(|| too_many_of(LOADING, "texts are being compiled"))?;
    // The name appears in every source snippet.
    let file = Printable(query.file.as_deref().unwrap_or("net")).to_string();
    let (answer, answered) = oneshot::channel();
    // It goes on if the client goes: an id that is reserved then is given back.
    let loading = tokio::spawn(async move {
        let state = load_text(state, (caller, peer), (body, file), answer).await;
        drop((place, memory));
        state
    });
    let id = answered.await.unwrap_or_else(|_| Err(not_loaded()))?;
    let wait = Duration::from_millis(query.wait_ms);
    let state = match wait.is_zero() {
        // The answer of a client that does not wait does not depend on who is faster.
        true => CommandState::Loading,
        false => match tokio::time::timeout(wait, loading).await {
            Ok(loaded) => loaded.unwrap_or(CommandState::Rejected),
            Err(_) => CommandState::Loading,
        },
    };
    let state = state.name().to_owned();
    Ok((StatusCode::ACCEPTED, Json(Loaded { id, state })).into_response())
}

/// Checks a text with the devices of this cell, as LOAD does, and loads nothing: a net, or the configuration of a cell. The
/// rehearsal is part of LOAD only.
#[cfg_attr(test, utoipa::path(post, path = "/check", operation_id = "checkText", tag = "commands", request_body(content((Object = "application/json"), (String = "application/yaml")), description = "a net, or the configuration of a cell"),
    params(("file" = Option<String>, Query, description = "file name for diagnostics")),
    responses((status = 200, body = Checked), (status = 409, body = ErrorBody), (status = 503, body = ErrorBody))))]
pub(super) async fn check(
    State(state): State<ServerState>,
    Query(query): Query<CheckQuery>,
    Extension(memory): Extension<TextMemory>,
    Extension(peer): Extension<ClientPeer>,
    body: Bytes,
) -> Result<Response, ErrorResponse> {
    let place = state.loading.take(peer, 1);
    let _place = place.ok_or_else(|| too_many_of(LOADING, "texts are being compiled"))?;
    let file = Printable(query.file.as_deref().unwrap_or("text")).to_string();
    let _turn = turns_of(&state, body.len()).take(peer).await;
    let checked = blocking(state, move |service| {
        let checked = service.check(&text_of(body, "the text is")?, &file);
        drop(memory);
        checked
    });
    Ok(Json(checked.await?).into_response())
}

/// Returns the queue in which a text of this size waits for its turn.
fn turns_of(state: &ServerState, bytes: usize) -> Arc<FairQueue> {
    Arc::clone(match bytes > LONG_TEXT {
        true => &state.compiling_long,
        false => &state.compiling,
    })
}

/// Reserves an id and answers, and compiles the text meanwhile, because an id takes a cycle of the executor. Returns whether
/// the net became ready or rejected.
async fn load_text(
    state: ServerState,
    (caller, peer): (Caller, ClientPeer),
    (body, file): (Bytes, String),
    answer: oneshot::Sender<Result<u64, ApiError>>,
) -> CommandState {
    let turns = turns_of(&state, body.len());
    let text = match text_of(body, "the text is") {
        Ok(text) => Arc::new(text),
        Err(error) => {
            // A client that is gone needs no answer.
            let _ = answer.send(Err(error));
            return CommandState::Rejected;
        }
    };
    let service = Arc::clone(&state.service);
    let compiling = {
        let (service, text, turns) = (Arc::clone(&service), Arc::clone(&text), Arc::clone(&turns));
        tokio::spawn(async move {
            // The executor is not waited for with a turn.
            let _turn = turns.take(peer).await;
            tokio::task::spawn_blocking(move || service.compile(&text, &file)).await
        })
    };
    let reserved = {
        let text = Arc::clone(&text);
        let reserve = move |service: &Service| service.reserve(&caller, &text);
        blocking(state, reserve).await
    };
    let id = reserved.as_ref().ok().copied();
    let is_awaited = answer.send(reserved).is_ok();
    let Some(id) = id.filter(|_| is_awaited) else {
        compiling.abort();
        if let Some(id) = id {
            // Nobody knows the id. On a panic, which the panic hook reports, `maintain` finds it.
            let _ = tokio::task::spawn_blocking(move || service.discard(id)).await;
        }
        return CommandState::Rejected;
    };
    let compiled = compiling.await.and_then(|compiled| compiled);
    let _turn = turns.take(peer).await;
    install(service, id, (text, compiled)).await
}

/// Installs what was compiled from a text.
async fn install(
    service: Arc<Service>,
    id: u64,
    (text, compiled): (Arc<String>, Result<CompiledText, JoinError>),
) -> CommandState {
    let installed = match compiled {
        Ok(compiled) => {
            let (service, text) = (Arc::clone(&service), Arc::unwrap_or_clone(text));
            tokio::task::spawn_blocking(move || service.install(id, text, compiled)).await
        }
        Err(error) => Err(error),
    };
    match installed {
        Ok(state) => state,
        Err(error) => {
            tracing::error!(id, %error, "a load panicked");
            // On a panic, which the panic hook reports, `maintain` finds it.
            let _ = tokio::task::spawn_blocking(move || service.fail(id)).await;
            CommandState::Rejected
        }
    }
}

fn too_long_a_wait(wait_ms: u64) -> ApiError {
    ApiError::new(
        codes::BAD_REQUEST,
        format!("`wait_ms` is {wait_ms}, the maximum is {WAIT_MAX_MS}"),
        "ask again with `GET /commands/{id}?brief=true` while the state is `loading`",
    )
}

fn not_loaded() -> ApiError {
    ApiError::new(
        codes::PROCESS_FAILED,
        "the loader failed to load the text",
        "this is a bug in the loader: report it",
    )
}
