//! The net-builder thread checks plans, computes the start values of nets from the positions at which the arms rest,
//! and rehearses the nets. It takes as long as a net needs, while the intake thread handles other requests.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::message::{DeviceState, Joints};
use rcc_engine::costs::Costs;
use rcc_engine::net::{Net, NetOrigin};
use rcc_engine::rehearsal::{RehearsalScene, rehearse};
use rcc_ipc::WakeSender;
use rcc_process::{Helper, Helpers};
use rcc_protocol::control::{Call, InputValue, PlanData, Refusal};
use rcc_protocol::rehearsal::RehearsalReport;
use rcc_protocol::wire;

/// Time allowed for one net. Path planning and rehearsal are bounded in work, not in time.
const BUILD_MAX: Duration = Duration::from_secs(60);
/// Interval of the thread's heartbeats while it is idle.
const IDLE: Duration = Duration::from_millis(200);

/// The cell and the machine that nets are built for.
#[derive(Debug)]
pub struct BuildContext {
    /// Models of the cell's devices.
    pub models: Vec<DeviceModel>,
    /// Fingerprint of the device table.
    pub configuration: u64,
    /// Base period, ns.
    pub period_ns: u64,
    /// Measured cost of each primitive on this machine.
    pub costs: Costs,
}

/// State of the devices at the time of a request.
#[derive(Clone, Debug)]
pub struct DeviceSnapshot {
    /// The newest measurement of each device; `present` is false if it is stale or the device is offline.
    pub devices: Vec<DeviceInput>,
    /// Hold position of each arm, rad; `None` if it is not known.
    pub holds: Vec<Option<Joints>>,
}

impl DeviceSnapshot {
    /// Returns the hold position of an arm, rad, if the arm is at rest and ready.
    #[must_use]
    pub fn rest_position(&self, device: usize) -> Option<Joints> {
        let input = self.devices.get(device)?;
        let ready = DeviceState::from_number(input.measurement.state) == DeviceState::Ready;
        let hold = self.holds.get(device).copied().flatten();
        hold.filter(|_| input.present && ready)
    }
}

/// Source from which a net is built.
#[derive(Debug)]
pub enum BuildSource {
    /// The plan of a new command.
    Plan(Box<PlanData>),
    /// An encoded [`Call::Install`]. It is decoded here, because a large plan takes longer than a CANCEL may wait for
    /// the intake thread.
    Encoded(Vec<u8>),
    /// The origin of a ready command, and the inputs that were set since; the net is built again for the arms' current
    /// positions.
    Rebuild(NetOrigin, Vec<InputValue>),
}

/// A request to build a net.
#[derive(Debug)]
pub struct BuildRequest {
    /// Ticket of the caller that waits for the net.
    pub ticket: u64,
    /// Id of the command.
    pub id: u64,
    /// Source of the net.
    pub source: BuildSource,
    /// State of the devices at the time of the request.
    pub snapshot: DeviceSnapshot,
}

/// The result of a [`BuildRequest`].
#[derive(Debug)]
pub struct BuildOutcome {
    /// Copied from the request.
    pub ticket: u64,
    /// Copied from the request.
    pub id: u64,
    /// The net of a ready command was rebuilt for its START.
    pub rebuild: bool,
    /// The net and the result of its rehearsal, or the reason for the refusal.
    pub net: Result<(Box<Net>, Option<RehearsalReport>), Refusal>,
}

/// Handle of the net-builder thread. The thread ends when this is dropped.
#[derive(Debug)]
pub struct NetBuilderThread {
    requests: Sender<BuildRequest>,
    outcomes: Receiver<BuildOutcome>,
}

impl NetBuilderThread {
    /// Starts the thread, which wakes the intake when a net is built.
    ///
    /// # Errors
    /// Returns an error if the system cannot create the thread.
    pub fn start(
        context: BuildContext,
        intake: WakeSender,
        helpers: &Helpers,
    ) -> io::Result<NetBuilderThread> {
        let (requests, incoming) = channel::<BuildRequest>();
        let (finished, outcomes) = channel();
        let work = move |helper: &Helper| {
            loop {
                helper.turn();
                let request = match incoming.recv_timeout(IDLE) {
                    Ok(request) => request,
                    Err(RecvTimeoutError::Timeout) => continue,
                    Err(RecvTimeoutError::Disconnected) => return,
                };
                let (ticket, id) = (request.ticket, request.id);
                let rebuild = matches!(request.source, BuildSource::Rebuild(..));
                let net = context.process(request);
                let outcome = BuildOutcome {
                    ticket,
                    id,
                    rebuild,
                    net,
                };
                if finished.send(outcome).is_err() {
                    return;
                }
                intake.wake();
            }
        };
        helpers.spawn("net-builder", BUILD_MAX, work)?;
        Ok(NetBuilderThread { requests, outcomes })
    }

    /// Submits a request.
    ///
    /// # Errors
    /// Returns [`Refusal::Overloaded`] if the thread is gone.
    pub fn submit(&self, request: BuildRequest) -> Result<(), Refusal> {
        self.requests.send(request).map_err(|_| Refusal::Overloaded)
    }

    /// Returns the next finished request, if there is one.
    #[must_use]
    pub fn next_outcome(&self) -> Option<BuildOutcome> {
        self.outcomes.try_recv().ok()
    }
}

impl BuildContext {
    fn build(&self, plan: PlanData, snapshot: &DeviceSnapshot) -> Result<Box<Net>, Refusal> {
        let dt_s = self.period_ns as f64 / 1e9;
        let holds = &snapshot.holds;
        Net::build(plan, &self.models, self.configuration, holds, dt_s)
    }

    fn process(
        &self,
        request: BuildRequest,
    ) -> Result<(Box<Net>, Option<RehearsalReport>), Refusal> {
        let BuildRequest {
            source, snapshot, ..
        } = request;
        let dt_s = self.period_ns as f64 / 1e9;
        let (mut net, values) = match source {
            BuildSource::Plan(plan) => (self.build(*plan, &snapshot)?, Vec::new()),
            BuildSource::Encoded(bytes) => match wire::decode(&bytes) {
                Ok(Call::Install { plan, .. }) => (self.build(plan, &snapshot)?, Vec::new()),
                Ok(_) | Err(_) => return Err(Refusal::NotUnderstood),
            },
            BuildSource::Rebuild(origin, values) => {
                let net =
                    Net::prepare_again(&origin, &self.models, self.configuration, &snapshot.holds)?;
                (net, values)
            }
        };
        net.expected_ns = self.costs.expected_ns(&net.plan());
        let holds: Vec<_> = (0..self.models.len())
            .map(|device| snapshot.rest_position(device))
            .collect();
        let scene = RehearsalScene {
            models: &self.models,
            devices: &snapshot.devices,
            holds: &holds,
            values: &values,
            dt_s,
        };
        let rehearsed = rehearse(&mut net, &scene)?;
        Ok((net, rehearsed))
    }
}
