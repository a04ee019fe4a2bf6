//! The table of types in reverse: the predecessor's types for each RCC primitive. Used by `rcc-cli convert`.

use std::collections::HashMap;

use crate::table::{self, TypeEntry};
use crate::text::{self, AstArgument};

/// A row of the table in reverse: the predecessor's type for an RCC primitive.
pub struct ReverseRow {
    /// The predecessor's type.
    pub entry: &'static TypeEntry,
    /// RCC input or parameter, and its counterpart.
    pub arguments: Vec<(&'static str, &'static str)>,
    /// RCC output and its counterpart.
    pub outputs: Vec<(&'static str, &'static str)>,
}

/// Returns, by RCC type, all rows that consist of one primitive with only `parent`'s inputs and parameters as
/// arguments.
pub fn reverse_rows() -> HashMap<&'static str, Vec<ReverseRow>> {
    let mut entries: Vec<&TypeEntry> = table::all().values().collect();
    entries.sort_by_key(|entry| &entry.name);
    let mut rows: HashMap<&str, Vec<ReverseRow>> = HashMap::new();
    for entry in entries {
        if let [net] = entry.nets.as_slice()
            && let Some((rcc_name, row)) = reverse_row(entry, net)
        {
            rows.entry(rcc_name).or_default().push(row);
        }
    }
    rows
}

fn reverse_row(
    entry: &'static TypeEntry,
    net: &'static text::AstFragment,
) -> Option<(&'static str, ReverseRow)> {
    let mut found = None;
    let mut outputs = Vec::new();
    for item in &net.items {
        if let text::AstPrimitive::Typed(ty, arguments) = &item.primitive {
            if found.is_some() {
                return None;
            }
            found = Some((ty, arguments));
        }
        if let Some(port) = &item.port {
            outputs.push((port.name.as_str(), item.name.name.as_str()));
        }
    }
    let (ty, arguments) = found?;
    let plain = arguments
        .iter()
        .map(|AstArgument { name, value, .. }| match value {
            text::AstValue::Link(from, port) => match &**from {
                text::AstPrimitive::Named(parent) if parent.name == "parent" => {
                    Some((name.name.as_str(), port.name.as_str()))
                }
                _ => None,
            },
            text::AstValue::Text(..) => None,
        });
    let arguments = plain.collect::<Option<Vec<_>>>()?;
    Some((
        ty.name.as_str(),
        ReverseRow {
            entry,
            arguments,
            outputs,
        },
    ))
}
