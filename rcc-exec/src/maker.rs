//! The maker thread: checks plans, computes the start values of nets from where the arms rest, and rehearses them. It takes
//! as long as a net needs, while the intake thread goes on with other requests.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::message::{DeviceState, Joints};
use rcc_engine::costs::Costs;
use rcc_engine::net::{Net, Origin};
use rcc_engine::rehearsal::{Scene, rehearse};
use rcc_ipc::control::{Call, InputValue, PlanData, Refusal};
use rcc_ipc::rehearsal::Rehearsed;
use rcc_ipc::wire;
use rcc_process::{Helper, Helpers};

/// How long one net may take: its paths are planned and it is rehearsed, both bounded in work, not in time.
const MAKE_MAX: Duration = Duration::from_secs(60);
/// How often it shows that it lives while there is nothing to do.
const IDLE: Duration = Duration::from_millis(200);

/// What nets are made for.
#[derive(Debug)]
pub struct Site {
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
pub struct Sight {
    /// What each measures; not present: it says nothing that counts.
    pub devices: Vec<DeviceInput>,
    /// Where each arm is held, `None` if nobody knows.
    pub holds: Vec<Option<Joints>>,
}

impl Sight {
    /// Where an arm is held, if it rests there.
    #[must_use]
    pub fn rests_at(&self, device: usize) -> Option<Joints> {
        let input = self.devices.get(device)?;
        let ready = DeviceState::from_number(input.measurement.state) == DeviceState::Ready;
        let hold = self.holds.get(device).copied().flatten();
        hold.filter(|_| input.present && ready)
    }
}

/// What a net is made of.
#[derive(Debug)]
pub enum What {
    /// A new command's plan.
    Plan(Box<PlanData>),
    /// An encoded [`Call::Install`]: decoding a large plan takes longer than a CANCEL may wait for the intake thread.
    Encoded(Vec<u8>),
    /// A command that is ready, from where its arms rest now, with what was set meanwhile.
    Anew(Origin, Vec<InputValue>),
}

/// A net to be made.
#[derive(Debug)]
pub struct Job {
    /// Who waits for it.
    pub ticket: u64,
    /// The command.
    pub id: u64,
    /// From what.
    pub what: What,
    /// Where the devices are.
    pub sight: Sight,
}

/// What came of a job.
#[derive(Debug)]
pub struct Made {
    /// Of the job.
    pub ticket: u64,
    /// Of the job.
    pub id: u64,
    /// It is made anew, for a START.
    pub anew: bool,
    /// The net and its rehearsal, or why there is none.
    pub net: Result<(Box<Net>, Option<Rehearsed>), Refusal>,
}

/// The intake thread's ends; when they are dropped, the thread ends.
#[derive(Debug)]
pub struct Maker {
    jobs: Sender<Job>,
    made: Receiver<Made>,
}

impl Maker {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(site: Site, helpers: &Helpers) -> io::Result<Maker> {
        let (jobs, work) = channel::<Job>();
        let (done, made) = channel();
        let work = move |helper: &Helper| {
            loop {
                helper.turn();
                let job = match work.recv_timeout(IDLE) {
                    Ok(job) => job,
                    Err(RecvTimeoutError::Timeout) => continue,
                    Err(RecvTimeoutError::Disconnected) => return,
                };
                let (ticket, id) = (job.ticket, job.id);
                let anew = matches!(job.what, What::Anew(..));
                let net = site.make(job);
                let made = Made {
                    ticket,
                    id,
                    anew,
                    net,
                };
                if done.send(made).is_err() {
                    return;
                }
            }
        };
        helpers.spawn("maker", MAKE_MAX, work)?;
        Ok(Maker { jobs, made })
    }

    /// Gives a job.
    ///
    /// # Errors
    /// Nobody takes it: the thread is gone.
    pub fn give(&self, job: Job) -> Result<(), Refusal> {
        self.jobs.send(job).map_err(|_| Refusal::Overloaded)
    }

    /// The next one that is made.
    #[must_use]
    pub fn take(&self) -> Option<Made> {
        self.made.try_recv().ok()
    }
}

impl Site {
    fn build(&self, plan: PlanData, sight: &Sight) -> Result<Box<Net>, Refusal> {
        let dt_s = self.period_ns as f64 / 1e9;
        let holds = &sight.holds;
        Net::build(plan, &self.models, self.configuration, holds, dt_s)
    }

    fn make(&self, job: Job) -> Result<(Box<Net>, Option<Rehearsed>), Refusal> {
        let Job { what, sight, .. } = job;
        let dt_s = self.period_ns as f64 / 1e9;
        let (mut net, values) = match what {
            What::Plan(plan) => (self.build(*plan, &sight)?, Vec::new()),
            What::Encoded(bytes) => match wire::decode(&bytes) {
                Ok(Call::Install { plan, .. }) => (self.build(plan, &sight)?, Vec::new()),
                Ok(_) | Err(_) => return Err(Refusal::NotUnderstood),
            },
            What::Anew(origin, values) => {
                let net = Net::anew(&origin, &self.models, self.configuration, &sight.holds)?;
                (net, values)
            }
        };
        net.expected_ns = self.costs.expected_ns(&net.plan());
        let holds: Vec<_> = (0..self.models.len())
            .map(|device| sight.rests_at(device))
            .collect();
        let scene = Scene {
            models: &self.models,
            devices: &sight.devices,
            holds: &holds,
            values: &values,
            dt_s,
        };
        let rehearsed = rehearse(&mut net, &scene)?;
        Ok((net, rehearsed))
    }
}
