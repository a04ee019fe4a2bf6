//! The intake thread: takes requests, builds nets, opens drivers' boards, and frees what the real-time
//! thread gives back. Allocates and waits as it likes.

use std::collections::HashMap;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use rcc_core::frame::DeviceModel;
use rcc_core::message::{DeviceState, JOINTS_MAX, Joints, MAGIC, Measurement};
use rcc_ipc::control::{
    Answer, Call, InputValue, MEASUREMENT, READ_ELEMENTS_MAX, READ_MAX, Refusal, SET_ELEMENTS_MAX,
    SET_MAX, SWITCH_MAX,
};
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::request::{PollError, Request, Server};
use rcc_ipc::seldom::Seldom;
use rcc_ipc::{Announcement, BoardReader, Role, Session, monotonic_ns, wire};
use rtrb::{Consumer, Producer};
use tracing::{info, warn};

use crate::incidents::Made;
use rcc_engine::costs::Costs;
use rcc_engine::net::Net;
use rcc_engine::queue::{Order, Outcome, Reading};

/// How often announcements of drivers are looked at.
const WATCH_EVERY: Duration = Duration::from_millis(50);
/// How often requests are looked at.
pub const POLL_EVERY: Duration = Duration::from_micros(500);

/// A device as the intake thread sees it.
struct Watched {
    name: String,
    /// Incarnation and our own reader of its board (the real-time thread has another one).
    attached: Option<(u64, BoardReader<Measurement>)>,
}

/// Everything the intake thread owns.
pub struct Intake {
    session: Session,
    server: Server,
    orders: Producer<Order>,
    outcomes: Consumer<Outcome>,
    models: Vec<DeviceModel>,
    configuration: u64,
    period_ns: u64,
    stale_after_ns: u64,
    costs: Costs,
    devices: Vec<Watched>,
    waiting: HashMap<u64, Request>,
    next_ticket: u64,
    watched_at: Option<Instant>,
    complaints: Seldom,
    recorder: Option<Recorder>,
    scribe: Option<Sender<Made>>,
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
}

impl Intake {
    /// Takes requests from `server` and gives orders to the real-time thread.
    pub fn new(
        session: Session,
        server: Server,
        orders: Producer<Order>,
        outcomes: Consumer<Outcome>,
        config: IntakeConfig,
    ) -> Intake {
        let devices = config
            .names
            .into_iter()
            .map(|name| Watched {
                name,
                attached: None,
            })
            .collect();
        Intake {
            session,
            server,
            orders,
            outcomes,
            models: config.models,
            configuration: config.configuration,
            period_ns: config.period_ns,
            stale_after_ns: config.stale_after_ns,
            costs: config.costs,
            devices,
            waiting: HashMap::new(),
            next_ticket: 1,
            watched_at: None,
            complaints: Seldom::default(),
            recorder: None,
            scribe: None,
        }
    }

