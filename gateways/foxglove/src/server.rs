//! State that all clients share, and the answers to their requests. One thread serves; blocking threads ask the loader.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;
use tokio_tungstenite::tungstenite::Message;

use crate::access::Access;
use crate::outbox::Outbox;
use crate::parameters::{ParameterError, Parameters, changes};
use crate::protocol::{self, Parameter, ServiceCall, StatusLevel};
use crate::services::{CallError, SERVICES, Service};
use crate::viewers::Viewers;

/// Calls of LOAD and START at a time, and as many of CANCEL.
const CALLS_MAX: usize = 8;
/// Interval at which watched parameters are read.
const PARAMETERS_EVERY: Duration = Duration::from_millis(500);

/// The server's state.
pub struct Server {
    /// Name of the cell.
    pub cell: String,
    /// Clients may set parameters and call services.
    pub has_control: bool,
    /// The clients that may connect.
    pub access: Access,
    /// Clients and channels.
    pub viewers: Arc<Viewers>,
    parameters: Arc<Mutex<Parameters>>,
    /// Changes with each life of this program, so that clients forget what they knew.
    session: String,
    calls: Arc<Semaphore>,
    stops: Arc<Semaphore>,
}

impl Server {
    /// Creates a server for a cell, which need not run yet.
    #[must_use]
    pub fn new(cell: &str, has_control: bool, access: Access, viewers: Arc<Viewers>) -> Server {
        let started = rcc_os::wall::since_epoch().as_millis();
        Server {
            cell: cell.to_owned(),
            has_control,
            access,
            viewers,
            parameters: Arc::new(Mutex::new(Parameters::of(cell))),
            session: format!("{started}-{}", std::process::id()),
            calls: Arc::new(Semaphore::new(CALLS_MAX)),
            stops: Arc::new(Semaphore::new(CALLS_MAX)),
        }
    }

    /// Returns what each client is sent first.
    #[must_use]
    pub fn greeting(&self) -> Vec<Message> {
        let mut capabilities = vec!["parameters", "parametersSubscribe"];
        if self.has_control {
            capabilities.push("services");
        }
        let name = format!("rcc {}", self.cell);
        let version = rcc_protocol::version::version();
        let info = protocol::server_info(&name, &capabilities, &self.session, version);
        let mut greeting = vec![info];
        if self.has_control {
            let rows = SERVICES.into_iter().map(Service::row);
            greeting.push(protocol::advertise_services(rows));
        }
        greeting
    }

    /// Runs work with the parameters on a blocking thread. None waits for another for longer than the loader may take.
    async fn with_parameters<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Parameters) -> T + Send + 'static,
    ) -> Option<T> {
        let parameters = Arc::clone(&self.parameters);
        let done = spawn_blocking(move || {
            work(&mut parameters.lock().unwrap_or_else(PoisonError::into_inner))
        });
        // A thread that panicked has said so.
        done.await.ok()
    }

    /// Tells changed parameters to those who watch them, for ever.
    pub async fn watch_parameters(self: Arc<Server>) {
        let mut known: Vec<Parameter> = Vec::new();
        loop {
            tokio::time::sleep(PARAMETERS_EVERY).await;
            if !self.viewers.watches_parameters() {
                continue;
            }
            // While the loader is gone, the last values stay.
            if let Some(Ok(now)) = self.with_parameters(|all| all.read(&[])).await {
                self.viewers.tell_parameters(&changes(&known, &now));
                known = now;
            }
        }
    }

    /// Answers a request for parameters.
    pub async fn get_parameters(&self, outbox: &Outbox, names: Vec<String>, id: Option<String>) {
        let read = self.with_parameters(move |all| all.read(&names)).await;
        let values = match read {
            Some(Ok(values)) => values,
            Some(Err(error)) => {
                tell(outbox, &format!("parameters cannot be read: {error}"));
                Vec::new()
            }
            None => Vec::new(),
        };
        outbox.answer(protocol::parameter_values(values.iter(), id.as_deref()));
    }

    /// Sets parameters, and answers with what they are then if the request has an id.
    pub async fn set_parameters(
        &self,
        outbox: &Outbox,
        parameters: Vec<Parameter>,
        id: Option<String>,
    ) {
        if !self.has_control {
            let words = "no parameter was set: `rcc-foxglove --control` allows it";
            tell(outbox, words);
        }
        let names: Vec<String> = parameters.iter().map(|one| one.name.clone()).collect();
        let has_control = self.has_control;
        let done = self.with_parameters(move |all| {
            let set = match has_control {
                true => all.set(&parameters),
                false => Ok(()),
            };
            (set, all.read(&names))
        });
        let Some((set, read)) = done.await else {
            return;
        };
        let failed = set
            .err()
            .or(read.as_ref().err().cloned().map(ParameterError::Loader));
        if let Some(error) = failed {
            tell(outbox, &format!("no parameter was set: {error}"));
        }
        // The new value, or after a refusal the old one, which the client otherwise believes to have changed.
        let values = read.unwrap_or_default();
        if id.is_some() {
            outbox.answer(protocol::parameter_values(values.iter(), id.as_deref()));
        }
        self.viewers.tell_parameters(&values);
    }

    /// Carries out a call of a service and answers it, on a task of its own: CANCEL waits for no other call.
    pub fn call(self: &Arc<Server>, outbox: &Arc<Outbox>, call: ServiceCall) {
        let service = match self.has_control {
            true => Service::of(call.service),
            false => Err(CallError::Unknown),
        };
        let service = match service {
            Ok(service) => service,
            Err(error) => {
                outbox.answer(protocol::service_failure(&call, &error.to_string()));
                return;
            }
        };
        let places = match service {
            Service::Cancel => &self.stops,
            Service::Load | Service::Start => &self.calls,
        };
        let Ok(place) = Arc::clone(places).try_acquire_owned() else {
            let words = "too many calls at a time: wait for their answers";
            outbox.answer(protocol::service_failure(&call, words));
            return;
        };
        let (cell, outbox) = (self.cell.clone(), Arc::clone(outbox));
        spawn_blocking(move || {
            let answer = match service.call(&cell, &call) {
                Ok(answer) => protocol::service_response(&call, &answer),
                Err(error) => protocol::service_failure(&call, &error.to_string()),
            };
            outbox.answer(answer);
            drop(place);
        });
    }
}

/// Tells an error to a client.
pub fn tell(outbox: &Outbox, words: &str) {
    outbox.answer(protocol::status(StatusLevel::Error, None, words));
}
