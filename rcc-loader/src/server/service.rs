//! Services of the loader for its clients: the life cycle of commands by name, and queries. Every function may block for
//! a while and is run by blocking threads, never by the thread that serves connections.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, RwLock};

use rcc_api::bodies::{CommandView, Done};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::messages::{self, NameResolver};
use rcc_config::CellConfig;
use rcc_core::message::{CommandEntry, CommandState, EndReason};
use rcc_ipc::events::EventRecorder;
use rcc_language::devices::DeviceTable;
use rcc_language::names::Names;
use rcc_process::Helpers;
use rcc_protocol::control::{Answer, Call, Refusal};
use rcc_protocol::ending::{ending, why_at_once};
use rcc_protocol::events::{EventKind, hex_digits};
use rcc_protocol::{Announcement, Configuration};
use serde::Serialize;

use super::address::{self, CommandAddress};
use super::caller::Caller;
use super::command_summary::CommandSummary;
use super::executor::{ExecutorConnection, ExecutorLink, TableSnapshot};
use super::published::Published;
use super::store::CommandStore;
use configuration::WatchedFiles;
pub use load::CompiledText;
pub use set_points::{LINES_MAX, LineQueue, SetPointChannel};
pub use stream::{EventStream, STREAM_NETS_MAX, StreamRequest, USUAL_RATE_MAX};

mod check;
mod configuration;
pub mod events;
mod handover;
pub mod history;
mod incidents;
mod load;
mod maintenance;
mod recording;
mod rules;
mod set_points;
mod status;
mod stream;
mod timing;
mod topics;
mod unloaded;
mod values;

/// The loader of one cell.
pub struct Service {
    executor: ExecutorLink,
    config: CellConfig,
    /// Its devices, for the compiler.
    devices: DeviceTable,
    /// This loader's announcement.
    own: Announcement,
    /// Incarnation of the last known executor, and the configuration by which its devices and channels are named: the
    /// part of [`Service::config`] that also holds for it.
    naming: Published<(u64, Arc<CellConfig>)>,
    files: Mutex<WatchedFiles>,
    /// Commands that this process is loading; distinguishes them from commands that a dead loader left `loading`.
    loading: Published<BTreeMap<u64, Arc<CommandSummary>>>,
    /// Commands that are `loading` in the executor's table and that this process is not loading.
    unclaimed: Mutex<maintenance::UnclaimedCommands>,
    recorder: Option<EventRecorder>,
    /// The helper threads of this process, for status queries.
    helpers: Helpers,
    /// Process id and incarnation of the executor that was last reported to the event log.
    reported_executor: RwLock<Option<(u32, u64)>>,
    event_log: events::SharedEventLog,
    history: history::History,
    unloaded: unloaded::UnloadedCommands,
    /// Incarnation of the executor, and its commands.
    store: RwLock<Option<(u64, Arc<CommandStore>)>>,
}

/// A command together with the contents of its file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DetailedCommand {
    /// The command.
    #[serde(flatten)]
    pub command: CommandView,
    /// The text that was loaded.
    pub text: String,
    /// Slots of every port and monitor in the plan.
    pub names: Option<Names>,
}

/// An operation on an existing command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// START.
    Start {
        /// The lease to which the command is bound from then on; 0: as it is bound already, if it is.
        lease: u64,
    },
    /// CANCEL.
    Cancel,
    /// ABORT.
    Abort,
    /// UNLOAD.
    Unload,
}

impl Operation {
    /// START without a lease.
    pub const START: Operation = Operation::Start { lease: 0 };

    /// Returns true for the states in which the operation has an effect.
    fn suits(self, state: CommandState) -> bool {
        match self {
            Operation::Start { .. } => state == CommandState::Ready,
            Operation::Cancel | Operation::Abort => state.is_active(),
            Operation::Unload => !state.is_active(),
        }
    }

