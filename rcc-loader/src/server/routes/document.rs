//! Makes `openapi.json`, the OpenAPI document: utoipa reads handlers and bodies; the description of each response, the
//! names of states, and how a client is authorised are added. Only in tests, which compare it with the file that the server
//! sends.

use rcc_api::bodies::{ErrorBody, Finding, TextLocation};
use rcc_api::codes;
use rcc_api::streams::{
    ChannelError, ChannelOpened, ChannelSet, StreamEnd, StreamLoss, StreamMonitored, StreamPorts,
    StreamState,
};
use rcc_core::helper::HelperState;
use rcc_core::message::{ClockState, CommandState, DeviceState, EndReason, FaultCode};
use rcc_protocol::rules::RuleState;
use serde_json::{Map, Value, json};
use utoipa::OpenApi;

use super::interface::METHODS;

#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "RCC",
        description = "Robot Control Core: load a net as a command, start it, cancel it, look at it."
    ),
    paths(
        super::load::load,
        super::list,
        super::detail,
        super::start,
        super::switch,
        super::set,
        super::set_points::set_points,
        super::values,
        super::cancel,
        super::abort,
        super::unload,
        super::devices,
        super::primitives,
        super::schema,
        super::status,
        super::timing,
        super::topics,
        super::acknowledge,
        super::openapi,
        super::stream::stream
    ),
    components(schemas(
        ErrorBody,
        Finding,
        TextLocation,
        ChannelOpened,
        ChannelSet,
        ChannelError,
        StreamPorts,
        StreamState,
        StreamMonitored,
        StreamLoss,
        StreamEnd
    ))
)]
struct ApiDocument;

/// Returns the document, as the handlers and the bodies make it.
fn made() -> Result<Value, serde_json::Error> {
    let document = ApiDocument::openapi().merge_from(super::records::RecordsDocument::openapi());
    complete(document.merge_from(super::rules::RulesDocument::openapi()))
}

/// The groups of operations.
const TAGS: [(&str, &str); 6] = [
    ("commands", "Load nets as commands, start and end them."),
    (
        "rules",
        "What follows what, in the same cycle; leases of clients.",
    ),
    ("values", "Set inputs, read ports, list topics."),
    ("cell", "Devices, processes, and the timing of the cycle."),
    ("records", "Events, and incidents of the flight recorder."),
    (
        "language",
        "Primitives, the JSON Schema of nets, and this document.",
    ),
];

/// Completes a document.
///
/// # Errors
/// Returns an error if it cannot be serialized; a test shows that it can.
fn complete(document: utoipa::openapi::OpenApi) -> Result<Value, serde_json::Error> {
    let mut document = serde_json::to_value(document)?;
    document["tags"] = TAGS
        .iter()
        .map(|(name, description)| json!({"name": name, "description": description}))
        .collect();
    document["components"]["securitySchemes"] = json!({"token": {
        "type": "http", "scheme": "bearer",
        "description": "The cell's token (`access: {tcp: {token_file: …}}`), over TCP only.",
    }});
    // Over the cell's Unix socket, the permissions of the file authorise the client.
    document["security"] = json!([{}, {"token": []}]);
    let schemas = &mut document["components"]["schemas"];
    for row in &enumerations() {
        row.apply(schemas);
    }
    let schemas = document["components"]["schemas"].clone();
    for item in members(&mut document["paths"]) {
        for method in METHODS {
            if let Some(operation) = item.get_mut(method) {
                describe(operation, &schemas);
            }
        }
    }
    Ok(document)
}

fn members(value: &mut Value) -> impl Iterator<Item = &mut Value> {
    let object = value.as_object_mut().into_iter();
    object.flat_map(Map::values_mut)
}

/// A closed set of names, and the properties that contain one of them.
struct Enumeration {
    name: &'static str,
    description: &'static str,
    values: Vec<&'static str>,
    /// Schema and property.
    used_by: &'static [(&'static str, &'static str)],
}

fn enumerations() -> Vec<Enumeration> {
    let known = |name: &&'static str| *name != "none";
    vec![
        Enumeration {
            name: "CommandState",
            description: "State of a command.",
            values: CommandState::ALL
                .map(|row| row.1)
                .into_iter()
                .filter(known)
                .collect(),
            used_by: &[
                ("CommandView", "state"),
                ("Loaded", "state"),
                ("TopicEnd", "state"),
                ("ValuesView", "state"),
            ],
        },
        Enumeration {
            name: "EndReason",
            description: "Why a command terminated.",
            values: EndReason::ALL
                .map(|row| row.1)
                .into_iter()
                .filter(known)
                .collect(),
            used_by: &[("CommandView", "reason")],
        },
        Enumeration {
            name: "FaultName",
            description: "The fault that ended a net.",
            values: FaultCode::ALL
                .map(|row| row.1)
                .into_iter()
                .filter(known)
                .collect(),
            used_by: &[("FaultView", "fault")],
        },
        Enumeration {
            name: "DeviceState",
            description: "State of a device, as the executor sees it.",
            values: DeviceState::ALL.map(DeviceState::name).to_vec(),
            used_by: &[("DeviceView", "state")],
        },
        Enumeration {
            name: "ClockState",
            description: "State of the clock of the cycles.",
            values: ClockState::ALL.map(|row| row.1).to_vec(),
            used_by: &[("ClockView", "state")],
        },
        Enumeration {
            name: "HelperState",
            description: "State of a helper thread.",
            values: [&HelperState::ALL.map(|row| row.1)[..], &["hanging"]].concat(),
            used_by: &[("HelperView", "state")],
        },
        Enumeration {
            name: "RuleState",
            description: "State of a rule.",
            values: RuleState::ALL.map(|row| row.1).to_vec(),
            used_by: &[("RuleView", "state")],
        },
        Enumeration {
            name: "Severity",
            description: "Severity of a finding.",
            values: vec!["error", "warning"],
            used_by: &[("Finding", "severity")],
        },
    ]
}

