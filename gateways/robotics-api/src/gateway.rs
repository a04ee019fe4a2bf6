//! The gateway: its state, its cell, and how nets get into the core and out of it. Shared by all threads.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard};
use std::time::{Duration, Instant};

use rcc_api::bodies::CommandDetail;
use rcc_api::codes;
use rcc_client::LeaseHolder;
use rcc_language::names::Names;

use crate::devices::DeviceSpec;
use crate::loader::{CellClient, LoaderError};
use crate::net_text::{self, NetText, NetUse, STOP_INPUT};
use crate::net_values::read_values;
use crate::own_cell::OwnCell;
use crate::pushes::NetState;
use crate::rate_limiter::RateLimiter;
use crate::state::{GatewayNet, GatewayState, ReportedValue};

/// Time without a sign of life after which the cell cancels the nets that this gateway started.
const LOST_AFTER: Duration = Duration::from_secs(2);

/// How the gateway behaves.
#[derive(Clone, Debug)]
pub struct GatewayOptions {
    /// Time after which the nets of a session without connections are stopped.
    pub session_timeout: Duration,
}

/// Everything that the threads share.
#[derive(Debug)]
pub struct Gateway {
    /// How it behaves.
    pub options: GatewayOptions,
    /// The cell's control socket.
    pub socket: PathBuf,
    /// The cell that the gateway made itself; `None` if it is attached to one.
    pub own: Option<OwnCell>,
    state: Mutex<GatewayState>,
    changed: Condvar,
    // Set by whoever wakes the engine, cleared by the engine; no other memory depends on it.
    is_woken: AtomicBool,
    /// Read by whoever loads or starts a net; written while the cell is started again.
    gate: RwLock<()>,
    rate_limiter: Arc<RateLimiter>,
    lease: Arc<LeaseHolder>,
}

impl Gateway {
    /// Returns the gateway of a cell.
    #[must_use]
    pub fn new(options: GatewayOptions, socket: PathBuf, own: Option<OwnCell>) -> Gateway {
        Gateway {
            options,
            socket,
            own,
            state: Mutex::default(),
            changed: Condvar::new(),
            is_woken: AtomicBool::new(false),
            gate: RwLock::new(()),
            rate_limiter: Arc::default(),
            lease: Arc::new(LeaseHolder::new(LOST_AFTER)),
        }
    }

    /// Returns a client of the cell's loader for the thread of a connection: with the rate limit of all of them.
    #[must_use]
    pub fn paced_loader(&self) -> CellClient {
        self.loader().at(Arc::clone(&self.rate_limiter))
    }

    /// Returns a client of the cell's loader, for a thread of the gateway's own.
    #[must_use]
    pub fn loader(&self) -> CellClient {
        CellClient::new(&self.socket).with_lease(Arc::clone(&self.lease))
    }

    /// Locks the state.
    pub fn state(&self) -> MutexGuard<'_, GatewayState> {
        // Each change is complete when it could panic.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes the engine: there is something to do.
    pub fn wake(&self) {
        self.is_woken.store(true, Ordering::Relaxed);
        self.changed.notify_all();
    }

    /// Waits until there is something to do, at most for `time`.
    pub fn sleep(&self, time: Duration) {
        let is_asleep = |_: &mut GatewayState| !self.is_woken.swap(false, Ordering::Relaxed);
        let waited = self
            .changed
            .wait_timeout_while(self.state(), time, is_asleep);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }

    /// Waits until the cell is not being started again, and keeps it running.
    pub fn keep_cell(&self) -> RwLockReadGuard<'_, ()> {
        self.gate.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs `restart` while nobody uses the cell, unless a net runs; afterwards no net is loaded there. Returns false
    /// if a net runs.
    pub fn without_nets(&self, restart: impl FnOnce()) -> bool {
        let _gate = self.gate.write().unwrap_or_else(PoisonError::into_inner);
        if self.state().nets.values().any(|net| net.state.is_active()) {
            return false;
        }
        restart();
        for net in self.state().nets.values_mut() {
            net.command = None;
            net.may_run = false;
        }
        true
    }

