//! Statistics of the line for `rcc-cli doctor device`. Written by the session's and the host's threads, read by any thread;
//! the values are atomics that publish no other data, hence Relaxed.

use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU8, AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

use ethercrab::SubDeviceState;
use rcc_driver_kit::driver::LinkDiagnosis;
use serde_json::{Value, json};

use super::axes::DriveStatus;
use super::power_state::PowerState;
use super::settings::EthercatSettings;
use crate::session::{FrameCounts, Loss, PortErrors};

/// State of a terminal that was never seen.
const UNKNOWN: u8 = u8::MAX;
/// Difference of a clock that was never read.
const NO_CLOCK: i64 = i64::MIN;

/// One terminal.
#[derive(Debug)]
struct TerminalCounters {
    name: String,
    kind: String,
    /// Number of the state in its last answer; 0 = it did not answer.
    state: AtomicU8,
    /// Four counters of 8 bits each.
    errors: [AtomicU32; 4],
    /// Difference of its clock from the reference clock, ns.
    clock_ns: AtomicI64,
}

/// The drive of one axis.
#[derive(Debug)]
struct DriveCounters {
    joint: String,
    terminal: String,
    /// Statusword in the low half, error code in the high half.
    words: AtomicU32,
}

/// Counters of the line since the driver started.
#[derive(Debug)]
pub struct LineCounters {
    interface: String,
    /// The exchanges follow a distributed clock.
    clocks: bool,
    terminals: Vec<TerminalCounters>,
    drives: Vec<DriveCounters>,
    /// Frames of the socket.
    pub frames: FrameCounts,
    sessions: AtomicU64,
    complete: AtomicU64,
    silent: AtomicU64,
    wrong: AtomicU64,
    /// The last wrong working counter and the right one.
    last_wrong: [AtomicU32; 2],
    /// Number of the present reason; 0 = none.
    reason: AtomicU32,
    /// There is a fault; spares the lock in each exchange.
    has_fault: AtomicBool,
    /// Why the last session ended or did not begin.
    fault: Mutex<Option<String>>,
}

impl LineCounters {
    /// Returns counters at 0.
    #[must_use]
    pub fn new(settings: &EthercatSettings) -> LineCounters {
        let terminals = settings.terminals.iter().map(|one| TerminalCounters {
            name: one.name.clone(),
            kind: one.type_name(),
            state: AtomicU8::new(UNKNOWN),
            errors: Default::default(),
            clock_ns: AtomicI64::new(NO_CLOCK),
        });
        let drives = settings.axes.iter().map(|axis| DriveCounters {
            joint: axis.joint.clone(),
            terminal: axis.terminal.clone(),
            words: AtomicU32::new(0),
        });
        LineCounters {
            drives: drives.collect(),
            interface: settings.interface.to_string(),
            clocks: settings.clocks.is_some(),
            terminals: terminals.collect(),
            frames: FrameCounts::default(),
            sessions: AtomicU64::new(0),
            complete: AtomicU64::new(0),
            silent: AtomicU64::new(0),
            wrong: AtomicU64::new(0),
            last_wrong: Default::default(),
            reason: AtomicU32::new(0),
            has_fault: AtomicBool::new(false),
            fault: Mutex::new(None),
        }
    }

    /// Counts a complete exchange.
    pub fn count_complete(&self) {
        self.complete.fetch_add(1, Relaxed);
    }

    /// Counts a lost exchange.
    pub fn count_loss(&self, loss: Loss) {
        match loss {
            Loss::Silent => {
                self.silent.fetch_add(1, Relaxed);
            }
            Loss::WorkingCounter { have, want } => {
                self.wrong.fetch_add(1, Relaxed);
                let [last_have, last_want] = &self.last_wrong;
                last_have.store(have.into(), Relaxed);
                last_want.store(want.into(), Relaxed);
            }
            Loss::Starting | Loss::Unconfirmed => {}
        }
    }

