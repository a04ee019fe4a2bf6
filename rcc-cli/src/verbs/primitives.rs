//! `primitives [NAME]`: the catalogue, or everything about one type. Needs no cell.

use rcc_loader::server::api::{ParameterView, PortView, PrimitiveView};
use rcc_loader::server::catalogue;
use rcc_loader::server::codes;

use crate::context::Context;
use crate::failure::Failure;
use crate::table;

/// Which.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Name of a type; all without.
    name: Option<String>,
}

/// Does it.
///
/// # Errors
/// There is no such primitive.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let all = catalogue::primitives();
    let Some(name) = arguments.name else {
        context.print(&all, |all| list(all));
        return Ok(());
    };
    let Some(found) = all.iter().find(|view| view.name.eq_ignore_ascii_case(&name)) else {
        let known = all.iter().map(|view| view.name.as_str());
        let closest = rcc_config::diagnostic::closest(&name, known);
        let help = closest.map_or_else(
            || "`rcc-cli primitives` lists all".to_owned(),
            |closest| format!("did you mean {closest}?"),
        );
        let message = format!("there is no primitive `{name}`");
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    };
    context.print(found, one);
    Ok(())
}

fn list(all: &[PrimitiveView]) -> String {
    let mut rows = table::table(&["PRIMITIVE", "WHAT IT DOES"]);
    for view in all {
        rows.add_row([&view.name, &view.summary]);
    }
    table::text(&rows)
}

fn one(view: &PrimitiveView) -> String {
    let mut text = format!("{}  {}\n  null: {}\n", view.name, view.summary, view.null);
    if view.unique {
        text.push_str("  a unique resource: one net at a time\n");
    }
    for (head, ports) in [("INPUT", &view.inputs), ("OUTPUT", &view.outputs)] {
        if !ports.is_empty() {
            let mut rows = table::table(&[head, "TYPE", "UNIT", "DEFAULT", "WHAT"]);
            for port in ports {
                rows.add_row(port_row(port));
            }
            text = format!("{text}\n{}\n", table::text(&rows));
        }
    }
    if !view.parameters.is_empty() {
        let mut rows = table::table(&["PARAMETER", "TYPE", "UNIT", "DEFAULT", "WHAT"]);
        for parameter in &view.parameters {
            rows.add_row(parameter_row(parameter));
        }
        text = format!("{text}\n{}\n", table::text(&rows));
    }
    text
}

fn port_row(port: &PortView) -> [String; 5] {
    let (ty, unit) = (port.ty.clone(), port.unit.clone());
    let default = port.default.clone().unwrap_or_default();
    [port.name.clone(), ty, unit, default, port.doc.clone()]
}

fn parameter_row(parameter: &ParameterView) -> [String; 5] {
    let bounds = [
        parameter.above.map(|bound| format!("more than {bound}")),
        parameter.at_least.map(|bound| format!("at least {bound}")),
        parameter.at_most.map(|bound| format!("at most {bound}")),
    ];
    let bounds: Vec<String> = bounds.into_iter().flatten().collect();
    let bound = match bounds.is_empty() {
        true => String::new(),
        false => format!(" ({})", bounds.join(", ")),
    };
    let default = parameter.default.clone().unwrap_or_default();
    [
        parameter.name.clone(),
        parameter.ty.clone(),
        parameter.unit.clone(),
        default,
        format!("{}{bound}", parameter.doc),
    ]
}
