//! The intake thread: takes requests, has nets made, opens drivers' boards, and frees what the real-time
//! thread gives back. Allocates and waits as it likes.

use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};
use std::io;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::message::{DeviceState, JOINTS_MAX, Joints, MAGIC, Measurement};
use rcc_ipc::control::{
    Answer, Call, InputValue, MEASUREMENT, READ_ELEMENTS_MAX, READ_MAX, Refusal, SET_ELEMENTS_MAX,
    SET_MAX, SWITCH_MAX, installs,
};
use rcc_ipc::events::{self, EventKind, EventRecorder};
use rcc_ipc::log_throttle::LogThrottle;
use rcc_ipc::rehearsal::RehearsalReport;
use rcc_ipc::request::{PollError, Request, Server};
use rcc_ipc::{
    Announcement, BoardReader, Liveness, ProcessInstance, ProcessMismatch, Role, Session,
    monotonic_ns, wire,
};
use rcc_process::Helpers;
use rtrb::{Consumer, Producer};
use tracing::{info, warn};

use crate::incidents::{self, RecordingResults};
use crate::net_builder::{
    BuildContext, BuildOutcome, BuildRequest, BuildSource, DeviceSnapshot, NetBuilderThread,
};
use rcc_engine::costs::Costs;
use rcc_engine::net::{Net, NetOrigin};
use rcc_engine::queue::{EngineReply, EngineRequest, ValueReading};

/// How often announcements of drivers are looked at.
const CHECK_DRIVERS_EVERY: Duration = Duration::from_millis(50);
/// How often requests are looked at.
pub const POLL_EVERY: Duration = Duration::from_micros(500);
/// Requests that may wait for a net that is being made.
const DEFERRED_MAX: usize = 64;

/// A device as the intake thread sees it.
struct DeviceLink {
    name: String,
    /// Incarnation and our own reader of its board (the real-time thread has another one).
    attached: Option<(u64, BoardReader<Measurement>)>,
    /// Incarnation of the driver that was told of last because it runs with another configuration; 0: none.
    refused: u64,
}

/// A caller who waits for an answer, and what is done when it comes.
struct PendingRequest {
    request: Request,
    then: OnDone,
}

/// What an answer that says that it is done means here.
enum OnDone {
    Nothing,
    /// A command is ready.
    Ready(u64, Option<RehearsalReport>, ReadyCommand),
    /// Commands are started.
    Started(Vec<u64>, Option<RehearsalReport>),
    /// Inputs of a command are set.
    Set(u64, Vec<InputValue>),
    /// A command is no more.
    Unloaded(u64),
}

/// A command that is ready and not started: what its net is made of anew if an arm rests elsewhere at START.
struct ReadyCommand {
    origin: NetOrigin,
    /// Bit d: it commands the arm of device d.
    arms: u64,
    /// What was set, by input.
    values: BTreeMap<u32, Vec<u64>>,
}

/// Everything the intake thread owns.
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
    /// Commands whose net is being made.
    building: HashSet<u64>,
    /// Those of them that are being made anew, for a START.
    rebuilding: HashSet<u64>,
    /// Those of them that somebody wanted to end meanwhile.
    withdrawn: HashSet<u64>,
    /// Calls that name one of them, in order.
    deferred: VecDeque<(Call, Request)>,
    next_ticket: u64,
    drivers_checked_at: Option<Instant>,
    error_log: LogThrottle,
    /// About drivers that may live or not, or whose board cannot be opened.
    liveness_log: LogThrottle,
    recorder: Option<EventRecorder>,
    incident_writer: Option<Sender<incidents::BuildOutcome>>,
    recordings: RecordingResults,
    announcement: Announcement,
}

/// What the intake thread must know about the cell.
pub struct IntakeConfig {
    /// Names of the devices, in the order of the configuration.
    pub names: Vec<String>,
    /// Their models.
    pub models: Vec<DeviceModel>,
    /// Fingerprint of the device table.
    pub configuration: u64,
    /// Base period.
    pub period_ns: u64,
    /// A board older than this says nothing about where a device is.
    pub stale_after_ns: u64,
    /// What primitives cost on this machine.
    pub costs: Costs,
    /// Where the thread that makes nets belongs to.
    pub helpers: Helpers,
    /// What this executor announces: a driver that announces another configuration is not attached.
    pub announcement: Announcement,
}

