//! Topics, the values that go from net to net: who publishes each, and who subscribes to it. Created by blocking threads
//! of the server.

use std::collections::BTreeMap;

use rcc_api::bodies::{TopicEnd, TopicView};
use rcc_api::error::ApiError;
use rcc_api::topics::uses;
use rcc_core::message::CommandState;

use super::Service;

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
