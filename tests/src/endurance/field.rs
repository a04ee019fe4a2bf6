//! State shared by the threads of an endurance run: the cell, its journal, counters, and requests that survive a dead loader.
//! Used by all of them.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use rcc_core::message::DeviceState;
use rcc_ipc::clean;
use rcc_os::process_instance::ProcessInstance;
use serde_json::Value;

use super::{Options, PRIORITY};
use crate::cell_fixture::{CellFixture, ExecutorBoards};
use crate::journal::{Journal, Random};
use crate::process::Process;
use crate::rest::Reply;
use crate::{await_some, await_told};

/// Index of the arm in the demo's configuration.
pub const ARM: usize = 0;
/// Index of the I/O station.
pub const IO: usize = 1;

macro_rules! counts {
    ($($field:ident: $words:literal,)*) => {
        /// How often each thing was done.
        #[derive(Debug, Default)]
        pub struct Counts {
            $(#[doc = $words] pub $field: AtomicU64,)*
        }

        impl Counts {
            /// All of them, with their words.
            pub fn numbers(&self) -> Vec<(&'static str, u64)> {
                vec![$(($words, self.$field.load(Ordering::Relaxed)),)*]
            }
        }
    };
}

counts! {
    finished: "motions that finished",
    canceled: "motions that were canceled",
    aborted: "motions that were aborted",
    killed: "motions whose driver was killed",
    disturbed: "motions that ended by a fault although nothing was killed",
    arm_restarts: "the arm's driver killed and started again",
    arm_starts_killed: "the arm's driver killed while it started",
    io_restarts: "the I/O driver killed and started again",
    io_starts_killed: "the I/O driver killed while it started",
    lamps: "nets on the I/O station",
    loaders: "loaders killed and started again",
    pairs: "two processes killed at the same moment, in motion",
    executor_pairs: "of them: the executor and another one",
    tails: "monitors that came, stalled and went",
    big_nets: "big nets loaded (50 to 1,500 primitives)",
    big_runs: "big nets run beside the motion",
    requests: "REST requests",
    refused: "of them without an answer (no loader at the moment), or refused for their number",
    janitors: "runs of the janitor",
}

impl Counts {
    /// Driver restarts of both devices.
    pub fn restarts(&self) -> u64 {
        let sum = [&self.arm_restarts, &self.io_restarts];
        let sum = sum
            .into_iter()
            .chain([&self.arm_starts_killed, &self.io_starts_killed]);
        sum.map(|count| count.load(Ordering::Relaxed)).sum()
    }

    /// Monitors so far.
    pub fn monitors(&self) -> u64 {
        self.tails.load(Ordering::Relaxed)
    }

    /// Motions so far.
    pub fn motions(&self) -> u64 {
        let all = [
            &self.finished,
            &self.canceled,
            &self.aborted,
            &self.killed,
            &self.disturbed,
        ];
        all.into_iter()
            .map(|count| count.load(Ordering::Relaxed))
            .sum()
    }
}

/// One more.
pub fn count(counter: &AtomicU64) {
    // Relaxed: only a number for people.
    counter.fetch_add(1, Ordering::Relaxed);
}

/// State shared by the threads.
#[derive(Debug)]
pub struct Field<'a> {
    /// The cell.
    pub place: &'a CellFixture,
    /// Options of the run.
    pub options: Options,
    /// Process id of the executor.
    executor: AtomicU32,
    /// Start of the run.
    pub begun: Instant,
    /// Log of the events.
    pub journal: Arc<Journal>,
    /// Number of times that each action was carried out.
    pub counts: Counts,
    /// The arm's driver; held while it is restarted.
    pub arm_driver: Mutex<Process>,
    /// The I/O driver; held while it is restarted, or must not be.
    pub io_driver: Mutex<Process>,
    /// The loader; held while it is restarted.
    pub loader: Mutex<Process>,
    /// Held while the janitor works: it is one at a time in any case.
    janitor: Mutex<()>,
    disturbed: Mutex<Vec<String>>,
}

