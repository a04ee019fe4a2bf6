//! The intake thread takes requests, has nets built, opens drivers' boards, and frees what the real-time thread gives
//! back. It may allocate and block.

use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};
use std::io;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::message::{DeviceState, JOINTS_MAX, Joints, MAGIC, Measurement};
use rcc_ipc::events::EventRecorder;
use rcc_ipc::request::{PollError, Request, Server};
use rcc_ipc::{BoardReader, Session};
use rcc_os::clock::monotonic_ns;
use rcc_os::process_instance::{Liveness, ProcessInstance};
use rcc_process::Helpers;
use rcc_process::log_throttle::LogThrottle;
use rcc_protocol::control::{
    Answer, Call, InputValue, MEASUREMENT, READ_ELEMENTS_MAX, READ_MAX, Refusal, SET_ELEMENTS_MAX,
    SET_MAX, SWITCH_MAX, installs,
};
use rcc_protocol::events::{EventKind, event_text, hex_digits};
use rcc_protocol::rehearsal::RehearsalReport;
use rcc_protocol::{Announcement, ProcessMismatch, Role, wire};
use rtrb::{Consumer, Producer};
use tracing::{info, warn};

use crate::incidents::{self, RecordingResults};
use crate::net_builder::{
    BuildContext, BuildOutcome, BuildRequest, BuildSource, DeviceSnapshot, NetBuilderThread,
};
use rcc_engine::costs::Costs;
use rcc_engine::net::{Net, NetOrigin};
use rcc_engine::queue::{EngineReply, EngineRequest, ValueReading};

/// Interval at which the announcements of drivers are checked.
const CHECK_DRIVERS_EVERY: Duration = Duration::from_millis(50);
/// Interval at which requests are polled.
pub const POLL_EVERY: Duration = Duration::from_micros(500);
/// Maximum number of requests that wait for a net that is being built.
const DEFERRED_MAX: usize = 64;

/// The driver of a device, as the intake thread knows it.
struct DeviceLink {
    name: String,
    /// The driver's incarnation, and this thread's reader of its board; the real-time thread has its own.
    attached: Option<(u64, BoardReader<Measurement>)>,
    /// Incarnation of the driver that was last reported as refused, because of its build or configuration; 0 if none
    /// was.
    refused: u64,
}

/// A request whose answer is pending, and the action to take when it succeeds.
struct PendingRequest {
    request: Request,
    on_done: OnDone,
}

/// Action to take when the real-time thread confirms a request.
enum OnDone {
    Nothing,
    /// Record a command that is now ready.
    Ready(u64, Option<RehearsalReport>, ReadyCommand),
    /// Forget the origins of commands that are now started.
    Started(Vec<u64>, Option<RehearsalReport>),
    /// Remember values that were set before START.
    Set(u64, Vec<InputValue>),
    /// Forget a command that was unloaded.
    Unloaded(u64),
}

/// A command that is ready but not started. Its net is rebuilt from `origin` if an arm rests elsewhere at START.
struct ReadyCommand {
    origin: NetOrigin,
    /// Bit d is set if the net commands the arm of device d.
    arms: u64,
    /// Values that were set since LOAD, by input.
    values: BTreeMap<u32, Vec<u64>>,
}

/// The state of the intake thread.
pub struct Intake {
    session: Session,
    server: Server,
    engine_requests: Producer<EngineRequest>,
    engine_replies: Consumer<EngineReply>,
    net_builder: NetBuilderThread,
    stale_after_ns: u64,
    devices: Vec<DeviceLink>,
    pending: HashMap<u64, PendingRequest>,
    ready: HashMap<u64, ReadyCommand>,
    /// Commands whose net is being built.
    building: HashSet<u64>,
    /// Commands among them whose net is being rebuilt for a START.
    rebuilding: HashSet<u64>,
    /// Commands among them that a CANCEL or ABORT has withdrawn.
    withdrawn: HashSet<u64>,
    /// Calls that name a command in `building`, in order of arrival.
    deferred: VecDeque<(Call, Request)>,
    next_ticket: u64,
    drivers_checked_at: Option<Instant>,
    error_log: LogThrottle,
    /// Limits log lines about drivers whose liveness is unknown or whose board cannot be opened.
    liveness_log: LogThrottle,
    recorder: Option<EventRecorder>,
    incident_writer: Option<Sender<incidents::PreparedNet>>,
    recordings: RecordingResults,
    announcement: Announcement,
}

