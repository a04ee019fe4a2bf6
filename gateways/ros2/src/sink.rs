//! Takes the messages about the cell and publishes those that have a type of ROS. Used by the thread that reads the cell.

use std::collections::BTreeMap;
use std::sync::Arc;

use rcc_recording::file::{AttachedText, ChannelInfo, RecordingError};
use rcc_recording::sink::{ChannelId, MessageSink, RecordingState};
use ros2_client::QosProfile;

use crate::names::recorded_topic;
use crate::node::{RawPublisher, RosNode, latched_qos, stream_qos};
use crate::raw::RawMessage;

/// Types made for one net or device have names that begin so; no node of ROS knows them.
const TABLE_SCHEMAS: &str = "rcc/msg/";
/// The channel of messages that are not published.
const NOWHERE: usize = 0;

/// Publishes what a recording gets.
pub struct RosSink {
    node: Arc<RosNode>,
    /// By channel; the first is [`NOWHERE`].
    publishers: Vec<Option<RawPublisher>>,
    by_topic: BTreeMap<String, usize>,
}

/// As ROS's own nodes offer these topics.
fn qos(topic: &str) -> QosProfile {
    match topic {
        "/robot_description" => latched_qos(1),
        "/rosout" => latched_qos(1000),
        "/tf" => stream_qos(100),
        _ => stream_qos(10),
    }
}

impl RosSink {
    /// Publishes by this node.
    #[must_use]
    pub fn new(node: Arc<RosNode>) -> RosSink {
        RosSink {
            node,
            publishers: vec![None],
            by_topic: BTreeMap::new(),
        }
    }

    fn publish(&self, channel: ChannelId, message: &[u8]) -> RecordingState {
        let publisher = self
            .publishers
            .get(channel.index())
            .and_then(Option::as_ref);
        if let Some(publisher) = publisher {
            // Newer values follow; a reader that is too slow is not waited for.
            if let Err(error) = publisher.publish(RawMessage::of(message)) {
                tracing::debug!(?error, "a message is dropped");
            }
        }
        RecordingState::Open
    }
}

impl MessageSink for RosSink {
    fn channel(&mut self, wanted: ChannelInfo) -> ChannelId {
        if wanted.schema.name.starts_with(TABLE_SCHEMAS) {
            return ChannelId::new(NOWHERE);
        }
        let topic = recorded_topic(&wanted.topic);
        if let Some(known) = self.by_topic.get(&topic) {
            return ChannelId::new(*known);
        }
        match self
            .node
            .publisher(&topic, &wanted.schema.name, qos(&topic))
        {
            Ok(publisher) => {
                let index = self.publishers.len();
                self.publishers.push(Some(publisher));
                self.by_topic.insert(topic, index);
                ChannelId::new(index)
            }
            Err(error) => {
                tracing::error!(topic, %error, "a topic is not published");
                ChannelId::new(NOWHERE)
            }
        }
    }

    fn attach(&mut self, _text: AttachedText, _time_ns: u64) -> Result<(), RecordingError> {
        Ok(())
    }

    fn write(
        &mut self,
        channel: ChannelId,
        _time_ns: u64,
        message: &[u8],
    ) -> Result<RecordingState, RecordingError> {
        Ok(self.publish(channel, message))
    }

    fn write_kept(
        &mut self,
        channel: ChannelId,
        time_ns: u64,
        message: &[u8],
    ) -> Result<RecordingState, RecordingError> {
        self.write(channel, time_ns, message)
    }
}
