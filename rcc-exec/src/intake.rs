//! The intake thread takes requests, has nets built, opens drivers' boards, and frees what the real-time thread gives
//! back. It may allocate and block. A request wakes it; the real-time thread, which calls nobody, does not: this thread
//! knows when the next cycle will have answered.

use std::collections::{HashMap, VecDeque};
use std::io;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use rcc_core::frame::DeviceModel;
use rcc_core::message::{CommandState, CycleStatus};
use rcc_engine::costs::Costs;
use rcc_engine::queue::ValueReading;
use rcc_ipc::events::EventRecorder;
use rcc_ipc::request::{PollError, Request, Server};
use rcc_ipc::{BoardReader, Session};
use rcc_os::clock::monotonic_ns;
use rcc_process::Helpers;
use rcc_process::log_throttle::LogThrottle;
use rcc_protocol::control::{
    Answer, Call, InputValue, READ_ELEMENTS_MAX, READ_MAX, Refusal, SET_ELEMENTS_MAX, SET_MAX,
    SWITCH_MAX, installs,
};
use rcc_protocol::rehearsal::RehearsalReport;
use rcc_protocol::rules::RULES_PER_REQUEST;
use rcc_protocol::{Announcement, wire};
use rtrb::{Consumer, Producer};
use tracing::warn;

use crate::boards::{EngineReply, EngineRequest};
use crate::ids::IdBlocks;
use crate::incidents::{self, RecordingResults};
use crate::net_builder::{BuildContext, BuildRequest, BuildSource, NetBuilderThread};
use crate::rule_texts::RuleTexts;

mod builds;
mod drivers;
mod rules;

use builds::{BuildState, ReadyCommand};
use drivers::DriverLinks;

/// Maximum time between two rounds while nothing is pending: each round checks the drivers and the stop request.
const IDLE_MAX: Duration = Duration::from_millis(2);
/// Polling interval for the answer of a cycle that should have ended.
const LATE_POLL: Duration = Duration::from_micros(50);
/// Maximum number of requests that wait for a net that is being built.
const DEFERRED_MAX: usize = 64;

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
    /// Nothing: the START of a command was withdrawn, so it is all right that the command is still ready.
    Withdrawn,
    /// Forget the origins of commands that are now started.
    Started(Vec<u64>, Option<RehearsalReport>),
    /// Remember values that were set before START.
    Set(u64, Vec<InputValue>),
    /// Forget a command that was unloaded.
    Unloaded(u64),
    /// Remember the names and conditions of rules.
    RulesInstalled(Vec<[String; 2]>),
    /// Forget a rule that was removed.
    RuleRemoved(u64),
}

