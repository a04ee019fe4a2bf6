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
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::rehearsal::Rehearsed;
use rcc_ipc::request::{PollError, Request, Server};
use rcc_ipc::seldom::Seldom;
use rcc_ipc::{
    Announcement, BoardReader, Disagreement, Life, Liveness, Role, Session, monotonic_ns, wire,
};
use rcc_process::Helpers;
use rtrb::{Consumer, Producer};
use tracing::{info, warn};

use crate::incidents::{self, Recordings};
use crate::maker::{Job, Made, Maker, Sight, Site, What};
use rcc_engine::costs::Costs;
use rcc_engine::net::{Net, Origin};
use rcc_engine::queue::{Order, Outcome, Reading};

/// How often announcements of drivers are looked at.
const WATCH_EVERY: Duration = Duration::from_millis(50);
/// How often requests are looked at.
pub const POLL_EVERY: Duration = Duration::from_micros(500);
/// Requests that may wait for a net that is being made.
const BEHIND_MAX: usize = 64;

/// A device as the intake thread sees it.
struct Watched {
    name: String,
    /// Incarnation and our own reader of its board (the real-time thread has another one).
    attached: Option<(u64, BoardReader<Measurement>)>,
    /// Incarnation of the driver that was told of last because it runs with another configuration; 0: none.
    refused: u64,
}

/// A caller who waits for an answer, and what is done when it comes.
struct Waiting {
    request: Request,
    then: Then,
}

/// What an answer that says that it is done means here.
enum Then {
    Nothing,
    /// A command is ready.
    Ready(u64, Option<Rehearsed>, Loaded),
    /// Commands are started.
    Started(Vec<u64>, Option<Rehearsed>),
    /// Inputs of a command are set.
    Set(u64, Vec<InputValue>),
    /// A command is no more.
    Unloaded(u64),
}

/// A command that is ready and not started: what its net is made of anew if an arm rests elsewhere at START.
struct Loaded {
    origin: Origin,
    /// Bit d: it commands the arm of device d.
    arms: u64,
    /// What was set, by input.
    values: BTreeMap<u32, Vec<u64>>,
}

