//! A fake executor without cycles: it keeps a table and answers calls.

use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use bytemuck::Zeroable;
use rcc_core::frame::PrepareFault;
use rcc_core::message::{
    CommandEntry, CommandState, CycleStatus, DeviceState, EndReason, MAGIC, Tables,
};
use rcc_core::timing::CycleTiming;
use rcc_ipc::{Announced, BoardWriter, Cell, Server, Session};
use rcc_protocol::control::{Answer, CONTROL, Call, NetValues, Refusal, STATUS, TABLES, TIMING};
use rcc_protocol::rules::{ListedRule, RuleFault, RuleState, RuleStatus};
use rcc_protocol::{Configuration, Role, wire};
use rcc_testing::TempDir;

/// A cell in a temporary folder, removed at the end of its test.
pub struct TestCell {
    pub cell: Cell,
    _folder: TempDir,
}

impl TestCell {
    pub fn new(name: &str) -> TestCell {
        let folder = rcc_testing::folder();
        TestCell {
            cell: Cell::at(name, folder.path()).expect("a cell"),
            _folder: folder,
        }
    }
}

impl Drop for TestCell {
    fn drop(&mut self) {
        let wiped = rcc_ipc::clean::remove_cell(&self.cell);
        if !thread::panicking() {
            wiped.expect("every session of the test is closed");
        }
    }
}

/// The calls to the fake executor, and what it observed.
#[derive(Default)]
pub struct CallLog {
    pub calls: Vec<Call>,
    /// True if the file with the names already existed at Install.
    pub named_before_install: bool,
    /// While true, only CANCEL and ABORT are answered.
    pub holds: bool,
}

/// The fake executor; it ends when dropped.
pub struct FakeExecutor {
    pub incarnation: u64,
    pub seen: Arc<Mutex<CallLog>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

struct State {
    cell: Cell,
    incarnation: u64,
    tables: Box<Tables>,
    board: BoardWriter<Tables>,
    seen: Arc<Mutex<CallLog>>,
    refuse_install: Option<Refusal>,
    next_id: u64,
    rules: Vec<ListedRule>,
}

impl FakeExecutor {
    /// Starts a fake executor with these commands in its table; it answers Install with `refuse`, if given.
    pub fn start(
        cell: &Cell,
        rows: &[(u64, CommandState)],
        refuse: Option<Refusal>,
    ) -> FakeExecutor {
        let session = Session::join(cell, Role::Executor, "exec").expect("join");
        let server = session.serve(CONTROL).expect("serve");
        let mut status = session.create_board::<CycleStatus>(STATUS).expect("status");
        let board = session.create_board::<Tables>(TABLES).expect("tables");
        let timing = session.create_board::<CycleTiming>(TIMING).expect("timing");
        let helpers = session
            .create_board::<rcc_core::helper::HelperTable>(rcc_protocol::control::HELPERS)
            .expect("helpers");
        status.write(&CycleStatus {
            magic: MAGIC,
            cycle: 7,
            grants: 3,
            ..CycleStatus::zeroed()
        });
        let announced = cell
            .announce(
                &session
                    .announcement()
                    .configured(Configuration::new(crate::test_server::config().identity()))
                    .service(CONTROL, server.service())
                    .service(STATUS, status.service())
                    .service(TABLES, board.service())
                    .service(TIMING, timing.service())
                    .service(rcc_protocol::control::HELPERS, helpers.service()),
            )
            .expect("announce");
        let mut tables = Box::new(Tables::zeroed());
        tables.magic = MAGIC;
        // The position of a device without a driver is not known.
        let unknown = matches!(
            refuse,
            Some(Refusal::Prepare(PrepareFault::HoldUnknown { device: 0 }))
        );
        if !unknown {
            tables.devices[0].state = DeviceState::Ready as u32;
            tables.devices[0].attached = 1;
        }
        for (row, (id, state)) in tables.commands.iter_mut().zip(rows) {
            (row.id, row.state) = (*id, *state as u32);
            if *state == CommandState::Terminated {
                row.reason = EndReason::Finished as u32;
            }
        }
        let seen = Arc::new(Mutex::new(CallLog::default()));
        let stop = Arc::new(AtomicBool::new(false));
        let incarnation = session.incarnation();
        let mut state = State {
            cell: cell.clone(),
            incarnation,
            tables,
            board,
            seen: Arc::clone(&seen),
            refuse_install: refuse,
            next_id: 100,
            rules: Vec::new(),
        };
        state.board.write(&state.tables);
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            serve(&server, &mut state, &stopped);
            drop((
                announced as Announced,
                (status, timing, helpers),
                state,
                server,
                session,
            ));
        });
        FakeExecutor {
            incarnation,
            seen,
            stop,
            thread: Some(thread),
        }
    }
}

#[allow(dead_code)] // Each test program uses only a part of it.
impl FakeExecutor {
    /// Holds back all answers except those to CANCEL and ABORT, or releases them.
    pub fn hold(&self, holds: bool) {
        self.seen.lock().expect("seen").holds = holds;
    }

