//! The gateway's requests to the cell's loader, with a common rate limit. Each thread that talks to the loader has a client of its
//! own; nothing here touches the cycle.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rcc_api::bodies::{
    CommandDetail, CommandRef, DeviceView, ErrorBody, Loaded, RuleBody, RulesBody, RulesInstalled,
    Start, StatusView, Switch, ValuesView,
};
use rcc_api::codes;
use rcc_client::{ClientError, LeaseHolder, Lines, LoaderClient, RequestError, segment};
use serde_json::{Map, Value};

use crate::rate_limiter::RateLimiter;

/// Time for one answer; the loader answers every request within 10 s.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(15);
/// Time for a net to be compiled, installed and rehearsed.
const LOADING_TIME_MAX: Duration = Duration::from_secs(60);
/// Pause between two looks at a net that is loading.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// The reason why the loader did not do what was asked, in one sentence.
#[derive(Debug, thiserror::Error)]
#[error("{}", message(&.0.body))]
pub struct LoaderError(#[from] RequestError);

impl LoaderError {
    /// Returns the code of a refusal.
    #[must_use]
    pub fn code(&self) -> &str {
        &self.0.body.code
    }

    /// Returns true if it is not known whether the core has done what was asked.
    #[must_use]
    pub fn is_unanswered(&self) -> bool {
        let silent = [codes::NO_EXECUTOR.code, codes::EXECUTOR_SILENT.code];
        self.is_unreachable() || silent.contains(&self.code())
    }

    /// Returns true if the loader did not answer; the cell may be restarting.
    #[must_use]
    pub fn is_unreachable(&self) -> bool {
        [codes::NO_LOADER.code, codes::LOADER_SILENT.code].contains(&self.code())
    }
}

/// Returns the refusal in an error of the client.
fn request_error(error: ClientError) -> RequestError {
    match error {
        ClientError::Request(error) => error,
        other => {
            let help = "see the log of the cell's loader";
            RequestError::new(codes::PROCESS_FAILED, other.to_string(), help)
        }
    }
}

/// Returns an error as one sentence with its remedy.
fn message(body: &ErrorBody) -> String {
    match &body.help {
        Some(help) if !help.is_empty() => format!("{}: {} ({help})", body.code, body.message),
        _ => format!("{}: {}", body.code, body.message),
    }
}

/// Requests to the loader of one cell. Commands are named by their net, which is unique: an id means another command
/// once the executor was started again.
#[derive(Debug)]
pub struct CellClient {
    socket: PathBuf,
    /// Made at the first request.
    client: Option<LoaderClient>,
    rate_limiter: Option<Arc<RateLimiter>>,
    lease: Option<Arc<LeaseHolder>>,
}

impl CellClient {
    /// Returns a client of the loader with this socket.
    #[must_use]
    pub fn new(socket: &Path) -> CellClient {
        CellClient {
            socket: socket.to_owned(),
            client: None,
            rate_limiter: None,
            lease: None,
        }
    }

    /// Returns this client with a lease, to which the nets that it starts are bound.
    #[must_use]
    pub fn with_lease(self, lease: Arc<LeaseHolder>) -> CellClient {
        CellClient {
            lease: Some(lease),
            ..self
        }
    }

    /// Returns this client with a common rate limit. CANCEL and ABORT do not wait for it.
    #[must_use]
    pub fn at(self, rate_limiter: Arc<RateLimiter>) -> CellClient {
        CellClient {
            rate_limiter: Some(rate_limiter),
            ..self
        }
    }

    /// Loads a net and waits until it is ready or rejected.
    ///
    /// # Errors
    /// Returns an error if the loader takes no net, or if it is still loading after a minute.
    pub fn load(&mut self, text: &str) -> Result<CommandDetail, LoaderError> {
        let Loaded { id, .. } = self.paced()?.post("/commands?file=net", text.to_owned())?;
        let begun = Instant::now();
        loop {
            let state = self.state(&id.to_string())?;
            if state.command.state != "loading" {
                return match state.command.state.as_str() {
                    "rejected" => Ok(state),
                    _ => Ok(self.paced()?.get(&format!("/commands/{id}"))?),
                };
            }
            if begun.elapsed() > LOADING_TIME_MAX {
                let message = format!("the net is still loading after {LOADING_TIME_MAX:?}");
                let help = "load it again when the machine is less busy";
                return Err(RequestError::new(codes::LOADER_SILENT, message, help).into());
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    /// Returns the state of a command, without its text.
    ///
    /// # Errors
    /// Returns an error if there is no such command.
    pub fn state(&mut self, command: &str) -> Result<CommandDetail, LoaderError> {
        let path = path(command, "?brief=true");
        Ok(self.paced()?.get(&path)?)
    }

    /// Carries out `start`, `cancel` or `abort`.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn operate(&mut self, command: &str, operation: &str) -> Result<(), LoaderError> {
        let path = path(command, &format!("/{operation}"));
        if operation == "start" {
            return self.begin(&path, |lease| {
                text(&Start {
                    lease,
                    ..Start::default()
                })
            });
        }
        self.client()?.post::<Value>(&path, String::new())?;
        Ok(())
    }

    /// Sends a request that starts commands, which are bound to the lease if there is one.
    fn begin(
        &mut self,
        path: &str,
        body: impl Fn(Option<u64>) -> String,
    ) -> Result<(), LoaderError> {
        let lease = self.lease.clone();
        let client = self.paced()?;
        match lease {
            None => client.post::<Value>(path, body(None)).map(drop)?,
            Some(lease) => lease
                .begin::<Value>(client, path, |number| Ok(body(Some(number))))
                .map(drop)
                .map_err(request_error)?,
        }
        Ok(())
    }

    /// Stops some commands and starts others between the same two cycles.
    ///
    /// # Errors
    /// Returns the loader's refusal; nothing has changed then.
    pub fn switch(&mut self, stop: &[String], start: &[String]) -> Result<(), LoaderError> {
        let named = |names: &[String]| names.iter().cloned().map(CommandRef::Name).collect();
        self.begin("/switch", |lease| {
            text(&Switch {
                stop: named(stop),
                start: named(start),
                lease,
                ..Switch::default()
            })
        })
    }

    /// Installs a rule that the core judges in every cycle; returns its number.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn install(&mut self, rule: RuleBody) -> Result<u64, LoaderError> {
        let body = RulesBody {
            rules: vec![rule],
            lease: None,
        };
        let installed: RulesInstalled = self.paced()?.post("/rules", text(&body))?;
        // One rule was sent, so that one was installed.
        Ok(installed.rules.first().map_or(0, |rule| rule.rule))
    }

    /// Sets inputs of a command.
    ///
    /// # Errors
    /// Returns the loader's refusal; nothing was set then.
    pub fn set(&mut self, command: &str, inputs: &Map<String, Value>) -> Result<(), LoaderError> {
        let path = path(command, "/inputs");
        self.paced()?.put::<Value>(&path, text(inputs))?;
        Ok(())
    }

    /// Reads the inputs of the monitors of a command, which are the values that the application sees.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn values(&mut self, command: &str, ports: &[String]) -> Result<ValuesView, LoaderError> {
        Ok(self.paced()?.values(command, ports)?)
    }

    /// Removes a command that is not active.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn unload(&mut self, command: &str) -> Result<(), LoaderError> {
        self.paced()?.delete::<Value>(&path(command, ""))?;
        Ok(())
    }

    /// Returns the executor's health.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn status(&mut self) -> Result<StatusView, LoaderError> {
        Ok(self.paced()?.get("/status")?)
    }

    /// Lists the devices of the cell.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn devices(&mut self) -> Result<Vec<DeviceView>, LoaderError> {
        Ok(self.paced()?.get("/devices")?)
    }

    /// Opens a stream: its lines as they arrive.
    ///
    /// # Errors
    /// Returns the loader's refusal.
    pub fn stream(&mut self, path: &str) -> Result<Lines<'_>, LoaderError> {
        Ok(self.paced()?.lines(path)?)
    }

    /// Returns the client when its turn has come.
    fn paced(&mut self) -> Result<&LoaderClient, LoaderError> {
        if let Some(rate_limiter) = &self.rate_limiter {
            rate_limiter.wait();
        }
        self.client()
    }

    fn client(&mut self) -> Result<&LoaderClient, LoaderError> {
        let client = match self.client.take() {
            Some(client) => client,
            None => {
                // The socket is in the folder of the cell.
                let cell = self.socket.parent().and_then(Path::file_name);
                let cell = cell.unwrap_or_default().to_string_lossy();
                LoaderClient::new(&cell, &self.socket, ANSWER_TIME_MAX)?
            }
        };
        Ok(self.client.insert(client))
    }
}

fn path(command: &str, rest: &str) -> String {
    format!("/commands/{}{rest}", segment(command))
}

/// Returns the text of a body; numbers and texts can be serialized.
fn text(body: &impl serde::Serialize) -> String {
    serde_json::to_string(body).unwrap_or_default()
}
