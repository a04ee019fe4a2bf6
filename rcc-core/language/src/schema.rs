//! The JSON Schema of nets and libraries, generated from the catalogue, for completion, documentation and validation in
//! editors. It accepts every net that the language accepts, and refuses errors that are visible without following
//! links. Never real-time.

use rcc_core::plan::OUTCOMES_MAX;
use rcc_core::primitive::{
    ChannelKind, DefaultValue, Parameter, ParameterKind, Port, PortType, Role, Spec,
};
use rcc_core::primitives::CATALOGUE;
use rcc_core::types::Type;
use rcc_core::unit::UNIT_NAMES;
use serde_json::{Map, Value, json};

use crate::devices::DeviceTable;
use crate::formula::{EXPRESSION, FORMULA};

/// The JSON Schema dialect.
pub const DIALECT: &str = "https://json-schema.org/draft/2020-12/schema";

/// Pattern of a link: an output, one of its elements, or (in a fragment) an input or parameter; or a formula, `= …`.
const REFERENCE: &str = r"^\s*=|^(\$?[A-Za-z][A-Za-z0-9_-]*)(\.[A-Za-z0-9_-]+)*(\[[0-9., ]+\])?$";
/// Pattern of a parameter of a fragment.
const PARAMETER: &str = r"^\$";
const ID: &str = "^[a-z][a-z0-9_]{0,63}$";

/// Returns the schema of nets and libraries. With a cell, it also lists the names of the cell's devices and channels.
#[must_use]
pub fn schema(cell: Option<&DeviceTable>) -> Value {
    let mut definitions = Map::new();
    for (name, schema) in shared() {
        definitions.insert(name.to_string(), schema);
    }
    let mut branches = Vec::new();
    for entry in CATALOGUE {
        let spec = &entry.spec;
        definitions.insert(spec.name.to_string(), primitive(spec, cell));
        let is_it = json!({"properties": {"type": {"const": spec.name}}, "required": ["type"]});
        branches.push(json!({"if": is_it, "then": {"$ref": format!("#/$defs/{}", spec.name)}}));
    }
    definitions.insert(FORMULA.to_string(), formula());
    let is_formula = json!({"properties": {"type": {"const": FORMULA}}, "required": ["type"]});
    branches.push(json!({"if": is_formula, "then": {"$ref": format!("#/$defs/{FORMULA}")}}));
    definitions.insert("primitive".to_string(), any_primitive(branches));
    json!({
        "$schema": DIALECT,
        "title": "A net of RCC, or a library of fragments",
        "type": "object",
        "if": {"required": ["library"]},
        "then": {"$ref": "#/$defs/library"},
        "else": {"$ref": "#/$defs/net"},
        "$defs": definitions,
    })
}

/// Returns the pattern of a number with a known unit, `deg(…)` or `rad(…)`.
fn quantity() -> String {
    let mut units: Vec<&str> = UNIT_NAMES.iter().map(|named| named.name).collect();
    units.sort_by_key(|name| std::cmp::Reverse(name.len()));
    let unit = format!(r"({})(\s*\^\s*-?[0-9]+)?", units.join("|"));
    let number = r"([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?";
    let angle = r"(deg|rad)\([0-9eEpi.+*/() -]+\)";
    format!(r"^\s*[+-]?\s*({angle}|{number}\s*{unit}(\s*[*/·]\s*{unit})*)\s*$")
}

/// Returns all definitions except the primitives: files, parts of fragments, values.
fn shared() -> impl Iterator<Item = (&'static str, Value)> {
    files().into_iter().chain(parts()).chain(values())
}

/// Returns an object whose keys are ids and whose values match the definition.
fn by_name(definition: &str, what: &str) -> Value {
    json!({
        "description": what,
        "type": "object",
        "propertyNames": {"pattern": ID},
        "additionalProperties": {"$ref": format!("#/$defs/{definition}")},
    })
}

fn list_of(items: &Value, what: &str) -> Value {
    json!({"description": what, "type": "array", "items": items})
}

fn described() -> Value {
    json!({"description": "Description for users.", "type": "string"})
}

