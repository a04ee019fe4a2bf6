//! Conditions of rules with numbers in place of names: outcomes, slots and topics of the nets as they were compiled.
//! Used by the loader's threads and by the command line.

use rcc_config::diagnostic::closest;
use rcc_core::topic::Topic;
use rcc_core::types::Store;
use rcc_language::condition::ConditionTerm;
use rcc_language::names::Names;
use rcc_protocol::rules::RuleTerm;

use crate::codes;
use crate::error::ApiError;

/// Resolves one term of the condition of the rule with this name. `command` returns the id of a command by its name,
/// `names` the names of its net.
///
/// # Errors
/// Returns an error if a command, an outcome or an output does not exist, or the output is not a single `Bool`.
pub fn resolve(
    rule: &str,
    term: &ConditionTerm,
    command: &dyn Fn(&str) -> Result<u64, ApiError>,
    names: &dyn Fn(u64) -> Names,
) -> Result<RuleTerm, ApiError> {
    let id_of = command;
    Ok(match term {
        ConditionTerm::True => RuleTerm::True,
        ConditionTerm::Not => RuleTerm::Not,
        ConditionTerm::And => RuleTerm::And,
        ConditionTerm::Or => RuleTerm::Or,
        ConditionTerm::Topic { topic } => RuleTerm::Topic {
            topic: Topic::new(topic, "Bool", ""),
        },
        ConditionTerm::State { command, state } => RuleTerm::State {
            command: id_of(command)?,
            state: *state as u32,
        },
        ConditionTerm::Reason { command, reason } => RuleTerm::Reason {
            command: id_of(command)?,
            reason: *reason as u32,
        },
        ConditionTerm::Outcome { command, outcome } => {
            let command = id_of(command)?;
            let outcome = number_of(rule, outcome, &names(command).outcomes)?;
            RuleTerm::Outcome { command, outcome }
        }
        ConditionTerm::Value {
            command,
            primitive,
            port,
        } => {
            let command = id_of(command)?;
            let slot = slot_of(rule, &names(command), primitive, port)?;
            RuleTerm::Value { command, slot }
        }
    })
}

/// Number of an outcome, counted from 1.
fn number_of(rule: &str, outcome: &str, outcomes: &[String]) -> Result<u32, ApiError> {
    let place = outcomes
        .iter()
        .zip(1..)
        .find(|(known, _)| *known == outcome);
    if let Some((_, number)) = place {
        return Ok(number);
    }
    let help = match closest(outcome, outcomes.iter().map(String::as_str)) {
        Some(near) => format!("did you mean `{near}`?"),
        None if outcomes.is_empty() => {
            "name the conditions of its Termination, or compare its `reason`".to_owned()
        }
        None => format!("its outcomes are {}", outcomes.join(", ")),
    };
    let message = format!("rule `{rule}`: the net has no outcome `{outcome}`");
    Err(ApiError::new(codes::BAD_CONDITION, message, help))
}

/// Slot of an output of type Bool.
fn slot_of(rule: &str, names: &Names, primitive: &str, port: &str) -> Result<u32, ApiError> {
    let bad = |message: String, help: String| {
        let message = format!("rule `{rule}`: {message}");
        Err(ApiError::new(codes::BAD_CONDITION, message, help))
    };
    let ids = names.primitives.iter().map(|known| known.id.as_str());
    let Some(found) = names.primitives.iter().find(|known| known.id == primitive) else {
        let help = match closest(primitive, ids) {
            Some(near) => format!("did you mean `{near}`?"),
            None => "name a primitive of the net; `rcc-cli watch` lists its ports".to_owned(),
        };
        return bad(
            format!("{} has no primitive `{primitive}`", names.net),
            help,
        );
    };
    let outputs = || found.outputs.iter().map(|known| known.name.as_str());
    let Some(output) = found.outputs.iter().find(|known| known.name == port) else {
        let help = match closest(port, outputs()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!(
                "its outputs are {}",
                outputs().collect::<Vec<_>>().join(", ")
            ),
        };
        return bad(format!("`{primitive}` has no output `{port}`"), help);
    };
    if output.store != Store::Bool || output.width != 1 {
        let help = "compare it in the net, for example by `Greater`, and name that output";
        let message = format!("`{primitive}.{port}` is {}, not Bool", output.type_name);
        return bad(message, help.to_owned());
    }
    Ok(output.slot)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_outcome_names_those_that_there_are() {
        let outcomes = ["touched".to_owned(), "arrived".to_owned()];
        assert_eq!(number_of("r", "arrived", &outcomes), Ok(2));
        let near = number_of("r", "touche", &outcomes).expect_err("unknown");
        assert!(near.help.contains("touched"), "{near:?}");
        let none = number_of("r", "x", &[]).expect_err("unknown");
        assert!(none.help.contains("reason"), "{none:?}");
    }
}