impl<'a> Field<'a> {
    /// Nothing has happened yet.
    pub fn new(
        place: &'a CellFixture,
        options: Options,
        executor: u32,
        journal: Arc<Journal>,
    ) -> Self {
        Field {
            place,
            options,
            executor: AtomicU32::new(executor),
            begun: Instant::now(),
            journal,
            counts: Counts::default(),
            arm_driver: Mutex::new(Process::driver(place, "lwr", PRIORITY)),
            io_driver: Mutex::new(Process::driver(place, "io", PRIORITY)),
            loader: Mutex::new(Process::of_cell(place, "loader", "rcc-loader", &[])),
            janitor: Mutex::default(),
            disturbed: Mutex::default(),
        }
    }

    /// Process id of the executor.
    pub fn executor(&self) -> u32 {
        // Relaxed: it changes only in a quiet moment, which is a lock.
        self.executor.load(Ordering::Relaxed)
    }

    /// Another executor is there.
    pub fn set_executor(&self, pid: u32) {
        self.executor.store(pid, Ordering::Relaxed);
    }

    /// Choices of a thread.
    pub fn random(&self, thread: u64) -> Random {
        Random::new(self.options.seed, thread)
    }

    /// One request, again and again until it is answered by a loader that reaches its executor. A loader that was killed
    /// is restarted.
    pub fn ask(&self, method: &str, path: &str, body: &str) -> Reply {
        await_told(&format!("an answer to {method} {path}"), || {
            let reply = self.try_ask(method, path, body);
            if reply.is_none()
                && let Ok(mut loader) = self.loader.try_lock()
            {
                self.restart_loader(&mut loader);
            }
            let reply = reply.ok_or("no answer")?;
            let later = reply.status >= 500 || reply.status == 429;
            if later {
                std::thread::sleep(Duration::from_millis(20));
                return Err(format!("{reply:?}"));
            }
            Ok(reply)
        })
    }

    /// Starts the loader and waits until it answers.
    pub fn start_loader(&self, loader: &mut Process) {
        loader.start(self.place);
        await_some("the loader to answer", || {
            self.place.try_rest("GET", "/status", "")
        });
    }

    /// Starts the loader if it was killed.
    pub fn restart_loader(&self, loader: &mut Process) {
        if loader.ended().is_some() {
            self.start_loader(loader);
            self.clean();
        }
    }

    /// One request; `None` if nobody answers.
    pub fn try_ask(&self, method: &str, path: &str, body: &str) -> Option<Reply> {
        count(&self.counts.requests);
        let reply = self.place.try_rest(method, path, body);
        if reply.as_ref().is_none_or(|reply| reply.status == 429) {
            count(&self.counts.refused);
        }
        reply
    }

    /// Loads a net whose name is given to no other one, also when the loader dies meanwhile; it must become ready.
    pub fn load(&self, name: &str, text: &str) -> u64 {
        await_told(&format!("net {name} to be ready"), || {
            let found = self.ask("GET", &format!("/commands/{name}"), "");
            let row = match found.status {
                200 => found.body,
                _ => {
                    // Without an answer it may have been taken: the next round looks.
                    let reply = self.try_ask("POST", "/commands", text);
                    let reply = reply.ok_or("no answer to LOAD")?;
                    assert!(
                        reply.status == 202 || reply.status >= 429,
                        "{name}: {reply:?}"
                    );
                    return Err(format!("{found:?}, LOAD: {reply:?}"));
                }
            };
            let id = row["id"].as_u64().ok_or_else(|| row.to_string())?;
            if row["state"] == "rejected" {
                // A loader that died while it loaded: RCC3017.
                let died = row.to_string().contains("RCC3017");
                assert!(died, "{name}: {row}");
                self.unload(id);
                return Err(row.to_string());
            }
            match row["state"] != "loading" {
                true => Ok(id),
                false => Err(row.to_string()),
            }
        })
    }

    /// Starts a command as soon as its devices allow it, also when the loader dies meanwhile.
    pub fn start(&self, id: u64) {
        await_told(&format!("the start of {id}"), || {
            if self.row(id)["state"] != "ready" {
                return Ok(());
            }
            let reply = self.try_ask("POST", &format!("/commands/{id}/start"), "");
            let reply = reply.ok_or("no answer")?;
            let later = matches!(reply.code(), "RCC3008" | "RCC3004" | "RCC3003");
            let later = later || reply.status >= 429;
            assert!(reply.status == 200 || later, "start {id}: {reply:?}");
            match reply.status {
                200 => Ok(()),
                _ => Err(format!("{reply:?}")),
            }
        });
    }

