//! A stream of values, states and events for one client, as server-sent events. Run by a worker thread of its own for each
//! stream, with a port of its own to the executor; nothing of it reaches the real-time thread but reads, at the rate of
//! the stream.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::streams::{StreamEnd, StreamLoss, StreamState};
use rcc_core::message::CommandState;
use rcc_ipc::events::EventReader;
use rcc_protocol::events::Event;
use serde::Serialize;

use super::Service;
use super::values::{SelectedPort, no_names, select};
use crate::server::address::CommandAddress;
use crate::server::executor::{ExecutorConnection, ExecutorPort};
use crate::server::live::LiveSender;
use crate::server::store::CommandStore;
use monitors::MonitorReader;

mod monitors;
mod samples;

/// Rate above which a stream is a fast one, samples per second: each sample of a net is one request to the executor,
/// which takes eight in a cycle. The maximum is the rate of the cell.
pub const USUAL_RATE_MAX: f64 = 250.0;
/// Maximum rate while the period of the cell is not known, samples per second.
const RATE_MAX_DEFAULT: f64 = 1000.0;
/// Minimum rate of a stream, samples per second.
pub const STREAM_RATE_MIN: f64 = 0.1;
/// Maximum number of nets of a stream.
pub const STREAM_NETS_MAX: usize = 8;
/// Interval at which states, events and monitored values are looked at, unless the rate is higher.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// Minimum of that interval.
const LOOK_EVERY_MIN: Duration = Duration::from_millis(4);
/// Time without a piece after which a comment shows that the stream is alive.
const SILENCE_MAX: Duration = Duration::from_secs(5);
/// Maximum number of events that wait for a client.
const EVENTS_MAX: usize = 256;

/// Selection of a client.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamRequest {
    /// Patterns of ports: `net/primitive.port`.
    pub ports: Vec<String>,
    /// Samples per second.
    pub rate: f64,
    /// Patterns of monitored ports, of which every value is sent.
    pub monitors: Vec<String>,
    /// States of commands.
    pub states: bool,
    /// Events of the event log.
    pub events: bool,
}

/// An open stream.
pub struct EventStream {
    subscriptions: Vec<Subscription>,
    /// Incarnation of the executor that ids in `ports` mean.
    incarnation: u64,
    period: Duration,
    look_every: Duration,
    port: Option<ExecutorPort>,
    states: Option<BTreeMap<u64, StateKey>>,
    reader: Option<EventReader>,
    monitors: Option<MonitorReader>,
    waiting: VecDeque<Event>,
    loss: StreamLoss,
    spoke: Instant,
}

/// Ports of one net. A name means the newest command of that name, preferably an active one; an id means one command of
/// one executor.
struct Subscription {
    net: String,
    patterns: Vec<String>,
    target: Option<Target>,
    /// True when no value can follow: it has an id, and the command has ended.
    is_over: bool,
}

impl Subscription {
    fn new(net: &str, pattern: &str) -> Subscription {
        Subscription {
            net: net.to_owned(),
            patterns: vec![pattern.to_owned()],
            target: None,
            is_over: false,
        }
    }

    /// Returns the id in the address; `None` if it is a name, which later commands may have.
    fn id(&self) -> Option<u64> {
        match CommandAddress::read(&self.net)? {
            CommandAddress::Id(id) | CommandAddress::Both(_, id) => Some(id),
            CommandAddress::Name(_) => None,
        }
    }
}

/// The command that a subscription reads now.
struct Target {
    id: u64,
    net: String,
    selected: Vec<SelectedPort>,
    is_announced: bool,
    /// Number of the evaluation that was sent last.
    evaluations: Option<u64>,
}

/// Effect of a change of state: the row's state and reason, whether it is being loaded, and the net's name.
type StateKey = (u32, u32, bool, String);

impl Service {
    /// Opens a stream.
    ///
    /// # Errors
    /// Returns an error if the request has no or too many subjects or no possible rate, if there is no such net or
    /// port, or if the executor has no room for another client.
    pub fn open_stream(&self, request: &StreamRequest) -> Result<EventStream, ApiError> {
        let (attached, store) = self.attach()?;
        let rate_max = match attached.status().period_ns {
            0 => RATE_MAX_DEFAULT,
            period_ns => 1e9 / period_ns as f64,
        };
        let mut subscriptions = subscriptions(request, rate_max)?;
        for subscription in &mut subscriptions {
            subscription.target = Some(self.target(&attached, &store, subscription)?);
        }
        let has_ports = !subscriptions.is_empty();
        let port = has_ports.then(|| self.executor.open_port()).transpose()?;
        let state = self.executor.cell().state();
        let reader = request.events.then(|| EventReader::open_at_end(&state));
        let monitors = (!request.monitors.is_empty())
            .then(|| MonitorReader::open(&request.monitors, &self.executor, &attached));
        Ok(EventStream {
            monitors: monitors.transpose()?,
            subscriptions,
            incarnation: attached.announcement.incarnation,
            period: Duration::from_secs_f64(1.0 / request.rate),
            look_every: look_every(request),
            port,
            states: request.states.then(BTreeMap::new),
            reader,
            waiting: VecDeque::new(),
            loss: StreamLoss::default(),
            spoke: Instant::now(),
        })
    }