/// The facts about the cell that the intake thread needs.
pub struct IntakeConfig {
    /// Names of the devices, in the order of the configuration.
    pub names: Vec<String>,
    /// Models of the devices.
    pub models: Vec<DeviceModel>,
    /// Fingerprint of the device table.
    pub configuration: u64,
    /// Base period, ns.
    pub period_ns: u64,
    /// Maximum age of a board whose hold position is used, ns.
    pub stale_after_ns: u64,
    /// Measured cost of each primitive on this machine.
    pub costs: Costs,
    /// The set of helper threads that the net builder joins.
    pub helpers: Helpers,
    /// This executor's announcement; a driver that announces another configuration is not attached.
    pub announcement: Announcement,
}

impl Intake {
    /// Creates the intake, which takes requests from `server` and passes them on to the real-time thread.
    ///
    /// # Errors
    /// Returns an error if the system cannot create the net-builder thread.
    pub fn new(
        session: Session,
        server: Server,
        engine_requests: Producer<EngineRequest>,
        engine_replies: Consumer<EngineReply>,
        config: IntakeConfig,
    ) -> io::Result<Intake> {
        let devices = config
            .names
            .into_iter()
            .map(|name| DeviceLink {
                name,
                attached: None,
                refused: 0,
            })
            .collect();
        let build_context = BuildContext {
            models: config.models,
            configuration: config.configuration,
            period_ns: config.period_ns,
            costs: config.costs,
        };
        Ok(Intake {
            session,
            server,
            engine_requests,
            engine_replies,
            net_builder: NetBuilderThread::start(build_context, &config.helpers)?,
            stale_after_ns: config.stale_after_ns,
            devices,
            pending: HashMap::new(),
            ready: HashMap::new(),
            building: HashSet::new(),
            rebuilding: HashSet::new(),
            withdrawn: HashSet::new(),
            deferred: VecDeque::new(),
            next_ticket: 1,
            drivers_checked_at: None,
            error_log: LogThrottle::default(),
            liveness_log: LogThrottle::default(),
            recorder: None,
            incident_writer: None,
            recordings: RecordingResults::default(),
            announcement: config.announcement,
        })
    }

    /// Sends the origin of every net to the writer of incident files, and answers queries about its recordings.
    #[must_use]
    pub fn with_incident_writer(
        mut self,
        incident_writer: Option<Sender<incidents::PreparedNet>>,
        recordings: RecordingResults,
    ) -> Intake {
        self.incident_writer = incident_writer;
        self.recordings = recordings;
        self
    }

    /// Also writes events to the cell's event log.
    #[must_use]
    pub fn with_event_log(mut self, recorder: EventRecorder) -> Intake {
        self.recorder = Some(recorder);
        self
    }

    fn record(&self, event: EventKind) {
        if let Some(recorder) = &self.recorder {
            recorder.tell(event);
        }
    }

    /// Processes pending work once; returns true if there was any.
    pub fn round(&mut self) -> bool {
        if self
            .drivers_checked_at
            .is_none_or(|at| at.elapsed() >= CHECK_DRIVERS_EVERY)
        {
            self.drivers_checked_at = Some(Instant::now());
            self.update_drivers();
        }
        let mut busy = false;
        while let Ok(reply) = self.engine_replies.pop() {
            busy = true;
            self.handle_reply(reply);
        }
        while let Some(outcome) = self.net_builder.next_outcome() {
            busy = true;
            self.handle_build_outcome(outcome);
        }
        match self.server.poll() {
            Ok(Some(request)) => {
                busy = true;
                self.accept(request);
            }
            Ok(None) => {}
            // A refused request counts as work, because others may wait behind it.
            Err(error) => {
                busy = matches!(error, PollError::Refused { .. });
                self.log_error(&error);
            }
        }
        busy
    }

