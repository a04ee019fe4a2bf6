//! Finds the net for `explain` and `graph`: a file, compiled locally without a cell, or a loaded net by name. Used by
//! the main thread.

use std::path::{Path, PathBuf};

use rcc_api::bodies::StatusView;
use rcc_api::codes::{self, exit};
use rcc_api::compile::findings;
use rcc_config::CellConfig;
use rcc_language::devices::DeviceTable;
use rcc_language::library::{FileLibraries, LibrarySource, NoLibraries};
use rcc_language::structure::NetStructure;
use rcc_language::{Compiled, Compiler};

use crate::client::LoaderClient;
use crate::context::Context;
use crate::failure::{Failure, draw};
use crate::follow;
use crate::output::print_diagnostics;
use crate::scenario::load_config;
use crate::supervisor::paths;

/// A compiled net.
pub struct ResolvedNet {
    /// Compiled net with its plan.
    pub compiled: Compiled,
    /// Its primitives, links and frames.
    pub structure: NetStructure,
    /// Configuration that it was compiled for.
    pub config: CellConfig,
    /// Client of the running cell, if one runs.
    pub client: Option<LoaderClient>,
}

/// Returns true if `net` is a file or the standard input, and not the name of a loaded net.
#[must_use]
pub fn is_file(net: &str) -> bool {
    net == "-" || Path::new(net).is_file()
}

/// Finds and compiles a net.
///
/// # Errors
/// Fails if the file does not exist or is invalid, or if the net does not exist.
pub fn find(context: &Context, net: &str, config: Option<PathBuf>) -> Result<ResolvedNet, Failure> {
    let is_file = is_file(net);
    // A file can be compiled without a cell.
    let client = context.client();
    let source = if is_file {
        follow::read_text(net)?
    } else {
        let client = client.as_ref().map_err(|failure| no_such(net, failure))?;
        (net.to_owned(), follow::state(client, net)?.text)
    };
    let client = match client {
        Err(failure) if context.remote.is_some() => return Err(failure),
        client => client.ok(),
    };
    let config = match config {
        Some(path) => path,
        None if context.remote.is_some() => return Err(no_config(context)),
        None => {
            let status = client
                .as_ref()
                .and_then(|client| client.get::<StatusView>("/status").ok());
            match status {
                Some(status) => PathBuf::from(status.config),
                None => paths::config("cells/demo.yaml")?,
            }
        }
    };
    let config = load_config(&config)?;
    // A loaded net is one text; its libraries are not available here.
    let libraries: &dyn LibrarySource = if is_file {
        &FileLibraries
    } else {
        &NoLibraries
    };
    let cell = DeviceTable::from(&config);
    let compiler = Compiler {
        libraries,
        ..rcc_directionet::compiler(&cell)
    };
    let (compiled, structure) = compiler
        .compile_with_structure(&source.1, &source.0)
        .map_err(|faults| {
            print_diagnostics(&draw(&findings(&faults), Some(&source), Context::drawing()));
            Failure::reported(exit::INVALID)
        })?;
    Ok(ResolvedNet {
        compiled,
        structure,
        config,
        client,
    })
}

/// Failure for a cell on another machine: its configuration is a file there.
fn no_config(context: &Context) -> Failure {
    let address = context
        .remote
        .as_ref()
        .map_or("", |remote| &remote.authority);
    Failure::new(
        codes::BAD_REQUEST,
        format!("the configuration of the cell at {address} is a file on its machine"),
        "name a copy of it: --config FILE (`rcc-cli status` shows its path)",
    )
}

/// Failure for a name that is not a file, with no cell to ask.
fn no_such(net: &str, failure: &Failure) -> Failure {
    let mut failure = failure.clone();
    failure.body.message = format!("file `{net}` not found, and {}", failure.body.message);
    failure
}
