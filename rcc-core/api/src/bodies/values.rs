//! Bodies about values: inputs that were set, and a snapshot of the ports of a net.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

/// Answer to setting inputs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct InputsSet {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// Executor cycle from which they take effect: the net's next evaluation in or after it sees all of them.
    pub cycle: u64,
    /// The inputs that were set, in the order of the request.
    pub set: Vec<String>,
}

/// Values of ports of one net, all from one cycle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ValuesView {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// `ready running canceling terminated`.
    pub state: String,
    /// Executor cycle in which the net was last evaluated; 0 if not yet: the values are its initial ones.
    pub cycle: u64,
    /// Number of its evaluations.
    pub net_cycle: u64,
    /// Logical time of that evaluation since START, s.
    pub time_s: f64,
    /// The values by port, in the order of the net.
    pub values: Vec<ValueView>,
}

/// The value of a port.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ValueView {
    /// `primitive.port`, or `primitive.port[index]`.
    pub port: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit, if the type does not imply it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// A number, a truth value, or a list of them. Null is `null`; infinity is the text `inf` or `-inf`.
    #[cfg_attr(feature = "openapi", schema(value_type = Object))]
    pub value: serde_json::Value,
}