    fn handle_reply(&mut self, engine_reply: EngineReply) {
        match engine_reply {
            EngineReply::Answer { ticket, answer } => {
                if let Some(PendingRequest { request, on_done }) = self.pending.remove(&ticket) {
                    let answer = self.finish_answer(answer, on_done);
                    reply(request, &answer);
                }
            }
            // Dropped here, because the real-time thread never frees memory.
            EngineReply::Values(values) => drop(values),
            EngineReply::Read {
                ticket,
                reading,
                refused,
            } => {
                if let Some(PendingRequest { request, .. }) = self.pending.remove(&ticket) {
                    let answer = refused.map_or(Answer::Values(reading.values), Answer::Refused);
                    reply(request, &answer);
                }
            }
            EngineReply::Net(net) => drop(net),
            EngineReply::Board(board) => drop(board),
        }
    }

    /// Logs a malformed request, at a limited rate so that no client can fill the log.
    fn log_error(&mut self, error: &dyn std::fmt::Display) {
        match self.error_log.admit(Instant::now()) {
            Some(0) => warn!("{error}"),
            Some(others) => warn!("{error}; {others} more since the last such message"),
            None => {}
        }
    }

    fn accept(&mut self, mut request: Request) {
        if let Some(id) = installs(request.bytes()) {
            let (ticket, snapshot) = (self.ticket(), self.snapshot());
            let source = BuildSource::Encoded(request.take_bytes());
            return self.build(ticket, id, source, snapshot, request);
        }
        let call = match wire::decode::<Call>(request.bytes()) {
            Ok(call) => call,
            Err(error) => {
                self.log_error(&format_args!("malformed request refused: {error}"));
                return reply(request, &Answer::Refused(Refusal::NotUnderstood));
            }
        };
        // A CANCEL or ABORT does not wait for a net to be built: a START that has not taken effect is withdrawn, and
        // for a command that is loading the real-time thread gives the answer.
        if let Call::Cancel { id } | Call::Abort { id } = call
            && self.building.contains(&id)
        {
            if self.rebuilding.contains(&id) {
                self.withdraw(id);
                return reply(request, &Answer::Done { cycle: 0 });
            }
            return self.dispatch(call, request);
        }
        // Other calls that name a command whose net is being built are deferred until it is finished.
        if commands_of(&call)
            .iter()
            .any(|id| self.building.contains(id))
        {
            if self.deferred.len() >= DEFERRED_MAX {
                return reply(request, &Answer::Refused(Refusal::Overloaded));
            }
            return self.deferred.push_back((call, request));
        }
        self.dispatch(call, request);
    }

    /// Refuses every START of this command that has not taken effect.
    fn withdraw(&mut self, id: u64) {
        self.withdrawn.insert(id);
        for (call, request) in std::mem::take(&mut self.deferred) {
            match call {
                Call::Start { id: other } if other == id => {
                    reply(request, &Answer::Refused(Refusal::Withdrawn));
                }
                call => self.deferred.push_back((call, request)),
            }
        }
    }

    fn ticket(&mut self) -> u64 {
        self.next_ticket += 1;
        self.next_ticket - 1
    }

