//! Conditions of rules with numbers in place of names: outcomes, slots and topics of the nets as they were compiled.
//! Used by the loader's threads and by the command line.

use rcc_config::diagnostic::closest;
use rcc_core::topic::Topic;
use rcc_core::types::Store;
use rcc_language::condition::ConditionTerm;
use rcc_language::names::Names;
use rcc_protocol::rules::{Limit, RuleTerm};

use crate::codes;
use crate::error::ApiError;

/// Resolves one term of the condition of the rule with this name. `command` returns the id of a command by its name,
/// `names` the names of its net.
///
/// # Errors
/// Returns an error if a command, an outcome or an output does not exist, or the output is not of one element or not of
/// the type that the term needs.
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
            let name = format!("{command}.{primitive}.{port}");
            let command = id_of(command)?;
            let (store, slot) = element_of(rule, &names(command), primitive, port)?;
            if store != Store::Bool {
                let help = format!("compare it: `{name} > …`, `<`, `>=` or `<=`");
                let message = format!("`{name}` is a number, not Bool");
                return Err(bad(rule, &message, help));
            }
            RuleTerm::Value { command, slot }
        }
        ConditionTerm::Compare {
            command,
            primitive,
            port,
            relation,
            limit,
        } => {
            let name = format!("{command}.{primitive}.{port}");
            let command = id_of(command)?;
            let (store, slot) = element_of(rule, &names(command), primitive, port)?;
            let limit = match store {
                Store::Real => Limit::Real(*limit),
                Store::Int if limit.fract() == 0.0 && limit.abs() < 9e15 => {
                    Limit::Int(*limit as i64)
                }
                Store::Int => {
                    let message = format!("`{name}` is Int, and {limit} is not");
                    return Err(bad(
                        rule,
                        &message,
                        "compare it with a whole number".to_owned(),
                    ));
                }
                Store::Bool => {
                    let message = format!("`{name}` is Bool, not a number");
                    let help = format!("write `{name}` or `not {name}`");
                    return Err(bad(rule, &message, help));
                }
            };
            RuleTerm::Compare {
                command,
                slot,
                relation: *relation,
                limit,
            }
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

fn bad(rule: &str, message: &str, help: String) -> ApiError {
    let message = format!("rule `{rule}`: {message}");
    ApiError::new(codes::BAD_CONDITION, message, help)
}

/// Name of a port, and the index of one of its elements if there is one: `joints[2]`. `None` if the index is not one.
#[must_use]
pub fn port_and_element(port: &str) -> Option<(&str, Option<u32>)> {
    match port.split_once('[') {
        None => Some((port, None)),
        Some((name, index)) => Some((name, Some(index.strip_suffix(']')?.parse().ok()?))),
    }
}

/// Returns true if the net has the output, whatever its type and the index of its element.
#[must_use]
pub fn has_output(names: &Names, primitive: &str, port: &str) -> bool {
    let port = port.split('[').next().unwrap_or_default();
    let mut primitives = names.primitives.iter();
    let found = primitives.find(|known| known.id == primitive);
    found.is_some_and(|found| found.outputs.iter().any(|output| output.name == port))
}

/// Arena and slot of an output of one element, or of one element of an output.
fn element_of(
    rule: &str,
    names: &Names,
    primitive: &str,
    port: &str,
) -> Result<(Store, u32), ApiError> {
    let ids = names.primitives.iter().map(|known| known.id.as_str());
    let Some(found) = names.primitives.iter().find(|known| known.id == primitive) else {
        let help = match closest(primitive, ids) {
            Some(near) => format!("did you mean `{near}`?"),
            None => "name a primitive of the net; `rcc-cli watch` lists its ports".to_owned(),
        };
        let message = format!("{} has no primitive `{primitive}`", names.net);
        return Err(bad(rule, &message, help));
    };
    let Some((port, element)) = port_and_element(port) else {
        let help = "write the index of an element as a number, counted from 0: `ik.joints[2]`";
        let message = format!("`{primitive}.{port}` has an invalid index");
        return Err(bad(rule, &message, help.to_owned()));
    };
    let outputs = || found.outputs.iter().map(|known| &*known.name);
    let Some(output) = found.outputs.iter().find(|known| known.name == port) else {
        let help = match closest(port, outputs()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!(
                "its outputs are {}",
                outputs().collect::<Vec<_>>().join(", ")
            ),
        };
        return Err(bad(
            rule,
            &format!("`{primitive}` has no output `{port}`"),
            help,
        ));
    };
    let last = output.width.saturating_sub(1);
    match element.unwrap_or(0) {
        0 if element.is_none() && output.width != 1 => {
            let message = format!(
                "`{primitive}.{port}` is {}, not one value",
                output.type_name
            );
            let help = format!("name one element: `{primitive}.{port}[0]` to `[{last}]`");
            Err(bad(rule, &message, help))
        }
        element if element > last => {
            let message = format!("`{primitive}.{port}` has no element {element}");
            Err(bad(rule, &message, format!("its elements are 0 to {last}")))
        }
        element => Ok((output.store, output.slot + element)),
    }
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
