//! The pump thread publishes monitor records and writes events to the log and to the cell's event log. It may block;
//! the real-time thread does not wait for it.

use std::time::{Duration, Instant};

use rcc_core::guard::{Violation, ViolationKind, axis};
use rcc_core::message::{
    CommandState, DeviceState, EndReason, FaultCode, FaultRecord, MonitorRecord,
};
use rcc_core::timing::{LateCause, LateCycle};
use rcc_ipc::events::{self, EventRecorder};
use rcc_ipc::{Cell, Publisher};
use rcc_process::log_throttle::LogThrottle;
use rcc_protocol::control::Refusal;
use rcc_protocol::events::{CommandFault, Event, EventKind, EventSeverity, hex_digits};
use rcc_protocol::rules::{DisarmReason, RuleState, RuleStatus};
use rtrb::Consumer;
use tracing::{info, warn};

use rcc_engine::queue::EngineEvent;

/// Interval at which the rings are emptied.
pub const PUMP_EVERY: Duration = Duration::from_millis(2);
/// Minimum time between two log lines about late cycles.
const LATE_REPORT_EVERY: Duration = Duration::from_secs(1);

/// The state of the pump thread.
#[derive(Debug)]
pub struct Pump {
    records: Consumer<MonitorRecord>,
    events: Consumer<EngineEvent>,
    publisher: Publisher<MonitorRecord>,
    batch: Vec<MonitorRecord>,
    devices: Vec<PumpedDevice>,
    late: LateSummary,
    log: Option<(Cell, EventRecorder)>,
    publish_log: LogThrottle,
}

#[derive(Debug, Default)]
struct LateSummary {
    count: u64,
    first_cycle: u64,
    worst_wake_ns: u64,
    worst_exec_ns: u64,
    computed_long: u64,
    /// The command with the longest evaluation in a cycle that computed too long, and that time, ns.
    costliest: Option<(u64, u64)>,
    reported_at: Option<Instant>,
}

impl LateSummary {
    fn add(&mut self, late: &LateCycle) {
        if self.count == 0 {
            self.first_cycle = late.cycle;
        }
        self.count += 1;
        self.worst_wake_ns = self.worst_wake_ns.max(late.wake_ns);
        self.worst_exec_ns = self.worst_exec_ns.max(late.exec_ns);
        if LateCause::from_number(late.cause) != LateCause::ComputedLong {
            return;
        }
        self.computed_long += 1;
        let costlier = self.costliest.is_none_or(|(_, ns)| ns < late.command_ns);
        if late.command != 0 && costlier {
            self.costliest = Some((late.command, late.command_ns));
        }
    }
}

/// A device, as log lines name it.
#[derive(Clone, Debug)]
pub struct PumpedDevice {
    /// Its name.
    pub name: String,
    /// Its joints are linear axes.
    pub linear: bool,
}

impl Pump {
    /// Creates the pump; `devices` are the devices by index, for log lines.
    pub fn new(
        records: Consumer<MonitorRecord>,
        events: Consumer<EngineEvent>,
        publisher: Publisher<MonitorRecord>,
        devices: Vec<PumpedDevice>,
    ) -> Pump {
        Pump {
            records,
            events,
            publisher,
            batch: Vec::with_capacity(4096),
            devices,
            late: LateSummary::default(),
            log: None,
            publish_log: LogThrottle::default(),
        }
    }

    /// Also writes events to the cell's event log.
    #[must_use]
    pub fn with_event_log(mut self, cell: &Cell, recorder: EventRecorder) -> Pump {
        self.log = Some((cell.clone(), recorder));
        self
    }

    /// Empties both rings once.
    pub fn round(&mut self) {
        self.batch.clear();
        while let Ok(record) = self.records.pop() {
            self.batch.push(record);
        }
        if let Err(error) = self.publisher.publish(&self.batch) {
            match self.publish_log.admit(Instant::now()) {
                Some(0) => warn!("lost monitor records: {error}"),
                Some(others) => {
                    warn!(
                        "lost monitor records: {error}; {others} more since the last such message"
                    );
                }
                None => {}
            }
        }
        while let Ok(event) = self.events.pop() {
            self.handle_event(event);
        }
        let reported_at = self.late.reported_at;
        if reported_at.is_none_or(|at| at.elapsed() >= LATE_REPORT_EVERY) {
            self.report_late();
        }
    }

    /// Empties both rings for the last time; late cycles are reported even if others were a moment ago.
    pub fn finish(&mut self) {
        self.round();
        self.report_late();
    }

    fn handle_event(&mut self, event: EngineEvent) {
        match event {
            EngineEvent::Late(late) => self.late.add(&late),
            EngineEvent::Rule(RuleStatus { cycle, .. })
            | EngineEvent::LeaseLost { cycle, .. }
            | EngineEvent::Command { cycle, .. }
            | EngineEvent::Device { cycle, .. }
            | EngineEvent::Acknowledged { cycle, .. } => {
                if let Some(what) = self.kind(&event) {
                    self.record(Some(cycle), what);
                }
            }
        }
    }

