//! The net that `explain` and `graph` are asked about: a file, compiled here without a cell, or a loaded net by name. Used
//! by the main thread; no verb itself.

use std::path::{Path, PathBuf};

use rcc_config::CellConfig;
use rcc_language::structure::NetStructure;
use rcc_language::library::{FileLibraries, LibrarySource, NoLibraries};
use rcc_language::{Compiled, compile_with_structure};
use rcc_loader::server::api::StatusView;
use rcc_loader::server::codes::exit;
use rcc_loader::server::compile::findings;

use super::check::load_config;
use crate::client::Client;
use crate::context::Context;
use crate::failure::{Failure, draw};
use crate::follow;
use crate::output::print_diagnostics;
use crate::supervisor::paths;

/// A net that compiled.
pub struct ResolvedNet {
    /// It and its plan.
    pub compiled: Compiled,
    /// What it consists of.
    pub structure: NetStructure,
    /// The configuration that it was compiled for.
    pub config: CellConfig,
    /// The running cell, if there is one.
    pub client: Option<Client>,
}

/// Finds and compiles a net.
///
/// # Errors
/// The file is not there or not valid, or there is no such net.
pub fn find(context: &Context, net: &str, config: Option<PathBuf>) -> Result<ResolvedNet, Failure> {
    let is_file = net == "-" || Path::new(net).is_file();
    // Without a cell a file can be looked at all the same.
    let client = context.client();
    let source = if is_file {
        follow::read_text(net)?
    } else {
        let client = client.as_ref().map_err(|failure| no_such(net, failure))?;
        (net.to_owned(), follow::state(client, net)?.text)
    };
    let client = client.ok();
    let config = match config {
        Some(path) => path,
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
    // A loaded net came as a text; its libraries are not here.
    let libraries: &dyn LibrarySource = if is_file { &FileLibraries } else { &NoLibraries };
    let (compiled, structure) =
        compile_with_structure(&source.1, &source.0, &config, libraries).map_err(|faults| {
            print_diagnostics(&draw(&findings(&faults), Some(&source), Context::colour()));
            Failure::said(exit::INVALID)
        })?;
    Ok(ResolvedNet {
        compiled,
        structure,
        config,
        client,
    })
}

/// A name that is no file, and no cell to ask.
fn no_such(net: &str, failure: &Failure) -> Failure {
    let mut failure = failure.clone();
    failure.body.message = format!("file `{net}` not found, and {}", failure.body.message);
    failure
}
