//! Topics, the values that go from net to net, as one net uses them. Pure.

use rcc_core::topic::Topic;
use rcc_language::names::Names;

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