    fn dispatch(&mut self, call: Call, request: Request) {
        let ticket = self.ticket();
        let mut on_done = OnDone::Nothing;
        let engine_request = match call {
            Call::Reserve => EngineRequest::Reserve { ticket },
            Call::Reject { id } => EngineRequest::Reject { ticket, id },
            Call::Start { id } => {
                let snapshot = self.snapshot();
                if let Some(source) = self.rebuild_source(id, &snapshot) {
                    return self.build(ticket, id, source, snapshot, request);
                }
                on_done = OnDone::Started(vec![id], None);
                EngineRequest::Start { ticket, id }
            }
            Call::Switch { stop, start } => match (id_list(&stop), id_list(&start)) {
                (Some(stop), Some(list)) => {
                    on_done = OnDone::Started(start, None);
                    EngineRequest::Handover {
                        ticket,
                        stop,
                        start: list,
                    }
                }
                _ => {
                    let max = SWITCH_MAX as u32;
                    let refusal = Refusal::SwitchTooLarge { max };
                    return reply(request, &Answer::Refused(refusal));
                }
            },
            Call::Set { id, values } => {
                if values.len() > SET_MAX || elements(&values) > SET_ELEMENTS_MAX {
                    let refusal = Refusal::SetTooLarge {
                        values: SET_MAX as u32,
                        elements: SET_ELEMENTS_MAX as u32,
                    };
                    return reply(request, &Answer::Refused(refusal));
                }
                if self.ready.contains_key(&id) {
                    on_done = OnDone::Set(id, values.clone());
                }
                EngineRequest::Set { ticket, id, values }
            }
            Call::Read { id, points } => {
                let widths = points.iter().map(|point| u64::from(point.width));
                if points.len() > READ_MAX || widths.sum::<u64>() > READ_ELEMENTS_MAX as u64 {
                    let refusal = Refusal::ReadTooLarge {
                        values: READ_MAX as u32,
                        elements: READ_ELEMENTS_MAX as u32,
                    };
                    return reply(request, &Answer::Refused(refusal));
                }
                let reading = ValueReading::of(points);
                EngineRequest::Read {
                    ticket,
                    id,
                    reading,
                }
            }
            Call::Cancel { id } => EngineRequest::Cancel { ticket, id },
            Call::Abort { id } => EngineRequest::Abort { ticket, id },
            Call::Unload { id } => {
                on_done = OnDone::Unloaded(id);
                EngineRequest::Unload { ticket, id }
            }
            Call::Record => EngineRequest::Record { ticket },
            Call::Recorded { cycle } => {
                let recorded = self.recordings.find(cycle);
                return reply(request, &Answer::Recorded(recorded));
            }
            Call::Acknowledge => EngineRequest::Acknowledge { ticket },
            Call::Install { id, plan } => {
                let snapshot = self.snapshot();
                return self.build(
                    ticket,
                    id,
                    BuildSource::Plan(Box::new(plan)),
                    snapshot,
                    request,
                );
            }
        };
        self.submit(
            engine_request,
            Some((ticket, PendingRequest { request, on_done })),
        );
    }

    /// Submits a net to be built; the request stays pending.
    fn build(
        &mut self,
        ticket: u64,
        id: u64,
        source: BuildSource,
        snapshot: DeviceSnapshot,
        request: Request,
    ) {
        let rebuild = matches!(source, BuildSource::Rebuild(..));
        let build_request = BuildRequest {
            ticket,
            id,
            source,
            snapshot,
        };
        match self.net_builder.submit(build_request) {
            Ok(()) => {
                self.building.insert(id);
                if rebuild {
                    self.rebuilding.insert(id);
                }
                let on_done = OnDone::Nothing;
                self.pending
                    .insert(ticket, PendingRequest { request, on_done });
            }
            Err(refusal) => reply(request, &Answer::Refused(refusal)),
        }
    }

    /// Handles the end of a build: the command becomes ready or rejected; after a rebuild it is started or stays ready.
    fn handle_build_outcome(&mut self, outcome: BuildOutcome) {
        let BuildOutcome {
            ticket,
            id,
            rebuild,
            net,
        } = outcome;
        self.building.remove(&id);
        self.rebuilding.remove(&id);
        let net = match self.withdrawn.remove(&id) {
            true => Err(Refusal::Withdrawn),
            false => net,
        };
        let pending = self.pending.remove(&ticket);
        if let Some(PendingRequest { request, .. }) = pending {
            match net {
                Ok((net, rehearsed)) if rebuild => {
                    self.start_rebuilt(ticket, id, net, rehearsed, request)
                }
                Ok((net, rehearsed)) => {
                    let ready = ReadyCommand {
                        origin: net.origin(),
                        arms: net.resources().arms,
                        values: BTreeMap::new(),
                    };
                    let on_done = OnDone::Ready(id, rehearsed, ready);
                    let engine_request = EngineRequest::Install { ticket, id, net };
                    self.submit(
                        engine_request,
                        Some((ticket, PendingRequest { request, on_done })),
                    );
                }
                Err(refusal) => {
                    reply(request, &Answer::Refused(refusal));
                    if !rebuild {
                        // Ticket 0, because the caller already has the reason.
                        self.submit(EngineRequest::Reject { ticket: 0, id }, None);
                    }
                }
            }
        }
        for (call, request) in std::mem::take(&mut self.deferred) {
            if commands_of(&call)
                .iter()
                .any(|id| self.building.contains(id))
            {
                self.deferred.push_back((call, request));
            } else {
                self.dispatch(call, request);
            }
        }
    }

