//! `~/NET/start` and `~/NET/cancel`, services of the type `std_srvs/Trigger`. A thread for each operation waits for requests,
//! so that CANCEL never waits for a START; the thread that looks at the nets says which there are.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};

use rcc_api::bodies::{CommandView, Done, OnClientLoss};
use rcc_client::{Cell, ClientError, segment};
use rcc_process::helpers;
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token, Waker};
use ros2_client::{Message, Server};
use serde::{Deserialize, Serialize};

use crate::loader::loader;
use crate::names::service;
use crate::node::RosNode;

/// The token of the waker; those of servers are greater.
const WAKE: Token = Token(0);
/// Events that are taken at once.
const EVENTS_MAX: usize = 64;
/// Nets that have services, since the gateway was started.
const SERVICES_MAX: usize = 256;

/// A request without fields: ROS sends one byte for it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TriggerRequest {
    structure_needs_at_least_one_member: u8,
}
impl Message for TriggerRequest {}

/// The answer of `std_srvs/Trigger`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TriggerAnswer {
    /// True if it was done.
    pub success: bool,
    /// The action that was taken, or the reason of the refusal.
    pub message: String,
}
impl Message for TriggerAnswer {}

type TriggerServer = Server<TriggerRequest, TriggerAnswer>;

/// The operation of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// START; the net is canceled when this process is gone.
    Start,
    /// CANCEL.
    Cancel,
}

impl Operation {
    /// Returns the last part of the service's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Operation::Start => "start",
            Operation::Cancel => "cancel",
        }
    }
}

/// A server for the thread.
type NewServer = (String, Box<TriggerServer>);

/// The services of one operation, as the thread sees them that looks at the nets.
pub struct OperationServers {
    operation: Operation,
    offered: BTreeSet<String>,
    servers: Sender<NewServer>,
    waker: Arc<Waker>,
}

impl OperationServers {
    /// Starts the thread that serves an operation until `ends`; wake it then by the waker that is returned.
    ///
    /// # Errors
    /// Fails if the system refuses a thread or an event queue.
    pub fn start(
        operation: Operation,
        cell: &str,
        ends: &Arc<AtomicBool>,
    ) -> io::Result<(OperationServers, Arc<Waker>)> {
        let poll = Poll::new()?;
        let waker = Arc::new(Waker::new(poll.registry(), WAKE)?);
        let (servers, arriving) = channel();
        let thread = ServiceThread {
            operation,
            cell: cell.to_owned(),
            ends: Arc::clone(ends),
            poll,
            arriving,
            servers: BTreeMap::new(),
            next_token: WAKE.0 + 1,
            leased: None,
        };
        helpers::thread(operation.name(), move || thread.run())?;
        let servers = OperationServers {
            operation,
            offered: BTreeSet::new(),
            servers,
            waker: Arc::clone(&waker),
        };
        Ok((servers, waker))
    }

    /// Offers the service for each net that is loaded. It stays when the net is unloaded, and then says that there is none: a
    /// client that has just found a service must not lose its request.
    pub fn offer(&mut self, node: &RosNode, commands: &[CommandView]) {
        let lives = |row: &&CommandView| {
            ["ready", "running", "canceling"].contains(&row.state.as_str())
                && !row.net.starts_with(crate::names::GOAL_NETS)
        };
        for row in commands.iter().filter(lives) {
            if self.offered.contains(&row.net) {
                continue;
            }
            if self.offered.len() >= SERVICES_MAX {
                let net = &row.net;
                tracing::warn!(
                    net,
                    "it has no services: the maximum is {SERVICES_MAX} nets"
                );
            } else {
                self.add(node, &row.net);
            }
            // One that cannot be offered is not tried five times a second.
            self.offered.insert(row.net.clone());
        }
    }

    fn add(&self, node: &RosNode, net: &str) {
        let name = service(node.name(), net, self.operation.name());
        match node.server(&name, "std_srvs/Trigger") {
            Ok(server) => {
                // The thread ends with the program only.
                let told = self
                    .servers
                    .send((net.to_owned(), Box::new(server)))
                    .is_ok();
                if !told || self.waker.wake().is_err() {
                    tracing::error!(net, "a service is not served");
                }
            }
            Err(error) => tracing::warn!(%error, "a service is not offered"),
        }
    }
}

struct ServiceThread {
    operation: Operation,
    cell: String,
    ends: Arc<AtomicBool>,
    poll: Poll,
    arriving: Receiver<NewServer>,
    servers: BTreeMap<String, TriggerServer>,
    next_token: usize,
    /// The connection whose lease what was started is bound to.
    leased: Option<Cell>,
}

impl ServiceThread {
    fn run(mut self) {
        let mut events = Events::with_capacity(EVENTS_MAX);
        // Acquire pairs with the release of the thread that ends the program.
        while !self.ends.load(Ordering::Acquire) {
            if let Err(error) = self.poll.poll(&mut events, None)
                && error.kind() != io::ErrorKind::Interrupted
            {
                tracing::error!(%error, "services of nets are not served any more");
                return;
            }
            self.take_new_servers();
            // Few servers: all are asked, whichever event came.
            let nets: Vec<String> = self.servers.keys().cloned().collect();
            for net in nets {
                self.serve(&net);
            }
        }
    }

    fn take_new_servers(&mut self) {
        while let Ok((net, mut server)) = self.arriving.try_recv() {
            let token = Token(self.next_token);
            self.next_token += 1;
            let registry = self.poll.registry();
            if let Err(error) = registry.register(&mut *server, token, Interest::READABLE) {
                tracing::warn!(net, %error, "a service cannot be awaited");
            }
            self.servers.insert(net, *server);
        }
    }

    fn serve(&mut self, net: &str) {
        loop {
            let Some(server) = self.servers.get(net) else {
                return;
            };
            let id = match server.receive_request() {
                Ok(Some((id, _))) => id,
                Ok(None) => return,
                Err(error) => {
                    tracing::debug!(?error, net, "a request is not understood");
                    return;
                }
            };
            let done = self.operate(net);
            let answer = match done {
                Ok(cycle) => TriggerAnswer {
                    success: true,
                    message: format!("{} in cycle {cycle}", self.operation.name()),
                },
                Err(error) => TriggerAnswer {
                    success: false,
                    message: error.to_string(),
                },
            };
            tracing::info!(
                net,
                operation = self.operation.name(),
                answer.message,
                "asked"
            );
            if let Some(server) = self.servers.get(net)
                && let Err(error) = server.send_response(id, answer)
            {
                tracing::debug!(?error, net, "not answered");
            }
        }
    }

    fn operate(&mut self, net: &str) -> Result<u64, ClientError> {
        match self.operation {
            Operation::Cancel => {
                let path = format!("/commands/{}/cancel", segment(net));
                let done: Done = loader(&self.cell)?.post(&path, String::new())?;
                Ok(done.cycle)
            }
            Operation::Start => {
                let cell = match &self.leased {
                    Some(cell) => cell,
                    None => self.leased.insert(Cell::local(&self.cell)?),
                };
                cell.command(net)?.start_with(OnClientLoss::Cancel)
            }
        }
    }
}
