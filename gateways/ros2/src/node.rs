//! The gateway's node: publishers, services and actions are made here. Used by all threads.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{
    Context, Message, MessageTypeName, Name, Node, NodeName, NodeOptions, ParameterValue,
    Publisher, Server, ServiceMapping, ServiceTypeName, Spinner,
};

use crate::raw::RawMessage;

/// A publisher of messages that are encoded already.
pub type RawPublisher = Publisher<RawMessage>;

/// Name, DDS domain and transport of the node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodePlace {
    /// Name of the node.
    pub name: String,
    /// DDS domain, 0 to 232.
    pub domain: u16,
    /// Announces itself on the loopback interface only; its sockets are bound to all addresses nevertheless.
    pub localhost_only: bool,
    /// How services are carried; peers need the same.
    pub mapping: ServiceMapping,
}

/// Why something cannot be offered.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NodeError {
    /// The name is none of ROS.
    #[error("`{name}` is no name for ROS ({cause})")]
    Name {
        /// The name.
        name: String,
        /// The fault.
        cause: String,
    },
    /// DDS refuses.
    #[error(
        "DDS refuses {what}: {cause}; is a network interface up, and the domain from 0 to 232?"
    )]
    Refused {
        /// The entity that was to be created.
        what: String,
        /// DDS's words.
        cause: String,
    },
}

fn refused(what: impl Into<String>, cause: impl std::fmt::Debug) -> NodeError {
    NodeError::Refused {
        what: what.into(),
        cause: format!("{cause:?}"),
    }
}

fn name_of(name: &str) -> Result<Name, NodeError> {
    Name::parse(name).map_err(|error| NodeError::Name {
        name: name.to_owned(),
        cause: error.to_string(),
    })
}

/// Returns package and type of `PACKAGE/TYPE`, or of `PACKAGE/msg/TYPE` as schemas have it.
fn type_of(name: &str) -> (&str, &str) {
    let package = name.split('/').next().unwrap_or_default();
    let ty = name.rsplit('/').next().unwrap_or_default();
    (package, ty)
}

/// For streams of values: reliable, since readers of best effort match it and not the reverse; no value waits for a reader.
#[must_use]
pub fn stream_qos(depth: usize) -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth })
}

/// For what later readers get, too.
#[must_use]
pub fn latched_qos(depth: usize) -> QosProfile {
    stream_qos(depth).durability(Durability::TransientLocal)
}

/// For services: volatile, or clients of ROS never match.
#[must_use]
pub fn service_qos() -> QosProfile {
    stream_qos(10).reliability_reliable(WhenFull::DEFAULT)
}

/// The node. Its methods may be called by any thread.
pub struct RosNode {
    node: Mutex<Node>,
    place: NodePlace,
}

impl RosNode {
    /// Joins the domain; the spinner is to be run by a thread of its own.
    ///
    /// # Errors
    /// Fails if DDS refuses, for example without a network interface.
    pub fn join(
        place: &NodePlace,
        options: NodeOptions,
    ) -> Result<(Arc<RosNode>, Spinner), NodeError> {
        let mut participant = DomainParticipantBuilder::new(place.domain);
        if place.localhost_only {
            participant = participant.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let what = || format!("domain {}", place.domain);
        let participant = participant
            .build()
            .map_err(|error| refused(what(), error))?;
        let context = Context::from_domain_participant(participant);
        let context = context.map_err(|error| refused(what(), error))?;
        let name = NodeName::new("/", &place.name).map_err(|error| NodeError::Name {
            name: place.name.clone(),
            cause: error.to_string(),
        })?;
        // The events of the cell are the node's log; `sink` writes them.
        let node = context.new_node(name, options.enable_rosout(false));
        let mut node = node.map_err(|error| refused("the node", error))?;
        let spinner = node
            .spinner()
            .map_err(|error| refused("the spinner", error))?;
        let node = RosNode {
            node: Mutex::new(node),
            place: place.clone(),
        };
        Ok((Arc::new(node), spinner))
    }

    /// Returns the node's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.place.name
    }

    /// Returns how services are carried.
    #[must_use]
    pub fn mapping(&self) -> ServiceMapping {
        self.place.mapping
    }

    /// Gives access to the node.
    pub fn lock(&self) -> MutexGuard<'_, Node> {
        // Each call of the library is complete before the lock is given back.
        self.node.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes a publisher of `PACKAGE/TYPE`.
    ///
    /// # Errors
    /// Fails if the topic is no name of ROS, or if DDS refuses.
    pub fn publisher(
        &self,
        topic: &str,
        ty: &str,
        qos: QosProfile,
    ) -> Result<RawPublisher, NodeError> {
        let (package, ty) = type_of(ty);
        let name = name_of(topic)?;
        let mut node = self.lock();
        let made = node.create_topic(&name, MessageTypeName::new(package, ty), &qos);
        let made = made.map_err(|error| refused(topic, error))?;
        node.create_publisher(&made, Some(qos))
            .map_err(|error| refused(topic, error))
    }

    /// Makes the server of a service of `PACKAGE/TYPE`.
    ///
    /// # Errors
    /// As [`RosNode::publisher`].
    pub fn server<Request, Answer>(
        &self,
        service: &str,
        ty: &str,
    ) -> Result<Server<Request, Answer>, NodeError>
    where
        Request: Message + Clone + 'static,
        Answer: Message + Clone + 'static,
    {
        let (package, ty) = type_of(ty);
        let name = name_of(service)?;
        self.lock()
            .create_server(
                self.place.mapping,
                &name,
                &ServiceTypeName::new(package, ty),
                service_qos(),
                service_qos(),
            )
            .map_err(|error| refused(service, error))
    }

    /// Sets a parameter of the node.
    ///
    /// # Errors
    /// Returns the words of whoever refuses it.
    pub fn set_parameter(&self, name: &str, value: ParameterValue) -> Result<(), String> {
        self.lock().set_parameter(name, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_type_has_the_same_name_with_and_without_its_kind() {
        let state = ("sensor_msgs", "JointState");
        assert_eq!(type_of("sensor_msgs/JointState"), state);
        assert_eq!(type_of("sensor_msgs/msg/JointState"), state);
    }
}
