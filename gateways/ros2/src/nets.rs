//! Looks at the cell's nets five times a second: which topics are published, which nets can be started or canceled, and the
//! values of their Inputs. A thread of its own; follows the cell over restarts of its processes.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rcc_api::bodies::{CommandView, StatusView, TopicView};
use rcc_client::published::{PublishedTopic, streams};
use rcc_client::{Cell, ClientError, LoaderClient, RequestError};
use rcc_recording::cdr::CdrWriter;

use crate::loader::loader;
use crate::names::net_topic;
use crate::node::{RawPublisher, RosNode, stream_qos};
use crate::parameters::Parameters;
use crate::raw::RawMessage;
use crate::services::OperationServers;
use crate::topics::TopicType;
use crate::trajectory::server::TrajectoryServers;
use rcc_process::readers::{EndRequest, Reader, Readers};

/// Time between two looks.
const EVERY: Duration = Duration::from_millis(200);

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
pub fn run(options: NetsOptions, node: Arc<RosNode>, ends: &AtomicBool) {
    let mut observer = NetsObserver {
        options,
        node,
        topics: BTreeSet::new(),
        publishers: BTreeMap::new(),
        readers: Readers::new("topics"),
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
    observer.readers.end();
}

struct NetsObserver {
    options: NetsOptions,
    node: Arc<RosNode>,
    /// Topics of the present readers.
    topics: BTreeSet<PublishedTopic>,
    /// Every topic that was published so far, with its type.
    publishers: BTreeMap<String, (TopicType, Arc<RawPublisher>)>,
    readers: Readers<TopicReader>,
    /// The last problem, so that it is logged once.
    problem: String,
}

impl NetsObserver {
    fn look(&mut self, client: &LoaderClient) -> Result<(), RequestError> {
        if let Some(trajectories) = &mut self.options.trajectories {
            trajectories.offer(&self.node);
        }
        let views: Vec<TopicView> = client.get("/topics")?;
        let published = PublishedTopic::all(&views);
        if published == self.topics {
            self.readers.restart_ended();
        } else {
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
        self.topics.clear();
        self.readers.end();
    }

    /// Begins to read these topics.
    fn read(&mut self, published: BTreeSet<PublishedTopic>, base_rate_hz: f64) {
        let topics = published.iter();
        let senders: Vec<(u64, TopicSender)> = topics
            .filter_map(|topic| Some((topic.id, self.sender(topic)?)))
            .collect();
        let (streams, left_out) = streams(senders);
        if left_out > 0 {
            tracing::warn!("topics of {left_out} nets are not sent: too many nets publish");
        }
        let readers = streams.into_iter().map(|senders| TopicReader {
            cell: self.options.cell.clone(),
            senders,
            rate_hz: self.options.rate_hz.min(base_rate_hz),
        });
        self.readers.replace(readers.collect());
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
            command: topic.path(),
            port: topic.port(),
            ty,
            publisher,
        })
    }
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
}

impl Reader for TopicReader {
    type Error = ClientError;

    fn read(&self, end: &EndRequest) -> Result<(), ClientError> {
        let cell = Cell::local(&self.cell)?;
        let ports: Vec<&str> = self
            .senders
            .iter()
            .map(|one| one.command.as_str())
            .collect();
        let mut out = CdrWriter::new();
        for sample in cell.watch(&ports, self.rate_hz)? {
            let sample = sample?;
            if end.is_made() {
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
