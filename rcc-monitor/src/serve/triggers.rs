//! Triggers of the flight recorder: conditions that the executor judges in each cycle, and that write an incident. They are
//! rules that do nothing else, so that a page which may not start nets may arm them. Run by the serving thread.

use std::sync::Arc;

use axum::Json;
use axum::extract::rejection::JsonRejection;
use axum::extract::{Path, State};
use axum::response::IntoResponse;
use hyper::Method;
use rcc_api::bodies::{ErrorBody, OnClientLoss, RecordBody, RuleBody, RuleView, RulesBody};
use rcc_api::codes;
use serde::Deserialize;

use super::Server;
use super::answers::{Answered, Refused, passed};

/// A condition to be armed.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TriggerBody {
    /// As of a rule: `line.ft.fz > 30`.
    when: String,
    /// Wait until it becomes true; do not record if it is true now.
    edge: bool,
}

impl Server {
    async fn recording_rules(&self) -> Result<Vec<RuleView>, ErrorBody> {
        let rules = self.loader.get("/rules").await?;
        let rules: Result<Vec<RuleView>, _> = serde_json::from_value(rules);
        let mut rules = rules.map_err(|error| ErrorBody {
            code: codes::OTHER_BUILD.code.to_owned(),
            message: format!("cannot parse the loader's answer: {error}"),
            help: Some("install rcc-monitor and rcc-loader from the same build".to_owned()),
            ..ErrorBody::default()
        })?;
        rules.retain(|rule| rule.record.is_some());
        Ok(rules)
    }
}

/// Lists the conditions that are armed, or have fired.
pub async fn list(State(server): State<Arc<Server>>) -> Answered {
    Ok(Json(server.recording_rules().await?).into_response())
}

/// Arms a condition for one incident. It stays armed when the page is closed.
pub async fn arm(
    State(server): State<Arc<Server>>,
    body: Result<Json<TriggerBody>, JsonRejection>,
) -> Answered {
    let Json(TriggerBody { when, edge }) = body.map_err(|error| {
        let help = "send {\"when\": CONDITION, \"edge\": true or false}";
        Refused::new(codes::BAD_REQUEST, error.body_text(), help)
    })?;
    let rule = RuleBody {
        when,
        record: Some(RecordBody {
            edge,
            ..RecordBody::default()
        }),
        on_client_loss: OnClientLoss::GoOn,
        ..RuleBody::default()
    };
    let rules = RulesBody {
        rules: vec![rule],
        lease: None,
    };
    let text = serde_json::to_string(&rules)
        .map_err(|error| Refused::new(codes::BAD_REQUEST, error.to_string(), ""))?;
    passed(&server, Method::POST, "/rules", text).await
}

/// Disarms a condition; other rules are refused.
pub async fn disarm(State(server): State<Arc<Server>>, Path(rule): Path<u64>) -> Answered {
    let known = server.recording_rules().await?;
    if !known.iter().any(|one| one.rule == rule) {
        return Err(Refused::new(
            codes::UNKNOWN_RULE,
            format!("no rule {rule} records incidents"),
            "look at the list again; `rcc-cli rules ls` has the other rules",
        ));
    }
    passed(
        &server,
        Method::DELETE,
        &format!("/rules/{rule}"),
        String::new(),
    )
    .await
}
