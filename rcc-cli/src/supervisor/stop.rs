//! Ends a cell: cancels commands, waits until devices are at rest, ends the processes in order, and removes all files but
//! the state folder.
//! Run by the supervisor's thread.

use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use rcc_api::bodies::{CommandView, DeviceView, StatusView};
use rcc_ipc::clean::WipeError;
use rcc_ipc::ownership;
use rcc_protocol::events::{EventKind, event_text};

use super::child::{self, ProcessState};
use super::processes::ProcessKind;
use super::{POLL_INTERVAL, Supervisor};
use crate::follow;
use crate::interrupt::Interrupts;

/// Longest time for nets to end after CANCEL.
const CANCEL_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest time for devices to come to rest.
const REST_TIMEOUT: Duration = Duration::from_secs(5);
/// Longest time for monitors to leave the cell.
const LEAVE_TIMEOUT: Duration = Duration::from_secs(2);

impl Supervisor {
    /// Ends the cell: cancels the nets, waits for rest, stops executor, loader, drivers and simulators, and removes all
    /// files but the event log, incidents and logs. A second Ctrl-C skips the waiting. Returns true if nothing was left behind and no process had to be
    /// killed.
    pub fn stop(mut self, interrupts: &Interrupts) -> bool {
        self.record(EventKind::CellStopping {
            why: "requested (Ctrl-C, SIGTERM, or end of its task)".to_owned(),
        });
        let asked = interrupts.count();
        let is_impatient = || interrupts.count() > asked;
        // Commands of an executor that this supervisor did not start are left alone.
        if self.has_own_executor() {
            self.end_nets(&is_impatient);
            self.wait_for_rest(&is_impatient);
        }
        let mut clean_end = true;
        for kind in ProcessKind::ALL {
            clean_end &= self.stop_processes(kind);
        }
        clean_end & self.remove_files()
    }

    /// Returns true unless the loader serves an executor that this supervisor did not start.
    fn has_own_executor(&self) -> bool {
        let own = self.pid("executor");
        let served = self.client.get::<StatusView>("/status").ok();
        own.is_some() && served.is_none_or(|status| Some(status.executor.pid) == own)
    }

    fn end_nets(&mut self, is_impatient: &dyn Fn() -> bool) {
        let started = Instant::now();
        let mut canceled = Vec::new();
        loop {
            let Ok(commands) = self.client.get::<Vec<CommandView>>("/commands") else {
                return;
            };
            let active = commands.iter().filter(|command| command.is_active());
            let active: Vec<&CommandView> = active.collect();
            if active.is_empty() {
                return;
            }
            let late = is_impatient() || started.elapsed() > CANCEL_TIMEOUT;
            for command in active {
                let gently = command.can_cancel && !late;
                if gently && canceled.contains(&command.id) {
                    continue;
                }
                canceled.push(command.id);
                let what = if gently { "cancel" } else { "abort" };
                self.report(&follow::title(command), what);
                // It may have ended meanwhile; the next poll shows that.
                let _ = follow::operate(&self.client, &command.id.to_string(), what);
            }
            if started.elapsed() > CANCEL_TIMEOUT * 2 {
                return;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    fn wait_for_rest(&mut self, is_impatient: &dyn Fn() -> bool) {
        let started = Instant::now();
        while started.elapsed() < REST_TIMEOUT && !is_impatient() {
            let Ok(devices) = self.client.get::<Vec<DeviceView>>("/devices") else {
                return;
            };
            let moving =
                |device: &DeviceView| matches!(device.state.as_str(), "commanded" | "stopping");
            if !devices.iter().any(moving) {
                return;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// Sends SIGTERM to all processes of a kind, then SIGKILL to those that remain. Returns true if none was killed.
    fn stop_processes(&mut self, kind: ProcessKind) -> bool {
        let of_kind = |child: &&mut child::Child| child.spec.kind == kind;
        for child in self.children.iter_mut().filter(of_kind) {
            child.signal(Signal::SIGTERM);
        }
        let limit = Instant::now() + self.stop_timeout();
        let mut killed = Vec::new();
        for child in self.children.iter_mut().filter(of_kind) {
            while child.pid().is_some() && child.ended().is_none() {
                if Instant::now() >= limit {
                    child.signal(Signal::SIGKILL);
                    killed.push(child.spec.name.clone());
                    break;
                }
                std::thread::sleep(POLL_INTERVAL / 4);
            }
            if let ProcessState::Starting(mut process) | ProcessState::Up(mut process) =
                std::mem::replace(&mut child.state, ProcessState::Failed)
            {
                // It has ended or was killed: this returns at once and leaves no zombie.
                let _ = process.wait();
            }
        }
        for name in &killed {
            self.report(name, "did not terminate and was killed");
        }
        killed.is_empty()
    }

    fn remove_files(mut self) -> bool {
        let limit = Instant::now() + LEAVE_TIMEOUT;
        // The cell stays claimed until its files are gone, so that nobody can claim it in between and lose files.
        let mut removed = ownership::release(&self.cell, &self.presence);
        // Monitors leave the cell a moment after the executor.
        while matches!(removed, Err(WipeError::InUse { .. })) && Instant::now() < limit {
            std::thread::sleep(POLL_INTERVAL);
            removed = ownership::release(&self.cell, &self.presence);
        }
        // Once released, the cell may already have a new owner, whose files are not ours.
        let Err(error) = &removed else {
            let kept = self.cell.state().path().display().to_string();
            self.record(EventKind::CellEnded {
                kept: event_text(&kept),
            });
            self.report(
                "cell",
                &format!("ended; events, incidents and logs stay in {kept}"),
            );
            return true;
        };
        self.report("cell", &error.to_string());
        for path in self.cell.leftovers().unwrap_or_default() {
            self.report("cell", &format!("left behind: {}", path.display()));
        }
        false
    }
}