    /// Returns the word for it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Operation::Start { .. } => "START",
            Operation::Cancel => "CANCEL",
            Operation::Abort => "ABORT",
            Operation::Unload => "UNLOAD",
        }
    }

    fn call(self, id: u64) -> Call {
        match self {
            Operation::Start { lease } => Call::Start { id, lease },
            Operation::Cancel => Call::Cancel { id },
            Operation::Abort => Call::Abort { id },
            Operation::Unload => Call::Unload { id },
        }
    }
}

impl Service {
    /// Creates the loader service of the cell that `executor` belongs to.
    #[must_use]
    pub fn new(executor: ExecutorLink, config: CellConfig) -> Service {
        let configuration = Configuration::new(config.identity());
        Service {
            own: executor.own().configured(configuration),
            executor,
            naming: Published::new((0, Arc::new(config.clone()))),
            files: Mutex::default(),
            devices: DeviceTable::from(&config),
            config,
            loading: Published::default(),
            unclaimed: Mutex::default(),
            recorder: None,
            helpers: Helpers::default(),
            reported_executor: RwLock::new(None),
            event_log: events::SharedEventLog::default(),
            history: history::History::default(),
            unloaded: unloaded::UnloadedCommands::default(),
            store: RwLock::new(None),
        }
    }

    /// Returns the JSON Schema of nets for this cell.
    #[must_use]
    pub fn schema(&self) -> serde_json::Value {
        rcc_language::schema::schema(Some(&self.devices))
    }

    /// Includes these helper threads of this process in the status.
    #[must_use]
    pub fn with_helpers(mut self, helpers: Helpers) -> Service {
        self.helpers = helpers;
        self
    }

    /// Writes events to the cell's event log.
    #[must_use]
    pub fn with_event_log(mut self, recorder: EventRecorder) -> Service {
        self.recorder = Some(recorder);
        self
    }

    fn record(&self, what: EventKind) {
        if let Some(recorder) = &self.recorder {
            recorder.tell(what);
        }
    }

    /// Reports each executor that is found or lost, once.
    fn report_executor_change(&self, found: Option<(u32, u64)>) {
        // A panic leaves it intact, because it is one value.
        let intact = PoisonError::into_inner;
        let is_known = *self.reported_executor.read().unwrap_or_else(intact) == found;
        if is_known {
            return;
        }
        let intact = PoisonError::into_inner;
        let mut reported_executor = self.reported_executor.write().unwrap_or_else(intact);
        if *reported_executor == found {
            return;
        }
        if let Some((pid, incarnation)) = std::mem::replace(&mut *reported_executor, found) {
            let executor = hex_digits(incarnation);
            self.record(EventKind::ExecutorLost { pid, executor });
        }
        if let Some((pid, incarnation)) = found {
            let executor = hex_digits(incarnation);
            self.record(EventKind::ExecutorFound { pid, executor });
        }
    }

    /// Returns the living executor and the store of its commands. When it is a new one, commands that a dead loader was
    /// loading there are rejected, and the files of dead executors are removed.
    ///
    /// # Errors
    /// Returns an error if there is no executor.
    pub fn attach(&self) -> Result<(Arc<ExecutorConnection>, Arc<CommandStore>), ApiError> {
        let attached = self.executor.attach();
        let found = attached.as_ref().ok().map(|(attached, _)| {
            let announced = &attached.announcement;
            (announced.pid, announced.incarnation)
        });
        self.report_executor_change(found);
        let (attached, _) = attached.inspect_err(|error| {
            if error.code == codes::OTHER_BUILD {
                self.check_unopened_configuration();
            }
        })?;
        self.check_configuration(&attached.announcement);
        let (store, orphans) = self.store(&attached);
        if let Some(orphans) = orphans {
            tracing::info!(pid = attached.announcement.pid, "attached to the executor");
            store.remove_others();
            self.reject_orphans(&orphans, &store);
        }
        Ok((attached, store))
    }

