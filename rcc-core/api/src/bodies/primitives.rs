//! Bodies about the catalogue of primitives.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

/// A primitive of the catalogue.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct PrimitiveView {
    /// Name of the type in nets.
    pub name: String,
    /// Description in one sentence.
    pub summary: String,
    /// Chapter of the manual.
    #[serde(default)]
    pub group: String,
    /// Effect of null inputs.
    pub null: String,
    /// Known inputs that have no result; empty if all have one.
    #[serde(default)]
    pub undefined: String,
    /// The formula and its source; may be empty.
    #[serde(default)]
    pub formula: String,
    /// Inputs.
    pub inputs: Vec<PortView>,
    /// Outputs.
    pub outputs: Vec<PortView>,
    /// Parameters.
    pub parameters: Vec<ParameterView>,
    /// True if it claims a resource exclusively for its net.
    pub unique: bool,
    /// True if it has state that persists from cycle to cycle.
    #[serde(default)]
    pub remembers: bool,
    /// Tables of worked values.
    #[serde(default)]
    pub examples: Vec<ExampleView>,
}

/// A port of a primitive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct PortView {
    /// Its name.
    pub name: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit; equal letters stand for equal units.
    pub unit: String,
    /// Meaning of the value.
    pub doc: String,
    /// Value of an unconnected input; `None` if it must be connected.
    #[serde(default)]
    pub default: Option<String>,
    /// True for an output that may be left unread.
    #[serde(default)]
    pub diagnostic: bool,
    /// Lower bound of an output.
    #[serde(default)]
    pub least: Option<f64>,
    /// Upper bound of an output.
    #[serde(default)]
    pub greatest: Option<f64>,
}

/// A table of worked values of a primitive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ExampleView {
    /// Title of the example.
    pub shows: String,
    /// Parameters as in a net; may be empty.
    pub parameters: String,
    /// The period of the net, ms.
    pub period_ms: u32,
    /// Names of ports.
    pub names: Vec<String>,
    /// One row per cycle, with a constant below each name.
    pub rows: Vec<Vec<String>>,
}

/// A parameter of a primitive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ParameterView {
    /// Its name.
    pub name: String,
    /// Its type, or the kind of thing it names.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit.
    pub unit: String,
    /// Meaning of the parameter.
    pub doc: String,
    /// Default value; `None` if it is required.
    #[serde(default)]
    pub default: Option<String>,
    /// Exclusive lower bound.
    #[serde(default)]
    pub above: Option<f64>,
    /// Inclusive lower bound.
    #[serde(default)]
    pub at_least: Option<f64>,
    /// Inclusive upper bound.
    #[serde(default)]
    pub at_most: Option<f64>,
}
