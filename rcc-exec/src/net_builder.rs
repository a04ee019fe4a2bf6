//! The maker thread: checks plans, computes the start values of nets from where the arms rest, and rehearses them. It takes
//! as long as a net needs, while the intake thread goes on with other requests.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::message::{DeviceState, Joints};
use rcc_engine::costs::Costs;
use rcc_engine::net::{Net, NetOrigin};
use rcc_engine::rehearsal::{RehearsalScene, rehearse};
use rcc_ipc::control::{Call, InputValue, PlanData, Refusal};
use rcc_ipc::rehearsal::RehearsalReport;
use rcc_ipc::wire;
use rcc_process::{Helper, Helpers};

/// How long one net may take: its paths are planned and it is rehearsed, both bounded in work, not in time.
const BUILD_MAX: Duration = Duration::from_secs(60);
/// How often it shows that it lives while there is nothing to do.
const IDLE: Duration = Duration::from_millis(200);

/// What nets are made for.
#[derive(Debug)]
pub struct BuildContext {
    /// The devices of the cell.
    pub models: Vec<DeviceModel>,
    /// Fingerprint of the device table.
    pub configuration: u64,
    /// Base period.
    pub period_ns: u64,
    /// What primitives cost on this machine.
    pub costs: Costs,
}

/// The devices, as seen when a net is asked for.
#[derive(Clone, Debug)]
pub struct DeviceSnapshot {
    /// What each measures; not present: it says nothing that counts.
    pub devices: Vec<DeviceInput>,
    /// Where each arm is held, `None` if nobody knows.
    pub holds: Vec<Option<Joints>>,
}

impl DeviceSnapshot {
    /// Where an arm is held, if it rests there.
    #[must_use]
    pub fn rest_position(&self, device: usize) -> Option<Joints> {
        let input = self.devices.get(device)?;
        let ready = DeviceState::from_number(input.measurement.state) == DeviceState::Ready;
        let hold = self.holds.get(device).copied().flatten();
        hold.filter(|_| input.present && ready)
    }
}

/// What a net is made of.
#[derive(Debug)]
pub enum BuildSource {
    /// A new command's plan.
    Plan(Box<PlanData>),
    /// An encoded [`Call::Install`]: decoding a large plan takes longer than a CANCEL may wait for the intake thread.
    Encoded(Vec<u8>),
    /// A command that is ready, from where its arms rest now, with what was set meanwhile.
    Rebuild(NetOrigin, Vec<InputValue>),
}

/// A net to be made.
#[derive(Debug)]
pub struct BuildRequest {
    /// Who waits for it.
    pub ticket: u64,
    /// The command.
    pub id: u64,
    /// From what.
    pub source: BuildSource,
    /// Where the devices are.
    pub snapshot: DeviceSnapshot,
}

/// What came of a job.
#[derive(Debug)]
pub struct BuildOutcome {
    /// Of the job.
    pub ticket: u64,
    /// Of the job.
    pub id: u64,
    /// It is made anew, for a START.
    pub rebuild: bool,
    /// The net and its rehearsal, or why there is none.
    pub net: Result<(Box<Net>, Option<RehearsalReport>), Refusal>,
}

/// The intake thread's ends; when they are dropped, the thread ends.
#[derive(Debug)]
pub struct NetBuilderThread {
    requests: Sender<BuildRequest>,
    outcomes: Receiver<BuildOutcome>,
}

impl NetBuilderThread {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(context: BuildContext, helpers: &Helpers) -> io::Result<NetBuilderThread> {
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
            }
        };
        helpers.spawn("maker", BUILD_MAX, work)?;
        Ok(NetBuilderThread { requests, outcomes })
    }

    /// Gives a job.
    ///
    /// # Errors
    /// Nobody takes it: the thread is gone.
    pub fn submit(&self, request: BuildRequest) -> Result<(), Refusal> {
        self.requests.send(request).map_err(|_| Refusal::Overloaded)
    }

    /// The next one that is made.
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
