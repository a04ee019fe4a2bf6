//! Values between nets: values that nets published up to the previous cycle are staged in the subscribing nets before
//! any net is evaluated, so that the order of rows has no effect. Real-time thread.
//!
//! Sources are looked up when a publishing net starts or ends; in all other cycles a value costs one copy, in running
//! nets only.

use rcc_core::message::COMMANDS_MAX;
use rcc_core::plan::{InputPoint, TOPICS_MAX};
use rcc_core::topic::Topic;
use rcc_protocol::control::Refusal;

use super::Engine;
use super::handover::HandoverRows;
use crate::boards::DeviceBoards;
use crate::input::TopicSource;
use crate::net::Net;
use crate::rows::{RowIndex, RowSet};

/// Room for the topics of all nets.
const PUBLISHED_MAX: usize = COMMANDS_MAX * TOPICS_MAX;

/// The values that running nets publish, sorted by topic.
#[derive(Debug)]
pub(super) struct PublishedTopics {
    published: [(Topic, TopicSource); PUBLISHED_MAX],
    count: usize,
    /// Changes whenever the list does.
    version: u64,
}

impl PublishedTopics {
    pub(super) fn new() -> Box<PublishedTopics> {
        let topic = Topic { key: 0, kind: 0 };
        let feed = TopicSource {
            row: RowIndex::FIRST,
            publish: 0,
        };
        Box::new(PublishedTopics {
            published: [(topic, feed); PUBLISHED_MAX],
            count: 0,
            version: 1,
        })
    }

    fn active(&self) -> &[(Topic, TopicSource)] {
        self.published.get(..self.count).unwrap_or(&[])
    }

    pub(super) fn find(&self, topic: Topic) -> Option<TopicSource> {
        let active = self.active();
        let found = active.binary_search_by_key(&topic.key, |(known, _)| known.key);
        let (known, feed) = active.get(found.ok()?)?;
        (*known == topic).then_some(*feed)
    }

    /// A topic has one publisher, and a net publishes at most [`TOPICS_MAX`] topics: there is room.
    fn add(&mut self, row: RowIndex, net: &Net) {
        for (point, publish) in net.plan().publishes.iter().zip(0..) {
            if let Some(place) = self.published.get_mut(self.count) {
                *place = (point.topic, TopicSource { row, publish });
                self.count += 1;
            }
        }
        if let Some(active) = self.published.get_mut(..self.count) {
            active.sort_unstable_by_key(|(topic, _)| topic.key);
        }
        self.version += 1;
    }

    fn remove(&mut self, row: RowIndex) {
        let mut kept = 0;
        for number in 0..self.count {
            let entry = self.published.get(number).copied();
            if let (Some(entry), Some(place)) = (
                entry.filter(|(_, feed)| feed.row != row),
                self.published.get_mut(kept),
            ) {
                *place = entry;
                kept += 1;
            }
        }
        if kept != self.count {
            self.count = kept;
            self.version += 1;
        }
    }
}

impl<B: DeviceBoards> Engine<B> {
    /// Stages values in the nets of these rows that are evaluated in this cycle.
    pub(super) fn deliver(&mut self, to: RowSet) {
        for row in self.commands.subscribers.common(to).rows() {
            if !self.is_due(row) {
                continue;
            }
            // Take the net out of its row while it reads the others; a net does not subscribe to itself.
            let Some(mut net) = self.commands[row].net.take() else {
                continue;
            };
            let (topics, commands) = (&self.topics, &self.commands);
            let now = (self.status.cycle, topics.version);
            let find = |input: &InputPoint| topics.find(input.topic?);
            net.receive(now, find, |source| commands[source].net.as_deref());
            self.commands[row].net = Some(net);
        }
    }

    /// The net in `row` runs from now on.
    pub(super) fn publish(&mut self, row: RowIndex) {
        if let Some(net) = &self.commands[row].net
            && !net.plan().publishes.is_empty()
        {
            self.topics.add(row, net);
        }
    }

    /// The net in `row` has ended, even if its arms still play its last set-points.
    pub(super) fn unpublish(&mut self, row: RowIndex) {
        self.topics.remove(row);
    }

    /// Checks that a published topic has the same type in this net and in the other active nets, in both directions.
    /// `sets` as for [`Engine::check_free`].
    pub(super) fn check_topics(&self, row: RowIndex, sets: HandoverRows) -> Result<(), Refusal> {
        let Some(own) = self.commands[row].net.as_deref() else {
            return Err(Refusal::UnknownCommand);
        };
        for other in self.other_active(row, sets) {
            let net = other.net.as_deref();
            let conflict =
                net.and_then(|net| topic_conflict(own, net).or_else(|| topic_conflict(net, own)));
            if let Some(Topic { key, .. }) = conflict {
                let other = other.entry.id;
                return Err(Refusal::OtherTopic { other, key });
            }
        }
        Ok(())
    }
}

/// A topic that one net publishes and the other one subscribes to with a different type.
fn topic_conflict(publishes: &Net, subscribes: &Net) -> Option<Topic> {
    let given = publishes.plan().publishes;
    if given.is_empty() || !subscribes.subscribes() {
        return None;
    }
    let shown = subscribes.plan().inputs.iter();
    let mut shown = shown.filter_map(|input| input.topic);
    // `Plan::check` has proved that topics are sorted.
    shown.find(|shown| {
        let found = given.binary_search_by_key(&shown.key, |point| point.topic.key);
        let given = found.ok().and_then(|found| given.get(found));
        given.is_some_and(|given| given.topic.kind != shown.kind)
    })
}
