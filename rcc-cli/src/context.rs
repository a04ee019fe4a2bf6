//! What all verbs share: which cell, how to print, how long to wait.
//! Made once from the arguments; used by the main thread.

use std::io::{self, IsTerminal};
use std::time::Duration;

use rcc_ipc::cell::base_dir;
use rcc_ipc::{Cell, CellError};
use rcc_loader::server::codes;
use serde::Serialize;

use crate::client::{Client, RemoteLoader, no_loader};
use crate::failure::Failure;
use crate::output::{print_diagnostics, print_line};

/// How results are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Tables and sentences.
    Human,
    /// JSON with stable keys.
    Json,
}

/// What all verbs share.
#[derive(Clone, Debug)]
pub struct Context {
    /// Name of the cell, if one was given.
    pub cell: Option<String>,
    /// A loader's TCP door, to be used instead of the cell's socket.
    pub remote: Option<RemoteLoader>,
    /// How results are printed.
    pub format: Format,
    /// How long one answer is waited for.
    pub timeout: Duration,
}

/// The cell of those who name none.
pub const DEFAULT_CELL: &str = "demo";

impl Context {
    /// The name of the cell.
    #[must_use]
    pub fn cell_name(&self) -> &str {
        self.cell.as_deref().unwrap_or(DEFAULT_CELL)
    }

    /// A client of the cell's loader.
    ///
    /// # Errors
    /// There is no such cell. Nothing is made on disk.
    pub fn client(&self) -> Result<Client, Failure> {
        if let Some(remote) = &self.remote {
            return Client::remote(remote.clone(), self.timeout);
        }
        let name = self.cell_name();
        let socket = match Cell::find(name) {
            Ok(Some(cell)) => cell.socket(),
            Ok(None) => return Err(no_loader(name, ": no such cell")),
            // Another user's: whether his `access` lets us in, the socket tells.
            Err(CellError::NotOurs { .. }) => base_dir().join(name).join("loader.sock"),
            Err(error) => return Err(of_cell(&error)),
        };
        Client::new(name, &socket, self.timeout)
    }

    /// True if diagnostics may be coloured.
    #[must_use]
    pub fn colour() -> bool {
        let off = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        !off && io::stderr().is_terminal()
    }

    /// Prints a result: the value as JSON, or what `human` makes of it.
    pub fn print<T: Serialize>(&self, value: &T, human: impl FnOnce(&T) -> String) {
        let text = match self.format {
            Format::Human => human(value),
            // Values of ours have string keys and finite numbers, or null instead.
            Format::Json => serde_json::to_string(value).unwrap_or_default(),
        };
        print_line(&text);
    }

    /// Prints a failure on stderr.
    pub fn print_failure(&self, failure: &Failure) {
        if failure.body.code.is_empty() && failure.body.message.is_empty() {
            return;
        }
        let text = match self.format {
            Format::Human => failure.human(Self::colour()),
            Format::Json => serde_json::to_string(&*failure.body).unwrap_or_default() + "\n",
        };
        print_diagnostics(&text);
    }
}

/// A cell's name or folder that cannot be used.
#[must_use]
pub fn of_cell(error: &rcc_ipc::CellError) -> Failure {
    let code = match error {
        CellError::NotOurs { .. } | CellError::Writable { .. } => codes::NOT_PERMITTED,
        CellError::BadName { .. } | CellError::PathTooLong { .. } => codes::BAD_REQUEST,
        CellError::Folder { source, .. } if source.kind() == io::ErrorKind::PermissionDenied => {
            codes::NOT_PERMITTED
        }
        CellError::MadeAnew { .. } => codes::CELL_LIVES,
        CellError::Folder { .. } => codes::PROCESS_FAILED,
    };
    Failure::new(code, error.to_string(), "")
}
