//! Incidents as curves: a recording is evaluated again, and values of each cycle are returned as columns. Works without
//! loader and executor. Run by blocking threads, one replay at a time.

use std::collections::BTreeMap;
use std::path::PathBuf;

use rcc_api::bodies::ErrorBody;
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::incident_nets::{IncidentNet, ShownSlots};
use rcc_api::incidents::{IncidentFolder, is_file_name};
use rcc_engine::incident::Incident;
use rcc_engine::replay::{ReplaySource, replay};
use rcc_ipc::Cell;
use rcc_protocol::pattern::Pattern;
use serde_json::{Map, Value, json};

/// Maximum number of columns of one answer.
const COLUMNS_MAX: usize = 64;
/// Maximum number of values of one answer.
const VALUES_MAX: usize = 2_000_000;

fn failed(message: impl Into<String>, help: &str) -> ErrorBody {
    ApiError::new(codes::NO_INCIDENT, message.into(), help).body()
}

fn folder(cell: &str) -> Result<PathBuf, ErrorBody> {
    let found = Cell::find(cell).map_err(|error| failed(error.to_string(), ""))?;
    let cell = found.ok_or_else(|| {
        failed(
            format!("cell `{cell}` not found"),
            "start it with `rcc-cli up FILE`",
        )
    })?;
    Ok(cell.state().incidents_dir())
}

/// Returns the cell's incidents, oldest first.
///
/// # Errors
/// Returns an error if the cell does not exist or its folder cannot be read.
pub fn list(cell: &str) -> Result<Value, ErrorBody> {
    let folder = folder(cell)?;
    let found = IncidentFolder::read(&folder);
    let found = found.map_err(|error| {
        failed(
            format!("{}: {error}", folder.display()),
            "check its permissions",
        )
    })?;
    Ok(json!(found.incidents))
}

fn open(cell: &str, name: &str) -> Result<(Incident, BTreeMap<u64, IncidentNet>), ErrorBody> {
    if !is_file_name(name) {
        return Err(failed(
            format!("`{name}` is not the name of an incident"),
            "choose one of the list",
        ));
    }
    let incident = Incident::read(&folder(cell)?.join(name));
    let incident =
        incident.map_err(|error| failed(format!("{name}: {error}"), "choose another one"))?;
    let of = |id: &u64| {
        (
            *id,
            IncidentNet::of(*id, incident.files.get(id).map(Vec::as_slice)),
        )
    };
    let nets = incident.nets.keys().map(of).collect();
    Ok((incident, nets))
}

/// Returns the ports of an incident's nets, with types and units.
///
/// # Errors
/// Returns an error if there is no such incident, or if it cannot be read.
pub fn ports(cell: &str, name: &str) -> Result<Value, ErrorBody> {
    let (incident, nets) = open(cell, name)?;
    let rows = nets.values().map(|net| {
        let ports = net.names.primitives.iter().flat_map(|primitive| {
            primitive.outputs.iter().map(|port| {
                json!({
                    "port": format!("{}.{}", primitive.id, port.name), "type": port.type_name, "unit": port.unit,
                    "width": port.width,
                })
            })
        });
        json!({"id": net.id, "net": net.net, "title": net.title(), "ports": ports.collect::<Vec<_>>()})
    });
    Ok(json!({"head": incident.head, "nets": rows.collect::<Vec<_>>()}))
}

/// Returns the values of ports in each recorded cycle, as columns, and whether the replay is the same as the recording.
///
/// # Errors
/// As [`ports`]; also if no port matches, or too many do.
pub fn values(cell: &str, name: &str, patterns: &[String]) -> Result<Value, ErrorBody> {
    let (incident, nets) = open(cell, name)?;
    let parsed = patterns.iter().map(|pattern| pattern.parse::<Pattern>());
    let patterns: Vec<Pattern> = parsed
        .collect::<Result<_, _>>()
        .map_err(|error| failed(error.to_string(), ""))?;
    let shown: BTreeMap<u64, Vec<ShownSlots>> = nets
        .iter()
        .map(|(id, net)| (*id, net.shown(&patterns)))
        .collect();
    let count: usize = shown.values().flatten().map(|one| one.width as usize).sum();
    if count == 0 || count > COLUMNS_MAX {
        let message = format!("{count} columns match; 1 to {COLUMNS_MAX} can be shown");
        return Err(failed(message, "choose other ports"));
    }
    let mut columns: BTreeMap<u64, NetColumns> = BTreeMap::new();
    let (mut first_ns, mut rows) = (None, 0);
    let source = ReplaySource {
        models: &incident.models,
        configuration: incident.configuration,
        nets: &incident.nets,
        words: &incident.records,
    };
    let results = replay(&source, None, |step| {
        let first = *first_ns.get_or_insert(step.woke_ns);
        let Some(shown) = shown.get(&step.id).filter(|shown| !shown.is_empty()) else {
            return;
        };
        if rows * count >= VALUES_MAX {
            return;
        }
        rows += 1;
        let net = columns.entry(step.id).or_default();
        net.cycles.push(step.cycle);
        net.seconds
            .push(step.woke_ns.saturating_sub(first) as f64 * 1e-9);
        net.values
            .extend(shown.iter().flat_map(|one| one.values(step.net)));
    });
    let results =
        results.map_err(|error| failed(format!("{name}: {error}"), "choose another one"))?;
    let identical = results.iter().all(|net| net.different == 0);
    let nets = columns.into_iter().map(|(id, net)| {
        let names: Vec<String> = shown[&id].iter().flat_map(ShownSlots::columns).collect();
        net.described(id, &names)
    });
    Ok(json!({
        "cycle": incident.head.cycle, "identical": identical, "whole": rows * count < VALUES_MAX,
        "nets": nets.collect::<Vec<_>>(),
    }))
}

/// Values of a net, row by row.
#[derive(Default)]
struct NetColumns {
    cycles: Vec<u64>,
    seconds: Vec<f64>,
    values: Vec<Value>,
}

impl NetColumns {
    fn described(&self, id: u64, names: &[String]) -> Value {
        let columns = names.iter().enumerate().map(|(index, name)| {
            let values = self.values.iter().skip(index).step_by(names.len());
            (name.clone(), values.cloned().collect())
        });
        let columns: Map<String, Value> = columns.collect();
        json!({"id": id, "cycles": self.cycles, "seconds": self.seconds, "columns": columns})
    }
}
