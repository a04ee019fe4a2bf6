//! Topics, the values that go from net to net: who publishes each, and who subscribes to it. Pure, except for the list
//! of all topics, which blocking threads of the server create.

use std::collections::BTreeMap;

use rcc_core::message::CommandState;
use rcc_core::topic::Topic;
use rcc_language::names::Names;

use super::api::{TopicEnd, TopicView};
use super::error::ApiError;
use super::service::Service;

/// A net's use of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicUse<'a> {
    /// Name of the topic.
    pub topic: &'a str,
    /// True if the net publishes the topic, false if it subscribes to it.
    pub publishes: bool,
    /// Id of the primitive.
    pub primitive: &'a str,
    /// Type.
    pub ty: &'a str,
    /// Unit; empty if the type implies it.
    pub unit: &'a str,
}

impl TopicUse<'_> {
    /// Returns the type and unit, for example `Real in N`, or `Wrench`.
    #[must_use]
    pub fn kind(&self) -> String {
        match self.unit {
            "" => self.ty.to_owned(),
            unit => format!("{} in {unit}", self.ty),
        }
    }

    /// Returns `publishes` or `subscribes to`.
    #[must_use]
    pub fn verb(&self) -> &'static str {
        match self.publishes {
            true => "publishes",
            false => "subscribes to",
        }
    }
}

/// Returns all uses of topics in a net.
pub fn uses(names: &Names) -> impl Iterator<Item = TopicUse<'_>> {
    let published = names.publishes.iter().map(|row| TopicUse {
        topic: &row.topic,
        publishes: true,
        primitive: &row.primitive,
        ty: &row.type_name,
        unit: row.unit.as_deref().unwrap_or_default(),
    });
    let shown = names.inputs.iter().filter_map(|row| {
        Some(TopicUse {
            topic: row.topic.as_deref()?,
            publishes: false,
            primitive: &row.primitive,
            ty: &row.type_name,
            unit: row.unit.as_deref().unwrap_or_default(),
        })
    });
    published.chain(shown)
}

/// Returns the net's use of the topic with this key.
#[must_use]
pub fn of_key(names: &Names, key: u64) -> Option<TopicUse<'_>> {
    uses(names)
        .find(|topic_use| Topic::new(topic_use.topic, topic_use.ty, topic_use.unit).key == key)
}

impl Service {
    /// Returns the topics of all nets that are ready or active, sorted by name; a name used with two types has two
    /// rows.
    ///
    /// # Errors
    /// Returns an error if there is no executor.
    pub fn topics(&self) -> Result<Vec<TopicView>, ApiError> {
        let (attached, store) = self.attach()?;
        let mut rows = attached.tables().commands;
        rows.sort_by_key(|row| row.id);
        let mut topics: BTreeMap<[String; 3], TopicView> = BTreeMap::new();
        for row in rows {
            let state = CommandState::from_number(row.state);
            let entry = store.summary(row.id);
            let Some(entry) = entry.filter(|_| state == CommandState::Ready || state.is_active())
            else {
                continue;
            };
            let names = &entry.names;
            for topic_use in uses(names) {
                let key = [topic_use.topic, topic_use.ty, topic_use.unit].map(str::to_owned);
                let view = topics.entry(key).or_insert_with(|| TopicView {
                    topic: topic_use.topic.to_owned(),
                    ty: topic_use.ty.to_owned(),
                    unit: Some(topic_use.unit.to_owned()).filter(|unit| !unit.is_empty()),
                    ..TopicView::default()
                });
                let end = TopicEnd {
                    id: row.id,
                    net: names.net.clone(),
                    primitive: topic_use.primitive.to_owned(),
                    state: state.name().to_owned(),
                };
                match topic_use.publishes {
                    true => view.publishers.push(end),
                    false => view.subscribers.push(end),
                }
            }
        }
        Ok(topics.into_values().collect())
    }
}