    /// Loads a net for a session; returns its name.
    ///
    /// # Errors
    /// Returns why the net was rejected, in one sentence.
    pub fn load(
        &self,
        loader: &mut CellClient,
        session: &str,
        text: &str,
    ) -> Result<String, String> {
        let name = format!("{}{}", net_prefix(), self.state().number("net"));
        let text = net_text::prepare(text, &name, &self.device_names(), NetUse::Run)
            .map_err(|error| error.to_string())?;
        let _cell = self.keep_cell();
        let (command, detail) = self.install(loader, &text)?;
        let net = described(session, text, command, &detail);
        self.state().nets.insert(name.clone(), net);
        Ok(name)
    }

    /// Returns the names of the cell's devices by those of the library.
    #[must_use]
    pub fn device_names(&self) -> BTreeMap<String, String> {
        let state = self.state();
        let devices = state.devices.iter();
        devices
            .map(|(name, device)| (name.clone(), device.cell_name.clone()))
            .collect()
    }

    /// Loads a text; where the core's table is full, nets that no rule would start make room.
    pub(crate) fn install(
        &self,
        loader: &mut CellClient,
        text: &NetText,
    ) -> Result<(u64, CommandDetail), String> {
        loop {
            match loader.load(&text.text) {
                Ok(detail) if detail.command.state == "rejected" => {
                    let id = detail.command.id;
                    // A rejected command takes a place until it is unloaded.
                    let _ = loader.unload(&id.to_string());
                    return Err(rejection(&detail));
                }
                Ok(detail) => return Ok((detail.command.id, detail)),
                Err(error) if error.code() == codes::TABLE_FULL.code && self.make_room(loader) => {}
                Err(error) => return Err(error.to_string()),
            }
        }
    }

    /// Unloads the oldest net that no rule would start; it is loaded again when a rule names it.
    fn make_room(&self, loader: &mut CellClient) -> bool {
        let name = {
            let mut state = self.state();
            let idle = state.nets.iter().filter(|(name, net)| {
                net.command.is_some()
                    && !net.state.is_active()
                    && !net.may_run
                    && !state.is_scheduled(name)
            });
            let oldest = idle
                .min_by_key(|(_, net)| net.command)
                .map(|(name, _)| name.clone());
            oldest.filter(|name| {
                let net = state.nets.get_mut(name);
                net.is_some_and(|net| net.command.take().is_some())
            })
        };
        name.is_some_and(|name| loader.unload(&name).is_ok())
    }

    /// Evaluates a net for one cycle, without commanding anything; returns its values by key.
    ///
    /// # Errors
    /// Returns why it cannot be evaluated, in one sentence.
    pub fn evaluate(
        &self,
        loader: &mut CellClient,
        text: &str,
    ) -> Result<Vec<(String, String)>, String> {
        let name = format!(
            "rpi{}eval{}",
            std::process::id(),
            self.state().number("eval")
        );
        let text = net_text::prepare(text, &name, &self.device_names(), NetUse::Evaluate)
            .map_err(|error| error.to_string())?;
        let _cell = self.keep_cell();
        let (command, detail) = self.install(loader, &text)?;
        let net = described("", text, command, &detail);
        let values = match net.uses.first() {
            Some(used) => Err(format!(
                "a net that is only evaluated must not command {used}"
            )),
            None => evaluated(loader, &net, &name).map_err(|error| error.to_string()),
        };
        // It has ended, or never began; if it cannot be unloaded, the loader's message says why.
        if let Err(error) = loader.unload(&name) {
            tracing::warn!(%error, "an evaluated net cannot be unloaded");
        }
        values
    }

    /// Adds a device; returns the reason if it cannot be created.
    ///
    /// # Errors
    /// Returns the HTTP status and the reason.
    pub fn create_device(&self, spec: DeviceSpec) -> Result<(), (u16, String)> {
        let Some(own) = &self.own else {
            let reason = "this gateway is attached to a cell, whose devices are fixed: name its device as the library does, \
                          or with --device";
            return Err((409, reason.to_owned()));
        };
        let exists = |state: &GatewayState| match state.devices.contains_key(&spec.name) {
            true => Err((400, format!("device '{}' exists", spec.name))),
            false => Ok(()),
        };
        exists(&self.state())?;
        let recognised = own
            .recognise(&spec)
            .map_err(|error| (400, error.to_string()))?;
        let mut state = self.state();
        exists(&state)?;
        refuse_while_running(&state, "created")?;
        own.add(&mut state, spec, recognised);
        state.push_devices();
        drop(state);
        own.wake();
        Ok(())
    }

