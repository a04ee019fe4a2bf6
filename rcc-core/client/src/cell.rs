//! A connection to a cell: its commands, devices and status. Blocks the calling thread.

use std::path::Path;
use std::time::{Duration, Instant};

use rcc_api::bodies::{CommandView, DeviceView, ErrorBody, Loaded, StatusView, Switched};
use rcc_api::codes;

use crate::command::{Command, Outcome};
use crate::error::{ClientError, RequestError};
use crate::transport::{LoaderClient, RemoteLoader, runtime_folder, segment};
use crate::watch::Watch;

/// Maximum time for the answer of a request.
const ANSWER_MAX: Duration = Duration::from_secs(20);
/// Maximum time for loading a net.
const LOAD_MAX: Duration = Duration::from_secs(60);
/// Interval at which a net that is being loaded is looked at.
const LOAD_POLL: Duration = Duration::from_millis(2);

/// A connection to a cell.
#[derive(Debug)]
pub struct Cell {
    pub(crate) client: LoaderClient,
}

impl Cell {
    /// Connects to the cell that the environment names, as `rcc-cli` does: `RCC_URL` with `RCC_TOKEN`, else `RCC_CELL`,
    /// else `demo`.
    ///
    /// # Errors
    /// Fails if the address is invalid, or if no loader answers.
    pub fn connect() -> Result<Cell, ClientError> {
        let variable = |name| std::env::var(name).ok().filter(|value| !value.is_empty());
        match (variable("RCC_URL"), variable("RCC_CELL")) {
            (Some(url), _) => Cell::remote(&url, variable("RCC_TOKEN").as_deref()),
            (None, name) => Cell::local(name.as_deref().unwrap_or("demo")),
        }
    }

    /// Connects to a cell of this machine.
    ///
    /// # Errors
    /// Fails if no loader answers.
    pub fn local(name: &str) -> Result<Cell, ClientError> {
        let socket = runtime_folder().join(name).join("loader.sock");
        Cell::proven(LoaderClient::new(name, &socket, ANSWER_MAX)?)
    }

    /// Connects to the cell whose loader listens at this Unix socket.
    ///
    /// # Errors
    /// Fails if no loader answers.
    pub fn at(socket: &Path) -> Result<Cell, ClientError> {
        let name = socket.display().to_string();
        Cell::proven(LoaderClient::new(&name, socket, ANSWER_MAX)?)
    }

    /// Connects to a cell of another machine: `http://HOST:PORT`, with its token.
    ///
    /// # Errors
    /// Fails if the address is invalid, if no loader answers, or if it refuses the token.
    pub fn remote(url: &str, token: Option<&str>) -> Result<Cell, ClientError> {
        let remote = RemoteLoader::new(url, None, token)?;
        Cell::proven(LoaderClient::remote(remote, ANSWER_MAX)?)
    }

    fn proven(client: LoaderClient) -> Result<Cell, ClientError> {
        let cell = Cell { client };
        cell.status()?;
        Ok(cell)
    }

    /// Returns the executor's health and the cell's processes.
    ///
    /// # Errors
    /// Fails if the loader does not answer.
    pub fn status(&self) -> Result<StatusView, ClientError> {
        Ok(self.client.get("/status")?)
    }

    /// Returns the devices with their channels.
    ///
    /// # Errors
    /// As [`Cell::status`].
    pub fn devices(&self) -> Result<Vec<DeviceView>, ClientError> {
        Ok(self.client.get("/devices")?)
    }

    /// Returns all commands, by id.
    ///
    /// # Errors
    /// As [`Cell::status`].
    pub fn commands(&self) -> Result<Vec<CommandView>, ClientError> {
        Ok(self.client.get("/commands")?)
    }

    /// LOAD: returns the command when it is ready. `net` is its text in YAML or JSON, as `NetBuilder::to_yaml` of
    /// `rcc-net` makes it. A net that is rejected is unloaded: the error has everything that is known about it.
    ///
    /// # Errors
    /// Fails if the net has errors ([`ClientError::Rejected`]), or if the loader refuses.
    pub fn load(&self, net: &str) -> Result<Command<'_>, ClientError> {
        let Loaded { id, .. } = self.client.post("/commands", net.to_owned())?;
        let command = Command::new(self, id);
        let limit = Instant::now() + LOAD_MAX;
        loop {
            let view = command.state()?;
            match view.state.as_str() {
                "loading" if Instant::now() < limit => std::thread::sleep(LOAD_POLL),
                "loading" => return Err(ClientError::Timeout(LOAD_MAX)),
                "rejected" => {
                    command.unload()?;
                    return Err(rejected(view));
                }
                _ => return Ok(command),
            }
        }
    }

    /// Returns a loaded command, by id or by the name of its net (then the newest).
    ///
    /// # Errors
    /// Fails if there is none.
    pub fn command(&self, name: &str) -> Result<Command<'_>, ClientError> {
        let path = format!("/commands/{}?brief=true", segment(name));
        let view: CommandView = self.client.get(&path)?;
        Ok(Command::new(self, view.id))
    }

    /// Loads, starts and follows a net, and unloads it.
    ///
    /// # Errors
    /// Fails if the net is rejected or refused, or if it ends otherwise than as `finished`
    /// ([`ClientError::NotFinished`]), so that `?` keeps a program from moving an arm that somebody stopped.
    pub fn run(&self, net: &str) -> Result<Outcome, ClientError> {
        let command = self.load(net)?;
        let outcome = command.start().and_then(|_| command.wait(None));
        match outcome {
            Ok(outcome) => {
                command.unload()?;
                outcome.finished()
            }
            Err(error) => {
                // The error that led here is the one to tell.
                let _ = command.end();
                Err(error)
            }
        }
    }

    /// Hand-over: stops some commands and starts others between the same two cycles; returns the first cycle of those
    /// that start.
    ///
    /// # Errors
    /// Fails if the hand-over is impossible; then nothing has changed.
    pub fn switch(
        &self,
        stop: &[&Command<'_>],
        start: &[&Command<'_>],
    ) -> Result<u64, ClientError> {
        let ids = |commands: &[&Command<'_>]| -> Vec<u64> {
            commands.iter().map(|command| command.id()).collect()
        };
        let body = serde_json::json!({"stop": ids(stop), "start": ids(start)});
        let body = body.to_string();
        let switched: Switched = self.client.post("/switch", body)?;
        Ok(switched.cycle)
    }

    /// Watches values of ports such as `line/*` or `belt/soft.out`, at a rate, Hz (0.1 to 250).
    ///
    /// # Errors
    /// Fails if there is no such net or port, or if the rate is out of range.
    pub fn watch(&self, ports: &[&str], rate: f64) -> Result<Watch<'_>, ClientError> {
        let ports: Vec<String> = ports.iter().map(|port| segment(port)).collect();
        let path = format!("/stream?ports={}&rate={rate}", ports.join(","));
        Ok(Watch::new(self.client.lines(&path)?))
    }
}

fn rejected(view: CommandView) -> ClientError {
    let first = view.diagnostics.first();
    let code = first.map_or_else(
        || codes::PLAN_REFUSED.code.to_owned(),
        |finding| finding.code.clone(),
    );
    ClientError::Rejected {
        error: RequestError::from_server(ErrorBody {
            code,
            message: "the text has errors".to_owned(),
            help: None,
            diagnostics: view.diagnostics,
        }),
        net: view.net,
    }
}