impl Intake {
    /// Takes requests from `server` and gives orders to the real-time thread.
    ///
    /// # Errors
    /// The system gives no thread to make nets.
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
        let site = BuildContext {
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
            net_builder: NetBuilderThread::start(site, &config.helpers)?,
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

    /// Tells every net that it makes to whoever writes incident files, and answers what became of them.
    #[must_use]
    pub fn with_incident_writer(
        mut self,
        incident_writer: Option<Sender<incidents::BuildOutcome>>,
        recordings: RecordingResults,
    ) -> Intake {
        self.incident_writer = incident_writer;
        self.recordings = recordings;
        self
    }

    /// Writes what happens to the cell's event log, too.
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

    /// One round; returns true if there was something to do.
    pub fn round(&mut self) -> bool {
        if self
            .drivers_checked_at
            .is_none_or(|at| at.elapsed() >= CHECK_DRIVERS_EVERY)
        {
            self.drivers_checked_at = Some(Instant::now());
            self.update_drivers();
        }
        let mut busy = false;
        while let Ok(outcome) = self.engine_replies.pop() {
            busy = true;
            self.handle_outcome(outcome);
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
            // A refused one was something to do: others may wait behind it.
            Err(error) => {
                busy = matches!(error, PollError::Refused { .. });
                self.log_error(&error);
            }
        }
        busy
    }

    fn handle_outcome(&mut self, outcome: EngineReply) {
        match outcome {
            EngineReply::Answer { ticket, answer } => {
                if let Some(PendingRequest { request, then }) = self.pending.remove(&ticket) {
                    let answer = self.finish_answer(answer, then);
                    reply(request, &answer);
                }
            }
            // Dropped here, so that the real-time thread never frees.
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

    /// Tells of a request that was none, seldom enough that nobody can fill the log.
    fn log_error(&mut self, error: &dyn std::fmt::Display) {
        match self.error_log.admit(Instant::now()) {
            Some(0) => warn!("{error}"),
            Some(others) => warn!("{error}; {others} more since the last such line"),
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
                self.log_error(&format_args!("a request is refused: {error}"));
                return reply(request, &Answer::Refused(Refusal::NotUnderstood));
            }
        };
        // Whoever wants an arm to stop does not wait for a net to be made: a START that has not begun is withdrawn, and of a
        // command that is loading the real-time thread says so.
        if let Call::Cancel { id } | Call::Abort { id } = call
            && self.building.contains(&id)
        {
            if self.rebuilding.contains(&id) {
                self.withdraw(id);
                return reply(request, &Answer::Done { cycle: 0 });
            }
            return self.dispatch(call, request);
        }
        // What concerns a command whose net is being made comes after it.
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

    /// Every START of this command that has not begun is refused.
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
        let mut then = OnDone::Nothing;
        let engine_request = match call {
            Call::Reserve => EngineRequest::Reserve { ticket },
            Call::Reject { id } => EngineRequest::Reject { ticket, id },
            Call::Start { id } => {
                let snapshot = self.snapshot();
                if let Some(source) = self.rebuild_source(id, &snapshot) {
                    return self.build(ticket, id, source, snapshot, request);
                }
                then = OnDone::Started(vec![id], None);
                EngineRequest::Start { ticket, id }
            }
            Call::Switch { stop, start } => match (id_list(&stop), id_list(&start)) {
                (Some(stop), Some(list)) => {
                    then = OnDone::Started(start, None);
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
                    then = OnDone::Set(id, values.clone());
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
                then = OnDone::Unloaded(id);
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
            Some((ticket, PendingRequest { request, then })),
        );
    }

    /// Has a net made; who asked for it waits.
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
                let then = OnDone::Nothing;
                self.pending
                    .insert(ticket, PendingRequest { request, then });
            }
            Err(refusal) => reply(request, &Answer::Refused(refusal)),
        }
    }

    /// A net is made, or cannot be: the command becomes ready or rejected, or is started, or stays ready.
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
                    let then = OnDone::Ready(id, rehearsed, ready);
                    let engine_request = EngineRequest::Install { ticket, id, net };
                    self.submit(
                        engine_request,
                        Some((ticket, PendingRequest { request, then })),
                    );
                }
                Err(refusal) => {
                    reply(request, &Answer::Refused(refusal));
                    if !rebuild {
                        // Nobody waits for this answer: the caller already has the reason.
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

    /// START of a command whose net was made anew: the net takes the place of the one that was ready.
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
        let then = OnDone::Started(vec![id], rehearsed);
        let engine_request = EngineRequest::Start { ticket, id };
        self.submit(
            engine_request,
            Some((ticket, PendingRequest { request, then })),
        );
    }

    /// Whoever writes incident files must have what a net begins from.
    fn send_origin(&self, id: u64, origin: &NetOrigin) {
        if let Some(incident_writer) = &self.incident_writer {
            // Gone only when the executor ends.
            let _ = incident_writer.send((id, origin.clone()));
        }
    }

    /// What is to be remembered of an answer, and the answer as the caller gets it.
    fn finish_answer(&mut self, answer: Answer, then: OnDone) -> Answer {
        let Answer::Done { cycle } = answer else {
            return answer;
        };
        let rehearsed = match then {
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

    /// What the net of a command must be made of anew to be started: its arms rest, and not all of them where they were
    /// when it was made. While one moves, START is left to refuse it.
    fn rebuild_source(&self, id: u64, snapshot: &DeviceSnapshot) -> Option<BuildSource> {
        let ready = self.ready.get(&id)?;
        let mut same = true;
        for device in (0..self.devices.len()).filter(|device| ready.arms >> device & 1 == 1) {
            let rests = snapshot.rest_position(device)?;
            let begun = ready.origin.begun.holds.get(device).copied().flatten();
            same &= begun == Some(rests);
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
            (Err(_), None) => warn!("an order was lost: the real-time thread takes none"),
        }
    }

    /// What the devices say now.
    fn snapshot(&self) -> DeviceSnapshot {
        let looks = self.devices.iter().map(|device| self.read_device(device));
        let (devices, holds) = looks.unzip();
        DeviceSnapshot { devices, holds }
    }

    /// What a device measures, and where its arm is held if that is known.
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

    /// Attaches drivers that announced themselves and detaches dead ones; whoever may live stays attached. A driver that was started with another
    /// configuration is not attached: its measurements and our set-points would mean other channels. To look once in each
    /// of its lives is enough, because neither of us reads the configuration again.
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
                        // Not followed before it is known to live.
                        Liveness::Unknown(error) => self.report_unknown(index, &error),
                        Liveness::Dead => self.detach_dead(index),
                    }
                }
                Ok(Some(_)) => self.detach_dead(index),
                // A driver takes its announcement back when its device rests and it ends.
                Ok(None) => self.detach(index),
                Err(error) => {
                    self.report_unknown(index, &error);
                    self.detach_dead(index);
                }
            }
        }
    }

    /// Attaches a driver that lives, unless it is of another build or means other channels by its set-points.
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

    /// Detaches the driver of a device if it is known to be dead.
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
        // A full ring leaves it attached; the next look tries again.
        if self.engine_requests.push(engine_request).is_err() {
            return;
        }
        device.attached = None;
        let gone = EventKind::DriverGone {
            device: device.name.clone(),
            driver: events::hex_digits(incarnation),
        };
        info!("driver of {} is gone", device.name);
        self.record(gone);
    }

    /// Whether a driver lives is not known: that is told, and nothing else is done.
    fn report_unknown(&mut self, index: usize, why: &dyn std::fmt::Display) {
        let Some(others) = self.liveness_log.admit(Instant::now()) else {
            return;
        };
        let name = self.devices.get(index).map_or("", |device| &device.name);
        let event = EventKind::LifeUnknown {
            process: format!("driver/{name}"),
            why: events::event_text(&why.to_string()),
        };
        warn!(
            "whether driver/{name} lives is not known ({why}); looked at again; {others} more such looks"
        );
        self.record(event);
    }

    /// Tells once of a driver that is of another build than this executor, or runs with another configuration.
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
                // A full ring leaves the device unattached; the next look at the announcements tries again.
                if self.engine_requests.push(engine_request).is_ok() {
                    info!("driver of {} is attached", self.devices[index].name);
                    self.record(EventKind::DriverAttached {
                        device: self.devices[index].name.clone(),
                        pid: driver.pid,
                        driver: events::hex_digits(incarnation),
                    });
                    self.devices[index].attached = Some((incarnation, mine));
                }
            }
            // Tried again at the next look.
            (Err(error), _) | (_, Err(error)) => {
                if self.liveness_log.admit(Instant::now()).is_some() {
                    let name = &self.devices[index].name;
                    warn!("the board of {name} cannot be opened: {error}");
                }
            }
        }
    }
}

/// The commands that a call does something to, except for one whose net is only now made.
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

/// The ids in a list of fixed length, if they fit; 0 names none.
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
        warn!("an answer was not delivered: {error}");
    }
}