    /// Writes an event to both logs.
    fn record(&self, cycle: Option<u64>, what: EventKind) {
        let Some((_, recorder)) = &self.log else {
            return;
        };
        let event = Event::now(recorder.source().clone(), cycle, what);
        let sentence = event.sentence(&|_, id| format!("command {id}"));
        let cycle = cycle.map_or_else(String::new, |cycle| format!(" (cycle {cycle})"));
        match event.severity {
            EventSeverity::Info => info!("{sentence}{cycle}"),
            _ => warn!("{sentence}{cycle}"),
        }
        recorder.record(event);
    }

    /// Converts an event of the real-time thread, with names in place of numbers.
    fn kind(&self, event: &EngineEvent) -> Option<EventKind> {
        Some(match *event {
            EngineEvent::Late(_) => return None,
            EngineEvent::Acknowledged { late, .. } => EventKind::Acknowledged { late },
            EngineEvent::Rule(ref status) => rule_event(status),
            EngineEvent::LeaseLost {
                lease,
                rules,
                commands,
                ..
            } => EventKind::LeaseLost {
                lease,
                rules,
                commands,
            },
            // The loader reports it, with the net's name.
            EngineEvent::Command { state, .. } if state == CommandState::Loading as u32 => {
                return None;
            }
            EngineEvent::Command {
                id,
                state,
                reason,
                outcome,
                cycles,
                ref fault,
                ..
            } => {
                let reason = EndReason::from_number(reason);
                let ended = reason != EndReason::None;
                let faulty = reason == EndReason::Fault;
                EventKind::Command {
                    command: id,
                    state: CommandState::from_number(state).name().to_owned(),
                    reason: ended.then(|| reason.name().to_owned()),
                    outcome: (outcome > 0).then_some(outcome),
                    cycles: ended.then_some(cycles),
                    fault: faulty.then(|| self.fault(fault)),
                }
            }
            EngineEvent::Device {
                device,
                state,
                was,
                reason,
                age_ns,
                driver,
                attached,
                ..
            } => {
                // A reason given before the driver fell silent does not explain its silence.
                let reason = match (attached, age_ns) {
                    (false, _) => "its driver is dead".to_owned(),
                    (true, 0) => self.reason(device, reason),
                    (true, _) => String::new(),
                };
                self.device_kind(device, [was, state], reason, age_ns, driver)
            }
        })
    }

    fn device_kind(
        &self,
        index: u32,
        [was, state]: [u32; 2],
        reason: String,
        age_ns: u64,
        driver: u64,
    ) -> EventKind {
        let device = self.device(index).to_owned();
        let [was, state] = [was, state].map(DeviceState::from_number);
        let driver = (driver != 0).then(|| hex_digits(driver));
        if state == DeviceState::Offline {
            return EventKind::DeviceLost {
                reason,
                board_age_us: (age_ns != 0).then_some(age_ns / 1000),
                driver,
                device,
            };
        }
        if was == DeviceState::Offline {
            let state = state.name().to_owned();
            return EventKind::DeviceFound {
                device,
                state,
                driver,
            };
        }
        EventKind::DeviceState {
            state: state.name().to_owned(),
            was: was.name().to_owned(),
            reason,
            device,
        }
    }

    /// Returns the driver's explanation of a reason number, from its announcement.
    fn reason(&self, device: u32, number: u32) -> String {
        let log = self.log.as_ref();
        log.map_or_else(String::new, |(cell, _)| {
            events::reason_words(cell, self.device(device), number)
        })
    }

    fn report_late(&mut self) {
        if self.late.count == 0 {
            return;
        }
        let LateSummary {
            count,
            first_cycle,
            worst_wake_ns,
            worst_exec_ns,
            computed_long,
            costliest,
            ..
        } = self.late;
        let what = EventKind::Late {
            count,
            first_cycle,
            worst_wake_us: worst_wake_ns as f64 * 1e-3,
            worst_exec_us: worst_exec_ns as f64 * 1e-3,
            computed_long: Some(computed_long),
            command: costliest.map(|(command, _)| command),
            command_us: costliest.map(|(_, ns)| ns as f64 * 1e-3),
        };
        self.record(Some(first_cycle), what);
        self.late = LateSummary {
            reported_at: Some(Instant::now()),
            ..LateSummary::default()
        };
    }

    fn device(&self, index: u32) -> &str {
        self.devices
            .get(index as usize)
            .map_or("?", |device| device.name.as_str())
    }

