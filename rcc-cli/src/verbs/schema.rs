//! `schema`: prints the JSON Schema of nets, from the running cell with its devices, or else from this program, and those
//! of the files of cells and robots.

use std::path::PathBuf;

use rcc_api::codes;
use rcc_language::devices::DeviceTable;
use rcc_language::schema::schema;

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
/// Fails if the configuration is invalid, or if the given cell cannot be reached.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let is_local = arguments.config.is_some() || arguments.of != SchemaKind::Net;
    if context.remote.is_some() && is_local {
        let message = "only the schema of nets without --config is that of a cell";
        let help = "omit --url (RCC_URL) for the schema of this program";
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    }
    let schema = match (arguments.of, arguments.config) {
        (SchemaKind::Net, Some(path)) => schema(Some(&DeviceTable::from(&load_config(&path)?))),
        (SchemaKind::Net, None) => {
            match context.client().and_then(|client| client.get("/schema")) {
                Ok(schema) => schema,
                Err(failure) if context.is_selected() => return Err(failure),
                // Without a cell the schema names no devices.
                Err(_) => schema(None),
            }
        }
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
