//! Report of a replay about rules. Pure; main thread.

use rcc_api::codes;
use rcc_core::counted::Counted;
use rcc_engine::replay::RuleReplayResult;
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::table::grouped;

/// The result as JSON; null if no rule was judged.
pub(super) fn value(rules: &RuleReplayResult) -> Value {
    if rules.recorded == 0 && rules.ended.is_empty() {
        return Value::Null;
    }
    let ended = rules
        .ended
        .iter()
        .map(|(cycle, rule, state)| json!({"cycle": cycle, "rule": rule, "state": state.name()}));
    json!({
        "recorded": rules.recorded, "compared": rules.compared, "held": rules.held, "reproduced": rules.reproduced,
        "mismatch": rules.mismatch.map(|(rule, cycle)| json!({"rule": rule, "cycle": cycle})),
        "ended": ended.collect::<Vec<_>>(),
    })
}

/// The result for people; empty if no rule was judged.
pub(super) fn describe(rules: &RuleReplayResult) -> String {
    if rules.recorded == 0 && rules.ended.is_empty() {
        return String::new();
    }
    let mut lines = vec![format!(
        "rules: {} of {} judgements compared, {} of {} that held reproduced",
        grouped(rules.compared),
        grouped(rules.recorded),
        rules.reproduced,
        rules.held
    )];
    lines.extend(rules.ended.iter().map(|(cycle, rule, state)| {
        format!("  cycle {}: rule {rule} {}", grouped(*cycle), state.name())
    }));
    if let Some((rule, cycle)) = rules.mismatch {
        lines.push(format!(
            "  DIFFERS: rule {rule} in cycle {}",
            grouped(cycle)
        ));
    }
    format!("\n{}", lines.join("\n"))
}

/// Fails if a condition was judged otherwise than in the recording.
pub(super) fn verdict(rules: &RuleReplayResult) -> Result<(), Failure> {
    match rules.mismatch {
        None => Ok(()),
        Some((rule, cycle)) => Err(Failure::new(
            codes::REPLAY_DIFFERS,
            format!(
                "rule {rule} is judged otherwise in cycle {cycle} than in the recording ({} compared)",
                Counted(rules.compared, "judgement")
            ),
            "the same plans and inputs must give the same bits: report this as a bug, with the file",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_protocol::rules::RuleState;

    #[test]
    fn firings_are_told_and_a_difference_is_a_failure() {
        let mut rules = RuleReplayResult::default();
        assert_eq!(
            (describe(&rules), value(&rules)),
            (String::new(), Value::Null)
        );
        rules.recorded = 1200;
        (rules.compared, rules.held, rules.reproduced) = (1100, 2, 2);
        rules.ended.push((4106, 7, RuleState::Fired));
        let told = describe(&rules);
        assert!(told.contains("cycle 4 106: rule 7 fired"), "{told}");
        assert!(verdict(&rules).is_ok());
        rules.mismatch = Some((7, 4106));
        assert!(describe(&rules).contains("DIFFERS"));
        assert!(verdict(&rules).is_err());
        assert_eq!(value(&rules)["mismatch"]["rule"], 7);
    }
}