    /// Returns the commands of an executor and, if they were just read from their files, the ids of those that a dead
    /// loader was loading there.
    fn store(&self, attached: &ExecutorConnection) -> (Arc<CommandStore>, Option<Vec<u64>>) {
        let incarnation = attached.announcement.incarnation;
        // A panic leaves it intact, because it is one value.
        let known = self.store.read().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, store)) = known.as_ref().filter(|(known, _)| *known == incarnation) {
            return (Arc::clone(store), None);
        }
        drop(known);
        // Other threads wait for the one that reads the files: without names they can do nothing.
        let mut store = self.store.write().unwrap_or_else(PoisonError::into_inner);
        match store.as_ref().filter(|(known, _)| *known == incarnation) {
            Some((_, store)) => (Arc::clone(store), None),
            None => {
                let found = Arc::new(CommandStore::open(self.executor.cell(), incarnation));
                // Read before any other thread can reserve an id there.
                let orphans = load::orphans(attached);
                *store = Some((incarnation, Arc::clone(&found)));
                (found, Some(orphans))
            }
        }
    }

    /// Returns all commands, sorted by id.
    ///
    /// # Errors
    /// Returns an error if there is no executor.
    pub fn list(&self) -> Result<Vec<CommandView>, ApiError> {
        let (attached, store) = self.attach()?;
        let mut rows = attached.tables().commands;
        rows.sort_by_key(|row| row.id);
        Ok(rows.iter().map(|row| self.view(&store, row)).collect())
    }

    /// Returns one command, by id or by name (then the newest of that name); with its text and names only if `in_full`.
    ///
    /// # Errors
    /// Returns an error if there is no executor or no such command.
    pub fn detail(&self, name: &str, in_full: bool) -> Result<DetailedCommand, ApiError> {
        let (attached, store) = self.attach()?;
        let id = self.resolve(|| attached.tables(), &store, name, |_| true)?;
        let row = attached.tables().command(id).copied();
        let row = row.or_else(|| self.loading_row(id));
        let command = self.view(&store, &row.ok_or_else(|| messages::unknown(name))?);
        let file = in_full
            .then(|| store.read(id))
            .flatten()
            .unwrap_or_default();
        Ok(DetailedCommand {
            command,
            text: file.text,
            names: file.names,
        })
    }

    /// As [`Service::detail`] without text and names; also finds, by id only, one of the last commands that had ended when
    /// they were unloaded.
    ///
    /// # Errors
    /// Returns an error if there is no executor or no such command.
    pub fn detail_or_unloaded(&self, name: &str) -> Result<DetailedCommand, ApiError> {
        self.detail(name, false).or_else(|error| {
            let unloaded = match CommandAddress::read(name) {
                Some(CommandAddress::Id(id)) => self.unloaded.find(id),
                _ => None,
            };
            unloaded
                .map(|command| DetailedCommand {
                    command,
                    text: String::new(),
                    names: None,
                })
                .ok_or(error)
        })
    }

    /// Carries out START, CANCEL, ABORT or UNLOAD.
    ///
    /// # Errors
    /// Returns an error if there is no executor or no such command, or if the executor refuses.
    pub fn operate(
        &self,
        caller: &Caller,
        name: &str,
        operation: Operation,
    ) -> Result<Done, ApiError> {
        self.carry_out(caller, name, operation, &mut |_| ())
    }

    /// As [`Service::operate`]; `done` is called at the end of each step, with its name.
    pub(super) fn carry_out(
        &self,
        caller: &Caller,
        name: &str,
        operation: Operation,
        done: &mut dyn FnMut(&'static str),
    ) -> Result<Done, ApiError> {
        let (attached, store) = self.attach()?;
        done("attach");
        if matches!(operation, Operation::Start { .. }) {
            self.require_agreement(&attached)?;
        }
        let tables = || match operation {
            Operation::Cancel | Operation::Abort => attached.tables_for_stop(),
            Operation::Start { .. } | Operation::Unload => attached.tables(),
        };
        let id = self.resolve(tables, &store, name, |state| operation.suits(state))?;
        let net = self.net(&store, id);
        if operation == Operation::Unload
            && let Some(row) = attached.tables().command(id)
            && row.reason != EndReason::None as u32
        {
            // Before the executor drops it: a client that no longer finds it in the table finds it here.
            self.unloaded.add(self.view(&store, row));
        }
        done("name");
        let answer = self.executor.call_for(caller, &operation.call(id))?;
        done("executor");
        match answer {
            Answer::Done { cycle } | Answer::Rehearsed { cycle, .. } => {
                if operation == Operation::Unload {
                    store.remove(id);
                }
                Ok(Done { id, net, cycle })
            }
            Answer::Refused(refusal) => Err(self.refused(&store, id, refusal)),
            _ => Err(unexpected()),
        }
    }

    /// Returns the error for a refused operation; that of a rejected command has the reason of the rejection.
    pub(super) fn refused(&self, store: &CommandStore, id: u64, refusal: Refusal) -> ApiError {
        let mut error = self.with_names(Some(store), |names| names.refusal(id, refusal));
        let rejected = CommandState::Rejected as u32;
        if !matches!(refusal, Refusal::WrongState { state } if state == rejected) {
            return error;
        }
        let summary = self.summary(store, id).unwrap_or_default();
        let mut findings = summary.diagnostics.iter();
        if let Some(cause) = findings.find(|finding| finding.severity == "error") {
            // A rejection by the executor names the command itself.
            error.message = match cause.message.starts_with(&error.message) {
                true => cause.message.clone(),
                false => format!("{}: {}", error.message, cause.message),
            };
        }
        error
    }

    /// Resolves `7`, `line` or `line#7` to a command. If several commands have the name, it is the newest one in a
    /// suitable state, or else the newest.
    fn resolve(
        &self,
        tables: impl FnOnce() -> Box<TableSnapshot>,
        store: &CommandStore,
        name: &str,
        suits: impl Fn(CommandState) -> bool,
    ) -> Result<u64, ApiError> {
        let name = match CommandAddress::read(name) {
            Some(CommandAddress::Id(id)) => return Ok(id),
            Some(CommandAddress::Both(net, id)) => {
                let is = self.summary(store, id);
                return match is.as_ref().map(|entry| entry.net.as_str()) {
                    Some(is) if is == net => Ok(id),
                    is => Err(address::other_name(net, id, is)),
                };
            }
            Some(CommandAddress::Name(name)) => name,
            None => return Err(messages::unknown(name)),
        };
        let rows = tables().commands;
        let state = |id: u64| {
            let row = rows.iter().find(|row| row.id == id)?;
            Some((id, CommandState::from_number(row.state)))
        };
        let loading: Vec<_> = self
            .loading
            .get()
            .iter()
            .filter(|(_, loading)| loading.net == name)
            .map(|(id, _)| (*id, CommandState::Loading))
            .collect();
        let named = store.named(name).into_iter().filter_map(state);
        let named: Vec<(u64, CommandState)> = named.chain(loading).collect();
        let newest = |of: &mut dyn Iterator<Item = &(u64, CommandState)>| of.map(|row| row.0).max();
        newest(&mut named.iter().filter(|(_, state)| suits(*state)))
            .or_else(|| newest(&mut named.iter()))
            .ok_or_else(|| self.unknown(store, name))
    }

    /// Returns the error for a name that no command has, with the name that is most like it.
    fn unknown(&self, store: &CommandStore, name: &str) -> ApiError {
        let loading = self.loading.get();
        let loading = loading.values().map(|loading| loading.net.clone());
        let nets: Vec<String> = store.nets().into_iter().chain(loading).collect();
        messages::unknown_among(name, nets.iter().map(String::as_str))
    }

    fn summary(&self, store: &CommandStore, id: u64) -> Option<Arc<CommandSummary>> {
        let loading = || self.loading.get().get(&id).map(Arc::clone);
        store.summary(id).or_else(loading)
    }

    /// Returns the name of a command's net; empty if it is not known.
    fn net(&self, store: &CommandStore, id: u64) -> String {
        let entry = self.summary(store, id);
        entry.map_or_else(String::new, |entry| entry.net.clone())
    }

    /// Returns a row for a command that is too new for the snapshot of the table.
    fn loading_row(&self, id: u64) -> Option<CommandEntry> {
        self.loading.get().contains_key(&id).then(|| CommandEntry {
            id,
            state: CommandState::Loading as u32,
            ..bytemuck::Zeroable::zeroed()
        })
    }

    fn view(&self, store: &CommandStore, row: &CommandEntry) -> CommandView {
        // Read before the file: the result of a load is written after the executor has answered.
        let is_loading = self.loading.get().contains_key(&row.id);
        let known = self.summary(store, row.id).unwrap_or_default();
        let state = match CommandState::from_number(row.state) {
            CommandState::Ready | CommandState::Rejected if is_loading => CommandState::Loading,
            state => state,
        };
        let reason = EndReason::from_number(row.reason);
        let outcome = known.names.outcome(row.outcome);
        let fault = self.with_names(Some(store), |names| names.fault(&row.fault));
        let ended =
            || (reason != EndReason::None).then(|| end_message(reason.name(), outcome, row.cycles));
        CommandView {
            id: row.id,
            net: known.net.clone(),
            description: known.description.clone(),
            state: state.name().to_owned(),
            reason: (reason != EndReason::None).then(|| reason.name().to_owned()),
            outcome: outcome.map(str::to_owned),
            words: fault
                .as_ref()
                .map(|fault| fault.words.clone())
                .or_else(ended),
            fault,
            can_cancel: row.can_cancel == 1,
            cycles: row.cycles,
            started_cycle: row.started_cycle,
            ended_cycle: row.ended_cycle,
            exec_last_ns: row.exec_last_ns,
            exec_max_ns: row.exec_max_ns,
            exec_mean_ns: row.exec_sum_ns.checked_div(row.cycles).unwrap_or(0),
            expected_ns: row.expected_ns,
            primitives: known.primitives,
            uses: known.uses.clone(),
            loaded_at: known.loaded_at,
            rehearsal: known.rehearsal.clone(),
            diagnostics: known.diagnostics.clone(),
        }
    }

    fn with_names<T>(
        &self,
        store: Option<&CommandStore>,
        what: impl FnOnce(&NameResolver<'_>) -> T,
    ) -> T {
        let net = |id: u64| match store.map(|store| self.net(store, id)) {
            Some(net) if !net.is_empty() => format!("{net}#{id}"),
            _ => format!("#{id}"),
        };
        let names = |id: u64| {
            let entry = store.and_then(|store| self.summary(store, id));
            entry.map(|entry| entry.names.clone()).unwrap_or_default()
        };
        let reason = |device: &str, reason: u32| self.reason_words(device, reason);
        let disagreement = |device: &str| self.disagreement(device);
        let condition = |device: &str| self.condition(device);
        what(&NameResolver {
            config: &self.naming_config(),
            disagreement: &disagreement,
            net: &net,
            names: &names,
            reason: &reason,
            condition: &condition,
        })
    }
}

/// Describes the end of a command, with the cause if it ended at once.
fn end_message(reason: &str, outcome: Option<&str>, cycles: u64) -> String {
    let words = ending(reason, outcome, cycles);
    match why_at_once(reason, outcome, cycles) {
        Some(why) => format!("{words}; {why}"),
        None => words,
    }
}

fn unexpected() -> ApiError {
    ApiError::new(
        codes::OTHER_BUILD,
        "the executor gave an unexpected answer",
        "install loader and executor from the same build and restart them",
    )
}
