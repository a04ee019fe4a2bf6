//! Settings shared by all verbs: cell, output format, time-out. Created once from the command line's arguments; used by
//! the main thread.

use std::io::{self, IsTerminal};
use std::time::Duration;

use rcc_api::codes;
use rcc_config::diagnostic::DrawingStyle;
use rcc_ipc::cell::base_dir;
use rcc_ipc::{Cell, CellError};
use serde::Serialize;

use crate::cells;
use crate::client::{LoaderClient, RemoteLoader};
use crate::failure::Failure;
use crate::output::{print_diagnostics, print_line, print_record};
use rcc_terminal::text::TerminalSize;

/// Output format of results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum OutputFormat {
    /// Tables and sentences.
    Human,
    /// JSON with stable keys.
    Json,
}

/// Settings shared by all verbs.
#[derive(Clone, Debug)]
pub struct Context {
    /// Name of the cell given on the command line, if any.
    pub cell: Option<String>,
    /// Loader reached over TCP, used instead of the cell's socket.
    pub remote: Option<RemoteLoader>,
    /// Output format of results.
    pub format: OutputFormat,
    /// Longest time to wait for one answer.
    pub timeout: Duration,
}

/// Name of the cell if none is given.
pub const DEFAULT_CELL: &str = "demo";

impl Context {
    /// Returns the name of the cell.
    #[must_use]
    pub fn cell_name(&self) -> &str {
        self.cell.as_deref().unwrap_or(DEFAULT_CELL)
    }

    /// Returns true if a cell was selected, by its name or its address.
    #[must_use]
    pub fn is_selected(&self) -> bool {
        self.cell.is_some() || self.remote.is_some()
    }

    /// Creates a client of the cell's loader. Creates nothing on disk.
    ///
    /// # Errors
    /// Fails if the cell does not exist.
    pub fn client(&self) -> Result<LoaderClient, Failure> {
        if let Some(remote) = &self.remote {
            return LoaderClient::remote(remote.clone(), self.timeout);
        }
        let name = self.cell_name();
        let socket = match Cell::find(name) {
            Ok(Some(cell)) => cell.socket(),
            Ok(None) => return Err(cells::not_found(name)),
            // The cell belongs to another user: connecting to its socket shows whether its `access` setting admits us.
            Err(CellError::NotOurs { .. }) => base_dir().join(name).join("loader.sock"),
            Err(error) => return Err(cell_failure(&error)),
        };
        LoaderClient::new(name, &socket, self.timeout)
    }

    /// Returns how diagnostics are drawn on stderr.
    #[must_use]
    pub fn drawing() -> DrawingStyle {
        let off = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        DrawingStyle {
            colour: !off && io::stderr().is_terminal(),
            columns: TerminalSize::of_stderr().map(|size| size.columns),
        }
    }

    /// Prints a result: as JSON, or as the text that `human` makes of it.
    pub fn print<T: Serialize>(&self, value: &T, human: impl FnOnce(&T) -> String) {
        match self.format {
            OutputFormat::Human => print_line(&human(value)),
            // Our values have string keys and numbers that are finite or null, so serialisation cannot fail.
            OutputFormat::Json => print_record(&serde_json::to_string(value).unwrap_or_default()),
        }
    }

    /// Prints a failure on stderr.
    pub fn print_failure(&self, failure: &Failure) {
        if failure.body.code.is_empty() && failure.body.message.is_empty() {
            return;
        }
        let text = match self.format {
            OutputFormat::Human => failure.human(Self::drawing()),
            OutputFormat::Json => serde_json::to_string(&*failure.body).unwrap_or_default() + "\n",
        };
        print_diagnostics(&text);
    }
}

/// Converts an error about a cell's name or folder into a failure.
#[must_use]
pub fn cell_failure(error: &rcc_ipc::CellError) -> Failure {
    let code = match error {
        CellError::NotOurs { .. } | CellError::Writable { .. } => codes::NOT_PERMITTED,
        CellError::BadName { .. } | CellError::PathTooLong { .. } => codes::BAD_REQUEST,
        CellError::Folder { source, .. } | CellError::State { source, .. }
            if source.kind() == io::ErrorKind::PermissionDenied =>
        {
            codes::NOT_PERMITTED
        }
        CellError::MadeAnew { .. } => codes::CELL_LIVES,
        CellError::Folder { .. } | CellError::State { .. } => codes::PROCESS_FAILED,
    };
    Failure::new(code, error.to_string(), "")
}