    /// Starts a command whose net was rebuilt: the new net replaces the one that was ready.
    fn start_rebuilt(
        &mut self,
        ticket: u64,
        id: u64,
        net: Box<Net>,
        rehearsed: Option<RehearsalReport>,
        request: Request,
    ) {
        let origin = net.origin();
        if self
            .engine_requests
            .push(EngineRequest::Renew { id, net })
            .is_err()
        {
            return reply(request, &Answer::Refused(Refusal::Overloaded));
        }
        self.send_origin(id, &origin);
        if let Some(ready) = self.ready.get_mut(&id) {
            ready.origin = origin;
        }
        let on_done = OnDone::Started(vec![id], rehearsed);
        let engine_request = EngineRequest::Start { ticket, id };
        self.submit(
            engine_request,
            Some((ticket, PendingRequest { request, on_done })),
        );
    }

    /// Sends the origin of a net to the writer of incident files.
    fn send_origin(&self, id: u64, origin: &NetOrigin) {
        if let Some(incident_writer) = &self.incident_writer {
            // The receiver is gone only when the executor ends.
            let _ = incident_writer.send((id, origin.clone()));
        }
    }

    /// Takes the action of a confirmed request, and returns the answer for the caller.
    fn finish_answer(&mut self, answer: Answer, on_done: OnDone) -> Answer {
        let Answer::Done { cycle } = answer else {
            return answer;
        };
        let rehearsed = match on_done {
            OnDone::Nothing => None,
            OnDone::Ready(id, rehearsed, ready) => {
                self.send_origin(id, &ready.origin);
                self.ready.insert(id, ready);
                rehearsed
            }
            OnDone::Started(ids, rehearsed) => {
                for id in ids {
                    self.ready.remove(&id);
                }
                rehearsed
            }
            OnDone::Set(id, values) => {
                if let Some(ready) = self.ready.get_mut(&id) {
                    let pairs = values.into_iter().map(|value| (value.input, value.words));
                    ready.values.extend(pairs);
                }
                None
            }
            OnDone::Unloaded(id) => {
                self.ready.remove(&id);
                None
            }
        };
        rehearsed.map_or(answer, |rehearsed| Answer::Rehearsed { cycle, rehearsed })
    }

    /// Returns what the net of a command must be rebuilt from before START: its arms are at rest, and at least one of
    /// them elsewhere than when the net was built. Returns `None` while an arm moves; START itself then refuses.
    fn rebuild_source(&self, id: u64, snapshot: &DeviceSnapshot) -> Option<BuildSource> {
        let ready = self.ready.get(&id)?;
        let mut same = true;
        for device in (0..self.devices.len()).filter(|device| ready.arms >> device & 1 == 1) {
            let rests = snapshot.rest_position(device)?;
            let conditions = &ready.origin.start_conditions;
            let built_for = conditions.holds.get(device).copied().flatten();
            same &= built_for == Some(rests);
        }
        let value = |(input, words): (&u32, &Vec<u64>)| InputValue {
            input: *input,
            words: words.clone(),
        };
        let values = || ready.values.iter().map(value).collect();
        (!same).then(|| BuildSource::Rebuild(ready.origin.clone(), values()))
    }

