//! Sets inputs of a net, and reads its ports as of one cycle. Run by blocking threads of the server; the real-time
//! thread sees only numbers.

use rcc_api::bodies::{InputsSet, ValueView, ValuesView};
use rcc_api::codes;
use rcc_api::compile::findings;
use rcc_api::error::ApiError;
use rcc_core::message::CommandState;
use rcc_core::plan::ValuePoint;
use rcc_core::types::{NULL_BOOL, NULL_INT, Store};
use rcc_language::input_values;
use rcc_language::names::{Names, PortNames};
use rcc_protocol::control::{Answer, Call, NetValues, READ_MAX};
use rcc_protocol::pattern::Pattern;
use serde_json::{Number, Value};

use super::{Service, unexpected};
use crate::server::caller::Caller;

/// A selected port, or one element of it.
#[derive(Clone, Debug, PartialEq)]
pub struct SelectedPort {
    /// `primitive.port`, or `primitive.port[index]`.
    pub port: String,
    /// Its type.
    pub ty: String,
    /// Its unit, if the type does not imply it.
    pub unit: Option<String>,
    /// Its slots.
    pub point: ValuePoint,
    /// True for types that are null as a whole or not at all.
    whole: bool,
}

impl Service {
    /// Sets inputs of a ready or active net, all of them between the same two cycles, or none; `text` maps their names
    /// to constants of the language.
    ///
    /// # Errors
    /// Returns an error if there is no such command, a value does not fit its input, or the executor refuses; nothing
    /// has changed then.
    pub fn set(&self, caller: &Caller, name: &str, text: &str) -> Result<InputsSet, ApiError> {
        let (attached, store) = self.attach()?;
        let suits = |state: CommandState| state == CommandState::Ready || state.is_active();
        let id = self.resolve(|| attached.tables(), &store, name, suits)?;
        let entry = store.summary(id).filter(|entry| entry.is_named);
        let entry = entry.ok_or_else(|| no_names(id))?;
        let names = &entry.names;
        let values =
            input_values::read(text, "values", names).map_err(|faults| refused(&faults))?;
        let set = values.iter().filter_map(|value| {
            let input = names.inputs.get(value.input as usize)?;
            Some(input.primitive.clone())
        });
        let (set, net) = (set.collect(), names.net.clone());
        match self.executor.call_for(caller, &Call::Set { id, values })? {
            Answer::Done { cycle } => Ok(InputsSet {
                id,
                net,
                cycle,
                set,
            }),
            Answer::Refused(refusal) => {
                Err(self.with_names(Some(&store), |names| names.refusal(id, refusal)))
            }
            _ => Err(unexpected()),
        }
    }

    /// Reads the ports that match the patterns, or all outputs without patterns, as the last evaluation left them.
    ///
    /// # Errors
    /// Returns an error if there is no such command or port, or if more ports are requested than can be read at once.
    pub fn values(
        &self,
        caller: &Caller,
        name: &str,
        ports: &[String],
    ) -> Result<ValuesView, ApiError> {
        let (attached, store) = self.attach()?;
        let id = self.resolve(
            || attached.tables(),
            &store,
            name,
            |state| state.is_active(),
        )?;
        let names = store.names(id).ok_or_else(|| no_names(id))?;
        let selected = select(&names, ports)?;
        let points = selected.iter().map(|selected| selected.point).collect();
        match self.executor.call_for(caller, &Call::Read { id, points })? {
            Answer::Values(values) => {
                let period_ns = attached.status().period_ns;
                Ok(view(id, &names.net, period_ns, &selected, &values))
            }
            Answer::Refused(refusal) => {
                Err(self.with_names(Some(&store), |names| names.refusal(id, refusal)))
            }
            _ => Err(unexpected()),
        }
    }
}

pub(super) fn no_names(id: u64) -> ApiError {
    let message = format!("command #{id} was never ready, so its ports and inputs are not known");
    ApiError::new(codes::WRONG_STATE, message, "`rcc-cli state` shows why")
}

pub(super) fn refused(faults: &rcc_config::diagnostic::Faults) -> ApiError {
    let diagnostics = findings(faults);
    let errors = diagnostics
        .iter()
        .filter(|finding| finding.severity == "error");
    let messages: Vec<&str> = errors
        .clone()
        .map(|finding| finding.message.as_str())
        .collect();
    let help = errors.clone().find_map(|finding| finding.help.clone());
    ApiError {
        code: codes::INPUT_REFUSED,
        message: format!("no input was set: {}", messages.join("; ")),
        help: help.unwrap_or_default(),
        diagnostics,
    }
}