fn files() -> [(&'static str, Value); 2] {
    let path = json!({"type": "string"});
    let uses = list_of(
        &path,
        "Files whose fragments are used; paths are relative to this file.",
    );
    let fragments = by_name("fragment", "Fragments by their names.");
    let timing = |what: &str| json!({"description": what, "$ref": "#/$defs/quantity"});
    let name =
        json!({"description": "Name.", "type": "string", "pattern": "^[a-z][a-z0-9-]{0,63}$"});
    let loss = "`null`: the net continues with null when a device that it commands is lost.";
    let mut net = object(
        "A net.",
        &["net", "primitives"],
        json!({
            "net": name,
            "description": described(),
            "on_device_loss": {"description": loss, "enum": [null, "fault"]},
            "period": timing("Period of evaluation: `5 ms`."),
            "rate": timing("Rate of evaluation: `200 Hz`."),
            "phase": timing("Delay after the start of the period: `2 ms`."),
            "use": uses,
            "fragments": fragments,
            "primitives": by_name("primitive", "Primitives by their ids."),
            "discard": list_of(&reference(), "Outputs that are not read."),
        }),
    );
    if let Some(net) = net.as_object_mut() {
        net.insert("not".to_string(), json!({"required": ["period", "rate"]}));
    }
    let library = object(
        "A library of fragments.",
        &["library"],
        json!({
            "library": {"description": "Name.", "type": "string"},
            "description": described(),
            "use": uses,
            "fragments": fragments,
        }),
    );
    [("net", net), ("library", library)]
}

fn parts() -> [(&'static str, Value); 4] {
    let fragment = object(
        "A reusable sub-net with parameters, inputs and outputs.",
        &["primitives"],
        json!({
            "description": described(),
            "parameters": by_name("fragmentPort", "Parameters that instances set; `$name` in the fragment."),
            "inputs": by_name("fragmentPort", "Inputs that instances connect; the bare name in the fragment."),
            "outputs": by_name("fragmentOutput", "Outputs of instances."),
            "primitives": by_name("primitive", "Primitives by their ids."),
            "discard": list_of(&reference(), "Outputs that are not read."),
        }),
    );
    let instance = object(
        "An instance of a fragment.",
        &["fragment"],
        json!({
            "fragment": {"description": "The fragment.", "type": "string"},
            "parameters": {"type": ["object", "null"]},
            "inputs": {"type": ["object", "null"]},
            "active": active(),
        }),
    );
    let port = json!({"type": ["object", "null"], "additionalProperties": false, "properties": {
        "type": {"description": "`Real`, `Pose`, `Real[7]`, …", "type": "string"},
        "unit": {"description": "`m/s`, `1`, …", "type": ["string", "integer"]},
        "default": {"description": "Value if an instance does not give one."},
        "description": described(),
    }});
    [
        ("fragment", fragment),
        ("instance", instance),
        ("fragmentPort", port),
        ("fragmentOutput", json!({"type": ["object", "string"]})),
    ]
}

fn values() -> [(&'static str, Value); 11] {
    let text = |what: &str, pattern: &str| json!({"description": what, "type": "string", "pattern": pattern});
    let link = object(
        "A link.",
        &["from"],
        json!({
            "from": reference(),
            "delayed": {"description": "True if it carries the value of the previous cycle.", "type": "boolean"},
            "initial": {"description": "Value in the first cycle, for a delayed link."},
        }),
    );
    let quantity_schema = json!({
        "description": "A number in SI units, or with a unit: `0.25 m/s`, `deg(30)`.",
        "anyOf": [{"type": "number"}, {"$ref": "#/$defs/withUnit"}, {"$ref": "#/$defs/parameter"}],
    });
    [
        (
            "reference",
            text("An output: `move.pose`, `state.position[0]`.", REFERENCE),
        ),
        ("parameter", text("A parameter of the fragment.", PARAMETER)),
        (
            "withUnit",
            text("A number with a unit: `0.25 m/s`, `deg(30)`.", &quantity()),
        ),
        ("quantity", quantity_schema),
        ("link", link),
        (
            "source",
            json!({
                "description": "A link, or a constant of any type.",
                "anyOf": [
                    {"type": ["boolean", "number", "null", "array", "object"]},
                    {"$ref": "#/$defs/withUnit"},
                    reference(),
                ],
            }),
        ),
        (
            "boolSource",
            source(vec![json!({"type": "boolean"}), reference()]),
        ),
        ("outcomes", outcomes()),
        (
            "intSource",
            source(vec![json!({"type": "integer"}), reference()]),
        ),
        (
            "realSource",
            source(vec![json!({"$ref": "#/$defs/quantity"}), reference()]),
        ),
        (
            "poseSource",
            source(vec![json!({"type": ["object", "string", "array"]})]),
        ),
    ]
}

/// Returns an object schema without additional keys.
fn object(description: &str, required: &[&str], properties: Value) -> Value {
    json!({
        "description": description,
        "type": "object",
        "required": required,
        "properties": properties,
        "additionalProperties": false,
    })
}

fn reference() -> Value {
    json!({"$ref": "#/$defs/reference"})
}

/// Returns the schema of a source: one of these kinds, null, or a link given as a mapping.
fn source(mut kinds: Vec<Value>) -> Value {
    kinds.push(json!({"type": "null"}));
    kinds.push(json!({"$ref": "#/$defs/link"}));
    json!({"anyOf": kinds})
}

/// Returns the schema of the condition of a `Termination`, or of its conditions by name.
fn outcomes() -> Value {
    json!({"anyOf": [
        {"$ref": "#/$defs/boolSource"},
        {
            "description": "Outcomes by their names; the first one that is true ends the net.",
            "type": "object",
            "propertyNames": {"pattern": ID, "not": {"enum": ["from", "delayed", "initial", "xyz", "rpy", "quat"]}},
            "additionalProperties": {"$ref": "#/$defs/boolSource"},
            "minProperties": 1,
            "maxProperties": OUTCOMES_MAX,
        },
    ]})
}

fn active() -> Value {
    json!({
        "description": "While this is false or null, the primitive is not evaluated and its outputs are null.",
        "$ref": "#/$defs/boolSource",
    })
}

/// Returns the schema of an entry of `primitives`; the branch of its type lists its members.
fn any_primitive(branches: Vec<Value>) -> Value {
    let names = CATALOGUE.iter().map(|entry| entry.spec.name);
    let names: Vec<&str> = names.chain([FORMULA]).collect();
    let about = CATALOGUE.iter().map(|entry| entry.spec.summary);
    let about: Vec<&str> = about.chain([ABOUT_FORMULA]).collect();
    json!({
        "type": "object",
        "if": {"required": ["fragment"]},
        "then": {"$ref": "#/$defs/instance"},
        "else": {
            "required": ["type"],
            "properties": {"type": {
                "description": "Type; `rcc-cli primitives` lists all types.",
                "enum": names,
                "markdownEnumDescriptions": about,
            }},
            "allOf": branches,
        },
    })
}

/// Description of `Formula`, one sentence.
const ABOUT_FORMULA: &str = "An expression over named inputs and outputs of other primitives.";

fn formula() -> Value {
    json!({
        "description": ABOUT_FORMULA,
        "properties": {
            "parameters": {
                "type": "object",
                "required": [EXPRESSION],
                "additionalProperties": false,
                "properties": {EXPRESSION: {
                    "description": "The expression: `clamp(2 * x, 0 m/s, 1 m/s)`.",
                    "type": "string",
                }},
            },
            "inputs": {
                "type": ["object", "null"],
                "additionalProperties": {"$ref": "#/$defs/source"},
            },
        },
        "required": ["parameters"],
    })
}

fn primitive(spec: &Spec, cell: Option<&DeviceTable>) -> Value {
    let mut about = format!("{}\n\nNull: {}.", spec.summary, spec.null);
    if !spec.undefined.is_empty() {
        about = format!("{about}\nNo result for: {}.", spec.undefined);
    }
    for port in spec.outputs {
        about = format!("{about}\nOutput `{}`: {}.", port.name, port.doc);
    }
    let parameters = spec.parameters.iter();
    let parameters: Map<String, Value> = parameters
        .map(|one| (one.name.to_string(), parameter(one, cell)))
        .collect();
    let inputs = spec.inputs.iter();
    let inputs: Map<String, Value> = inputs
        .map(|port| (port.name.to_string(), input(port, spec.role)))
        .collect();
    let needs: Vec<&str> = spec
        .parameters
        .iter()
        .filter(|one| one.default.is_none())
        .map(|one| one.name)
        .collect();
    let wants: Vec<&str> = spec
        .inputs
        .iter()
        .filter(|port| port.default.is_none())
        .map(|port| port.name)
        .collect();
    let mut required = vec!["type"];
    required.extend((!needs.is_empty()).then_some("parameters"));
    required.extend((!wants.is_empty()).then_some("inputs"));
    let group = |properties: Map<String, Value>, required: &[&str]| {
        json!({
            // An absent mapping counts as an empty one.
            "type": if required.is_empty() { json!(["object", "null"]) } else { json!("object") },
            "properties": properties,
            "required": required,
            "additionalProperties": false,
        })
    };
    object(
        &about,
        &required,
        json!({
            "type": {"const": spec.name},
            "parameters": group(parameters, &needs),
            "inputs": group(inputs, &wants),
            "active": active(),
        }),
    )
}

fn input(port: &Port, role: Role) -> Value {
    let kind = match port.ty {
        _ if role == Role::Termination => "outcomes",
        PortType::Is(Type::Bool) => "boolSource",
        PortType::Is(Type::Int) => "intSource",
        PortType::Is(Type::Real) | PortType::Number => "realSource",
        PortType::Is(Type::Pose | Type::Rotation) => "poseSource",
        _ => "source",
    };
    let mut schema =
        json!({"description": port_description(port), "$ref": format!("#/$defs/{kind}")});
    with_default(&mut schema, port.default);
    schema
}

fn port_description(port: &Port) -> String {
    match port.ty {
        PortType::Is(ty) => format!("{} ({ty})", port.doc),
        _ => port.doc.to_string(),
    }
}

fn with_default(schema: &mut Value, default: Option<DefaultValue>) {
    let default = match default {
        None => return,
        Some(DefaultValue::Real(value)) => json!(value),
        Some(DefaultValue::Int(value)) => json!(value),
        Some(DefaultValue::Bool(value)) => json!(value),
        Some(DefaultValue::Word(word)) => json!(word),
        Some(DefaultValue::Null) => Value::Null,
    };
    if let Some(schema) = schema.as_object_mut() {
        schema.insert("default".to_string(), default);
    }
}

fn parameter(parameter: &Parameter, cell: Option<&DeviceTable>) -> Value {
    let mut schema =
        match parameter.kind {
            ParameterKind::Value(PortType::Is(Type::Real), _)
            | ParameterKind::Start(Type::Real, _) => real(parameter),
            ParameterKind::Value(PortType::Is(Type::Int), _)
            | ParameterKind::Start(Type::Int, _) => either(json!({"type": "integer"})),
            ParameterKind::Value(PortType::Is(Type::Bool), _)
            | ParameterKind::Start(Type::Bool, _) => either(json!({"type": "boolean"})),
            ParameterKind::Rate => json!({"$ref": "#/$defs/quantity"}),
            ParameterKind::Word(words) => named(words.to_vec()),
            ParameterKind::Topic => named(Vec::new()),
            ParameterKind::Type | ParameterKind::Unit(_) => either(named(Vec::new())),
            ParameterKind::Arm => named(devices(cell, true)),
            ParameterKind::Device => named(devices(cell, false)),
            ParameterKind::Channel(kind) => named(channels(cell, kind)),
            // The type is open, or there are many notations.
            _ => json!({}),
        };
    if let Some(schema) = schema.as_object_mut() {
        schema.insert("description".to_string(), json!(parameter.doc));
    }
    with_default(&mut schema, parameter.default);
    schema
}

/// Returns the schema of a number with its bounds. The bounds apply to bare numbers; those with a unit are checked by
/// the compiler.
fn real(parameter: &Parameter) -> Value {
    let mut number = Map::new();
    number.insert("type".to_string(), json!("number"));
    for (key, bound) in [
        ("exclusiveMinimum", parameter.above),
        ("minimum", parameter.at_least),
        ("maximum", parameter.at_most),
    ] {
        if let Some(bound) = bound {
            number.insert(key.to_string(), json!(bound));
        }
    }
    json!({"anyOf": [number, {"$ref": "#/$defs/withUnit"}, {"$ref": "#/$defs/parameter"}, {"type": "null"}]})
}

/// Returns a schema that also accepts null and parameters of the fragment.
fn either(schema: Value) -> Value {
    json!({"anyOf": [schema, {"$ref": "#/$defs/parameter"}, {"type": "null"}]})
}

/// Returns the schema of a name: one of `names`, or any if they are not known.
fn named(names: Vec<&str>) -> Value {
    if names.is_empty() {
        return json!({"type": "string"});
    }
    json!({"anyOf": [{"enum": names}, {"$ref": "#/$defs/parameter"}]})
}

fn devices(cell: Option<&DeviceTable>, arms: bool) -> Vec<&str> {
    let devices = cell.into_iter().flat_map(|cell| &cell.devices);
    let fit = devices.filter(|device| !arms || device.model.arm.is_some());
    fit.map(|device| device.name.as_str()).collect()
}

fn channels(cell: Option<&DeviceTable>, kind: ChannelKind) -> Vec<&str> {
    let devices = cell.into_iter().flat_map(|cell| &cell.devices);
    let channels = devices.flat_map(|device| device.channels_of(kind));
    let mut names: Vec<&str> = channels.map(|channel| channel.name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    names
}
