//! A loaded net. Blocks the calling thread.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rcc_api::bodies::{CommandView, Done, InputsSet, OnClientLoss, Start, ValuesView};
use rcc_api::codes;
use serde::Serialize;

use crate::connection::Connection;
use crate::error::ClientError;
use crate::outcome::Outcome;
use crate::watch::Watch;

/// Interval at which a command that is awaited is looked at.
const POLL: Duration = Duration::from_millis(5);
/// Maximum time that an interrupted net is given to come to rest.
const REST_MAX: Duration = Duration::from_secs(60);

/// A loaded net. Dropping it changes nothing in the cell.
#[derive(Debug)]
pub struct Command<'a> {
    connection: &'a Connection,
    id: u64,
    // True if it ends with this program; written and read by callers, and no other memory depends on it.
    is_bound: AtomicBool,
}

impl<'a> Command<'a> {
    pub(crate) fn new(connection: &'a Connection, id: u64) -> Command<'a> {
        Command {
            connection,
            id,
            is_bound: AtomicBool::new(false),
        }
    }

    /// Returns its id.
    #[must_use]
    pub fn id(&self) -> u64 {
        self.id
    }

    fn path(&self, what: &str) -> String {
        format!("/commands/{}{what}", self.id)
    }

    /// STATE: everything that is known about it, but its text.
    ///
    /// # Errors
    /// Fails if the loader does not answer, or if it was unloaded.
    pub fn state(&self) -> Result<CommandView, ClientError> {
        Ok(self.connection.client.get(&self.path("?brief=true"))?)
    }

    fn operate(&self, what: &str) -> Result<u64, ClientError> {
        let done: Done = self
            .connection
            .client
            .post(&self.path(what), String::new())?;
        Ok(done.cycle)
    }

    /// START; returns the first cycle. It goes on when this program is gone.
    ///
    /// # Errors
    /// Fails if it is not `ready`, if another command holds an arm or output that it needs, or if a device is not ready.
    pub fn start(&self) -> Result<u64, ClientError> {
        self.start_with(OnClientLoss::GoOn)
    }

    /// START, and what follows when this program is gone; returns the first cycle.
    ///
    /// # Errors
    /// As [`Command::start`], or if no lease can be granted.
    pub fn start_with(&self, on_client_loss: OnClientLoss) -> Result<u64, ClientError> {
        let started: Done =
            self.connection
                .begin(&self.path("/start"), on_client_loss, |lease| {
                    crate::json_text(&Start {
                        lease,
                        ..Start::default()
                    })
                })?;
        self.bind(on_client_loss);
        Ok(started.cycle)
    }

    pub(crate) fn bind(&self, on_client_loss: OnClientLoss) {
        let is_bound = on_client_loss == OnClientLoss::Cancel;
        self.is_bound.store(is_bound, Ordering::Relaxed);
    }

    pub(crate) fn is_bound(&self) -> bool {
        self.is_bound.load(Ordering::Relaxed)
    }

    /// CANCEL: asks the net to end in its own way; returns the cycle in which it took effect.
    ///
    /// # Errors
    /// Fails if it does not run, or has no `Cancel`.
    pub fn cancel(&self) -> Result<u64, ClientError> {
        self.operate("/cancel")
    }

    /// ABORT: ends the net at once; the drivers bring its arms to rest.
    ///
    /// # Errors
    /// Fails if it does not run.
    pub fn abort(&self) -> Result<u64, ClientError> {
        self.operate("/abort")
    }

    /// UNLOAD.
    ///
    /// # Errors
    /// Fails if it is active.
    pub fn unload(&self) -> Result<(), ClientError> {
        let _: Done = self.connection.client.delete(&self.path(""))?;
        Ok(())
    }

    /// UNLOAD of a command that has ended; somebody else may have unloaded it.
    pub(crate) fn unload_ended(&self) -> Result<(), ClientError> {
        match self.unload() {
            Err(ClientError::Request(error)) if error.body.code == codes::UNKNOWN_COMMAND.code => {
                Ok(())
            }
            unloaded => unloaded,
        }
    }

    /// Waits until it has ended, at most for `timeout`; also if somebody unloads it then.
    ///
    /// # Errors
    /// Fails if the loader does not answer, if it was unloaded before it had run, or with [`ClientError::Timeout`].
    pub fn wait(&self, timeout: Option<Duration>) -> Result<Outcome, ClientError> {
        let begun = Instant::now();
        loop {
            let view: CommandView = self.connection.client.get(&self.path("?unloaded=true"))?;
            if matches!(view.state.as_str(), "terminated" | "rejected") {
                return Ok(Outcome {
                    net: view.net,
                    id: self.id,
                    reason: view.reason.unwrap_or(view.state),
                    outcome: view.outcome,
                    words: view.words.unwrap_or_default(),
                    cycles: view.cycles,
                });
            }
            match timeout {
                Some(limit) if begun.elapsed() >= limit => {
                    return Err(ClientError::Timeout(limit));
                }
                _ => std::thread::sleep(POLL),
            }
        }
    }

    /// Sets inputs, all of them in the same cycle, which is returned: a map or a structure from their names to values;
    /// null unsets an input. A text is a constant of the language: `"0.2 m/s"`.
    ///
    /// # Errors
    /// Fails if an input or a value is not possible; then nothing has changed.
    pub fn set(&self, values: &impl Serialize) -> Result<u64, ClientError> {
        let body = crate::json_text(values)?;
        let set: InputsSet = self.connection.client.put(&self.path("/inputs"), body)?;
        Ok(set.cycle)
    }

    /// Returns values of ports (all without patterns) as of the last evaluation.
    ///
    /// # Errors
    /// Fails if it has no such port.
    pub fn values(&self, ports: &[&str]) -> Result<ValuesView, ClientError> {
        let ports: Vec<String> = ports.iter().map(|port| (*port).to_owned()).collect();
        Ok(self
            .connection
            .client
            .values(&self.id.to_string(), &ports)?)
    }

    /// Watches values of its ports such as `move.distance` or `*`, at a rate, Hz (0.1 to the rate of the cell). The
    /// samples end when the net does; the last one has its last values.
    ///
    /// # Errors
    /// Fails if it has no such port, or if the rate is out of range.
    pub fn watch(&self, ports: &[&str], rate: f64) -> Result<Watch<'a>, ClientError> {
        let ports: Vec<String> = ports
            .iter()
            .map(|port| format!("#{}/{port}", self.id))
            .collect();
        let ports: Vec<&str> = ports.iter().map(String::as_str).collect();
        self.connection.watch(&ports, rate)
    }

    /// CANCEL, or ABORT if it cannot be canceled; waits for the end, and unloads.
    pub(crate) fn end(&self) -> Result<(), ClientError> {
        let view = self.state()?;
        if view.is_active() {
            match view.can_cancel {
                true => self.cancel()?,
                false => self.abort()?,
            };
            self.wait(Some(REST_MAX))?;
        }
        self.unload()
    }
}
