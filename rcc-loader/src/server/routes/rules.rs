//! The routes of rules and leases. Run by the one thread that serves connections.

use axum::Router;
use axum::body::Bytes;
use axum::extract::{Extension, Path, State};
use axum::response::Response;
use axum::routing::{get, post};
#[cfg(test)]
use rcc_api::bodies::{
    ErrorBody, LeaseBody, LeaseCommands, LeaseDone, LeaseGranted, RuleNumber, RuleView, RulesBody,
    RulesInstalled,
};
use rcc_api::codes;
use rcc_api::error::ApiError;

use super::ServerState;
use super::requests::{answering, json};
use crate::server::caller::Caller;
use crate::server::error::ErrorResponse;
use crate::server::service::Service;

/// The part of the OpenAPI document about these routes.
#[cfg(test)]
#[derive(utoipa::OpenApi)]
#[openapi(paths(install, list, detail, remove, grant, renew, bind, end))]
pub(super) struct RulesDocument;

/// Creates the router of these routes.
pub(super) fn router() -> Router<ServerState> {
    Router::new()
        .route("/rules", get(list).post(install))
        .route("/rules/{rule}", get(detail).delete(remove))
        .route("/leases", post(grant))
        .route("/leases/{lease}", axum::routing::delete(end))
        .route("/leases/{lease}/renew", post(renew))
        .route("/leases/{lease}/commands", post(bind))
}

fn number(what: &str, text: &str) -> Result<u64, ApiError> {
    text.parse().map_err(|_| {
        ApiError::new(
            codes::BAD_REQUEST,
            format!("the number of the {what} is not a number"),
            format!("give the number that the answer to the creation of the {what} contained"),
        )
    })
}

/// Installs rules: all of them between the same two cycles, or none. Conditions that are true now fire in that cycle.
#[cfg_attr(test, utoipa::path(post, path = "/rules", operation_id = "installRules", tag = "rules", request_body(content = RulesBody),
    responses((status = 200, body = RulesInstalled), (status = 400, body = ErrorBody), (status = 404, body = ErrorBody),
        (status = 409, body = ErrorBody), (status = 422, body = ErrorBody))))]
async fn install(
    State(state): State<ServerState>,
    Extension(caller): Extension<Caller>,
    body: Bytes,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| {
        service.install_rules(&caller, &json(&body)?)
    })
    .await
}

/// Lists all rules, sorted by number; ended ones stay until their place is needed.
#[cfg_attr(test, utoipa::path(get, path = "/rules", operation_id = "listRules", tag = "rules",
    responses((status = 200, body = Vec<RuleView>), (status = 503, body = ErrorBody))))]
async fn list(State(state): State<ServerState>) -> Result<Response, ErrorResponse> {
    answering(state, Service::rules).await
}

/// Returns one rule.
#[cfg_attr(test, utoipa::path(get, path = "/rules/{rule}", operation_id = "getRule", tag = "rules", params(("rule" = u64, Path, description = "number of the rule")),
    responses((status = 200, body = RuleView), (status = 404, body = ErrorBody))))]
async fn detail(
    State(state): State<ServerState>,
    Path(rule): Path<String>,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| service.rule(number("rule", &rule)?)).await
}

/// Removes a rule; one that could still fire is disarmed.
#[cfg_attr(test, utoipa::path(delete, path = "/rules/{rule}", operation_id = "removeRule", tag = "rules", params(("rule" = u64, Path, description = "number of the rule")),
    responses((status = 200, body = RuleNumber), (status = 404, body = ErrorBody))))]
async fn remove(
    State(state): State<ServerState>,
    Path(rule): Path<String>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| {
        service.remove_rule(&caller, number("rule", &rule)?)
    })
    .await
}

/// Grants a lease: the client counts as present until it expires, and as long as it is renewed.
#[cfg_attr(test, utoipa::path(post, path = "/leases", operation_id = "grantLease", tag = "rules", request_body(content = LeaseBody),
    responses((status = 200, body = LeaseGranted), (status = 400, body = ErrorBody), (status = 409, body = ErrorBody))))]
async fn grant(
    State(state): State<ServerState>,
    Extension(caller): Extension<Caller>,
    body: Bytes,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| {
        service.grant_lease(&caller, &json(&body)?)
    })
    .await
}

/// Renews a lease.
#[cfg_attr(test, utoipa::path(post, path = "/leases/{lease}/renew", operation_id = "renewLease", tag = "rules", params(("lease" = u64, Path, description = "number of the lease")),
    responses((status = 200, body = LeaseDone), (status = 404, body = ErrorBody))))]
async fn renew(
    State(state): State<ServerState>,
    Path(lease): Path<String>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| {
        service.renew_lease(&caller, number("lease", &lease)?)
    })
    .await
}

/// Binds ready or active commands to a lease: when it is lost, they are canceled, or aborted if they cannot be.
#[cfg_attr(test, utoipa::path(post, path = "/leases/{lease}/commands", operation_id = "bindLease", tag = "rules", params(("lease" = u64, Path, description = "number of the lease")),
    request_body(content = LeaseCommands),
    responses((status = 200, body = LeaseDone), (status = 404, body = ErrorBody), (status = 409, body = ErrorBody))))]
async fn bind(
    State(state): State<ServerState>,
    Path(lease): Path<String>,
    Extension(caller): Extension<Caller>,
    body: Bytes,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| {
        service.bind_lease(&caller, number("lease", &lease)?, &json(&body)?)
    })
    .await
}

/// Ends a lease now, as if it had expired.
#[cfg_attr(test, utoipa::path(delete, path = "/leases/{lease}", operation_id = "endLease", tag = "rules", params(("lease" = u64, Path, description = "number of the lease")),
    responses((status = 200, body = LeaseDone), (status = 404, body = ErrorBody))))]
async fn end(
    State(state): State<ServerState>,
    Path(lease): Path<String>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, ErrorResponse> {
    answering(state, move |service| {
        service.end_lease(&caller, number("lease", &lease)?)
    })
    .await
}