    fn submit(&mut self, engine_request: EngineRequest, pending: Option<(u64, PendingRequest)>) {
        match (self.engine_requests.push(engine_request), pending) {
            (Ok(()), Some((ticket, pending))) => {
                self.pending.insert(ticket, pending);
            }
            (Err(_), Some((_, pending))) => {
                reply(pending.request, &Answer::Refused(Refusal::Overloaded));
            }
            (Ok(()), None) => {}
            (Err(_), None) => warn!("an order was lost: the queue of the real-time thread is full"),
        }
    }

    /// Returns the current state of all devices.
    fn snapshot(&self) -> DeviceSnapshot {
        let looks = self.devices.iter().map(|device| self.read_device(device));
        let (devices, holds) = looks.unzip();
        DeviceSnapshot { devices, holds }
    }

    /// Returns the measurement of a device, and the hold position of its arm if it is known.
    fn read_device(&self, device: &DeviceLink) -> (DeviceInput, Option<Joints>) {
        let mut input = DeviceInput {
            present: false,
            measurement: Measurement::zeroed(),
        };
        let Some((_, board)) = device.attached.as_ref() else {
            return (input, None);
        };
        let measurement = board.read();
        let fresh = monotonic_ns().abs_diff(measurement.stamp_ns) <= self.stale_after_ns;
        let online = DeviceState::from_number(measurement.state) != DeviceState::Offline;
        let finite = measurement.hold.iter().all(|value| value.is_finite());
        let known = measurement.magic == MAGIC
            && measurement.joints as usize <= JOINTS_MAX
            && measurement.joints > 0;
        input.present = fresh && online && measurement.magic == MAGIC;
        input.measurement = measurement;
        let hold = (fresh && online && finite && known).then_some(measurement.hold);
        (input, hold)
    }

    /// Attaches drivers that have announced themselves and detaches dead ones; a driver that may be alive stays
    /// attached. A driver that was started with another configuration is not attached, because its measurements and our
    /// set-points would refer to other channels. One check per incarnation is enough, because neither process reads its
    /// configuration again.
    fn update_drivers(&mut self) {
        for index in 0..self.devices.len() {
            let Some(device) = self.devices.get(index) else {
                return;
            };
            let attached = device.attached.as_ref().map(|(driver, _)| *driver);
            let announced = self.session.cell().announced(Role::Driver, &device.name);
            match announced {
                Ok(Some(announced)) if attached != Some(announced.incarnation) => {
                    match announced.liveness() {
                        Liveness::Alive => {
                            self.consider_driver(index, &announced);
                        }
                        // It is not attached before it is known to be alive.
                        Liveness::Unknown(error) => self.report_unknown(index, &error),
                        Liveness::Dead => self.detach_dead(index),
                    }
                }
                Ok(Some(_)) => self.detach_dead(index),
                // A driver removes its announcement when its device is at rest and it ends.
                Ok(None) => self.detach(index),
                Err(error) => {
                    self.report_unknown(index, &error);
                    self.detach_dead(index);
                }
            }
        }
    }

    /// Attaches a living driver, unless its build or configuration differs from ours.
    fn consider_driver(&mut self, index: usize, driver: &Announcement) {
        let Some(device) = self.devices.get(index) else {
            return;
        };
        if let Some(why) = ProcessMismatch::about_device(driver, &self.announcement, &device.name) {
            self.detach(index);
            self.report_disagreement(index, driver, &why);
        } else if let Some(service) = driver.services.get(MEASUREMENT) {
            self.attach(index, driver, service);
        }
    }

    /// Detaches the driver of a device if the driver is known to be dead.
    fn detach_dead(&mut self, index: usize) {
        let attached = self
            .devices
            .get(index)
            .and_then(|one| one.attached.as_ref());
        let Some((driver, _)) = attached else {
            return;
        };
        match ProcessInstance::from_incarnation(*driver).liveness() {
            Liveness::Alive => {}
            Liveness::Dead => self.detach(index),
            Liveness::Unknown(error) => self.report_unknown(index, &error),
        }
    }