/// The state of the intake thread.
pub struct Intake {
    drivers: DriverLinks,
    server: Server,
    status: BoardReader<CycleStatus>,
    engine_requests: Producer<EngineRequest>,
    engine_replies: Consumer<EngineReply>,
    net_builder: NetBuilderThread,
    pending: HashMap<u64, PendingRequest>,
    ready: HashMap<u64, ReadyCommand>,
    /// Commands whose net is being built.
    building: HashMap<u64, BuildState>,
    /// Calls that name a command in `building`, in order of arrival.
    deferred: VecDeque<(Call, Request)>,
    rule_texts: RuleTexts,
    ids: IdBlocks,
    next_ticket: u64,
    error_log: LogThrottle,
    incident_writer: Option<Sender<incidents::PreparedNet>>,
    recordings: RecordingResults,
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
    /// The executor's own counters, which say when a cycle began.
    pub status: BoardReader<CycleStatus>,
    /// This executor's announcement; a driver that announces another configuration is not attached.
    pub announcement: Announcement,
    /// The ids that this executor may give.
    pub ids: IdBlocks,
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
        let (names, announcement) = (config.names, config.announcement);
        let build_context = BuildContext {
            models: config.models,
            configuration: config.configuration,
            period_ns: config.period_ns,
            costs: config.costs,
        };
        let waker = server.waker()?;
        let net_builder = NetBuilderThread::start(build_context, waker, &config.helpers)?;
        Ok(Intake {
            drivers: DriverLinks::new(session, names, announcement, config.stale_after_ns),
            server,
            status: config.status,
            engine_requests,
            engine_replies,
            net_builder,
            pending: HashMap::new(),
            ready: HashMap::new(),
            building: HashMap::new(),
            deferred: VecDeque::new(),
            rule_texts: RuleTexts::default(),
            ids: config.ids,
            next_ticket: 1,
            error_log: LogThrottle::default(),
            incident_writer: None,
            recordings: RecordingResults::default(),
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

    /// Keeps the texts of rules where others can read them.
    #[must_use]
    pub fn with_rule_texts(mut self, rule_texts: RuleTexts) -> Intake {
        self.rule_texts = rule_texts;
        self
    }

    /// Also writes events to the cell's event log.
    #[must_use]
    pub fn with_event_log(mut self, recorder: EventRecorder) -> Intake {
        self.drivers.log_events(recorder);
        self
    }

    /// Processes pending work once; returns true if there was any.
    pub fn round(&mut self) -> bool {
        self.drivers.update(&mut self.engine_requests);
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

    /// Waits until there may be work: for a request, for a net that is built, or until the next answer of the real-time
    /// thread is due.
    pub fn wait(&self) {
        let answer = if self.pending.is_empty() {
            IDLE_MAX
        } else {
            until_answer(&self.status.read(), monotonic_ns())
        };
        self.server.wait(answer);
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
            EngineReply::RuleList(rules) => drop(rules),
            EngineReply::Rules { ticket, list } => self.handle_rules(ticket, list),
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
            let build_request = BuildRequest {
                ticket: self.ticket(),
                id,
                source: BuildSource::Encoded(request.take_bytes()),
                snapshot: self.drivers.snapshot(),
            };
            return self.build(build_request, None, request);
        }
        let call = match wire::decode::<Call>(request.bytes()) {
            Ok(call) => call,
            Err(error) => {
                self.log_error(&format_args!("malformed request refused: {error}"));
                return reply(request, &Answer::Refused(Refusal::NotUnderstood));
            }
        };
        // A call that only stops does not wait for a net to be built: a START that has not taken effect is withdrawn. The
        // real-time thread disarms the rules that would start something after the stop, and gives the answer.
        if let Some(stopped) = stops_only(&call) {
            stopped.iter().for_each(|id| self.withdraw(*id));
            return self.dispatch(self.without_withdrawn(call), request);
        }
        // Other calls that name a command whose net is being built are deferred until it is finished.
        if self.awaits_build(&call) {
            if self.deferred.len() >= DEFERRED_MAX {
                return reply(request, &Answer::Refused(Refusal::Overloaded));
            }
            return self.deferred.push_back((call, request));
        }
        self.dispatch(call, request);
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
            Call::Start { id, lease } => {
                let snapshot = self.drivers.snapshot();
                if let Some(source) = self.rebuild_source(id, &snapshot) {
                    let build_request = BuildRequest {
                        ticket,
                        id,
                        source,
                        snapshot,
                    };
                    return self.build(build_request, Some(lease), request);
                }
                on_done = OnDone::Started(vec![id], None);
                EngineRequest::Start { ticket, id, lease }
            }
            Call::Switch { stop, start, lease } => match (id_list(&stop), id_list(&start)) {
                (Some(stop), Some(list)) => {
                    on_done = OnDone::Started(start, None);
                    EngineRequest::Handover {
                        ticket,
                        stop,
                        start: list,
                        lease,
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
            Call::Cancel { id } => {
                on_done = self.on_stopped(id);
                EngineRequest::Cancel { ticket, id }
            }
            Call::Abort { id } => {
                on_done = self.on_stopped(id);
                EngineRequest::Abort { ticket, id }
            }
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
            call @ (Call::InstallRules { .. }
            | Call::RemoveRule { .. }
            | Call::Rules { .. }
            | Call::GrantLease { .. }
            | Call::RenewLease { .. }
            | Call::EndLease { .. }
            | Call::BindLease { .. }) => return self.dispatch_rules(ticket, call, request),
            Call::Install { id, plan } => {
                let build_request = BuildRequest {
                    ticket,
                    id,
                    source: BuildSource::Plan(Box::new(plan)),
                    snapshot: self.drivers.snapshot(),
                };
                return self.build(build_request, None, request);
            }
        };
        self.submit(
            engine_request,
            Some((ticket, PendingRequest { request, on_done })),
        );
    }

    /// Takes the action of a confirmed request, and returns the answer for the caller.
    fn finish_answer(&mut self, answer: Answer, mut on_done: OnDone) -> Answer {
        if let Answer::Reserved { id } | Answer::RulesInstalled { first: id, .. } = answer {
            self.ids.cover(id.saturating_add(RULES_PER_REQUEST as u64));
        }
        self.note_rules(&answer, &mut on_done);
        if let (OnDone::Withdrawn, Answer::Refused(Refusal::WrongState { state })) =
            (&on_done, &answer)
            && CommandState::from_number(*state) == CommandState::Ready
        {
            let cycle = self.status.read().cycle;
            return Answer::Done { cycle };
        }
        let Answer::Done { cycle } = answer else {
            return answer;
        };
        let rehearsed = match on_done {
            OnDone::Nothing
            | OnDone::Withdrawn
            | OnDone::RulesInstalled(_)
            | OnDone::RuleRemoved(_) => None,
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
}

/// Returns the time until the next cycle has answered, if it takes as long as the last one; at most [`IDLE_MAX`].
fn until_answer(status: &CycleStatus, now_ns: u64) -> Duration {
    let due_ns = status
        .stamp_ns
        .saturating_add(status.period_ns)
        .saturating_add(status.exec_last_ns);
    Duration::from_nanos(due_ns.saturating_sub(now_ns)).clamp(LATE_POLL, IDLE_MAX)
}

/// Returns the commands that a call stops if it does nothing else.
fn stops_only(call: &Call) -> Option<Vec<u64>> {
    match call {
        Call::Cancel { id } | Call::Abort { id } => Some(vec![*id]),
        Call::Switch { stop, start, .. } if start.is_empty() => Some(stop.clone()),
        _ => None,
    }
}

/// Returns the commands that a call changes, except the one that an Install creates.
fn commands_of(call: &Call) -> Vec<u64> {
    match call {
        Call::Start { id, .. }
        | Call::Cancel { id }
        | Call::Abort { id }
        | Call::Unload { id }
        | Call::Set { id, .. }
        | Call::Reject { id } => vec![*id],
        Call::Switch { stop, start, .. } => [&stop[..], start].concat(),
        Call::BindLease { commands, .. } => commands.clone(),
        Call::InstallRules { rules } => rules.iter().flat_map(|rule| rule.rule.targets()).collect(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn an_answer_is_looked_for_when_its_cycle_has_ended() {
        let status = CycleStatus {
            stamp_ns: 5_000_000,
            period_ns: 1_000_000,
            exec_last_ns: 20_000,
            ..CycleStatus::zeroed()
        };
        let wait = |now_ns| until_answer(&status, now_ns);
        assert_eq!(wait(5_100_000), Duration::from_micros(920));
        assert_eq!(wait(6_010_000), LATE_POLL, "about to end");
        assert_eq!(wait(9_000_000), LATE_POLL, "late");
        assert_eq!(wait(0), IDLE_MAX, "a long period");
        assert_eq!(until_answer(&CycleStatus::zeroed(), 1), LATE_POLL);
    }
}