    /// Finds the command that a subscription reads, and its ports.
    fn target(
        &self,
        attached: &ExecutorConnection,
        store: &CommandStore,
        subscription: &Subscription,
    ) -> Result<Target, ApiError> {
        let active = |state: CommandState| state.is_active();
        let id = self.resolve(|| attached.tables(), store, &subscription.net, active)?;
        let names = store.names(id).ok_or_else(|| no_names(id))?;
        Ok(Target {
            id,
            selected: select(&names, &subscription.patterns)?,
            net: names.net,
            is_announced: false,
            evaluations: None,
        })
    }
}

/// Returns the interval at which states, events and monitored values are looked at. A client that asks for states waits
/// for an outcome, and its next net starts by this interval later.
fn look_every(request: &StreamRequest) -> Duration {
    match (request.monitors.is_empty(), request.states) {
        (true, true) => LOOK_EVERY_MIN,
        (true, false) => LOOK_EVERY,
        (false, _) => Duration::from_secs_f64(1.0 / request.rate).clamp(LOOK_EVERY_MIN, LOOK_EVERY),
    }
}

/// Checks a request, and sorts its ports by net.
fn subscriptions(request: &StreamRequest, rate_max: f64) -> Result<Vec<Subscription>, ApiError> {
    let refused = |message: String, help: &str| ApiError::new(codes::BAD_REQUEST, message, help);
    let is_empty = request.ports.is_empty() && request.monitors.is_empty();
    if is_empty && !request.states && !request.events {
        let help =
            "add `ports=NET/PRIMITIVE.PORT`, `monitors=NET/*`, `states=true` or `events=true`";
        return Err(refused("the stream has no subject".to_owned(), help));
    }
    if !(STREAM_RATE_MIN..=rate_max).contains(&request.rate) {
        let message = format!(
            "rate: {} is not between {STREAM_RATE_MIN} and {rate_max} samples per second, the rate of the cell",
            request.rate
        );
        let help = "a `Monitor` in the net shows every cycle: add one, and `monitors=NET/*`";
        return Err(refused(message, help));
    }
    let mut all: Vec<Subscription> = Vec::new();
    for port in &request.ports {
        let Some((net, pattern)) = port.split_once('/') else {
            let message = format!("`{port}` names no net");
            return Err(refused(
                message,
                "write NET/PRIMITIVE.PORT, such as `belt/soft.out`",
            ));
        };
        match all.iter_mut().find(|known| known.net == net) {
            Some(known) => known.patterns.push(pattern.to_owned()),
            None => all.push(Subscription::new(net, pattern)),
        }
    }
    if all.len() > STREAM_NETS_MAX {
        let message = format!("the ports are of {} nets", all.len());
        let help = format!("a stream reads at most {STREAM_NETS_MAX} nets: open another one");
        return Err(refused(message, &help));
    }
    Ok(all)
}

impl EventStream {
    /// Serves the client until it is gone, or until nothing can follow.
    pub fn serve(mut self, service: &Service, client: LiveSender) {
        let (mut sample, mut look) = (Instant::now(), Instant::now());
        while !client.is_over() {
            let now = Instant::now();
            if now >= look {
                look = now + self.look_every;
                self.look(service, &client);
                if self.is_over() {
                    return client.finish(self.last_pieces());
                }
            }
            if !self.subscriptions.is_empty() && now >= sample {
                let late = now.duration_since(sample).as_nanos() / self.period.as_nanos().max(1);
                let missed = u32::try_from(late).unwrap_or(u32::MAX);
                self.loss.samples += u64::from(missed);
                sample = match missed {
                    0 => sample + self.period,
                    _ => now + self.period,
                };
                self.sample(service, &client);
            }
            if self.spoke.elapsed() > SILENCE_MAX {
                self.spoke = Instant::now();
                // Full: the client has something to read.
                let _ = client.send(":\n\n".to_owned());
            }
            let next = match self.subscriptions.is_empty() {
                true => look,
                false => sample.min(look),
            };
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
        }
    }

