//! The `Input`s of loaded nets as parameters, `NET/INPUT`: of several nets of one name those of the newest. Read from and
//! set at the loader, by blocking threads of the serving one.

use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap};

use rcc_api::bodies::{CommandDetail, CommandKey, CommandView, InputsSet, ValuesView};
use rcc_api::codes::UNKNOWN_COMMAND;
use rcc_client::{LoaderClient, RequestError};
use serde_json::{Map, Value};

use crate::protocol::Parameter;
use crate::services::loader;

/// Shown for a value that is null; setting it unsets the `Input`. A parameter without a value would not be shown.
pub const NULL: &str = "null";

/// Why parameters are not set.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParameterError {
    /// There is none of this name.
    #[error("no parameter `{0}`: it is NET/INPUT of a net that is loaded")]
    Unknown(String),
    /// The loader refuses, or does not answer.
    #[error(transparent)]
    Loader(#[from] RequestError),
}

/// Reads and sets parameters.
#[derive(Debug)]
pub struct Parameters {
    cell: String,
    /// Settable inputs of each command.
    known: HashMap<CommandKey, Vec<String>>,
}

/// An input: its command and its name there.
type Place = (u64, String);

impl Parameters {
    /// Reads and sets those of this cell, which need not run.
    #[must_use]
    pub fn of(cell: &str) -> Parameters {
        Parameters {
            cell: cell.to_owned(),
            known: HashMap::new(),
        }
    }

    /// Returns the place of each parameter by its name.
    fn places(&mut self, loader: &LoaderClient) -> Result<BTreeMap<String, Place>, RequestError> {
        let rows: Vec<CommandView> = loader.get("/commands")?;
        let newest = CommandView::newest_of_each_net(&rows);
        self.known
            .retain(|key, _| newest.values().any(|one| one == key));
        let mut places = BTreeMap::new();
        for (net, key) in newest {
            for input in self.inputs(loader, key)? {
                places.insert(format!("{net}/{input}"), (key.0, input.clone()));
            }
        }
        Ok(places)
    }

    /// Returns the settable inputs of a command; none if it was unloaded meanwhile.
    fn inputs(
        &mut self,
        loader: &LoaderClient,
        key: CommandKey,
    ) -> Result<&[String], RequestError> {
        match self.known.entry(key) {
            Entry::Occupied(known) => Ok(known.into_mut()),
            Entry::Vacant(place) => {
                let detail: CommandDetail = match loader.get(&format!("/commands/{}", key.0)) {
                    Err(error) if error.body.code == UNKNOWN_COMMAND.code => return Ok(&[]),
                    answer => answer?,
                };
                match detail.settable_inputs() {
                    Some(inputs) => Ok(place.insert(inputs)),
                    None => Ok(&[]),
                }
            }
        }
    }

    /// Returns the parameters of these names, all of them if there is no name.
    ///
    /// # Errors
    /// Fails if the loader does not answer.
    pub fn read(&mut self, names: &[String]) -> Result<Vec<Parameter>, RequestError> {
        let loader = loader(&self.cell)?;
        let mut wanted: BTreeMap<u64, Vec<(String, String)>> = BTreeMap::new();
        for (name, (id, input)) in self.places(&loader)? {
            if names.is_empty() || names.contains(&name) {
                wanted.entry(id).or_default().push((name, input));
            }
        }
        let mut parameters = Vec::new();
        for (id, inputs) in wanted {
            let ports: Vec<String> = inputs
                .iter()
                .map(|(_, input)| format!("{input}.value"))
                .collect();
            let view: ValuesView = match loader.values(&id.to_string(), &ports) {
                Ok(view) => view,
                // It was unloaded meanwhile.
                Err(error) if error.body.code == UNKNOWN_COMMAND.code => continue,
                Err(error) => return Err(error),
            };
            for (name, input) in inputs {
                let port = format!("{input}.value");
                let found = view.values.iter().find(|value| value.port == port);
                parameters.extend(found.map(|found| parameter(name, &found.ty, &found.value)));
            }
        }
        Ok(parameters)
    }

    /// Sets parameters: those of one net in the same cycle.
    ///
    /// # Errors
    /// Fails if there is no such parameter, or the loader refuses a value; then none of that net is set.
    pub fn set(&mut self, parameters: &[Parameter]) -> Result<(), ParameterError> {
        let loader = loader(&self.cell)?;
        let places = self.places(&loader)?;
        let mut wanted: BTreeMap<u64, Map<String, Value>> = BTreeMap::new();
        for parameter in parameters {
            let place = places.get(&parameter.name);
            let (id, input) =
                place.ok_or_else(|| ParameterError::Unknown(parameter.name.clone()))?;
            let value = match &parameter.value {
                Some(Value::String(text)) if text == NULL => Value::Null,
                given => given.clone().unwrap_or(Value::Null),
            };
            wanted.entry(*id).or_default().insert(input.clone(), value);
        }
        for (id, values) in wanted {
            let body = Value::Object(values).to_string();
            let _: InputsSet = loader.put(&format!("/commands/{id}/inputs"), body)?;
        }
        Ok(())
    }
}

