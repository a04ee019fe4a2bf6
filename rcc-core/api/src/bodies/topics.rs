//! Bodies about topics and the nets at their ends.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

use super::is_active;

impl TopicEnd {
    /// Returns true while the command is `running` or `canceling`.
    #[must_use]
    pub fn is_active(&self) -> bool {
        is_active(&self.state)
    }
}

/// A topic: a value that goes from net to net.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct TopicView {
    /// Its name.
    pub topic: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit; null if the type implies it or there is none.
    pub unit: Option<String>,
    /// Nets that publish it; at most one of them runs.
    pub publishers: Vec<TopicEnd>,
    /// Nets that subscribe to it.
    pub subscribers: Vec<TopicEnd>,
}

/// A net at one end of a topic.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct TopicEnd {
    /// Id of the command.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// The primitive.
    pub primitive: String,
    /// The command's state.
    pub state: String,
}
