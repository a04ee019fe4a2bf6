//! Compiles a text to a plan, with everything that the server stores beside it. Run by blocking threads of the server,
//! and by `rcc-cli check` without a server.

use rcc_config::diagnostic::{DRAWN_MAX, DiagnosticRow, DrawingStyle, Faults, Severity, render};
use rcc_config::file_kind::root_entries;
use rcc_core::message::DEVICES_MAX;
use rcc_core::plan::Resource;
use rcc_language::devices::DeviceTable;
use rcc_language::names::Names;
use rcc_language::syntax::is_net_name;
use rcc_protocol::control::PlanData;

use crate::bodies::{Finding, TextLocation};

/// A successfully compiled net.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// The net's name.
    pub net: String,
    /// Its description.
    pub description: String,
    /// Its plan.
    pub plan: PlanData,
    /// Slots of every port and monitor in the plan.
    pub names: Names,
    /// Warnings.
    pub warnings: Vec<Finding>,
    /// Resources that the net claims exclusively.
    pub uses: Vec<Resource>,
    /// The topics that it publishes.
    pub topics: Vec<String>,
    /// True if the net has a `Cancel` primitive.
    pub can_cancel: bool,
    /// Number of primitives as the text has them: a formula or an instance of a fragment counts once.
    pub primitives: u32,
}

/// Compiles a text for a cell.
///
/// # Errors
/// Returns all errors and warnings of the text if it has an error.
pub fn compile(text: &str, file: &str, cell: &DeviceTable) -> Result<Compiled, Vec<Finding>> {
    let compiled = rcc_directionet::compiler(cell)
        .compile(text, file)
        .map_err(|faults| findings(&faults))?;
    let claims = &compiled.checked.resources;
    let bits = |bits: u64| (0..u64::BITS).filter(move |bit| bits >> bit & 1 == 1);
    let mut uses: Vec<Resource> = bits(claims.arms)
        .map(|device| Resource::Arm { device })
        .collect();
    for device in 0..DEVICES_MAX {
        let of = |table: &[u64; DEVICES_MAX]| table.get(device).copied().unwrap_or(0);
        let number = device as u32;
        uses.extend(bits(of(&claims.digital)).map(|channel| Resource::Digital {
            device: number,
            channel,
        }));
        uses.extend(bits(of(&claims.analog)).map(|channel| Resource::Analog {
            device: number,
            channel,
        }));
    }
    let topics = compiled.names.publishes.iter();
    let topics = topics.map(|row| row.topic.clone()).collect();
    Ok(Compiled {
        topics,
        names: compiled.names,
        net: compiled.net,
        description: compiled.description,
        warnings: findings(&compiled.warnings),
        plan: compiled.plan,
        uses,
        can_cancel: compiled.checked.can_cancel,
        primitives: compiled.primitives,
    })
}

/// Converts faults to findings. Beyond the first [`DRAWN_MAX`], findings have no source snippet, because each takes a
/// pass through the whole text.
#[must_use]
pub fn findings(faults: &Faults) -> Vec<Finding> {
    let style = DrawingStyle::default();
    let drawn = |row: &DiagnosticRow| render(std::slice::from_ref(row), &faults.sources, style);
    faults
        .rows()
        .into_iter()
        .enumerate()
        .map(|(number, row)| Finding {
            rendered: match number < DRAWN_MAX {
                true => drawn(&row),
                false => format!("{}: {}\n", row.code, row.message),
            },
            ..finding(row)
        })
        .collect()
}

fn finding(row: DiagnosticRow) -> Finding {
    Finding {
        code: row.code,
        severity: match row.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        }
        .to_owned(),
        message: row.message,
        place: (row.line > 0).then_some(TextLocation {
            file: row.file,
            line: row.line,
            column: row.column,
            length: row.length,
            label: row.label,
        }),
        used_at: row.used_at.map(|location| TextLocation {
            file: location.file,
            line: location.line,
            column: location.column,
            length: location.length,
            label: location.label,
        }),
        help: row.help,
        rendered: String::new(),
    }
}

/// Returns the net's name in a text, as far as it can be found in a text with errors; empty otherwise.
#[must_use]
pub fn name_of(text: &str) -> String {
    let entries = root_entries(text);
    let named = entries.iter().find(|(key, _)| *key == "net");
    let mut name = named.map_or("", |(_, value)| value).to_owned();
    if !is_net_name(&name) {
        // An invalid name is neither printed nor looked up: it may be an id, or control a terminal.
        name.clear();
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_is_found_in_broken_texts_too() {
        assert_eq!(name_of("# x\nnet: line # a line\nprimitives: [\n"), "line");
        assert_eq!(name_of("{\"net\": \"line\", \"primitives\": {"), "line");
        assert_eq!(
            name_of("{\"primitives\":{\"a\":{}},\"net\":\"line\"}"),
            "line"
        );
        assert_eq!(name_of("\u{feff}net : line\n"), "line");
        assert_eq!(name_of("nothing"), "");
        assert_eq!(name_of("net: \"1\"\n"), "");
        assert_eq!(name_of("net: left#7\n"), "");
        assert_eq!(name_of("net: Left\n"), "");
    }
}