/// Returns the ports that match the patterns, in the order of the net, each once; without patterns, all outputs.
pub(super) fn select(names: &Names, ports: &[String]) -> Result<Vec<SelectedPort>, ApiError> {
    let patterns = ports.iter().map(|port| {
        let pattern: Result<Pattern, _> = port.parse();
        pattern.map_err(|error| ApiError::new(codes::BAD_REQUEST, error.to_string(), ""))
    });
    let patterns: Vec<Pattern> = patterns.collect::<Result<_, _>>()?;
    let mut used = vec![false; patterns.len()];
    let mut selected: Vec<SelectedPort> = Vec::new();
    for primitive in &names.primitives {
        if selected.len() > READ_MAX {
            break;
        }
        // A motion has an input and an output `speed`. The name means the output; the input's value can be read at its
        // source.
        let is_output = |name: &str| primitive.outputs.iter().any(|port| port.name == name);
        let inputs = primitive.inputs.iter().map(|port| (port, true));
        let inputs = inputs.filter(|(port, _)| !is_output(&port.name));
        let outputs = primitive.outputs.iter().map(|port| (port, false));
        for (port, is_input) in inputs.chain(outputs) {
            let name = format!("{}.{}", primitive.id, port.name);
            if patterns.is_empty() && !is_input {
                selected.extend(of_port(&name, port, None));
            }
            for (pattern, used) in patterns.iter().zip(&mut used) {
                let full = format!("{}/{name}", names.net);
                if pattern.matches(&full) || pattern.matches(&name) {
                    *used = true;
                    let found = of_port(&name, port, pattern.element);
                    let new = found.filter(|new| selected.iter().all(|old| old.port != new.port));
                    selected.extend(new);
                }
            }
        }
    }
    if selected.len() > READ_MAX {
        let message = format!(
            "the patterns match more than {READ_MAX} ports of `{}`",
            names.net
        );
        let help = "select fewer ports: `--ports 'move.*'`, or `?ports=move.*`";
        return Err(ApiError::new(codes::TOO_MANY_PORTS, message, help));
    }
    let unmatched = ports.iter().zip(&used).find(|(_, used)| !**used);
    match unmatched {
        Some((port, _)) => Err(no_port(names, port)),
        None => Ok(selected),
    }
}

fn of_port(name: &str, port: &PortNames, element: Option<usize>) -> Option<SelectedPort> {
    let kind = port.type_name.split('[').next().unwrap_or_default();
    let point = ValuePoint {
        store: port.store,
        slot: port.slot,
        width: port.width,
    };
    let whole = SelectedPort {
        port: name.to_owned(),
        ty: port.type_name.to_string(),
        unit: port.unit.as_deref().map(str::to_owned),
        point,
        whole: !matches!(kind, "Real" | "Bool" | "Int"),
    };
    let Some(element) = element else {
        return Some(whole);
    };
    let index = u32::try_from(element)
        .ok()
        .filter(|index| *index < port.width)?;
    Some(SelectedPort {
        port: format!("{name}[{element}]"),
        // The elements of composite types are numbers.
        ty: if whole.whole { "Real" } else { kind }.to_owned(),
        point: ValuePoint {
            slot: port.slot + index,
            width: 1,
            ..point
        },
        whole: false,
        ..whole
    })
}

fn no_port(names: &Names, port: &str) -> ApiError {
    let ports = names.primitives.iter().flat_map(|primitive| {
        let ports = primitive.inputs.iter().chain(&primitive.outputs);
        ports.map(|port| format!("{}.{}", primitive.id, port.name))
    });
    let ports: Vec<String> = ports.take(2000).collect();
    let near = rcc_config::diagnostic::closest(port, ports.iter().map(String::as_str));
    let help = match near {
        Some(near) => format!("did you mean `{near}`?"),
        None => "write primitive.port; * and ? match any characters; `rcc-cli state NET --values` lists the outputs".to_owned(),
    };
    let message = format!("`{}` has no port `{port}`", names.net);
    ApiError::new(codes::UNKNOWN_PORT, message, help)
}

pub(super) fn view(
    id: u64,
    net: &str,
    period_ns: u64,
    selected: &[SelectedPort],
    values: &NetValues,
) -> ValuesView {
    let mut words = values.words.as_slice();
    let values_of = selected.iter().map(|selected| {
        let (own, rest) = words
            .split_at_checked(selected.point.width as usize)
            .unwrap_or_default();
        words = rest;
        ValueView {
            port: selected.port.clone(),
            ty: selected.ty.clone(),
            unit: selected.unit.clone(),
            value: json(selected, own),
        }
    });
    let step_s = period_ns as f64 * f64::from(values.every) / 1e9;
    ValuesView {
        id,
        net: net.to_owned(),
        state: CommandState::from_number(values.state).name().to_owned(),
        cycle: values.cycle,
        net_cycle: values.evaluations,
        time_s: values.evaluations.saturating_sub(1) as f64 * step_s,
        values: values_of.collect(),
    }
}

