//! Counters of the connection to the robot, for `rcc-cli doctor device`.
//! Written by the exchange thread, read by the diagnosis thread. The counters are atomics; the last error and the missing
//! channel are behind a lock that the exchange thread only tries, and only when something is wrong.

use std::net::SocketAddr;
use std::sync::Mutex;
use std::sync::atomic::{AtomicI32, AtomicU64, Ordering::Relaxed};

use serde_json::{Value, json};

use super::session::{Refusal, RobotState};
use crate::drivers::fri_socket::peer::Peer;
use crate::fri_iiwa::wire::{
    ClientCommandMode, ControlMode, DriveState, OperationMode, Quality, SafetyState, SessionState,
    Version,
};
use rcc_driver_kit::driver::LinkDiagnosis;

/// Counters of one connection.
#[derive(Debug)]
pub struct IiwaCounters {
    listen: SocketAddr,
    peer: Option<Peer>,
    version: Version,
    accepted: AtomicU64,
    answered: AtomicU64,
    /// Datagrams from another address.
    foreign: AtomicU64,
    unreadable: AtomicU64,
    /// Datagrams that can be read, but are out of order, not finite, or not confirmed.
    refused: AtomicU64,
    session: AtomicI32,
    quality: AtomicI32,
    safety: AtomicI32,
    operation: AtomicI32,
    control: AtomicI32,
    command_mode: AtomicI32,
    /// The lowest state of a drive.
    drives: AtomicI32,
    period_ms: AtomicU64,
    multiplier: AtomicU64,
    texts: Mutex<Texts>,
}

#[derive(Debug, Default)]
struct Texts {
    robot: Option<SocketAddr>,
    last_error: Option<String>,
    foreign_last: Option<SocketAddr>,
    missing_io: Option<String>,
}

impl IiwaCounters {
    /// Counters of a socket that is bound to `listen` and answers only `peer`, if given.
    #[must_use]
    pub fn new(listen: SocketAddr, peer: Option<Peer>, version: Version) -> Self {
        let unknown = || AtomicI32::new(-1);
        Self {
            listen,
            peer,
            version,
            accepted: AtomicU64::new(0),
            answered: AtomicU64::new(0),
            foreign: AtomicU64::new(0),
            unreadable: AtomicU64::new(0),
            refused: AtomicU64::new(0),
            session: unknown(),
            quality: unknown(),
            safety: unknown(),
            operation: unknown(),
            control: unknown(),
            command_mode: unknown(),
            drives: unknown(),
            period_ms: AtomicU64::new(0),
            multiplier: AtomicU64::new(0),
            texts: Mutex::new(Texts::default()),
        }
    }

    /// Counts an accepted datagram.
    pub fn accepted(&self, source: SocketAddr, state: &RobotState, missing_io: Option<&str>) {
        let first = self.accepted.fetch_add(1, Relaxed) == 0;
        self.session.store(state.session as i32, Relaxed);
        self.quality.store(state.quality as i32, Relaxed);
        self.safety.store(state.safety, Relaxed);
        self.operation.store(state.operation, Relaxed);
        self.control.store(state.control, Relaxed);
        self.command_mode.store(state.command_mode, Relaxed);
        let drives = state.drives.iter().copied().min().unwrap_or(-1);
        self.drives.store(drives, Relaxed);
        self.period_ms.store(state.period_ns / 1_000_000, Relaxed);
        self.multiplier.store(u64::from(state.multiplier), Relaxed);
        if (first || missing_io.is_some())
            && let Ok(mut texts) = self.texts.try_lock()
        {
            texts.robot = Some(source);
            if texts.missing_io.as_deref() != missing_io {
                texts.missing_io = missing_io.map(str::to_owned);
                if let Some(name) = missing_io {
                    tracing::warn!("the robot does not list `{name}` with this direction and type");
                }
            }
        }
    }

    /// Counts a refused datagram.
    pub fn refused(&self, source: SocketAddr, refusal: &Refusal) {
        let counter = match refusal.wire {
            Some(_) => &self.unreadable,
            None => &self.refused,
        };
        let count = counter.fetch_add(1, Relaxed) + 1;
        if let Ok(mut texts) = self.texts.try_lock() {
            let text = format!("{source}: {refusal}");
            // Ever more rarely: a sender of invalid datagrams must not fill the log.
            if refusal.wire.is_some() && count.is_power_of_two() {
                tracing::warn!(count, "datagram not read: {text}");
            }
            texts.last_error = Some(text);
        }
    }

    /// Counts a datagram from an address that is not the robot's.
    pub fn foreign(&self, source: SocketAddr) {
        self.foreign.fetch_add(1, Relaxed);
        if let Ok(mut texts) = self.texts.try_lock() {
            texts.last_error = Some(format!("{source}: not the robot that is answered"));
            texts.foreign_last = Some(source);
        }
    }

    /// Counts an answer.
    pub fn answered(&self) {
        self.answered.fetch_add(1, Relaxed);
    }
}

impl LinkDiagnosis for IiwaCounters {
    fn link(&self) -> Value {
        let number = |counter: &AtomicU64| counter.load(Relaxed);
        let state = |field: &AtomicI32| field.load(Relaxed);
        let texts = self.texts.lock().unwrap_or_else(|lock| lock.into_inner());
        let accepted = number(&self.accepted);
        json!({
            "protocol": format!("FRI of the LBR iiwa and Med, {:?}", self.version),
            "listen": self.listen.to_string(),
            "peer": self.peer.map(|peer| peer.to_string()),
            "robot": texts.robot.map(|robot| robot.to_string()),
            "datagrams": accepted + number(&self.foreign) + number(&self.unreadable) + number(&self.refused),
            "accepted": accepted,
            "answered": number(&self.answered),
            "foreign": number(&self.foreign),
            "foreign_last": texts.foreign_last.map(|source| source.to_string()),
            "unreadable": number(&self.unreadable),
            "refused": number(&self.refused),
            "last_error": texts.last_error,
            "missing_io": texts.missing_io,
            "session": word(SessionState::from_wire(state(&self.session))),
            "quality": word(Quality::from_wire(state(&self.quality))),
            "safety": word(SafetyState::from_wire(state(&self.safety))),
            "operation": word(OperationMode::from_wire(state(&self.operation))),
            "control": word(ControlMode::from_wire(state(&self.control))),
            "drives": word(DriveState::from_wire(state(&self.drives))),
            "send_period_ms": number(&self.period_ms),
            "receive_multiplier": number(&self.multiplier),
            "command_mode": word(ClientCommandMode::from_wire(state(&self.command_mode))),
        })
    }
}

fn word<T: std::fmt::Debug>(value: Option<T>) -> Option<String> {
    value.map(|value| format!("{value:?}"))
}
