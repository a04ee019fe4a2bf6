//! Inputs of loaded nets as parameters of the node, `NET.INPUT`: of several nets of one name those of the newest. The thread
//! that looks at the nets mirrors the values; the spinner's thread sets them at the loader.

use std::cell::Cell as Flag;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rcc_api::bodies::{CommandDetail, CommandKey, CommandView, InputsSet, ValuesView};
use rcc_api::codes::UNKNOWN_COMMAND;
use rcc_client::{LoaderClient, RequestError, segment};
use ros2_client::{NodeOptions, ParameterValue};
use serde_json::{Value, json};

use crate::loader::loader;
use crate::names::{GOAL_NETS, parameter};
use crate::node::RosNode;

thread_local! {
    /// True while this thread mirrors the loader's values: they are not sent back.
    static MIRRORS: Flag<bool> = const { Flag::new(false) };
}

/// An input: its net and its name there. The loader finds the newest net of the name when it is set, since nets may have been
/// loaded and unloaded after the last look.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Place {
    net: String,
    input: String,
}

/// Where each parameter is set.
#[derive(Clone, Debug, Default)]
struct Places(Arc<Mutex<BTreeMap<String, Place>>>);

impl Places {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Place>> {
        // Each change is one assignment.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Mirrors the Inputs of nets.
#[derive(Debug, Default)]
pub struct Parameters {
    places: Places,
    /// Settable inputs of each command.
    known: BTreeMap<CommandKey, Vec<String>>,
    /// The values that the node has.
    shown: BTreeMap<String, ParameterValue>,
}

impl Parameters {
    /// Returns the options of a node whose parameters are the Inputs of this cell's nets; without `control` they are not set.
    pub fn options(&self, cell: &str, control: bool) -> NodeOptions {
        let (places, cell) = (self.places.clone(), cell.to_owned());
        let of_validator = self.places.clone();
        NodeOptions::new()
            // Nets come and go; which names there are is checked below.
            .allow_undeclared_parameters(true)
            .parameter_validator(Box::new(move |name, _| {
                let is_own = MIRRORS.get() || name == "use_sim_time";
                match is_own || of_validator.lock().contains_key(name) {
                    false => Err(format!(
                        "no parameter `{name}`: it is NET.INPUT of a net that is loaded"
                    )),
                    true if is_own || control => Ok(()),
                    true => {
                        Err("this gateway only reads: start rcc-ros2 with --control".to_owned())
                    }
                }
            }))
            .parameter_set_action(Box::new(move |name, value| {
                let place = places.lock().get(name).cloned();
                match place {
                    Some(place) if !MIRRORS.get() => set(&cell, &place, value),
                    _ => Ok(()),
                }
            }))
    }

    /// Gives the node the present values.
    ///
    /// # Errors
    /// Fails if the loader does not answer.
    pub fn mirror(
        &mut self,
        node: &RosNode,
        client: &LoaderClient,
        commands: &[CommandView],
    ) -> Result<(), RequestError> {
        let mut newest = CommandView::newest_of_each_net(commands);
        newest.retain(|net, _| !net.starts_with(GOAL_NETS));
        self.known
            .retain(|key, _| newest.values().any(|one| one == key));
        let (mut places, mut values) = (BTreeMap::new(), BTreeMap::new());
        for (net, key) in newest {
            for (name, place, value) in self.of_net(client, net, key)? {
                places.insert(name.clone(), place);
                values.insert(name, value);
            }
        }
        *self.places.lock() = places;
        self.show(node, values);
        Ok(())
    }

    /// Returns names, places and values of the inputs of a net.
    fn of_net(
        &mut self,
        client: &LoaderClient,
        net: &str,
        key: CommandKey,
    ) -> Result<Vec<(String, Place, ParameterValue)>, RequestError> {
        let (id, _) = key;
        let inputs = match self.known.get(&key) {
            Some(known) => known.clone(),
            None => {
                let detail: CommandDetail = match client.get(&format!("/commands/{id}")) {
                    Err(error) if error.body.code == UNKNOWN_COMMAND.code => return Ok(Vec::new()),
                    answer => answer?,
                };
                let Some(inputs) = detail.settable_inputs() else {
                    return Ok(Vec::new());
                };
                self.known.insert(key, inputs.clone());
                inputs
            }
        };
        if inputs.is_empty() {
            return Ok(Vec::new());
        }
        let ports: Vec<String> = inputs
            .iter()
            .map(|input| format!("{input}.value"))
            .collect();
        let view: ValuesView = match client.values(&id.to_string(), &ports) {
            // It was unloaded meanwhile.
            Err(error) if error.body.code == UNKNOWN_COMMAND.code => return Ok(Vec::new()),
            answer => answer?,
        };
        let row = |input: String| {
            let port = format!("{input}.value");
            let found = view.values.iter().find(|value| value.port == port)?;
            let place = Place {
                net: net.to_owned(),
                input: input.clone(),
            };
            Some((
                parameter(net, &input),
                place,
                shown(&found.ty, &found.value),
            ))
        };
        Ok(inputs.into_iter().filter_map(row).collect())
    }

