//! Bodies of requests and answers, shared by the server and the command line. Plain data for threads that are not
//! real-time. Values are in SI units, times in nanoseconds unless their name says otherwise.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

mod commands;
mod devices;
mod primitives;
mod records;
mod rules;
mod status;
mod timing;
mod topics;
mod values;

pub use commands::{
    Checked, CommandDetail, CommandKey, CommandView, Done, FaultView, Loaded, PeakView,
    RehearsalView, Start, Switch, Switched,
};
pub use devices::{ChannelView, DeviceView};
pub use primitives::{ExampleView, ParameterView, PortView, PrimitiveView};
pub use records::{
    EventPage, EventSourceView, EventView, HistoryPage, IncidentView, MonitoredValue,
    WrittenIncident,
};
pub use rules::{
    CommandList, LeaseBody, LeaseCommands, LeaseDone, LeaseGranted, OnClientLoss, RecordBody,
    RecordedView, RuleBody, RuleNumber, RuleView, RulesBody, RulesInstalled,
};
pub use status::{
    Acknowledged, ClockView, ExecutorView, HelperView, LateView, ProcessView, StatusView,
};
pub use timing::{BucketView, HistogramView, PrimitiveTimeView, TimingView, TotalView};
pub use topics::{TopicEnd, TopicView};
pub use values::{InputsSet, ValueView, ValuesView};

/// An error, with the same codes as on the command line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ErrorBody {
    /// `RCC1xxx` language, `RCC2xxx` configuration, `RCC3xxx` life cycle, `RCC4xxx` processes.
    pub code: String,
    /// The error and its location, for people.
    pub message: String,
    /// The remedy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub help: Option<String>,
    /// Errors and warnings of a text.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub diagnostics: Vec<Finding>,
}

/// One error or warning in a text.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct Finding {
    /// `RCC1xxx` and others.
    pub code: String,
    /// `error` or `warning`.
    pub severity: String,
    /// The error or warning, for people.
    pub message: String,
    /// Its position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<TextLocation>,
    /// Where the faulty text is used, if that is elsewhere: the instance of a fragment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub used_at: Option<TextLocation>,
    /// The remedy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub help: Option<String>,
    /// For people: with a source snippet, without colour.
    #[serde(default)]
    pub rendered: String,
}

/// A position in a text, counted from 1.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Place))]
pub struct TextLocation {
    /// Name of the text.
    pub file: String,
    /// Line.
    pub line: usize,
    /// Column, in characters.
    pub column: usize,
    /// Length in bytes, at most to the end of the line.
    #[serde(default)]
    pub length: usize,
    /// Note at this position.
    #[serde(default)]
    pub label: String,
}

/// A command as named in a request: its id, the net's name, or `name#id`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(untagged)]
#[cfg_attr(feature = "openapi", schema(as = Named))]
pub enum CommandRef {
    /// An id.
    Id(u64),
    /// A name (of several nets with this name, the newest in a suitable state), `name#id`, or an id as text.
    Name(String),
}

/// Returns true for the name of the state of an active command.
fn is_active(state: &str) -> bool {
    matches!(state, "running" | "canceling")
}
