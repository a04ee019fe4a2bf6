//! Serves the actions of all arms: goals, CANCEL, results, and feedback 20 times a second. One thread, which waits for
//! requests; those of nets are made by [`GoalStarter`].

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use rcc_client::LoaderClient;
use rcc_process::helpers;
use ros2_client::action::{ActionServer, ActionServerQosPolicies};
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token, Waker};
use ros2_client::{ActionTypeName, Name};

use crate::cell::ArmStates;
use crate::loader::loader;
use crate::names::trajectory_action;
use crate::node::{NodeError, RawPublisher, RosNode, latched_qos, service_qos, stream_qos};
use crate::trajectory::messages::{Feedback, Goal, Outcome};
use crate::trajectory::starter::GoalStarter;
use arm::{ArmAction, GoalNews};

mod arm;
mod ending;

/// The token of the waker; those of servers are greater.
const WAKE: Token = Token(0);
/// Events that are taken at once.
const EVENTS_MAX: usize = 64;
/// Time between two messages of feedback.
pub const FEEDBACK_EVERY: Duration = Duration::from_millis(50);
/// Goals of one arm that wait; more are refused.
const WAITING_MAX: usize = 4;

/// The action server of the library.
pub(crate) type TrajectoryServer = ActionServer<Goal, Outcome, Feedback>;

/// An arm that appears.
struct NewArm {
    device: String,
    joints: Vec<String>,
    server: Box<TrajectoryServer>,
    log: RawPublisher,
}

/// The actions, as the thread sees them that looks at the cell.
pub struct TrajectoryServers {
    offered: BTreeSet<String>,
    arms: Sender<NewArm>,
    waker: Arc<Waker>,
    states: Arc<ArmStates>,
}

impl TrajectoryServers {
    /// Starts the thread that serves until `ends`; wake it then by the waker that is returned.
    ///
    /// # Errors
    /// Fails if the system refuses a thread or an event queue.
    pub fn start(
        cell: &str,
        states: &Arc<ArmStates>,
        ends: &Arc<AtomicBool>,
    ) -> io::Result<(TrajectoryServers, Arc<Waker>)> {
        let poll = Poll::new()?;
        let waker = Arc::new(Waker::new(poll.registry(), WAKE)?);
        let (arms, arriving) = channel();
        let (told, news) = channel();
        let client = loader(cell).map_err(|error| io::Error::other(error.to_string()))?;
        let thread = ServerThread {
            cell: cell.to_owned(),
            client,
            states: Arc::clone(states),
            ends: Arc::clone(ends),
            poll,
            waker: Arc::clone(&waker),
            arriving,
            told,
            news,
            arms: BTreeMap::new(),
            next_token: WAKE.0 + 1,
        };
        helpers::thread("trajectories", move || thread.run())?;
        let servers = TrajectoryServers {
            offered: BTreeSet::new(),
            arms,
            waker: Arc::clone(&waker),
            states: Arc::clone(states),
        };
        Ok((servers, waker))
    }

    /// Offers the action of each arm that has appeared.
    pub fn offer(&mut self, node: &RosNode) {
        for (device, joints) in self.states.arms() {
            if self.offered.contains(&device) {
                continue;
            }
            let log = || node.publisher("/rosout", "rcl_interfaces/Log", latched_qos(1000));
            match action_server(node, &device).and_then(|server| Ok((server, log()?))) {
                Ok((server, log)) => {
                    let arm = NewArm {
                        device: device.clone(),
                        joints,
                        server: Box::new(server),
                        log,
                    };
                    // The thread ends with the program only.
                    let told = self.arms.send(arm).is_ok();
                    if !told || self.waker.wake().is_err() {
                        tracing::error!(device, "the action is not served");
                    }
                }
                Err(error) => tracing::error!(%error, "an action is not offered"),
            }
            // One that cannot be offered is not tried five times a second.
            self.offered.insert(device);
        }
    }
}

fn action_server(node: &RosNode, device: &str) -> Result<TrajectoryServer, NodeError> {
    let name = trajectory_action(device);
    let parsed = Name::parse(&name).map_err(|error| NodeError::Name {
        name: name.clone(),
        cause: error.to_string(),
    })?;
    let qos = ActionServerQosPolicies {
        goal_service: service_qos(),
        result_service: service_qos(),
        cancel_service: service_qos(),
        feedback_publisher: stream_qos(10),
        // Clients that come later learn which goals there are.
        status_publisher: latched_qos(1),
    };
    let ty = ActionTypeName::new("control_msgs", "FollowJointTrajectory");
    let made = node
        .lock()
        .create_action_server(node.mapping(), &parsed, &ty, qos);
    made.map_err(|error| NodeError::Refused {
        what: name,
        cause: format!("{error:?}"),
    })
}

struct ServerThread {
    cell: String,
    client: LoaderClient,
    states: Arc<ArmStates>,
    ends: Arc<AtomicBool>,
    poll: Poll,
    waker: Arc<Waker>,
    arriving: Receiver<NewArm>,
    /// For the threads that start goals.
    told: Sender<GoalNews>,
    news: Receiver<GoalNews>,
    arms: BTreeMap<String, ArmAction>,
    next_token: usize,
}

impl ServerThread {
    fn run(mut self) {
        let mut events = Events::with_capacity(EVENTS_MAX);
        let mut next = Instant::now();
        // Acquire pairs with the release of the thread that ends the program.
        while !self.ends.load(Ordering::Acquire) {
            let moves = self.arms.values().any(ArmAction::moves);
            let pause = moves.then(|| next.saturating_duration_since(Instant::now()));
            if let Err(error) = self.poll.poll(&mut events, pause)
                && error.kind() != io::ErrorKind::Interrupted
            {
                tracing::error!(%error, "trajectories are not served any more");
                return;
            }
            while let Ok(arm) = self.arriving.try_recv() {
                self.add(arm);
            }
            while let Ok(news) = self.news.try_recv() {
                if let Some(arm) = self.arms.get_mut(&news.device) {
                    arm.started(&self.client, news);
                }
            }
            let is_due = Instant::now() >= next;
            if is_due {
                next = Instant::now() + FEEDBACK_EVERY;
            }
            for arm in self.arms.values_mut() {
                arm.serve(&self.client);
                if is_due {
                    arm.turn(&self.client, &self.states);
                }
            }
        }
    }

    fn add(&mut self, arm: NewArm) {
        let NewArm {
            device,
            joints,
            mut server,
            log,
        } = arm;
        let registry = self.poll.registry();
        let mut token = || {
            self.next_token += 1;
            Token(self.next_token)
        };
        let registered = registry
            .register(server.goal_server(), token(), Interest::READABLE)
            .and_then(|()| registry.register(server.cancel_server(), token(), Interest::READABLE))
            .and_then(|()| registry.register(server.result_server(), token(), Interest::READABLE));
        let starter = GoalStarter::new(&self.cell, &device, joints, Arc::clone(&self.states));
        let (goals, waiting) = std::sync::mpsc::sync_channel(WAITING_MAX);
        let work = arm::work(
            device.clone(),
            starter,
            waiting,
            self.told.clone(),
            Arc::clone(&self.waker),
        );
        let started = registered.and_then(|()| helpers::thread("goals", work));
        match started {
            Ok(()) => {
                let action = ArmAction::new(&device, (*server, log), goals);
                self.arms.insert(device, action);
            }
            Err(error) => tracing::error!(device, %error, "the action is not served"),
        }
    }
}