    fn show(&mut self, node: &RosNode, values: BTreeMap<String, ParameterValue>) {
        MIRRORS.set(true);
        let gone = self.shown.keys().filter(|name| !values.contains_key(*name));
        let gone: Vec<String> = gone.cloned().collect();
        for name in gone {
            node.lock().undeclare_parameter(&name);
            self.shown.remove(&name);
        }
        for (name, value) in values {
            if self.shown.get(&name) == Some(&value) {
                continue;
            }
            match node.set_parameter(&name, value.clone()) {
                Ok(()) => drop(self.shown.insert(name, value)),
                Err(words) => tracing::warn!(name, words, "a parameter is not shown"),
            }
        }
        MIRRORS.set(false);
    }
}

fn set(cell: &str, place: &Place, value: &ParameterValue) -> Result<(), String> {
    let value = given(value).ok_or("parameters of bytes and texts are not those of a net")?;
    let body = json!({ place.input.clone(): value }).to_string();
    let words = |error: RequestError| error.to_string();
    let loader = loader(cell).map_err(words)?;
    let set: Result<InputsSet, _> =
        loader.put(&format!("/commands/{}/inputs", segment(&place.net)), body);
    set.map(drop).map_err(words)
}

/// Returns a value for the loader: JSON; a text is a constant of the language, such as `0.2 m/s`.
fn given(value: &ParameterValue) -> Option<Value> {
    Some(match value {
        ParameterValue::NotSet => Value::Null,
        ParameterValue::Boolean(value) => json!(value),
        ParameterValue::Integer(value) => json!(value),
        // Infinity and NaN have no JSON, and would become null.
        ParameterValue::Double(value) if value.is_finite() => json!(value),
        ParameterValue::Double(_) => return None,
        ParameterValue::String(value) => json!(value),
        ParameterValue::BooleanArray(values) => json!(values),
        ParameterValue::IntegerArray(values) => json!(values),
        ParameterValue::DoubleArray(values) => json!(values),
        ParameterValue::ByteArray(_) | ParameterValue::StringArray(_) => return None,
    })
}

/// Returns a value for ROS. Null is the text `null`: a parameter that is not set would be one that is not there.
fn shown(ty: &str, value: &Value) -> ParameterValue {
    let elements = value.as_array().map(Vec::as_slice).unwrap_or_default();
    let reals = |values: &[Value]| {
        values
            .iter()
            .map(|one| one.as_f64().unwrap_or(f64::NAN))
            .collect()
    };
    match value {
        Value::Bool(value) => ParameterValue::Boolean(*value),
        Value::Number(number) => match number.as_i64().filter(|_| ty.starts_with("Int")) {
            Some(value) => ParameterValue::Integer(value),
            None => ParameterValue::Double(number.as_f64().unwrap_or(f64::NAN)),
        },
        Value::Array(_) if ty.starts_with("Bool") && elements.iter().all(Value::is_boolean) => {
            ParameterValue::BooleanArray(elements.iter().filter_map(Value::as_bool).collect())
        }
        Value::Array(_) if ty.starts_with("Int") && elements.iter().all(Value::is_i64) => {
            ParameterValue::IntegerArray(elements.iter().filter_map(Value::as_i64).collect())
        }
        Value::Array(_) if !ty.starts_with("Bool") && !ty.starts_with("Int") => {
            ParameterValue::DoubleArray(reals(elements))
        }
        other => ParameterValue::String(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_shown_in_its_type() {
        for (ty, value, wanted) in [
            ("Real", json!(1), ParameterValue::Double(1.0)),
            ("Int", json!(3), ParameterValue::Integer(3)),
            ("Bool", json!(true), ParameterValue::Boolean(true)),
            ("Real", Value::Null, ParameterValue::String("null".into())),
            (
                "Real[2]",
                json!([1, 2.5]),
                ParameterValue::DoubleArray(vec![1.0, 2.5]),
            ),
            (
                "Int[2]",
                json!([1, 2]),
                ParameterValue::IntegerArray(vec![1, 2]),
            ),
        ] {
            assert_eq!(shown(ty, &value), wanted, "{ty} {value}");
        }
    }

    #[test]
    fn what_has_no_json_is_refused_instead_of_becoming_null() {
        assert_eq!(given(&ParameterValue::Double(f64::NAN)), None);
        assert_eq!(given(&ParameterValue::Double(f64::INFINITY)), None);
        assert_eq!(given(&ParameterValue::NotSet), Some(Value::Null));
        assert_eq!(
            given(&ParameterValue::String("0.2 m/s".into())),
            Some(json!("0.2 m/s"))
        );
    }
}