    /// Tells every net that it makes to whoever writes incident files.
    #[must_use]
    pub fn telling(mut self, scribe: Option<Sender<Made>>) -> Intake {
        self.scribe = scribe;
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
                if let Some(request) = self.waiting.remove(&ticket) {
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
                if let Some(request) = self.waiting.remove(&ticket) {
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

    fn take(&mut self, request: Request) {
        let call = match wire::decode_serde::<Call>(request.bytes()) {
            Ok(call) => call,
            Err(error) => {
                self.complain(&format_args!("a request is refused: {error}"));
                return reply(request, &Answer::Refused(Refusal::NotUnderstood));
            }
        };
        let ticket = self.next_ticket;
        self.next_ticket += 1;
        let order = match call {
            Call::Reserve => Order::Reserve { ticket },
            Call::Reject { id } => Order::Reject { ticket, id },
            Call::Start { id } => Order::Start { ticket, id },
            Call::Switch { stop, start } => match (named(&stop), named(&start)) {
                (Some(stop), Some(start)) => Order::Switch {
                    ticket,
                    stop,
                    start,
                },
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
            Call::Unload { id } => Order::Unload { ticket, id },
            Call::Record => Order::Record { ticket },
            Call::Acknowledge => Order::Acknowledge { ticket },
            Call::Install { id, plan } => {
                let holds = self.holds();
                match Net::build(
                    plan,
                    &self.models,
                    self.configuration,
                    &holds,
                    self.period_ns as f64 / 1e9,
                ) {
                    Ok(mut net) => {
                        net.expected_ns = self.costs.expected_ns(&net.plan());
                        if let Some(scribe) = &self.scribe {
                            // Gone only when the executor ends.
                            let _ = scribe.send((id, net.origin()));
                        }
                        Order::Install { ticket, id, net }
                    }
                    Err(refusal) => {
                        reply(request, &Answer::Refused(refusal));
                        // Nobody waits for this answer: the caller already has the reason.
                        return self.send(Order::Reject { ticket: 0, id }, None);
                    }
                }
            }
        };
        self.send(order, Some((ticket, request)));
    }

    fn send(&mut self, order: Order, waiting: Option<(u64, Request)>) {
        match (self.orders.push(order), waiting) {
            (Ok(()), Some((ticket, request))) => {
                self.waiting.insert(ticket, request);
            }
            (Err(_), Some((_, request))) => reply(request, &Answer::Refused(Refusal::Overloaded)),
            (Ok(()), None) => {}
            (Err(_), None) => warn!("an order was lost: the real-time thread takes none"),
        }
    }

    /// Where each arm is held now; `None` if nobody knows.
    fn holds(&self) -> Vec<Option<Joints>> {
        self.devices
            .iter()
            .map(|device| self.hold(device))
            .collect()
    }

    fn hold(&self, device: &Watched) -> Option<Joints> {
        let (_, board) = device.attached.as_ref()?;
        let measurement = board.read();
        let fresh = monotonic_ns().abs_diff(measurement.stamp_ns) <= self.stale_after_ns;
        let online = DeviceState::from_number(measurement.state) != DeviceState::Offline;
        let finite = measurement.hold.iter().all(|value| value.is_finite());
        let known = measurement.magic == MAGIC
            && measurement.joints as usize <= JOINTS_MAX
            && measurement.joints > 0;
        (fresh && online && finite && known).then_some(measurement.hold)
    }

    /// Attaches drivers that announced themselves and detaches dead ones.
    fn watch_drivers(&mut self) {
        for index in 0..self.devices.len() {
            let Some(device) = self.devices.get(index) else {
                return;
            };
            let announced = self.session.cell().announced(Role::Driver, &device.name);
            let alive = announced
                .ok()
                .flatten()
                .filter(|announcement| announcement.is_alive());
            let attached = device
                .attached
                .as_ref()
                .map(|(incarnation, _)| *incarnation);
            match (alive, attached) {
                (Some(announcement), attached) if attached != Some(announcement.incarnation) => {
                    if let Some(service) = announcement.services.get(MEASUREMENT) {
                        self.attach(index, &announcement, service);
                    }
                }
                (None, Some(incarnation)) => {
                    info!("driver of {} is gone", device.name);
                    let gone = Kind::DriverGone {
                        device: device.name.clone(),
                        driver: events::digits(incarnation),
                    };
                    if self
                        .orders
                        .push(Order::Detach {
                            device: index,
                            incarnation,
                        })
                        .is_ok()
                    {
                        self.record(gone);
                        self.devices[index].attached = None;
                    }
                }
                _ => {}
            }
        }
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
            (Err(error), _) | (_, Err(error)) => {
                warn!(
                    "the board of {} cannot be opened: {error}",
                    self.devices[index].name
                );
            }
        }
    }
}

/// The ids in a list of fixed length, if they fit; 0 names none.
fn named(ids: &[u64]) -> Option<[u64; SWITCH_MAX]> {
    let mut list = [0; SWITCH_MAX];
    list.get_mut(..ids.len())?.copy_from_slice(ids);
    Some(list)
}

fn elements(values: &[InputValue]) -> usize {
    values.iter().map(|value| value.words.len()).sum()
}

fn reply(request: Request, answer: &Answer) {
    let sent = wire::encode_serde(answer).map_err(|error| error.to_string());
    let sent = sent.and_then(|bytes| request.answer(&bytes).map_err(|error| error.to_string()));
    if let Err(error) = sent {
        warn!("an answer was not delivered: {error}");
    }
}
