//! `schema`: prints the JSON Schema of nets, from the running cell with its devices, or else from this program.

use std::path::PathBuf;

use rcc_language::devices::DeviceTable;
use rcc_language::schema::schema;
use serde_json::Value;

use crate::context::Context;
use crate::failure::Failure;
use crate::output::print_record;
use crate::scenario::load_config;

/// Arguments of `schema`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Cell configuration whose devices and channels are named [default: the running cell's, else none]
    #[arg(long)]
    config: Option<PathBuf>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the configuration is invalid.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let schema = match arguments.config {
        Some(path) => schema(Some(&DeviceTable::from(&load_config(&path)?))),
        None => running(context).unwrap_or_else(|| schema(None)),
    };
    let text = serde_json::to_string_pretty(&schema).unwrap_or_default();
    print_record(&text);
    Ok(())
}

/// Returns the schema of the running cell, if one runs.
fn running(context: &Context) -> Option<Value> {
    context.client().ok()?.get("/schema").ok()
}
