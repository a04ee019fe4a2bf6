//! `incidents arm`, `armed`, `disarm`: rules that record the last seconds when their condition becomes true. The
//! real-time thread judges them in each cycle. Main thread.

use std::time::Duration;

use rcc_api::bodies::{
    OnClientLoss, RecordBody, RuleBody, RuleNumber, RuleView, RulesBody, RulesInstalled,
};
use rcc_api::codes;

use crate::context::Context;
use crate::failure::Failure;
use crate::verbs::rules;
use crate::{lease, table};

/// Arguments of `incidents arm`.
#[derive(clap::Args, Debug)]
pub struct ArmArguments {
    /// The condition, as of a rule: 'ft.fz > 30', 'line.ik.joints[3] < deg(-90) or not line.touch.out'
    #[arg(value_name = "CONDITION")]
    when: String,
    /// Record so many times, instead of once
    #[arg(long, default_value = "1", value_parser = clap::value_parser!(u32).range(1..=1000))]
    times: u32,
    /// Shortest time between two recordings; a condition that becomes true sooner is only counted
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = distance)]
    distance: Duration,
    /// Wait until the condition becomes true; do not record if it is true now
    #[arg(long)]
    edge: bool,
}

fn distance(text: &str) -> Result<Duration, String> {
    let distance = crate::duration::duration(text)?;
    match distance < Duration::from_secs(1) {
        true => Err(format!("`{text}` is too short: at least 1s")),
        false => Ok(distance),
    }
}

/// Arms a condition.
pub(super) fn arm(context: &Context, arguments: ArmArguments) -> Result<(), Failure> {
    let distance_ms = arguments.distance.as_millis();
    let rule = RuleBody {
        when: arguments.when,
        record: Some(RecordBody {
            times: arguments.times,
            distance_ms: u64::try_from(distance_ms).unwrap_or(u64::MAX),
            edge: arguments.edge,
        }),
        // It stays until it has fired or is disarmed, whoever armed it.
        on_client_loss: OnClientLoss::GoOn,
        ..RuleBody::default()
    };
    let body = lease::text(&RulesBody {
        rules: vec![rule],
        lease: None,
    })?;
    let armed: RulesInstalled = context.client()?.post("/rules", body)?;
    context.print(&armed, |armed| {
        let lines = armed.rules.iter().map(|rule| {
            format!(
                "condition {} `{}` is judged from cycle {} on; `rcc-cli incidents` lists what it records, \
                 `rcc-cli incidents disarm {}` disarms it",
                rule.rule,
                rule.name,
                table::grouped(armed.cycle),
                rule.rule
            )
        });
        lines.collect::<Vec<_>>().join("\n")
    });
    Ok(())
}

/// Lists the rules that record.
pub(super) fn list(context: &Context) -> Result<(), Failure> {
    let mut all: Vec<RuleView> = context.client()?.get("/rules")?;
    all.retain(|rule| rule.record.is_some());
    context.print(&all, |all| {
        if all.is_empty() {
            return "nothing is armed; `rcc-cli incidents arm CONDITION` arms a condition"
                .to_owned();
        }
        let mut rows = table::table(&[
            "NUMBER",
            "CONDITION",
            "STATE",
            "RECORDED",
            "LAST CYCLE",
            "REASON",
        ]);
        for rule in all {
            let last = rule.recorded.and_then(|recorded| recorded.cycle);
            rows.add_row([
                rule.rule.to_string(),
                rule.when.clone(),
                rule.state.clone(),
                rules::recorded(rule).unwrap_or_default(),
                last.map_or_else(|| "–".to_owned(), table::grouped),
                rule.words.clone().unwrap_or_default(),
            ]);
        }
        table::text(&rows)
    });
    Ok(())
}

/// Removes rules that record; refuses other rules.
pub(super) fn disarm(context: &Context, numbers: &[u64]) -> Result<(), Failure> {
    let client = context.client()?;
    for number in numbers {
        let rule: RuleView = client.get(&format!("/rules/{number}"))?;
        if rule.record.is_none() {
            return Err(Failure::new(
                codes::BAD_REQUEST,
                format!("rule {number} `{}` does not record incidents", rule.name),
                format!("`rcc-cli rules remove {number}` removes it"),
            ));
        }
    }
    let removed = numbers
        .iter()
        .map(|number| client.delete::<RuleNumber>(&format!("/rules/{number}")));
    let removed = removed.collect::<Result<Vec<_>, Failure>>()?;
    context.print(&removed, |removed| {
        let lines = removed
            .iter()
            .map(|rule| format!("condition {} `{}` disarmed", rule.rule, rule.name));
        lines.collect::<Vec<_>>().join("\n")
    });
    Ok(())
}
