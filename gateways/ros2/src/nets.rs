//! Looks at the cell's nets five times a second: which topics are published, which nets can be started or cancelled, and the
//! values of their Inputs. A thread of its own; follows the cell over restarts of its processes.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use rcc_api::bodies::{CommandView, StatusView, TopicView};
use rcc_client::{Cell, ClientError, LoaderClient, RequestError};
use rcc_process::helpers;
use rcc_recording::cdr::CdrWriter;

use crate::loader::loader;
use crate::names::net_topic;
use crate::node::{RawPublisher, RosNode, stream_qos};
use crate::parameters::Parameters;
use crate::raw::RawMessage;
use crate::services::OperationServers;
use crate::topics::TopicType;
use crate::trajectory::server::TrajectoryServers;

/// Time between two looks.
const EVERY: Duration = Duration::from_millis(200);
/// Nets of one stream; a limit of the loader.
const NETS_OF_STREAM: usize = 8;
/// Streams that one client may have besides others; a limit of the loader.
const STREAMS_MAX: usize = 4;
/// The output of `Publish`: what the topic has.
const PORT: &str = "out";

/// A topic that a running net publishes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct PublishedTopic {
    topic: String,
    ty: String,
    id: u64,
    net: String,
    primitive: String,
}

impl PublishedTopic {
    fn port(&self) -> String {
        format!("{}.{PORT}", self.primitive)
    }
}

/// Options of the thread that looks at the nets.
pub struct NetsOptions {
    /// Name of the cell.
    pub cell: String,
    /// Greatest rate of a topic, Hz.
    pub rate_hz: f64,
    /// Services of nets.
    pub services: Vec<OperationServers>,
    /// Inputs of nets.
    pub parameters: Parameters,
    /// Actions of arms; `None`: they are not offered.
    pub trajectories: Option<TrajectoryServers>,
}

/// Looks at the nets until `ends`.
pub fn run(options: NetsOptions, node: Arc<RosNode>, ends: &Arc<AtomicBool>) {
    let mut observer = NetsObserver {
        options,
        node,
        ends: Arc::clone(ends),
        topics: BTreeSet::new(),
        publishers: BTreeMap::new(),
        generation: Arc::default(),
        problem: String::new(),
    };
    let client = match loader(&observer.options.cell) {
        Ok(client) => client,
        Err(error) => {
            tracing::error!(%error, "nets are not offered");
            return;
        }
    };
    // Acquire pairs with the release of the thread that ends the program.
    while !ends.load(Ordering::Acquire) {
        match observer.look(&client) {
            Ok(()) => observer.problem.clear(),
            Err(error) => observer.lost(&error),
        }
        std::thread::sleep(EVERY);
    }
    observer.end_readers();
}

struct NetsObserver {
    options: NetsOptions,
    node: Arc<RosNode>,
    ends: Arc<AtomicBool>,
    /// Topics of the present readers.
    topics: BTreeSet<PublishedTopic>,
    /// Every topic that was published so far, with its type.
    publishers: BTreeMap<String, (TopicType, Arc<RawPublisher>)>,
    /// Counts changes of `topics`: a reader of an older number ends.
    generation: Arc<AtomicU64>,
    /// The last problem, so that it is logged once.
    problem: String,
}

impl NetsObserver {
    fn look(&mut self, client: &LoaderClient) -> Result<(), RequestError> {
        if let Some(trajectories) = &mut self.options.trajectories {
            trajectories.offer(&self.node);
        }
        let views: Vec<TopicView> = client.get("/topics")?;
        let published = published(&views);
        if published != self.topics {
            let status: StatusView = client.get("/status")?;
            let base_rate_hz = 1e9 / status.executor.period_ns.max(1) as f64;
            self.read(published, base_rate_hz);
        }
        let commands: Vec<CommandView> = client.get("/commands")?;
        for servers in &mut self.options.services {
            servers.offer(&self.node, &commands);
        }
        self.options
            .parameters
            .mirror(&self.node, client, &commands)
    }

    /// The loader, or its executor, does not answer.
    fn lost(&mut self, error: &RequestError) {
        let words = error.to_string();
        if self.problem != words {
            tracing::warn!("cell `{}`: {words}", self.options.cell);
            self.problem = words;
        }
        self.end_readers();
    }

    fn end_readers(&mut self) {
        self.topics.clear();
        // Release pairs with the acquire of the readers.
        self.generation.fetch_add(1, Ordering::Release);
    }