impl Enumeration {
    /// Adds the schema, and refers to it wherever it is used; a property that may be null stays so.
    fn apply(&self, schemas: &mut Value) {
        schemas[self.name] =
            json!({"type": "string", "description": self.description, "enum": self.values});
        let reference = json!({"$ref": format!("#/components/schemas/{}", self.name)});
        for (schema, property) in self.used_by {
            // Properties of a schema that contains another one are in the parts of `allOf`.
            let Some(field) = schemas[*schema]["properties"].get_mut(*property) else {
                continue;
            };
            let is_optional = field["type"].is_array();
            let description = field["description"].take();
            *field = match is_optional {
                true => json!({"oneOf": [{"type": "null"}, reference]}),
                false => reference.clone(),
            };
            field["description"] = description;
        }
    }
}

/// Describes the responses of an operation that have no description.
fn describe(operation: &mut Value, schemas: &Value) {
    let summary = operation["summary"].as_str().unwrap_or_default().to_owned();
    let responses = operation["responses"].as_object_mut();
    for (status, response) in responses.into_iter().flatten() {
        // Generators know bytes as this type; utoipa writes a list of integers.
        if let Some(schema) = response.pointer_mut("/content/application~1octet-stream/schema") {
            *schema = json!({"type": "string", "format": "binary"});
        }
        if response["description"]
            .as_str()
            .is_some_and(|text| !text.is_empty())
        {
            continue;
        }
        let text = match status.parse::<u16>() {
            Ok(status) if status >= 400 => failures(status),
            _ => success(response, schemas).unwrap_or_else(|| summary.clone()),
        };
        response["description"] = text.into();
    }
}

/// Returns the meanings of a status of the table of codes.
fn failures(status: u16) -> String {
    let rows = codes::TABLE.iter().filter(|row| row.status == status);
    let mut texts: Vec<String> = rows
        .map(|row| format!("{}: {}", row.code, row.title))
        .collect();
    if status == codes::INVALID_STATUS {
        texts.push("RCC1xxx and RCC2xxx: the text is not valid.".to_owned());
    }
    texts.join(" ")
}

/// Returns the description of the schema of a body; of its elements, if it is a list.
fn success(response: &Value, schemas: &Value) -> Option<String> {
    let schema = &response["content"]["application/json"]["schema"];
    let (list, reference) = match schema["items"]["$ref"].as_str() {
        Some(reference) => (true, reference),
        None => (false, schema["$ref"].as_str()?),
    };
    let text = schemas[reference.rsplit('/').next()?]["description"].as_str()?;
    Some(match list {
        true => format!("A list, each element: {text}"),
        false => text.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    use crate::server::routes::OPEN_API;
    use crate::server::routes::interface::operations;

    fn document() -> Value {
        serde_json::from_str(OPEN_API).expect("JSON")
    }

    #[test]
    fn the_file_is_what_handlers_and_bodies_make() -> Result<(), Box<dyn std::error::Error>> {
        let made = serde_json::to_string_pretty(&made()?)? + "\n";
        if std::env::var_os("RCC_BLESS").is_some() {
            std::fs::write(
                concat!(
                    env!("CARGO_MANIFEST_DIR"),
                    "/src/server/routes/openapi.json"
                ),
                made,
            )?;
            return Ok(());
        }
        assert!(
            made == OPEN_API,
            "openapi.json is of another interface; RCC_BLESS=1 cargo test -p rcc-loader --lib document"
        );
        Ok(())
    }

    #[test]
    fn every_operation_has_a_name_of_its_own_a_group_and_described_responses() {
        let document = document();
        let mut names = BTreeSet::new();
        for (path, method, operation) in operations(&document) {
            let name = operation["operationId"].as_str().unwrap_or_default();
            let words = name.chars().filter(char::is_ascii_uppercase).count();
            assert!(words >= 1, "{method} {path}: `{name}` is no telling name");
            assert!(names.insert(name.to_owned()), "{name} is not unique");
            let tag = operation["tags"][0].as_str().unwrap_or_default();
            assert!(TAGS.iter().any(|row| row.0 == tag), "{name}: {tag}");
            let responses = operation["responses"].as_object().expect("responses");
            assert!(!responses.is_empty(), "{name}");
            for (status, response) in responses {
                let text = response["description"].as_str().unwrap_or_default();
                assert!(
                    text.ends_with('.') || text.ends_with(':') || text.len() > 10,
                    "{name} {status}: `{text}`"
                );
            }
        }
    }

    #[test]
    fn every_state_is_one_of_its_names() {
        let document = document();
        let schemas = &document["components"]["schemas"];
        for row in enumerations() {
            assert_eq!(schemas[row.name]["enum"], json!(row.values));
            for (schema, property) in row.used_by {
                let field = &schemas[*schema]["properties"][*property];
                let shown = field.to_string();
                assert!(
                    shown.contains(&format!("schemas/{}\"", row.name)),
                    "{schema}.{property}: {shown}"
                );
            }
        }
        let reason = &schemas["CommandView"]["properties"]["reason"];
        assert_eq!(reason["oneOf"][0]["type"], "null", "{reason}");
    }

    #[test]
    fn a_client_is_told_how_it_is_authorised() {
        let document = document();
        let scheme = &document["components"]["securitySchemes"]["token"];
        assert_eq!(
            (&scheme["type"], &scheme["scheme"]),
            (&json!("http"), &json!("bearer"))
        );
        assert_eq!(document["security"], json!([{}, {"token": []}]));
    }
}