fn parameter(name: String, ty: &str, value: &Value) -> Parameter {
    // Bool and Int are what JSON says; a Real that is a whole number is not an integer.
    let is_real = !ty.starts_with("Bool") && !ty.starts_with("Int");
    let ty = match value {
        Value::Number(_) if is_real => Some("float64"),
        Value::Array(elements) if is_real && elements.iter().all(Value::is_number) => {
            Some("float64_array")
        }
        _ => None,
    };
    let value = match value {
        Value::Null => Value::from(NULL),
        value => value.clone(),
    };
    Parameter {
        name,
        value: Some(value),
        ty: ty.map(str::to_owned),
    }
}

/// Returns the parameters that are new or have another value, and, without a value, those that are gone.
#[must_use]
pub fn changes(before: &[Parameter], now: &[Parameter]) -> Vec<Parameter> {
    let changed = now.iter().filter(|one| !before.contains(one)).cloned();
    let is_there = |old: &&Parameter| now.iter().any(|one| one.name == old.name);
    let gone = before.iter().filter(|old| !is_there(old));
    let gone = gone.map(|old| Parameter {
        name: old.name.clone(),
        value: None,
        ty: None,
    });
    changed.chain(gone).collect()
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixListener;
    use std::thread::JoinHandle;
    use std::time::Duration;

    use super::*;
    use rcc_api::bodies::ErrorBody;
    use rcc_testing::TempDir;
    use rcc_testing::http::answer_request;
    use serde_json::json;

    /// Starts a thread that answers these requests in their order, each with a status and a body. Returns a client for them.
    fn loader(
        folder: &TempDir,
        answers: Vec<(&'static str, u16, Value)>,
    ) -> (LoaderClient, JoinHandle<()>) {
        let socket = folder.path().join("loader.sock");
        let listener = UnixListener::bind(&socket).expect("a socket");
        let client = LoaderClient::new("test", &socket, Duration::from_secs(60));
        let server = std::thread::spawn(move || {
            for (path, status, body) in answers {
                let (stream, _) = listener.accept().expect("a client");
                let answered = answer_request(&stream, |request| {
                    assert_eq!(request.line, format!("GET {path}"));
                    (status, body.to_string())
                });
                answered.expect("an answer");
            }
        });
        (client.expect("a client"), server)
    }

    #[test]
    fn a_net_that_is_unloaded_after_the_list_has_no_parameters() {
        let ready = |id, net: &str| CommandView {
            id,
            net: net.into(),
            state: "ready".into(),
            ..CommandView::default()
        };
        let (gone, belt) = (ready(7, "arm"), ready(8, "belt"));
        let unknown = ErrorBody {
            code: UNKNOWN_COMMAND.code.into(),
            ..ErrorBody::default()
        };
        let detail = CommandDetail {
            command: belt.clone(),
            text: String::new(),
            names: json!({"inputs": [{"primitive": "speed"}]}),
        };
        let folder = rcc_testing::folder();
        let answers = vec![
            ("/commands", 200, json!([gone, belt])),
            ("/commands/7", 404, json!(unknown)),
            ("/commands/8", 200, json!(detail)),
        ];
        let (loader, server) = loader(&folder, answers);
        let places = Parameters::of("test").places(&loader);
        let wanted = BTreeMap::from([("belt/speed".to_owned(), (8, "speed".to_owned()))]);
        assert_eq!(places, Ok(wanted));
        server.join().expect("all were asked for");
    }

    #[test]
    fn a_real_is_told_as_one_and_null_is_shown() {
        let of = |ty: &str, value: Value| {
            let one = parameter("belt/x".into(), ty, &value);
            (one.value, one.ty)
        };
        let real = Some("float64".to_owned());
        assert_eq!(of("Real", json!(1)), (Some(json!(1)), real));
        let array = Some("float64_array".to_owned());
        assert_eq!(
            of("Real[2]", json!([1, 2.5])),
            (Some(json!([1, 2.5])), array)
        );
        for (ty, value) in [
            ("Bool", json!(true)),
            ("Int", json!(3)),
            ("Pose", json!([1, null])),
        ] {
            assert_eq!(of(ty, value.clone()), (Some(value), None));
        }
        assert_eq!(of("Real", Value::Null), (Some(json!("null")), None));
    }

    #[test]
    fn changed_new_and_removed_parameters_are_told() {
        let one = |name: &str, value: Option<Value>| Parameter {
            name: name.into(),
            value,
            ty: None,
        };
        let before = [
            one("a", Some(json!(1))),
            one("b", Some(json!(1))),
            one("c", Some(json!(1))),
        ];
        let now = [
            one("a", Some(json!(1))),
            one("b", Some(json!(2))),
            one("d", Some(json!(3))),
        ];
        let told = [
            one("b", Some(json!(2))),
            one("d", Some(json!(3))),
            one("c", None),
        ];
        assert_eq!(changes(&before, &now), told);
    }
}