    /// Begins to read these topics.
    fn read(&mut self, published: BTreeSet<PublishedTopic>, base_rate_hz: f64) {
        // Release pairs with the acquire of the readers.
        let generation = self.generation.fetch_add(1, Ordering::Release) + 1;
        let mut nets: BTreeMap<u64, Vec<TopicSender>> = BTreeMap::new();
        for topic in &published {
            if let Some(sender) = self.sender(topic) {
                nets.entry(topic.id).or_default().push(sender);
            }
        }
        if nets.len() > NETS_OF_STREAM * STREAMS_MAX {
            let most = NETS_OF_STREAM * STREAMS_MAX;
            tracing::warn!(
                "{} nets publish topics; {most} of them are sent",
                nets.len()
            );
        }
        let mut nets: Vec<Vec<TopicSender>> = nets.into_values().collect();
        nets.truncate(NETS_OF_STREAM * STREAMS_MAX);
        while !nets.is_empty() {
            let rest = nets.split_off(nets.len().min(NETS_OF_STREAM));
            let reader = TopicReader {
                cell: self.options.cell.clone(),
                senders: std::mem::replace(&mut nets, rest)
                    .into_iter()
                    .flatten()
                    .collect(),
                rate_hz: self.options.rate_hz.min(base_rate_hz),
                generation: (Arc::clone(&self.generation), generation),
                ends: Arc::clone(&self.ends),
            };
            let started = helpers::thread("topics", move || {
                if let Err(error) = reader.read() {
                    // The next look sees what has become of the nets.
                    tracing::debug!(%error, "values end");
                }
            });
            if let Err(error) = started {
                tracing::error!(%error, "topics of nets are not published");
            }
        }
        self.topics = published;
    }

    /// Returns what sends a topic; `None` if ROS has no such type or name.
    fn sender(&mut self, topic: &PublishedTopic) -> Option<TopicSender> {
        let Some(ty) = TopicType::of(&topic.ty) else {
            tracing::warn!("topic `{}` has no type of ROS: {}", topic.topic, topic.ty);
            return None;
        };
        let name = net_topic(self.node.name(), &topic.topic);
        let known = self.publishers.get(&name).filter(|(of, _)| *of == ty);
        let publisher = match known {
            Some((_, publisher)) => Arc::clone(publisher),
            None => match self.node.publisher(&name, ty.ros, stream_qos(10)) {
                Ok(publisher) => {
                    let publisher = Arc::new(publisher);
                    self.publishers.insert(name, (ty, Arc::clone(&publisher)));
                    publisher
                }
                Err(error) => {
                    tracing::warn!(%error, "a topic is not published");
                    return None;
                }
            },
        };
        Some(TopicSender {
            id: topic.id,
            command: format!("{}#{}/{}", topic.net, topic.id, topic.port()),
            port: topic.port(),
            ty,
            publisher,
        })
    }
}

/// Returns the topics of running nets.
fn published(views: &[TopicView]) -> BTreeSet<PublishedTopic> {
    let mut found = BTreeSet::new();
    for view in views {
        let running = view.publishers.iter();
        for end in running.filter(|end| end.is_active()) {
            found.insert(PublishedTopic {
                topic: view.topic.clone(),
                ty: view.ty.clone(),
                id: end.id,
                net: end.net.clone(),
                primitive: end.primitive.clone(),
            });
        }
    }
    found
}

/// A topic of a running net, and where it goes.
struct TopicSender {
    id: u64,
    /// Name of its port for the loader: `NET#ID/PRIMITIVE.out`.
    command: String,
    port: String,
    ty: TopicType,
    publisher: Arc<RawPublisher>,
}

/// Reads the values of some nets from the loader's stream. A thread of its own.
struct TopicReader {
    cell: String,
    senders: Vec<TopicSender>,
    rate_hz: f64,
    /// The present number, and that of this reader.
    generation: (Arc<AtomicU64>, u64),
    ends: Arc<AtomicBool>,
}

impl TopicReader {
    fn read(&self) -> Result<(), ClientError> {
        let cell = Cell::local(&self.cell)?;
        let ports: Vec<&str> = self
            .senders
            .iter()
            .map(|one| one.command.as_str())
            .collect();
        let mut out = CdrWriter::new();
        let (present, own) = &self.generation;
        for sample in cell.watch(&ports, self.rate_hz)? {
            let sample = sample?;
            // Acquire pairs with the release of the observer, and of the thread that ends the program.
            if present.load(Ordering::Acquire) != *own || self.ends.load(Ordering::Acquire) {
                return Ok(());
            }
            for sender in self.senders.iter().filter(|one| one.id == sample.id) {
                let Some(value) = sample.values.get(&sender.port) else {
                    continue;
                };
                if sender.ty.encode(value, &mut out) {
                    let message = RawMessage::of(out.bytes());
                    if let Err(error) = sender.publisher.publish(message) {
                        tracing::debug!(?error, "a message is dropped");
                    }
                }
            }
        }
        Ok(())
    }
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
        let found: Vec<u64> = published(&[view]).iter().map(|topic| topic.id).collect();
        assert_eq!(found, [2]);
    }
}