/// Converts a value to JSON.
fn json(selected: &SelectedPort, words: &[u64]) -> Value {
    let store = selected.point.store;
    let mut elements: Vec<Value> = words.iter().map(|word| element(store, *word)).collect();
    match elements.len() {
        1 if !selected.whole && !selected.ty.contains('[') => elements.pop().unwrap_or_default(),
        _ if selected.whole && elements.last().is_none_or(Value::is_null) => Value::Null,
        _ => Value::Array(elements),
    }
}

fn element(store: Store, word: u64) -> Value {
    match store {
        Store::Real => {
            let value = f64::from_bits(word);
            let number = Number::from_f64(value).map(Value::Number);
            match number {
                Some(number) => number,
                None if value.is_nan() => Value::Null,
                None => Value::from(value.to_string()),
            }
        }
        Store::Bool if word >= u64::from(NULL_BOOL) => Value::Null,
        Store::Bool => Value::Bool(word == 1),
        Store::Int if word.cast_signed() == NULL_INT => Value::Null,
        Store::Int => Value::from(word.cast_signed()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_language::names::PrimitiveNames;

    fn port(name: &str, type_name: &str, store: Store, slot: u32, width: u32) -> PortNames {
        PortNames {
            name: name.to_owned().into(),
            store,
            slot,
            width,
            type_name: type_name.to_owned().into(),
            unit: None,
            source: None,
        }
    }

    fn names() -> Names {
        let primitive = |id: &str, inputs, outputs| PrimitiveNames {
            id: id.into(),
            type_name: "Any".into(),
            inputs,
            outputs,
            never_null: false,
        };
        Names {
            net: "line".to_owned(),
            primitives: vec![
                primitive(
                    "move",
                    vec![
                        port("stop", "Bool", Store::Bool, 1, 1),
                        port("speed", "Real", Store::Real, 20, 1),
                    ],
                    vec![
                        port("pose", "Pose", Store::Real, 0, 7),
                        port("done", "Bool", Store::Bool, 0, 1),
                        port("speed", "Real", Store::Real, 9, 1),
                    ],
                ),
                primitive(
                    "a/filter",
                    vec![],
                    vec![port("out", "Real[2]", Store::Real, 7, 2)],
                ),
            ],
            ..Names::default()
        }
    }

    fn ports(patterns: &[&str]) -> Result<Vec<String>, ApiError> {
        let patterns: Vec<String> = patterns.iter().map(|text| (*text).to_owned()).collect();
        let selected = select(&names(), &patterns)?;
        Ok(selected.into_iter().map(|selected| selected.port).collect())
    }

    #[test]
    fn patterns_select_ports_elements_and_ports_in_fragments() {
        let all = ["move.pose", "move.done", "move.speed", "a/filter.out"].map(str::to_owned);
        assert_eq!(ports(&[]).as_deref(), Ok(&all[..]));
        assert_eq!(ports(&["move.stop"]), Ok(vec!["move.stop".to_owned()]));
        assert_eq!(ports(&["line/move.*"]).map(|found| found.len()), Ok(4));
        // Not the slot that feeds the input of the same name.
        let speed = select(&names(), &["move.speed".to_owned()]).unwrap_or_default();
        assert_eq!(
            speed
                .iter()
                .map(|selected| selected.point.slot)
                .collect::<Vec<_>>(),
            [9]
        );
        assert_eq!(
            ports(&["a/filter.out[1]"]),
            Ok(vec!["a/filter.out[1]".to_owned()])
        );
        assert_eq!(
            ports(&["line/a/*", "*filter.out"]),
            Ok(vec!["a/filter.out".to_owned()])
        );
    }

    #[test]
    fn an_unknown_port_is_refused_with_a_similar_name() {
        let refused = ports(&["move.pose", "move.pos"]);
        let help = refused.map_err(|error| (error.code, error.help));
        assert_eq!(
            help,
            Err((codes::UNKNOWN_PORT, "did you mean `move.pose`?".to_owned()))
        );
        assert!(ports(&["a b"]).is_err());
    }

    #[test]
    fn null_is_null_and_a_composite_is_null_as_a_whole() {
        let names = names();
        let selected = select(&names, &[]).unwrap_or_default();
        let mut words = vec![f64::NAN.to_bits(); 7];
        words.push(2);
        words.push(1.5_f64.to_bits());
        words.extend([f64::NAN.to_bits(), f64::INFINITY.to_bits()]);
        let values = NetValues {
            every: 2,
            evaluations: 4,
            words,
            ..NetValues::default()
        };
        let view = view(3, "line", 1_000_000, &selected, &values);
        let selected: Vec<&Value> = view.values.iter().map(|value| &value.value).collect();
        let last = serde_json::json!([null, "inf"]);
        let speed = serde_json::json!(1.5);
        assert_eq!(selected, [&Value::Null, &Value::Null, &speed, &last]);
        assert_eq!(view.time_s, 0.006);
    }
}