    /// Returns true if nothing can follow: all ports are those of commands that have ended.
    fn is_over(&self) -> bool {
        let has_more = self.states.is_some() || self.reader.is_some() || self.monitors.is_some();
        !has_more && self.subscriptions.iter().all(|one| one.is_over)
    }

    /// Returns the end of the stream: what was lost, and that it is complete.
    fn last_pieces(&self) -> String {
        let lost = match self.loss == StreamLoss::default() {
            true => String::new(),
            false => frame("lost", &self.loss),
        };
        lost + &frame("end", &StreamEnd::default())
    }

    /// Sends an event; false if the client has no room for it.
    fn send(&mut self, client: &LiveSender, event: &str, data: &impl Serialize) -> bool {
        if self.loss != StreamLoss::default() && client.send(frame("lost", &self.loss)).is_ok() {
            self.loss = StreamLoss::default();
        }
        let is_sent = client.send(frame(event, data)).is_ok();
        if is_sent {
            self.spoke = Instant::now();
        }
        is_sent
    }

    /// Sends the values of monitors; those for which the client has no room are lost.
    fn send_monitored(&mut self, service: &Service, client: &LiveSender) {
        let Some(mut reader) = self.monitors.take() else {
            return;
        };
        if let Ok((attached, store)) = service.attach()
            && reader.subscribe(&service.executor, &attached).is_ok()
        {
            let (message, lost) = reader.read(&attached, &store);
            self.loss.records += lost;
            if let Some(message) = message
                && !self.send(client, "monitored", &message)
            {
                let values = message
                    .batches
                    .iter()
                    .map(|batch| batch.cycles.len() as u64);
                self.loss.records += values.sum::<u64>();
            }
        }
        self.monitors = Some(reader);
    }

    /// Sends changed states, last values, new events and monitored values, and finds a restarted executor.
    fn look(&mut self, service: &Service, client: &LiveSender) {
        if self.port.is_none() && !self.subscriptions.is_empty() {
            self.port = service.executor.open_port().ok();
            if self.port.is_some() {
                self.subscriptions
                    .iter_mut()
                    .for_each(|one| one.target = None);
            }
        }
        if let Some(mut known) = self.states.take() {
            self.look_at_states(service, client, &mut known);
            self.states = Some(known);
        }
        self.look_at_ends(service, client);
        self.send_monitored(service, client);
        if let Some(reader) = &mut self.reader {
            // The log may be out of reach for a moment: the events come later.
            for event in reader.poll().unwrap_or_default() {
                if self.waiting.len() >= EVENTS_MAX {
                    self.waiting.pop_front();
                    self.loss.events += 1;
                }
                self.waiting.push_back(event);
            }
        }
        while let Some(event) = self.waiting.pop_front() {
            if !self.send(client, "event", &event) {
                self.waiting.push_front(event);
                return;
            }
        }
    }

    /// Sends the states that changed; one for which there is no room is sent later, as it is then.
    fn look_at_states(
        &mut self,
        service: &Service,
        client: &LiveSender,
        known: &mut BTreeMap<u64, StateKey>,
    ) {
        let Ok((attached, store)) = service.attach() else {
            return;
        };
        let rows = attached.tables().commands;
        for row in &rows {
            let is_loading = service.loading.get().contains_key(&row.id);
            let same =
                |key: &StateKey| (key.0, key.1, key.2) == (row.state, row.reason, is_loading);
            if known.get(&row.id).is_some_and(same) {
                continue;
            }
            let view = service.view(&store, row);
            let state = StreamState {
                id: row.id,
                net: view.net.clone(),
                state: view.state,
                reason: view.reason,
                outcome: view.outcome,
                fault: view.fault,
            };
            if self.send(client, "state", &state) {
                known.insert(row.id, (row.state, row.reason, is_loading, view.net));
            }
        }
        let is_gone = |id: &u64| rows.iter().all(|row| row.id != *id);
        let gone: Vec<u64> = known.keys().copied().filter(is_gone).collect();
        for id in gone {
            let net = known.get(&id).map(|key| key.3.clone());
            let state = StreamState {
                id,
                net: net.unwrap_or_default(),
                state: "unloaded".to_owned(),
                ..StreamState::default()
            };
            if self.send(client, "state", &state) {
                known.remove(&id);
            }
        }
    }
}

/// Formats a server-sent event; JSON has no line feed.
fn frame(event: &str, data: &impl Serialize) -> String {
    // Serializing numbers and texts cannot fail.
    let data = serde_json::to_string(data).unwrap_or_default();
    format!("event: {event}\ndata: {data}\n\n")
}

#[cfg(test)]
mod tests;