    fn detach(&mut self, index: usize) {
        let Some(device) = self.devices.get_mut(index) else {
            return;
        };
        let Some((incarnation, _)) = device.attached else {
            return;
        };
        let engine_request = EngineRequest::Detach {
            device: index,
            incarnation,
        };
        // If the ring is full the driver stays attached, and the next check tries again.
        if self.engine_requests.push(engine_request).is_err() {
            return;
        }
        device.attached = None;
        let gone = EventKind::DriverGone {
            device: device.name.clone(),
            driver: hex_digits(incarnation),
        };
        info!("driver of {} detached", device.name);
        self.record(gone);
    }

    /// Reports that it is not known whether a driver is alive; nothing else is done.
    fn report_unknown(&mut self, index: usize, why: &dyn std::fmt::Display) {
        let Some(others) = self.liveness_log.admit(Instant::now()) else {
            return;
        };
        let name = self.devices.get(index).map_or("", |device| &device.name);
        let event = EventKind::LifeUnknown {
            process: format!("driver/{name}"),
            why: event_text(&why.to_string()),
        };
        warn!(
            "cannot tell whether driver/{name} is alive ({why}); the check is repeated; {others} more such failures since the last message"
        );
        self.record(event);
    }

    /// Reports, once per incarnation, a driver whose build or configuration differs from this executor's.
    fn report_disagreement(&mut self, index: usize, driver: &Announcement, why: &ProcessMismatch) {
        if std::mem::replace(&mut self.devices[index].refused, driver.incarnation)
            == driver.incarnation
        {
            return;
        }
        warn!("{} is not attached: {why}; {}", driver.who(), why.remedy());
        self.record(why.event(driver));
    }

    fn attach(&mut self, index: usize, driver: &Announcement, service: &str) {
        let incarnation = driver.incarnation;
        let boards = (
            self.session.open_board(service),
            self.session.open_board(service),
        );
        match boards {
            (Ok(mine), Ok(board)) => {
                let engine_request = EngineRequest::Attach {
                    device: index,
                    incarnation,
                    board: Box::new(board),
                };
                // If the ring is full the driver stays detached, and the next check tries again.
                if self.engine_requests.push(engine_request).is_ok() {
                    info!("driver of {} attached", self.devices[index].name);
                    self.record(EventKind::DriverAttached {
                        device: self.devices[index].name.clone(),
                        pid: driver.pid,
                        driver: hex_digits(incarnation),
                    });
                    self.devices[index].attached = Some((incarnation, mine));
                }
            }
            // The next check tries again.
            (Err(error), _) | (_, Err(error)) => {
                if self.liveness_log.admit(Instant::now()).is_some() {
                    let name = &self.devices[index].name;
                    warn!("cannot open the board of {name}: {error}");
                }
            }
        }
    }
}

/// Returns the commands that a call changes, except the one that an Install creates.
fn commands_of(call: &Call) -> Vec<u64> {
    match call {
        Call::Start { id }
        | Call::Cancel { id }
        | Call::Abort { id }
        | Call::Unload { id }
        | Call::Set { id, .. }
        | Call::Reject { id } => vec![*id],
        Call::Switch { stop, start } => [&stop[..], start].concat(),
        _ => Vec::new(),
    }
}

/// Returns the ids as a list of fixed length, filled with 0, or `None` if there are too many.
fn id_list(ids: &[u64]) -> Option<[u64; SWITCH_MAX]> {
    let mut list = [0; SWITCH_MAX];
    list.get_mut(..ids.len())?.copy_from_slice(ids);
    Some(list)
}

fn elements(values: &[InputValue]) -> usize {
    values.iter().map(|value| value.words.len()).sum()
}

fn reply(request: Request, answer: &Answer) {
    let sent = wire::encode(answer).map_err(|error| error.to_string());
    let sent = sent.and_then(|bytes| request.answer(&bytes).map_err(|error| error.to_string()));
    if let Err(error) = sent {
        warn!("cannot deliver an answer: {error}");
    }
}