    fn fault(&self, fault: &FaultRecord) -> CommandFault {
        let kind = ViolationKind::from_number(fault.violation);
        let index = fault.joint.saturating_sub(1);
        let joint = (fault.joint != 0 && axis(index as usize).is_none()).then_some(fault.joint);
        let violation = kind.map(|kind| {
            let (value, limit) = (fault.value, fault.limit);
            let joint = u8::try_from(index).unwrap_or(u8::MAX);
            Violation {
                kind,
                joint,
                value,
                limit,
            }
        });
        let device = self.devices.get(fault.device as usize);
        let linear = device.is_some_and(|device| device.linear);
        let unit = violation.map(|violation| violation.unit_of(linear).to_owned());
        let rule = kind.map(|kind| match kind {
            ViolationKind::NotFinite => "set-point is not a number",
            ViolationKind::Range => "position",
            ViolationKind::Velocity => "velocity",
            ViolationKind::Acceleration => "acceleration",
            ViolationKind::Jump => "distance from where the device is held",
            ViolationKind::Stiffness => "stiffness",
            ViolationKind::StiffnessRate => "rate of change of the stiffness",
            ViolationKind::Damping => "damping ratio",
            ViolationKind::Added => "additional torque",
            ViolationKind::Strategy => "control strategy",
            ViolationKind::Workspace => "workspace",
            ViolationKind::Singularity => "distance to a singularity",
        });
        // Without a joint, the violation's text contains everything.
        let rule = match (violation, rule) {
            (Some(violation), Some(_)) if joint.is_none() => Some(violation.to_string()),
            (_, rule) => rule.map(str::to_owned),
        };
        let number = |value: f64| value.is_finite().then_some(value);
        CommandFault {
            code: FaultCode::from_number(fault.code).name().to_owned(),
            device: (fault.device != u32::MAX).then(|| self.device(fault.device).to_owned()),
            joint,
            rule,
            value: kind.and(number(fault.value)),
            limit: kind.and(number(fault.limit)),
            unit,
        }
    }
}

/// The event of a rule that can no longer fire.
fn rule_event(status: &RuleStatus) -> EventKind {
    let disarmed = status.disarmed.map(|reason| match reason {
        DisarmReason::Removed => (None, "it was removed".to_owned()),
        DisarmReason::Stopped { command } => {
            let why = "a client stopped this command, and the rule would start something after it";
            (Some(command), why.to_owned())
        }
        DisarmReason::ClientLost { lease } => (None, format!("its client is gone (lease {lease})")),
        DisarmReason::Stopping => (None, "the executor is stopping".to_owned()),
    });
    let refused = status.refusal.map(|(command, refusal)| {
        let command = (command != 0).then_some(command);
        (command, refusal_words(refusal, status.state))
    });
    let (command, why) = disarmed.or(refused).unwrap_or_default();
    EventKind::Rule {
        rule: status.id,
        state: status.state.name().to_owned(),
        command,
        why,
    }
}

/// Short reason why a rule was refused when it fired; `GET /rules` gives names, values and limits.
fn refusal_words(refusal: Refusal, state: RuleState) -> String {
    match refusal {
        Refusal::Busy { holder, .. } => format!("command {holder} has a resource that it needs"),
        Refusal::WrongState { state } => {
            format!("it is {}", CommandState::from_number(state).name())
        }
        Refusal::UnknownCommand => "it does not exist any more".to_owned(),
        Refusal::Continuation { joint, .. } => {
            format!("its first set-point does not continue the motion of joint {joint}")
        }
        Refusal::FirstSetPoint { joint, .. } => {
            format!("its first set-point is not where joint {joint} is held")
        }
        Refusal::LetsGo { .. } => "it has no set-point for the arm in its first cycle".to_owned(),
        Refusal::DeviceNotReady { .. } => "a device that it needs is not ready".to_owned(),
        Refusal::NeverTogether => "its nets have no common cycle".to_owned(),
        Refusal::Rule { .. } if state == RuleState::Expired => {
            "its condition can never hold any more".to_owned()
        }
        _ => "the executor refused it".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use rcc_ipc::Session;
    use rcc_ipc::events::EventReader;
    use rcc_protocol::Role;
    use rcc_protocol::control::RECORDS;

    use super::*;

    #[test]
    fn late_cycles_before_an_orderly_end_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let cell = Cell::at("pump", folder.path()).unwrap();
        cell.make_state(None).unwrap();
        let session = Session::join(&cell, Role::Executor, "executor").unwrap();
        let recorder = EventRecorder::start(&cell, Role::Executor, "executor").unwrap();
        let (_records, records) = rtrb::RingBuffer::new(4);
        let (mut events, queued) = rtrb::RingBuffer::new(4);
        let publisher = session.publisher(RECORDS).unwrap();
        let mut pump = Pump::new(records, queued, publisher, Vec::new())
            .with_event_log(&cell, recorder.clone());
        let mut late = |cycle| {
            let late = LateCycle {
                cycle,
                ..LateCycle::NONE
            };
            events.push(EngineEvent::Late(late)).unwrap();
        };
        late(5);
        pump.round();
        late(9);
        late(10);
        pump.finish();
        recorder.flush(Duration::from_secs(60));
        let reported = EventReader::open(&cell.state()).poll().unwrap();
        let reported = reported.into_iter().filter_map(|event| match event.what {
            EventKind::Late {
                first_cycle, count, ..
            } => Some((first_cycle, count)),
            _ => None,
        });
        assert_eq!(reported.collect::<Vec<_>>(), [(5, 1), (9, 2)]);
    }
}
