//! A connection to a cell: its commands, devices and status. Blocks the calling thread.

use std::path::Path;
use std::time::Duration;

use rcc_api::bodies::{
    Checked, CommandRef, CommandView, DeviceView, ErrorBody, OnClientLoss, StatusView, Switch,
    Switched,
};
use rcc_api::codes;

use crate::command::Command;
use crate::connection::Connection;
use crate::error::{ClientError, RequestError};
use crate::outcome::Outcome;
use crate::transport::{LoaderClient, RemoteLoader, segment};
use crate::watch::Watch;

/// Maximum time for the answer of a request.
const ANSWER_MAX: Duration = Duration::from_secs(20);
/// Maximum time for loading a net.
const LOAD_MAX: Duration = Duration::from_secs(60);

/// A connection to a cell. Dropping it is the loss of the client for what it runs.
#[derive(Debug)]
pub struct Cell {
    pub(crate) connection: Connection,
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
        Cell::proven(LoaderClient::local(name, ANSWER_MAX)?)
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
        let cell = Cell {
            connection: Connection::new(client),
        };
        cell.status()?;
        Ok(cell)
    }

    /// Returns this connection with another time (50 ms to an hour, 1 s by default) after which the program counts as
    /// lost when it gives no sign of life. A thread gives it, not the program's own ones.
    #[must_use]
    pub fn with_lost_after(self, lost_after: Duration) -> Cell {
        Cell {
            connection: self.connection.with_lost_after(lost_after),
        }
    }

    /// Returns the executor's health and the cell's processes.
    ///
    /// # Errors
    /// Fails if the loader does not answer.
    pub fn status(&self) -> Result<StatusView, ClientError> {
        Ok(self.connection.client.get("/status")?)
    }

    /// Returns the devices with their channels.
    ///
    /// # Errors
    /// As [`Cell::status`].
    pub fn devices(&self) -> Result<Vec<DeviceView>, ClientError> {
        Ok(self.connection.client.get("/devices")?)
    }

    /// Returns all commands, by id.
    ///
    /// # Errors
    /// As [`Cell::status`].
    pub fn commands(&self) -> Result<Vec<CommandView>, ClientError> {
        Ok(self.connection.client.get("/commands")?)
    }

    /// LOAD: returns the command when it is ready. `net` is its text in YAML or JSON, as `NetBuilder::to_yaml` of
    /// `rcc-net` makes it. A net that is rejected is unloaded: the error has everything that is known about it.
    ///
    /// # Errors
    /// Fails if the net has errors ([`ClientError::Rejected`]), or if the loader refuses.
    pub fn load(&self, net: &str) -> Result<Command<'_>, ClientError> {
        let view = self.connection.client.load(None, net, LOAD_MAX)?;
        let command = Command::new(&self.connection, view.id);
        match view.state.as_str() {
            "loading" => Err(ClientError::Timeout(LOAD_MAX)),
            "rejected" => {
                command.unload_ended()?;
                Err(rejected(view))
            }
            _ => Ok(command),
        }
    }

    /// Checks a text as LOAD does, and loads nothing: a net, or the configuration of a cell; `file` is its name in
    /// diagnostics. The rehearsal is part of LOAD only.
    ///
    /// # Errors
    /// Fails if the loader would refuse every net. An invalid text is no error here.
    pub fn check(&self, text: &str, file: &str) -> Result<Checked, ClientError> {
        let path = format!("/check?file={}", segment(file));
        Ok(self.connection.client.post(&path, text.to_owned())?)
    }

    /// Returns a loaded command, by id or by the name of its net (then the newest).
    ///
    /// # Errors
    /// Fails if there is none.
    pub fn command(&self, name: &str) -> Result<Command<'_>, ClientError> {
        let path = format!("/commands/{}?brief=true", segment(name));
        let view: CommandView = self.connection.client.get(&path)?;
        Ok(Command::new(&self.connection, view.id))
    }

    /// Loads and starts a net. It is canceled when this program is gone, and when this connection is dropped.
    ///
    /// # Errors
    /// Fails if the net is rejected or refused; then nothing is left of it.
    pub fn start(&self, net: &str) -> Result<Command<'_>, ClientError> {
        let command = self.load(net)?;
        match command.start_with(OnClientLoss::Cancel) {
            Ok(_) => Ok(command),
            Err(error) => {
                // The error that led here is the one to tell.
                let _ = command.end();
                Err(error)
            }
        }
    }

    /// Loads, starts and follows a net, and unloads it. It is canceled when this program is gone.
    ///
    /// # Errors
    /// Fails if the net is rejected or refused, or if it ends otherwise than as `finished`
    /// ([`ClientError::NotFinished`]), so that `?` keeps a program from moving an arm that somebody stopped.
    pub fn run(&self, net: &str) -> Result<Outcome, ClientError> {
        self.run_with(net, OnClientLoss::Cancel)
    }

    /// As [`Cell::run`], with what follows when this program is gone.
    ///
    /// # Errors
    /// As [`Cell::run`].
    pub fn run_with(
        &self,
        net: &str,
        on_client_loss: OnClientLoss,
    ) -> Result<Outcome, ClientError> {
        let command = self.load(net)?;
        let started = command.start_with(on_client_loss);
        let outcome = started.and_then(|_| command.wait(None));
        match outcome {
            Ok(outcome) => {
                command.unload_ended()?;
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
    /// that start. They are canceled with this program if one that stops would have been.
    ///
    /// # Errors
    /// Fails if the hand-over is impossible; then nothing has changed.
    pub fn switch(
        &self,
        stop: &[&Command<'_>],
        start: &[&Command<'_>],
    ) -> Result<u64, ClientError> {
        let on_client_loss = match stop.iter().any(|command| command.is_bound()) {
            true => OnClientLoss::Cancel,
            false => OnClientLoss::GoOn,
        };
        self.switch_with(stop, start, on_client_loss)
    }

    /// As [`Cell::switch`], with what follows for those that start when this program is gone.
    ///
    /// # Errors
    /// As [`Cell::switch`].
    pub fn switch_with(
        &self,
        stop: &[&Command<'_>],
        start: &[&Command<'_>],
        on_client_loss: OnClientLoss,
    ) -> Result<u64, ClientError> {
        let ids = |commands: &[&Command<'_>]| -> Vec<CommandRef> {
            let ids = commands.iter().map(|command| CommandRef::Id(command.id()));
            ids.collect()
        };
        let switched: Switched = self.connection.begin("/switch", on_client_loss, |lease| {
            crate::json_text(&Switch {
                stop: ids(stop),
                start: ids(start),
                lease,
                ..Switch::default()
            })
        })?;
        start.iter().for_each(|one| one.bind(on_client_loss));
        Ok(switched.cycle)
    }

    /// Watches values of ports such as `line/*` or `belt/soft.out`, at a rate, Hz (0.1 to the rate of the cell). A name
    /// also stands for commands that are loaded later, so that the samples go on when a net ends; those of
    /// [`Command::watch`] end with it.
    ///
    /// # Errors
    /// Fails if there is no such net or port, or if the rate is out of range.
    pub fn watch(&self, ports: &[&str], rate: f64) -> Result<Watch<'_>, ClientError> {
        self.connection.watch(ports, rate)
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
