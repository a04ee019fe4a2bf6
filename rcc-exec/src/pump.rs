//! The pump thread: carries monitor records to the stream and events to the log. May block; the
//! real-time thread does not wait for it.

use std::time::{Duration, Instant};

use rcc_core::guard::ViolationKind;
use rcc_core::message::{
    CommandState, DeviceState, EndReason, FaultCode, FaultRecord, MonitorRecord,
};
use rcc_ipc::Publisher;
use rtrb::Consumer;
use tracing::{info, warn};

use crate::queue::Event;

/// How often the rings are emptied.
pub const PUMP_EVERY: Duration = Duration::from_millis(2);
/// At most one line about late cycles in this time.
const LATE_LINE_EVERY: Duration = Duration::from_secs(1);

/// Everything the pump thread owns.
#[derive(Debug)]
pub struct Pump {
    records: Consumer<MonitorRecord>,
    events: Consumer<Event>,
    publisher: Publisher<MonitorRecord>,
    batch: Vec<MonitorRecord>,
    devices: Vec<String>,
    late: Late,
}

#[derive(Debug, Default)]
struct Late {
    count: u64,
    first_cycle: u64,
    worst_wake_ns: u64,
    worst_exec_ns: u64,
    said_at: Option<Instant>,
}

impl Pump {
    /// `devices` are the names by index, for the log.
    pub fn new(
        records: Consumer<MonitorRecord>,
        events: Consumer<Event>,
        publisher: Publisher<MonitorRecord>,
        devices: Vec<String>,
    ) -> Pump {
        Pump {
            records,
            events,
            publisher,
            batch: Vec::with_capacity(4096),
            devices,
            late: Late::default(),
        }
    }

    /// Empties both rings once.
    pub fn round(&mut self) {
        self.batch.clear();
        while let Ok(record) = self.records.pop() {
            self.batch.push(record);
        }
        let published = self.publisher.publish(&self.batch);
        if let Err(error) = published {
            warn!("monitor records were lost: {error}");
        }
        while let Ok(event) = self.events.pop() {
            self.tell(event);
        }
        self.tell_late();
    }

    fn tell(&mut self, event: Event) {
        match event {
            Event::Command {
                cycle,
                id,
                state,
                reason,
                fault,
            } => {
                let state = CommandState::from_number(state).name();
                match EndReason::from_number(reason) {
                    EndReason::Fault => warn!(
                        "command {id} {state}, {} (cycle {cycle})",
                        self.fault_text(&fault)
                    ),
                    EndReason::None => info!("command {id} {state} (cycle {cycle})"),
                    reason => info!("command {id} {state}: {} (cycle {cycle})", reason.name()),
                }
            }
            Event::Device {
                cycle,
                device,
                state,
                reason,
            } => {
                let state = DeviceState::from_number(state).name();
                info!(
                    "device {} {state} (reason {reason}, cycle {cycle})",
                    self.device(device)
                );
            }
            Event::Late {
                cycle,
                wake_ns,
                exec_ns,
            } => {
                if self.late.count == 0 {
                    self.late.first_cycle = cycle;
                }
                self.late.count += 1;
                self.late.worst_wake_ns = self.late.worst_wake_ns.max(wake_ns);
                self.late.worst_exec_ns = self.late.worst_exec_ns.max(exec_ns);
            }
        }
    }

    fn tell_late(&mut self) {
        let quiet = self
            .late
            .said_at
            .is_some_and(|at| at.elapsed() < LATE_LINE_EVERY);
        if self.late.count == 0 || quiet {
            return;
        }
        let Late {
            count,
            first_cycle,
            worst_wake_ns,
            worst_exec_ns,
            ..
        } = self.late;
        warn!(
            "{count} late cycles since cycle {first_cycle}: woke up to {:.3} ms after the deadline, computed up to {:.3} ms",
            worst_wake_ns as f64 * 1e-6,
            worst_exec_ns as f64 * 1e-6
        );
        self.late = Late {
            said_at: Some(Instant::now()),
            ..Late::default()
        };
    }

    fn device(&self, index: u32) -> &str {
        self.devices.get(index as usize).map_or("?", String::as_str)
    }

    fn fault_text(&self, fault: &FaultRecord) -> String {
        let code = FaultCode::from_number(fault.code).name();
        let mut text = format!("fault: {code}");
        if fault.device != u32::MAX {
            text += &format!(" on {}", self.device(fault.device));
        }
        if let Some(kind) = ViolationKind::from_number(fault.violation) {
            text += &format!(
                ", joint {}: {kind:?} {} (limit {})",
                fault.joint, fault.value, fault.limit
            );
        }
        text
    }
}