    /// Removes a device.
    ///
    /// # Errors
    /// Returns the HTTP status and the reason.
    pub fn remove_device(&self, name: &str) -> Result<(), (u16, String)> {
        let Some(own) = &self.own else {
            let reason = "this gateway is attached to a cell, whose devices are fixed";
            return Err((409, reason.to_owned()));
        };
        let mut state = self.state();
        if !state.devices.contains_key(name) {
            return Err((404, format!("device '{name}' does not exist")));
        }
        refuse_while_running(&state, "removed")?;
        own.remove(&mut state, name);
        state.push_devices();
        drop(state);
        own.wake();
        Ok(())
    }
}

/// The devices of a cell are fixed while it runs: it is started again, which must not end a net.
fn refuse_while_running(state: &GatewayState, what: &str) -> Result<(), (u16, String)> {
    let running = state.nets.iter().find(|(_, net)| net.state.is_active());
    match running {
        Some((name, _)) => Err((
            409,
            format!("no device can be {what} while a net runs: {name}"),
        )),
        None => Ok(()),
    }
}

/// Starts an evaluated net and reads its values when it has ended.
fn evaluated(
    loader: &mut CellClient,
    net: &GatewayNet,
    command: &str,
) -> Result<Vec<(String, String)>, LoaderError> {
    const TIME_MAX: Duration = Duration::from_secs(5);
    loader.operate(command, "start")?;
    let begun = Instant::now();
    while loader.state(command)?.command.state != "terminated" {
        if begun.elapsed() > TIME_MAX {
            // It has been told to end in its first cycle; nothing is commanded.
            loader.operate(command, "abort")?;
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    let mut found = BTreeMap::new();
    read_values(loader, net, command, &mut found)?;
    Ok(found.into_iter().collect())
}

/// Returns the beginning of the names of this gateway's nets.
#[must_use]
pub fn net_prefix() -> String {
    format!("rpi{}net", std::process::id())
}

/// Returns a net that has just been loaded.
fn described(session: &str, text: NetText, command: u64, detail: &CommandDetail) -> GatewayNet {
    // The loader has written it from the same type.
    let names: Names = serde_json::from_value(detail.names.clone()).unwrap_or_default();
    let reported = names.monitors.iter().filter_map(|monitor| {
        Some(ReportedValue {
            port: format!("{}.value", monitor.primitive),
            source: monitor.source.clone(),
            type_name: monitor.type_name.clone(),
            key: text.reported.get(&monitor.primitive)?.clone(),
        })
    });
    let inputs = names
        .settable()
        .map(|(_, input)| (input.primitive.clone(), input.type_name.clone()));
    GatewayNet {
        session: session.to_owned(),
        state: NetState::Ready,
        command: Some(command),
        reported: reported.collect(),
        inputs: inputs.filter(|(id, _)| id != STOP_INPUT).collect(),
        uses: detail
            .command
            .uses
            .iter()
            .filter(|used| !used.starts_with("topic "))
            .cloned()
            .collect::<BTreeSet<_>>(),
        can_cancel: detail.command.can_cancel,
        text: Arc::new(text),
        ..GatewayNet::default()
    }
}

/// Returns the errors of a rejected net as one sentence.
fn rejection(detail: &CommandDetail) -> String {
    let errors = detail
        .command
        .diagnostics
        .iter()
        .filter(|finding| finding.severity == "error");
    let words: Vec<String> = errors
        .map(|finding| {
            let help = finding
                .help
                .as_deref()
                .map_or(String::new(), |help| format!(" ({help})"));
            format!("{}: {}{help}", finding.code, finding.message)
        })
        .collect();
    match (words.first(), words.len()) {
        (None, _) => "the net was rejected".to_owned(),
        (Some(first), 1) => first.clone(),
        (Some(first), count) => format!("{first}; and {} more", count - 1),
    }
}