/// Everything the intake thread owns.
pub struct Intake {
    session: Session,
    server: Server,
    orders: Producer<Order>,
    outcomes: Consumer<Outcome>,
    maker: Maker,
    stale_after_ns: u64,
    devices: Vec<Watched>,
    waiting: HashMap<u64, Waiting>,
    loaded: HashMap<u64, Loaded>,
    /// Commands whose net is being made.
    making: HashSet<u64>,
    /// Those of them that are being made anew, for a START.
    starting: HashSet<u64>,
    /// Those of them that somebody wanted to end meanwhile.
    withdrawn: HashSet<u64>,
    /// Calls that name one of them, in order.
    behind: VecDeque<(Call, Request)>,
    next_ticket: u64,
    watched_at: Option<Instant>,
    complaints: Seldom,
    /// About drivers that may live or not, or whose board cannot be opened.
    doubts: Seldom,
    recorder: Option<Recorder>,
    scribe: Option<Sender<incidents::Made>>,
    recordings: Recordings,
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
        orders: Producer<Order>,
        outcomes: Consumer<Outcome>,
        config: IntakeConfig,
    ) -> io::Result<Intake> {
        let devices = config
            .names
            .into_iter()
            .map(|name| Watched {
                name,
                attached: None,
                refused: 0,
            })
            .collect();
        let site = Site {
            models: config.models,
            configuration: config.configuration,
            period_ns: config.period_ns,
            costs: config.costs,
        };
        Ok(Intake {
            session,
            server,
            orders,
            outcomes,
            maker: Maker::start(site, &config.helpers)?,
            stale_after_ns: config.stale_after_ns,
            devices,
            waiting: HashMap::new(),
            loaded: HashMap::new(),
            making: HashSet::new(),
            starting: HashSet::new(),
            withdrawn: HashSet::new(),
            behind: VecDeque::new(),
            next_ticket: 1,
            watched_at: None,
            complaints: Seldom::default(),
            doubts: Seldom::default(),
            recorder: None,
            scribe: None,
            recordings: Recordings::default(),
            announcement: config.announcement,
        })
    }

    /// Tells every net that it makes to whoever writes incident files, and answers what became of them.
    #[must_use]
    pub fn telling(
        mut self,
        scribe: Option<Sender<incidents::Made>>,
        recordings: Recordings,
    ) -> Intake {
        self.scribe = scribe;
        self.recordings = recordings;
        self
    }

    /// Writes what happens to the cell's event log, too.
    #[must_use]
    pub fn recording(mut self, recorder: Recorder) -> Intake {
        self.recorder = Some(recorder);
        self
    }

    fn record(&self, what: Kind) {
        if let Some(recorder) = &self.recorder {
            recorder.tell(what);
        }
    }

    /// One round; returns true if there was something to do.
    pub fn round(&mut self) -> bool {
        if self.watched_at.is_none_or(|at| at.elapsed() >= WATCH_EVERY) {
            self.watched_at = Some(Instant::now());
            self.watch_drivers();
        }
        let mut busy = false;
        while let Ok(outcome) = self.outcomes.pop() {
            busy = true;
            self.take_back(outcome);
        }
        while let Some(made) = self.maker.take() {
            busy = true;
            self.take_made(made);
        }
        match self.server.poll() {
            Ok(Some(request)) => {
                busy = true;
                self.take(request);
            }
            Ok(None) => {}
            // A refused one was something to do: others may wait behind it.
            Err(error) => {
                busy = matches!(error, PollError::Refused { .. });
                self.complain(&error);
            }
        }
        busy
    }

    fn take_back(&mut self, outcome: Outcome) {
        match outcome {
            Outcome::Answer { ticket, answer } => {
                if let Some(Waiting { request, then }) = self.waiting.remove(&ticket) {
                    let answer = self.answered(answer, then);
                    reply(request, &answer);
                }
            }
            // Dropped here, so that the real-time thread never frees.
            Outcome::Values(values) => drop(values),
            Outcome::Read {
                ticket,
                reading,
                refused,
            } => {
                if let Some(Waiting { request, .. }) = self.waiting.remove(&ticket) {
                    let answer = refused.map_or(Answer::Values(reading.values), Answer::Refused);
                    reply(request, &answer);
                }
            }
            Outcome::Net(net) => drop(net),
            Outcome::Board(board) => drop(board),
        }
    }

    /// Tells of a request that was none, seldom enough that nobody can fill the log.
    fn complain(&mut self, error: &dyn std::fmt::Display) {
        match self.complaints.say(Instant::now()) {
            Some(0) => warn!("{error}"),
            Some(others) => warn!("{error}; {others} more since the last such line"),
            None => {}
        }
    }

    fn take(&mut self, mut request: Request) {
        if let Some(id) = installs(request.bytes()) {
            let (ticket, sight) = (self.ticket(), self.sight());
            let what = What::Encoded(request.take_bytes());
            return self.make(ticket, id, what, sight, request);
        }
        let call = match wire::decode::<Call>(request.bytes()) {
            Ok(call) => call,
            Err(error) => {
                self.complain(&format_args!("a request is refused: {error}"));
                return reply(request, &Answer::Refused(Refusal::NotUnderstood));
            }
        };
        // Whoever wants an arm to stop does not wait for a net to be made: a START that has not begun is withdrawn, and of a
        // command that is loading the real-time thread says so.
        if let Call::Cancel { id } | Call::Abort { id } = call
            && self.making.contains(&id)
        {
            if self.starting.contains(&id) {
                self.withdraw(id);
                return reply(request, &Answer::Done { cycle: 0 });
            }
            return self.obey(call, request);
        }
        // What concerns a command whose net is being made comes after it.
        if named_in(&call).iter().any(|id| self.making.contains(id)) {
            if self.behind.len() >= BEHIND_MAX {
                return reply(request, &Answer::Refused(Refusal::Overloaded));
            }
            return self.behind.push_back((call, request));
        }
        self.obey(call, request);
    }

    /// Every START of this command that has not begun is refused.
    fn withdraw(&mut self, id: u64) {
        self.withdrawn.insert(id);
        for (call, request) in std::mem::take(&mut self.behind) {
            match call {
                Call::Start { id: other } if other == id => {
                    reply(request, &Answer::Refused(Refusal::Withdrawn));
                }
                call => self.behind.push_back((call, request)),
            }
        }
    }

    fn ticket(&mut self) -> u64 {
        self.next_ticket += 1;
        self.next_ticket - 1
    }

    fn obey(&mut self, call: Call, request: Request) {
        let ticket = self.ticket();
        let mut then = Then::Nothing;
        let order = match call {
            Call::Reserve => Order::Reserve { ticket },
            Call::Reject { id } => Order::Reject { ticket, id },
            Call::Start { id } => {
                let sight = self.sight();
                if let Some(what) = self.elsewhere(id, &sight) {
                    return self.make(ticket, id, what, sight, request);
                }
                then = Then::Started(vec![id], None);
                Order::Start { ticket, id }
            }
            Call::Switch { stop, start } => match (listed(&stop), listed(&start)) {
                (Some(stop), Some(list)) => {
                    then = Then::Started(start, None);
                    Order::Switch {
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
                if self.loaded.contains_key(&id) {
                    then = Then::Set(id, values.clone());
                }
                Order::Set { ticket, id, values }
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
                let reading = Reading::of(points);
                Order::Read {
                    ticket,
                    id,
                    reading,
                }
            }
            Call::Cancel { id } => Order::Cancel { ticket, id },
            Call::Abort { id } => Order::Abort { ticket, id },
            Call::Unload { id } => {
                then = Then::Unloaded(id);
                Order::Unload { ticket, id }
            }
            Call::Record => Order::Record { ticket },
            Call::Recorded { cycle } => {
                let recorded = self.recordings.of(cycle);
                return reply(request, &Answer::Recorded(recorded));
            }
            Call::Acknowledge => Order::Acknowledge { ticket },
            Call::Install { id, plan } => {
                let sight = self.sight();
                return self.make(ticket, id, What::Plan(Box::new(plan)), sight, request);
            }
        };
        self.send(order, Some((ticket, Waiting { request, then })));
    }

    /// Has a net made; who asked for it waits.
    fn make(&mut self, ticket: u64, id: u64, what: What, sight: Sight, request: Request) {
        let anew = matches!(what, What::Anew(..));
        let job = Job {
            ticket,
            id,
            what,
            sight,
        };
        match self.maker.give(job) {
            Ok(()) => {
                self.making.insert(id);
                if anew {
                    self.starting.insert(id);
                }
                let then = Then::Nothing;
                self.waiting.insert(ticket, Waiting { request, then });
            }
            Err(refusal) => reply(request, &Answer::Refused(refusal)),
        }
    }

    /// A net is made, or cannot be: the command becomes ready or rejected, or is started, or stays ready.
    fn take_made(&mut self, made: Made) {
        let Made {
            ticket,
            id,
            anew,
            net,
        } = made;
        self.making.remove(&id);
        self.starting.remove(&id);
        let net = match self.withdrawn.remove(&id) {
            true => Err(Refusal::Withdrawn),
            false => net,
        };
        let waiting = self.waiting.remove(&ticket);
        if let Some(Waiting { request, .. }) = waiting {
            match net {
                Ok((net, rehearsed)) if anew => {
                    self.start_anew(ticket, id, net, rehearsed, request)
                }
                Ok((net, rehearsed)) => {
                    let loaded = Loaded {
                        origin: net.origin(),
                        arms: net.resources().arms,
                        values: BTreeMap::new(),
                    };
                    let then = Then::Ready(id, rehearsed, loaded);
                    let order = Order::Install { ticket, id, net };
                    self.send(order, Some((ticket, Waiting { request, then })));
                }
                Err(refusal) => {
                    reply(request, &Answer::Refused(refusal));
                    if !anew {
                        // Nobody waits for this answer: the caller already has the reason.
                        self.send(Order::Reject { ticket: 0, id }, None);
                    }
                }
            }
        }
        for (call, request) in std::mem::take(&mut self.behind) {
            if named_in(&call).iter().any(|id| self.making.contains(id)) {
                self.behind.push_back((call, request));
            } else {
                self.obey(call, request);
            }
        }
    }

    /// START of a command whose net was made anew: the net takes the place of the one that was ready.
    fn start_anew(
        &mut self,
        ticket: u64,
        id: u64,
        net: Box<Net>,
        rehearsed: Option<Rehearsed>,
        request: Request,
    ) {
        let origin = net.origin();
        if self.orders.push(Order::Renew { id, net }).is_err() {
            return reply(request, &Answer::Refused(Refusal::Overloaded));
        }
        self.tell(id, &origin);
        if let Some(loaded) = self.loaded.get_mut(&id) {
            loaded.origin = origin;
        }
        let then = Then::Started(vec![id], rehearsed);
        let order = Order::Start { ticket, id };
        self.send(order, Some((ticket, Waiting { request, then })));
    }

    /// Whoever writes incident files must have what a net begins from.
    fn tell(&self, id: u64, origin: &Origin) {
        if let Some(scribe) = &self.scribe {
            // Gone only when the executor ends.
            let _ = scribe.send((id, origin.clone()));
        }
    }

    /// What is to be remembered of an answer, and the answer as the caller gets it.
    fn answered(&mut self, answer: Answer, then: Then) -> Answer {
        let Answer::Done { cycle } = answer else {
            return answer;
        };
        let rehearsed = match then {
            Then::Nothing => None,
            Then::Ready(id, rehearsed, loaded) => {
                self.tell(id, &loaded.origin);
                self.loaded.insert(id, loaded);
                rehearsed
            }
            Then::Started(ids, rehearsed) => {
                for id in ids {
                    self.loaded.remove(&id);
                }
                rehearsed
            }
            Then::Set(id, values) => {
                if let Some(loaded) = self.loaded.get_mut(&id) {
                    let pairs = values.into_iter().map(|value| (value.input, value.words));
                    loaded.values.extend(pairs);
                }
                None
            }
            Then::Unloaded(id) => {
                self.loaded.remove(&id);
                None
            }
        };
        rehearsed.map_or(answer, |rehearsed| Answer::Rehearsed { cycle, rehearsed })
    }

    /// What the net of a command must be made of anew to be started: its arms rest, and not all of them where they were
    /// when it was made. While one moves, START is left to refuse it.
    fn elsewhere(&self, id: u64, sight: &Sight) -> Option<What> {
        let loaded = self.loaded.get(&id)?;
        let mut same = true;
        for device in (0..self.devices.len()).filter(|device| loaded.arms >> device & 1 == 1) {
            let rests = sight.rests_at(device)?;
            let begun = loaded.origin.begun.holds.get(device).copied().flatten();
            same &= begun == Some(rests);
        }
        let value = |(input, words): (&u32, &Vec<u64>)| InputValue {
            input: *input,
            words: words.clone(),
        };
        let values = || loaded.values.iter().map(value).collect();
        (!same).then(|| What::Anew(loaded.origin.clone(), values()))
    }

    fn send(&mut self, order: Order, waiting: Option<(u64, Waiting)>) {
        match (self.orders.push(order), waiting) {
            (Ok(()), Some((ticket, waiting))) => {
                self.waiting.insert(ticket, waiting);
            }
            (Err(_), Some((_, waiting))) => {
                reply(waiting.request, &Answer::Refused(Refusal::Overloaded));
            }
            (Ok(()), None) => {}
            (Err(_), None) => warn!("an order was lost: the real-time thread takes none"),
        }
    }

    /// What the devices say now.
    fn sight(&self) -> Sight {
        let looks = self.devices.iter().map(|device| self.look(device));
        let (devices, holds) = looks.unzip();
        Sight { devices, holds }
    }

    /// What a device measures, and where its arm is held if that is known.
    fn look(&self, device: &Watched) -> (DeviceInput, Option<Joints>) {
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
    fn watch_drivers(&mut self) {
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
                            self.meet(index, &announced);
                        }
                        // Not followed before it is known to live.
                        Liveness::Unknown(error) => self.doubt(index, &error),
                        Liveness::Dead => self.detach_dead(index),
                    }
                }
                Ok(Some(_)) => self.detach_dead(index),
                // A driver takes its announcement back when its device rests and it ends.
                Ok(None) => self.detach(index),
                Err(error) => {
                    self.doubt(index, &error);
                    self.detach_dead(index);
                }
            }
        }
    }

    /// Attaches a driver that lives, unless it is of another build or means other channels by its set-points.
    fn meet(&mut self, index: usize, driver: &Announcement) {
        let Some(device) = self.devices.get(index) else {
            return;
        };
        if let Some(why) = Disagreement::about_device(driver, &self.announcement, &device.name) {
            self.detach(index);
            self.refuse(index, driver, &why);
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
        match Life::from_incarnation(*driver).liveness() {
            Liveness::Alive => {}
            Liveness::Dead => self.detach(index),
            Liveness::Unknown(error) => self.doubt(index, &error),
        }
    }

    fn detach(&mut self, index: usize) {
        let Some(device) = self.devices.get_mut(index) else {
            return;
        };
        let Some((incarnation, _)) = device.attached else {
            return;
        };
        let order = Order::Detach {
            device: index,
            incarnation,
        };
        // A full ring leaves it attached; the next look tries again.
        if self.orders.push(order).is_err() {
            return;
        }
        device.attached = None;
        let gone = Kind::DriverGone {
            device: device.name.clone(),
            driver: events::digits(incarnation),
        };
        info!("driver of {} is gone", device.name);
        self.record(gone);
    }

    /// Whether a driver lives is not known: that is told, and nothing else is done.
    fn doubt(&mut self, index: usize, why: &dyn std::fmt::Display) {
        let Some(others) = self.doubts.say(Instant::now()) else {
            return;
        };
        let name = self.devices.get(index).map_or("", |device| &device.name);
        let what = Kind::LifeUnknown {
            process: format!("driver/{name}"),
            why: events::text(&why.to_string()),
        };
        warn!(
            "whether driver/{name} lives is not known ({why}); looked at again; {others} more such looks"
        );
        self.record(what);
    }

    /// Tells once of a driver that is of another build than this executor, or runs with another configuration.
    fn refuse(&mut self, index: usize, driver: &Announcement, why: &Disagreement) {
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
                let order = Order::Attach {
                    device: index,
                    incarnation,
                    board: Box::new(board),
                };
                // A full ring leaves the device unattached; the next look at the announcements tries again.
                if self.orders.push(order).is_ok() {
                    info!("driver of {} is attached", self.devices[index].name);
                    self.record(Kind::DriverAttached {
                        device: self.devices[index].name.clone(),
                        pid: driver.pid,
                        driver: events::digits(incarnation),
                    });
                    self.devices[index].attached = Some((incarnation, mine));
                }
            }
            // Tried again at the next look.
            (Err(error), _) | (_, Err(error)) => {
                if self.doubts.say(Instant::now()).is_some() {
                    let name = &self.devices[index].name;
                    warn!("the board of {name} cannot be opened: {error}");
                }
            }
        }
    }
}

/// The commands that a call does something to, except for one whose net is only now made.
fn named_in(call: &Call) -> Vec<u64> {
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
fn listed(ids: &[u64]) -> Option<[u64; SWITCH_MAX]> {
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