    /// Waits until `count` of the received calls match.
    pub fn wait_for_calls(&self, count: usize, such: impl Fn(&Call) -> bool) {
        let begun = std::time::Instant::now();
        while self.count(&such) < count {
            assert!(
                begun.elapsed() < Duration::from_secs(60),
                "it never saw them"
            );
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// Returns how many of the received calls match.
    pub fn count(&self, such: impl Fn(&Call) -> bool) -> usize {
        let seen = self.seen.lock().expect("seen");
        seen.calls.iter().filter(|call| such(call)).count()
    }
}

impl Drop for FakeExecutor {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn serve(server: &Server, state: &mut State, stop: &AtomicBool) {
    let mut held = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        let request = server.poll().expect("poll");
        let idle = request.is_none();
        if let Some(request) = request {
            let call: Call = wire::decode(request.bytes()).expect("a call");
            let answer = state.answer(call.clone());
            held.push((request, call, answer));
        }
        let holds = state.seen.lock().expect("seen").holds;
        let waits =
            |call: &Call| holds && !matches!(call, Call::Cancel { .. } | Call::Abort { .. });
        for (request, call, answer) in std::mem::take(&mut held) {
            if waits(&call) {
                held.push((request, call, answer));
                continue;
            }
            let bytes = wire::encode(&answer).expect("an answer");
            // The client may have given up.
            let _ = request.answer(&bytes);
        }
        if idle {
            thread::sleep(Duration::from_millis(1));
        }
    }
}

impl State {
    fn answer(&mut self, call: Call) -> Answer {
        self.seen.lock().expect("seen").calls.push(call.clone());
        let answer = match call {
            Call::Reserve => {
                self.next_id += 1;
                let free = self.tables.commands.iter_mut().find(|row| row.id == 0);
                let row = free.expect("a free row");
                (row.id, row.state) = (self.next_id, CommandState::Loading as u32);
                Answer::Reserved { id: self.next_id }
            }
            Call::Install { id, .. } => {
                let folder = format!("{:016x}", self.incarnation);
                let file = self
                    .cell
                    .commands_dir()
                    .join(folder)
                    .join(format!("{id}.json"));
                self.seen.lock().expect("seen").named_before_install = file.is_file();
                match self.refuse_install {
                    Some(refusal) => {
                        self.set(id, CommandState::Rejected);
                        Answer::Refused(refusal)
                    }
                    None => self.set(id, CommandState::Ready),
                }
            }
            Call::Reject { id } => self.set(id, CommandState::Rejected),
            Call::Start { lease, .. } if ![0, 3].contains(&lease) => {
                Answer::Refused(Refusal::LeaseEnded { lease })
            }
            Call::Start { id, .. } => match self.row(id).map(|row| row.state) {
                Some(state) if state == CommandState::Rejected as u32 => {
                    Answer::Refused(Refusal::WrongState { state })
                }
                _ => self.set(id, CommandState::Running),
            },
            Call::Switch { stop, start, .. } => {
                for id in stop {
                    self.set(id, CommandState::Terminated);
                }
                for id in start {
                    self.set(id, CommandState::Running);
                }
                Answer::Done { cycle: 8 }
            }
            Call::Set { id, .. } => match self.row(id) {
                Some(_) => Answer::Done { cycle: 9 },
                None => Answer::Refused(Refusal::UnknownCommand),
            },
            Call::Read { points, .. } => {
                let elements = points.iter().map(|point| point.width as usize).sum();
                Answer::Values(NetValues {
                    cycle: 8,
                    evaluations: 3,
                    every: 2,
                    state: CommandState::Running as u32,
                    words: vec![0.25f64.to_bits(); elements],
                })
            }
            Call::Cancel { .. } => Answer::Refused(Refusal::NotCancelable),
            Call::Abort { id } => self.set(id, CommandState::Terminated),
            Call::Unload { id } => match self.row(id) {
                Some(row) => {
                    row.id = 0;
                    Answer::Done { cycle: 0 }
                }
                None => Answer::Refused(Refusal::UnknownCommand),
            },
            Call::Record | Call::Recorded { .. } => Answer::Refused(Refusal::NoRecorder),
            Call::Acknowledge => Answer::Done { cycle: 8 },
            Call::InstallRules { rules } => {
                let first = self.rules.len() as u64 + 1;
                for (new, id) in rules.into_iter().zip(first..) {
                    let status = RuleStatus {
                        id,
                        state: RuleState::Armed,
                        cycle: 8,
                        lease: new.rule.lease,
                        goes_on: new.rule.goes_on,
                        ..RuleStatus::NONE
                    };
                    self.rules.push(ListedRule {
                        rule: new.rule,
                        status,
                        name: new.name,
                        when: new.when,
                    });
                }
                Answer::RulesInstalled { first, cycle: 8 }
            }
            Call::Rules { after } => {
                let rules = self.rules.iter().filter(|rule| rule.status.id > after);
                Answer::Rules(rules.take(2).cloned().collect())
            }
            Call::RemoveRule { id } => {
                let count = self.rules.len();
                self.rules.retain(|rule| rule.status.id != id);
                match self.rules.len() < count {
                    true => Answer::Done { cycle: 8 },
                    false => Answer::Refused(Refusal::UnknownRule),
                }
            }
            Call::GrantLease { .. } => Answer::Reserved { id: 3 },
            Call::RenewLease { lease: 3 } | Call::EndLease { lease: 3 } => {
                Answer::Done { cycle: 8 }
            }
            Call::BindLease { lease: 3, .. } => Answer::Done { cycle: 8 },
            Call::RenewLease { .. } | Call::EndLease { .. } | Call::BindLease { .. } => {
                Answer::Refused(Refusal::Rule {
                    index: 0,
                    fault: RuleFault::LeaseUnknown,
                })
            }
        };
        self.board.write(&self.tables);
        answer
    }

    fn row(&mut self, id: u64) -> Option<&mut CommandEntry> {
        self.tables.commands.iter_mut().find(|row| row.id == id)
    }

    fn set(&mut self, id: u64, state: CommandState) -> Answer {
        match self.row(id) {
            Some(row) => {
                row.state = state as u32;
                Answer::Done { cycle: 8 }
            }
            None => Answer::Refused(Refusal::UnknownCommand),
        }
    }
}
