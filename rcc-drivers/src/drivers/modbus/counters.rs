//! Counters of the connections to all servers, for `rcc-cli doctor`.
//! Written by the host's thread, read by any other; Relaxed, because each counter is independent. The text of the last
//! fault is behind a lock that each side holds for a copy.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde_json::{Value, json};

use super::fault::{self, ServerFault};
use super::settings::ServerSettings;
use rcc_driver_kit::driver::LinkDiagnosis;

/// Counters of one server since the driver started, unless noted otherwise.
#[derive(Debug, Default)]
pub struct ServerCounters {
    name: Option<String>,
    address: String,
    unit: u8,
    online: AtomicU32,
    fault: AtomicU32,
    quality_permille: AtomicU32,
    connections: AtomicU64,
    rounds: AtomicU64,
    rounds_late: AtomicU64,
    timeouts: AtomicU64,
    exceptions: AtomicU64,
    broken: AtomicU64,
    discarded: AtomicU64,
    read_ns: AtomicU64,
    read_max_ns: AtomicU64,
    /// The last fault with the point, value or unit that it concerns; empty before the first.
    last_fault: Mutex<String>,
}

impl ServerCounters {
    /// Counters at 0.
    #[must_use]
    pub fn new(settings: &ServerSettings) -> Self {
        Self {
            name: settings.name.clone(),
            address: settings.address.to_string(),
            unit: settings.unit,
            ..Self::default()
        }
    }

    /// Counts a new connection.
    pub fn connected(&self) {
        self.connections.fetch_add(1, Relaxed);
    }

    /// Stores the present state.
    pub fn now(&self, online: bool, fault: u32, quality_permille: u32, discarded: u64) {
        self.online.store(u32::from(online), Relaxed);
        self.fault.store(fault, Relaxed);
        self.quality_permille.store(quality_permille, Relaxed);
        self.discarded.store(discarded, Relaxed);
    }

    /// Counts a round that has ended, within its period or not.
    pub fn round(&self, in_time: bool) {
        self.rounds.fetch_add(1, Relaxed);
        self.rounds_late.fetch_add(u64::from(!in_time), Relaxed);
    }

    /// Stores the time from the request to the last input of a round.
    pub fn read(&self, time: Duration) {
        let time_ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self.read_ns.store(time_ns, Relaxed);
        self.read_max_ns.fetch_max(time_ns, Relaxed);
    }

    /// Counts a loss of the server, and keeps its cause.
    pub fn lost(&self, fault: &ServerFault) {
        *self.last_fault() = fault.to_string();
        let count = match fault {
            ServerFault::Timeout { .. } | ServerFault::OtherUnit { .. } => &self.timeouts,
            ServerFault::Exception { .. } | ServerFault::NoMaskWrite { .. } => &self.exceptions,
            ServerFault::Broken(_) => &self.broken,
            _ => return,
        };
        count.fetch_add(1, Relaxed);
    }

    fn last_fault(&self) -> MutexGuard<'_, String> {
        // A panic leaves it intact: it is replaced as a whole.
        self.last_fault
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn json(&self) -> Value {
        let number = |figure: &AtomicU64| figure.load(Relaxed);
        let last_fault = self.last_fault().clone();
        let fault = self.fault.load(Relaxed);
        json!({
            "server": self.name,
            "address": self.address,
            "unit": self.unit,
            "online": self.online.load(Relaxed) == 1,
            "fault": (fault != 0).then(|| fault::description(fault)),
            "last_fault": (!last_fault.is_empty()).then_some(last_fault),
            "quality_permille": self.quality_permille.load(Relaxed),
            "connections": number(&self.connections),
            "rounds": number(&self.rounds),
            "rounds_late": number(&self.rounds_late),
            "timeouts": number(&self.timeouts),
            "exceptions": number(&self.exceptions),
            "broken_answers": number(&self.broken),
            "discarded_answers": number(&self.discarded),
            "read_ns": number(&self.read_ns),
            "read_max_ns": number(&self.read_max_ns),
        })
    }
}

/// The counters of all servers.
#[derive(Debug)]
pub struct ModbusCounters {
    /// One per server, in the order of the configuration.
    pub servers: Vec<Arc<ServerCounters>>,
    /// Delay of the rounds, ns.
    pub begun_late: RoundDelay,
}

/// Delay between the scheduled and the actual start of rounds.
#[derive(Debug, Default)]
pub struct RoundDelay {
    last_ns: AtomicU64,
    max_ns: AtomicU64,
}

impl RoundDelay {
    /// Counts a round that started late by this time.
    pub fn count(&self, late: Duration) {
        let late_ns = u64::try_from(late.as_nanos()).unwrap_or(u64::MAX);
        self.last_ns.store(late_ns, Relaxed);
        self.max_ns.fetch_max(late_ns, Relaxed);
    }
}

impl LinkDiagnosis for ModbusCounters {
    fn link(&self) -> Value {
        let servers: Vec<Value> = self.servers.iter().map(|one| one.json()).collect();
        json!({
            "protocol": "Modbus TCP",
            "begun_late_ns": self.begun_late.last_ns.load(Relaxed),
            // Maximum since the last call.
            "begun_late_max_ns": self.begun_late.max_ns.swap(0, Relaxed),
            "servers": servers,
        })
    }
}