    /// Returns the number of exchanges that were lost.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.silent.load(Relaxed) + self.wrong.load(Relaxed)
    }

    /// Returns the number of packets that were no answer.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.frames.refused.load(Relaxed)
    }

    /// Stores the states of all terminals.
    pub fn states(&self, states: &[SubDeviceState]) {
        for (terminal, state) in self.terminals.iter().zip(states) {
            terminal.state.store(u8::from(*state), Relaxed);
        }
    }

    /// Stores what the drives show.
    pub fn drives<'a>(&self, drives: impl Iterator<Item = &'a DriveStatus>) {
        for (own, drive) in self.drives.iter().zip(drives) {
            let words = u32::from(drive.error) << 16 | u32::from(drive.word);
            own.words.store(words, Relaxed);
        }
    }

    /// Stores the error counters of a terminal.
    pub fn port_errors(&self, position: usize, errors: PortErrors) {
        let Some(terminal) = self.terminals.get(position) else {
            return;
        };
        let PortErrors {
            invalid_frames,
            receive_errors,
            forwarded,
            lost_links,
        } = errors;
        let all = [invalid_frames, receive_errors, forwarded, lost_links];
        for (place, values) in terminal.errors.iter().zip(all) {
            place.store(u32::from_le_bytes(values), Relaxed);
        }
    }

    /// Stores the difference of a terminal's clock from the reference clock, ns.
    pub fn clock_difference(&self, position: usize, difference_ns: i64) {
        if let Some(terminal) = self.terminals.get(position) {
            terminal.clock_ns.store(difference_ns, Relaxed);
        }
    }

    /// Counts a session that begins; the clocks of before are not known any more.
    pub fn begin_session(&self) {
        for terminal in &self.terminals {
            terminal.clock_ns.store(NO_CLOCK, Relaxed);
        }
        self.sessions.fetch_add(1, Relaxed);
    }

    /// Stores the present reason; 0 = none.
    pub fn set_reason(&self, reason: u32) {
        self.reason.store(reason, Relaxed);
    }

    /// Forgets the fault, if there is one: the line is in OP.
    pub fn clear_fault(&self) {
        if self.has_fault.swap(false, Relaxed) {
            *self.fault.lock().unwrap_or_else(PoisonError::into_inner) = None;
        }
    }

    /// Stores why a session ended; returns true if this is another cause than before.
    pub fn set_fault(&self, fault: Option<String>) -> bool {
        let mut place = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
        let changed = *place != fault;
        self.has_fault.store(fault.is_some(), Relaxed);
        *place = fault;
        changed
    }
}

impl LinkDiagnosis for LineCounters {
    fn link(&self) -> Value {
        let fault = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
        let [have, want] = &self.last_wrong;
        let terminals = self.terminals.iter().zip(1..).map(|(terminal, position)| {
            let [invalid, receive, forwarded, lost] = &terminal.errors;
            let ports = |counters: &AtomicU32| counters.load(Relaxed).to_le_bytes();
            json!({
                "position": position,
                "name": terminal.name,
                "type": terminal.kind,
                "state": state_name(terminal.state.load(Relaxed)),
                "invalid_frames": ports(invalid),
                "receive_errors": ports(receive),
                "forwarded_errors": ports(forwarded),
                "lost_links": ports(lost),
                "clock_difference_ns": known(terminal.clock_ns.load(Relaxed)),
            })
        });
        let drives = self.drives.iter().map(|drive| {
            let words = drive.words.load(Relaxed);
            json!({
                "joint": drive.joint,
                "terminal": drive.terminal,
                "state": PowerState::of(words as u16).name(),
                "error_code": words >> 16,
            })
        });
        json!({
            "drives": drives.collect::<Vec<_>>(),
            "interface": self.interface,
            "distributed_clocks": self.clocks,
            "reason": self.reason.load(Relaxed),
            "fault": *fault,
            "sessions": self.sessions.load(Relaxed),
            "complete": self.complete.load(Relaxed),
            "silent": self.silent.load(Relaxed),
            "wrong_working_counter": self.wrong.load(Relaxed),
            "last_wrong": {"have": have.load(Relaxed), "want": want.load(Relaxed)},
            "unsent_frames": self.frames.unsent.load(Relaxed),
            "refused_packets": self.frames.refused.load(Relaxed),
            "terminals": terminals.collect::<Vec<_>>(),
        })
    }
}

/// Returns a difference of clocks; `None` if it was never read.
fn known(difference_ns: i64) -> Option<i64> {
    (difference_ns != NO_CLOCK).then_some(difference_ns)
}

/// Returns the name of a state by its number (ETG.1000.6, table 9).
fn state_name(number: u8) -> &'static str {
    match number {
        0 => "no answer",
        1 => "INIT",
        2 => "PREOP",
        3 => "BOOT",
        4 => "SAFEOP",
        8 => "OP",
        UNKNOWN => "unknown",
        _ => "invalid",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_driver_kit::conformance::device;

    #[test]
    fn the_diagnosis_has_states_counters_and_the_fault() {
        let terminals = json!({"in": {"position": 1, "type": "EL1008"}, "out": {"position": 2, "type": "EL2008"}});
        let settings = json!({"interface": "eth1", "terminals": terminals});
        let settings = EthercatSettings::new(&device("ethercat", settings, &[])).unwrap();
        let counters = LineCounters::new(&settings);
        counters.states(&[SubDeviceState::Op]);
        counters.count_loss(Loss::WorkingCounter { have: 1, want: 3 });
        let errors = PortErrors {
            lost_links: [0, 2, 0, 0],
            ..PortErrors::default()
        };
        counters.port_errors(1, errors);
        assert!(counters.set_fault(Some("pulled".to_owned())));
        assert!(!counters.set_fault(Some("pulled".to_owned())));
        let link = counters.link();
        assert_eq!(link["terminals"][0]["state"], "OP");
        assert_eq!(link["terminals"][1]["state"], "unknown");
        assert_eq!(link["terminals"][1]["lost_links"], json!([0, 2, 0, 0]));
        assert_eq!(link["last_wrong"], json!({"have": 1, "want": 3}));
        assert_eq!(
            (&link["fault"], &link["wrong_working_counter"]),
            (&json!("pulled"), &json!(1))
        );
    }
}
