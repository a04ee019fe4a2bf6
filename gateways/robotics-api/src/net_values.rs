//! The values that a net reports, as the loader tells them, in the library's notation. Run by the engine and by the
//! threads of connections.

use std::collections::BTreeMap;

use crate::loader::{CellClient, LoaderError};
use crate::state::GatewayNet;

/// The command of which values were read.
#[derive(Debug)]
pub struct ReadCommand {
    /// Its state.
    pub state: String,
    /// The net's name.
    pub net: String,
    /// Cycle of the values.
    pub cycle: u64,
}

/// Reads the values that a net reports; null values are missing.
///
/// # Errors
/// Returns the loader's refusal.
pub fn read_values(
    loader: &mut CellClient,
    net: &GatewayNet,
    command: &str,
    values: &mut BTreeMap<String, String>,
) -> Result<ReadCommand, LoaderError> {
    /// More ports than this are asked for by one pattern.
    const NAMED_MAX: usize = 48;
    if net.reported.is_empty() {
        let detail = loader.state(command)?;
        return Ok(ReadCommand {
            state: detail.command.state,
            net: detail.command.net,
            cycle: 0,
        });
    }
    let ports: Vec<String> = match net.reported.len() {
        0..=NAMED_MAX => net
            .reported
            .iter()
            .map(|value| value.port.clone())
            .collect(),
        _ => vec!["out*.value".to_owned()],
    };
    let view = loader.values(command, &ports)?;
    let by_port: BTreeMap<&str, &serde_json::Value> = view
        .values
        .iter()
        .map(|value| (value.port.as_str(), &value.value))
        .collect();
    for reported in &net.reported {
        let value = by_port.get(reported.port.as_str());
        let text = value.and_then(|value| crate::values::to_library(&reported.type_name, value));
        match text {
            Some(text) => values.insert(reported.key.clone(), text),
            None => values.remove(&reported.key),
        };
    }
    Ok(ReadCommand {
        state: view.state,
        net: view.net,
        cycle: view.cycle,
    })
}
