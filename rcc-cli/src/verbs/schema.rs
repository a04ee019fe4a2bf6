//! `schema`: prints the JSON Schema of nets, from the running cell with its devices, or else from this program, and those
//! of the files of cells and robots.

use std::path::PathBuf;

use rcc_api::codes;
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
    /// Kind of file that the schema describes
    #[arg(value_enum, default_value = "net")]
    of: SchemaKind,
    /// Cell configuration whose devices and channels are named [default: the running cell's, else none]
    #[arg(long)]
    config: Option<PathBuf>,
}

/// Kinds of files with a schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum SchemaKind {
    /// Nets and libraries of fragments
    Net,
    /// Configurations of cells
    Cell,
    /// Configurations of robots
    Robot,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the configuration is invalid.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let schema = match (arguments.of, arguments.config) {
        (SchemaKind::Net, Some(path)) => schema(Some(&DeviceTable::from(&load_config(&path)?))),
        (SchemaKind::Net, None) => running(context).unwrap_or_else(|| schema(None)),
        (SchemaKind::Cell | SchemaKind::Robot, Some(_)) => {
            let message =
                "--config names the devices of nets; the schemas of cells and robots need none";
            return Err(Failure::new(codes::BAD_REQUEST, message, "remove --config"));
        }
        (SchemaKind::Cell, None) => rcc_config::schema::cell(),
        (SchemaKind::Robot, None) => rcc_config::schema::robot(),
    };
    let text = serde_json::to_string_pretty(&schema).unwrap_or_default();
    print_record(&text);
    Ok(())
}

/// Returns the schema of the running cell, if one runs.
fn running(context: &Context) -> Option<Value> {
    context.client().ok()?.get("/schema").ok()
}
