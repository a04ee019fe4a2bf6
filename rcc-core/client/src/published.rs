//! Topics that running nets publish, and the streams by which a client reads all of them.

use std::collections::{BTreeMap, BTreeSet};

use rcc_api::bodies::TopicView;

/// The output of `Publish`: what the topic has.
const PORT: &str = "out";
/// Nets of one stream; a limit of the loader.
const NETS_OF_STREAM: usize = 8;
/// Streams that one client may have besides others; a limit of the loader.
const STREAMS_MAX: usize = 4;

/// A topic that a running net publishes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct PublishedTopic {
    /// Name of the topic.
    pub topic: String,
    /// Type.
    pub ty: String,
    /// Unit.
    pub unit: Option<String>,
    /// Id of the command.
    pub id: u64,
    /// Name of its net.
    pub net: String,
    /// Its `Publish`.
    pub primitive: String,
}

impl PublishedTopic {
    /// Returns the topics of running nets.
    #[must_use]
    pub fn all(views: &[TopicView]) -> BTreeSet<PublishedTopic> {
        let topics = views.iter().flat_map(|view| {
            let running = view.publishers.iter().filter(|end| end.is_active());
            running.map(|end| PublishedTopic {
                topic: view.topic.clone(),
                ty: view.ty.clone(),
                unit: view.unit.clone(),
                id: end.id,
                net: end.net.clone(),
                primitive: end.primitive.clone(),
            })
        });
        topics.collect()
    }

    /// Returns the port that has its value: `PRIMITIVE.out`.
    #[must_use]
    pub fn port(&self) -> String {
        format!("{}.{PORT}", self.primitive)
    }

    /// Returns the port as [`Cell::watch`](crate::Cell::watch) names it: `NET#ID/PRIMITIVE.out`.
    #[must_use]
    pub fn path(&self) -> String {
        format!("{}#{}/{}", self.net, self.id, self.port())
    }
}

/// Distributes topics, each with the id of its command, over the streams that one client may have. Returns the topics of each
/// stream, and the number of nets beyond the loader's limits, which are left out.
#[must_use]
pub fn streams<T>(topics: impl IntoIterator<Item = (u64, T)>) -> (Vec<Vec<T>>, usize) {
    let mut nets: BTreeMap<u64, Vec<T>> = BTreeMap::new();
    for (id, topic) in topics {
        nets.entry(id).or_default().push(topic);
    }
    let most = NETS_OF_STREAM * STREAMS_MAX;
    let left_out = nets.len().saturating_sub(most);
    let mut streams: Vec<Vec<T>> = Vec::new();
    for (number, topics) in nets.into_values().take(most).enumerate() {
        match streams.get_mut(number / NETS_OF_STREAM) {
            Some(stream) => stream.extend(topics),
            None => streams.push(topics),
        }
    }
    (streams, left_out)
}

#[cfg(test)]
mod tests {
    use rcc_api::bodies::TopicEnd;

    use super::*;

    #[test]
    fn only_running_nets_publish() {
        let end = |id, state: &str| TopicEnd {
            id,
            net: "belt".into(),
            primitive: "give".into(),
            state: state.into(),
        };
        let view = TopicView {
            topic: "belt/position".into(),
            ty: "Real".into(),
            unit: Some("m".into()),
            publishers: vec![end(1, "terminated"), end(2, "running"), end(3, "ready")],
            subscribers: vec![end(4, "running")],
        };
        let found = PublishedTopic::all(&[view]);
        let found: Vec<String> = found.iter().map(PublishedTopic::path).collect();
        assert_eq!(found, ["belt#2/give.out"]);
    }

    #[test]
    fn a_stream_has_whole_nets_and_no_more_than_the_loader_allows() {
        // Three topics of each net, in turns.
        let topics = |nets: u64| (0..3 * nets).map(move |number| (number % nets, number));
        for (nets, expected, expected_left_out) in [
            (0, vec![], 0),
            (1, vec![3], 0),
            (8, vec![24], 0),
            (9, vec![24, 3], 0),
            (40, vec![24; 4], 8),
        ] {
            let (streams, left_out) = streams(topics(nets));
            assert_eq!(left_out, expected_left_out, "{nets}");
            let lengths: Vec<usize> = streams.iter().map(Vec::len).collect();
            assert_eq!(lengths, expected, "{nets}");
            for (number, stream) in streams.iter().enumerate() {
                let first = (number * NETS_OF_STREAM) as u64;
                let own = first..first + NETS_OF_STREAM as u64;
                assert!(stream.iter().all(|topic| own.contains(&(topic % nets))));
            }
        }
    }
}
