//! Messages of streams and set-point channels: lines of JSON, and the data of server-sent events. Written by the
//! loader, read by clients.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

use crate::bodies::{ErrorBody, FaultView};

/// First line of a set-point channel.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ChannelOpened {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
}

/// A set of values took effect.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ChannelSet {
    /// The newest line of the set, counted from 1; empty lines are not counted.
    pub line: u64,
    /// Executor cycle from which they take effect.
    pub cycle: u64,
}

/// A line was refused, or the channel ends.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ChannelError {
    /// The line, counted from 1; missing if the error is not of one line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// The error.
    pub error: ErrorBody,
}

/// Last line of a set-point channel: what became of all lines.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ChannelEnd {
    /// Lines that the client sent.
    pub lines: u64,
    /// Lines of which at least one value took effect.
    pub set: u64,
    /// Lines that newer ones overtook before a cycle could see them.
    pub superseded: u64,
    /// Lines that were refused.
    pub refused: u64,
    /// Lines of the answer for which there was no room, because the client did not read.
    pub unreported: u64,
    /// Executor cycle from which the last values took effect; 0 if none did.
    pub cycle: u64,
    /// True if the command or the executor takes no more values.
    pub is_closed: bool,
}

/// Data of the event `ports` of a stream: the ports of the following values of this command.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct StreamPorts {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// The ports, in the order of the values.
    pub ports: Vec<StreamPort>,
}

/// One port of a stream.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct StreamPort {
    /// `primitive.port`, or `primitive.port[index]`.
    pub port: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit, if the type does not imply it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// Data of the event `values` of a stream: values of one net, all from one cycle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct StreamValues {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// Executor cycle of the net's last evaluation.
    pub cycle: u64,
    /// Number of the net's evaluations.
    pub net_cycle: u64,
    /// Logical time of the net, s.
    pub time_s: f64,
    /// The values by port; null is null.
    #[cfg_attr(feature = "openapi", schema(value_type = Object))]
    pub values: serde_json::Map<String, serde_json::Value>,
}

/// Data of the event `monitored` of a stream: all values of monitors since the last such event, and how far it is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct StreamMonitored {
    /// Executor cycle in which the values were read; those of the last cycles may follow.
    pub cycle: u64,
    /// Period of the executor, s.
    pub period_s: f64,
    /// The values by command and port.
    pub batches: Vec<MonitorBatch>,
}

/// Values of one monitored port, in order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct MonitorBatch {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// The observed port: `primitive.port`, or `primitive.port[index]`.
    pub port: String,
    /// Executor cycle of the command's first evaluation.
    pub started_cycle: u64,
    /// Executor cycles of the values.
    pub cycles: Vec<u64>,
    /// The values; null is null.
    #[cfg_attr(feature = "openapi", schema(value_type = Vec<Object>))]
    pub values: Vec<serde_json::Value>,
}

/// Data of the event `state` of a stream: the state of a command, at the beginning and at each change.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct StreamState {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// Its state; `unloaded` when it is gone.
    pub state: String,
    /// The reason for a terminated command.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Name of the outcome that ended it, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<String>,
    /// Details of a fault.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<FaultView>,
}

/// Data of the event `end` of a stream: nothing can follow, because every command that `ports` names by its id has ended.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct StreamEnd {}

/// Data of the event `lost` of a stream: counts since the last such event. The client read too slowly, or the samples
/// could not be taken at the rate.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct StreamLoss {
    /// Samples of values.
    pub samples: u64,
    /// Events of the event log.
    pub events: u64,
    /// Records of monitors.
    #[serde(default)]
    pub records: u64,
}