    /// `cancel` or `abort`; it may have ended meanwhile.
    pub fn stop(&self, id: u64, what: &str) {
        let reply = self.ask("POST", &format!("/commands/{id}/{what}"), "");
        let over = matches!(reply.code(), "RCC3003");
        assert!(reply.status == 200 || over, "{what} {id}: {reply:?}");
    }

    /// The row of a command.
    pub fn row(&self, id: u64) -> Value {
        let reply = self.ask("GET", &format!("/commands/{id}"), "");
        assert_eq!(reply.status, 200, "{id}: {reply:?}");
        reply.body
    }

    /// Waits until a command is terminated; returns its row.
    pub fn await_end(&self, id: u64) -> Value {
        await_some(&format!("the end of command {id}"), || {
            let row = self.row(id);
            (row["state"] == "terminated").then_some(row)
        })
    }

    /// Removes a command.
    pub fn unload(&self, id: u64) {
        let reply = self.ask("DELETE", &format!("/commands/{id}"), "");
        assert!(matches!(reply.status, 200 | 404), "unload {id}: {reply:?}");
    }

    /// Unloads the commands of loaders that died before they answered: nobody knows their ids, and they stay, rejected,
    /// until they are unloaded.
    pub fn unload_rejected(&self) {
        let commands = self.ask("GET", "/commands", "").body;
        let rows = commands.as_array().expect("a list of commands").iter();
        for row in rows.filter(|row| row["state"] == "rejected") {
            self.unload(row["id"].as_u64().expect("an id"));
        }
    }

    /// Runs the janitor, as a supervisor does after a death.
    pub fn clean(&self) {
        let _one = self.janitor.lock().unwrap_or_else(|held| held.into_inner());
        await_some("the janitor", || {
            count(&self.counts.janitors);
            clean::run_janitor(self.place.cell(), clean::JANITOR_TIMEOUT).ok()
        });
    }

    /// Asks a process to end, which it must.
    pub fn end(&self, process: &mut Process) {
        match process.end(Signal::SIGTERM) {
            Some(status) if status.success() => {}
            status => {
                let name = process.name();
                self.journal
                    .add_finding(format!("{name} after SIGTERM: {status:?}"));
            }
        }
    }

    /// Waits until the executor sees this life of a driver, and its device is ready.
    pub fn await_driver(&self, watch: &ExecutorBoards, device: usize, pid: u32) {
        await_told(&format!("driver {pid} to be ready"), || {
            let row = watch.tables().devices[device];
            let seen = ProcessInstance::from_incarnation(row.incarnation).pid;
            match seen == pid && row.state == DeviceState::Ready as u32 {
                true => Ok(()),
                false => Err(format!("driver {seen} is seen, in state {}", row.state)),
            }
        });
    }

    /// Looks at the boards of the executor that lives now.
    pub fn renew(&self, watch: &mut ExecutorBoards) {
        let seen = watch.status().incarnation;
        if ProcessInstance::from_incarnation(seen).pid != self.executor() {
            *watch = self.place.watch();
        }
    }

    /// Keeps how a motion ended that should have ended otherwise.
    pub fn keep_disturbed(&self, what: String) {
        self.journal.note(what.clone());
        let mut all = self
            .disturbed
            .lock()
            .unwrap_or_else(|held| held.into_inner());
        if all.len() < 50 {
            all.push(what);
        }
    }

    /// See [`Field::keep_disturbed`].
    pub fn disturbed(&self) -> Vec<String> {
        let all = self
            .disturbed
            .lock()
            .unwrap_or_else(|held| held.into_inner());
        all.clone()
    }
}

/// The process, whose last holder may have failed: it is a handle, and those are whole.
pub fn held(process: &Mutex<Process>) -> MutexGuard<'_, Process> {
    process.lock().unwrap_or_else(PoisonError::into_inner)
}
