//! `primitives [NAME|WORD]`: the manual: all primitives by group, one type in detail, or the types that mention a word.
//! Needs no cell.

use rcc_api::bodies::{ExampleView, ParameterView, PortView, PrimitiveView};
use rcc_api::{catalogue, codes, manual};
use rcc_core::primitives::SUBJECTS;

use crate::context::Context;
use crate::failure::Failure;
use crate::output::print_line;
use crate::table;

/// Arguments of `primitives`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Name of a type, or a word to search for in names, summaries and ports; without it all types are listed
    name: Option<String>,
    /// Only list this group (a word of its title)
    #[arg(long, conflicts_with = "name")]
    group: Option<String>,
    /// Print Markdown: one type, or the whole manual
    #[arg(long, conflicts_with = "group")]
    markdown: bool,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the primitive or group does not exist.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let all = catalogue::primitives();
    let found = match (&arguments.name, &arguments.group) {
        (None, None) => all.clone(),
        (None, Some(group)) => of_group(&all, group)?,
        (Some(name), _) => match all.iter().find(|view| view.name.eq_ignore_ascii_case(name)) {
            Some(view) => {
                if arguments.markdown {
                    print_line(manual::page(view).trim_end());
                } else {
                    context.print(view, describe);
                }
                return Ok(());
            }
            None => with_word(&all, name)?,
        },
    };
    if arguments.markdown {
        print_line(manual::document(&found).trim_end());
    } else {
        context.print(&found, |found| list(found));
    }
    Ok(())
}

fn of_group(all: &[PrimitiveView], word: &str) -> Result<Vec<PrimitiveView>, Failure> {
    let fits = |group: &str| group.to_lowercase().contains(&word.to_lowercase());
    let found: Vec<_> = all
        .iter()
        .filter(|view| fits(&view.group))
        .cloned()
        .collect();
    if found.is_empty() {
        let message = format!("group `{word}` not found");
        let titles: Vec<_> = SUBJECTS.iter().map(|subject| subject.title).collect();
        let help = format!("groups: {}", titles.join(", "));
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    }
    Ok(found)
}

fn with_word(all: &[PrimitiveView], word: &str) -> Result<Vec<PrimitiveView>, Failure> {
    let lower = word.to_lowercase();
    let has = |text: &str| text.to_lowercase().contains(&lower);
    let port = |port: &PortView| has(&port.name) || has(&port.doc);
    let fits = |view: &&PrimitiveView| {
        let ports = view.inputs.iter().chain(&view.outputs).any(port);
        let parameters = view
            .parameters
            .iter()
            .any(|one| has(&one.name) || has(&one.doc));
        has(&view.name) || has(&view.summary) || has(&view.formula) || ports || parameters
    };
    let found: Vec<_> = all.iter().filter(fits).cloned().collect();
    if !found.is_empty() {
        return Ok(found);
    }
    let known = all.iter().map(|view| view.name.as_str());
    let closest = rcc_config::diagnostic::closest(word, known);
    let help = closest.map_or_else(
        || "`rcc-cli primitives` lists all primitives".to_owned(),
        |closest| format!("did you mean {closest}?"),
    );
    let message = format!("primitive `{word}` not found");
    Err(Failure::new(codes::BAD_REQUEST, message, help))
}

fn list(all: &[PrimitiveView]) -> String {
    let mut text = String::new();
    for group in SUBJECTS.iter().map(|subject| subject.title) {
        let mut rows = table::table(&[&group.to_uppercase(), "WHAT IT DOES"]);
        let mut any = false;
        for view in all.iter().filter(|view| view.group == group) {
            rows.add_row([&view.name, &view.summary]);
            any = true;
        }
        if any {
            let gap = if text.is_empty() { "" } else { "\n\n" };
            text = format!("{text}{gap}{}", table::text(&rows));
        }
    }
    text
}

fn describe(view: &PrimitiveView) -> String {
    let mut text = format!("{}  {}\n  null: {}\n", view.name, view.summary, view.null);
    if !view.undefined.is_empty() {
        text = format!("{text}  undefined for: {}\n", view.undefined);
    }
    if !view.formula.is_empty() {
        text = format!("{text}  formula: {}\n", view.formula);
    }
    if view.remembers {
        text.push_str("  keeps state from cycle to cycle\n");
    }
    if view.unique {
        text.push_str("  exclusive: one net at a time\n");
    }
    for (head, more, ports) in [
        ("INPUT", "DEFAULT", &view.inputs),
        ("OUTPUT", "RANGE", &view.outputs),
    ] {
        if !ports.is_empty() {
            let mut rows = table::table(&[head, "TYPE", "UNIT", more, "WHAT"]);
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
    for example in &view.examples {
        text = format!("{text}\n{}\n", worked_values(example));
    }
    text
}

fn port_row(port: &PortView) -> [String; 5] {
    let (ty, unit) = (port.ty.clone(), port.unit.clone());
    let more = port.default.clone().unwrap_or_else(|| manual::range(port));
    [port.name.clone(), ty, unit, more, port.doc.clone()]
}

fn parameter_row(parameter: &ParameterView) -> [String; 5] {
    let bound = match manual::bounds(parameter).as_str() {
        "" => String::new(),
        bounds => format!(" ({bounds})"),
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

/// Formats a worked example, one row per cycle.
fn worked_values(example: &ExampleView) -> String {
    let names: Vec<String> = example
        .names
        .iter()
        .map(|name| name.to_uppercase())
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut rows = table::table(&names);
    for row in &example.rows {
        rows.add_row(row);
    }
    let mut about = format!("example: {}", example.shows);
    if !example.parameters.is_empty() {
        about = format!("{about}; parameters: {}", example.parameters);
    }
    if example.period_ms != 1 {
        about = format!("{about}; every {} ms", example.period_ms);
    }
    format!("{about}\n{}", table::text(&rows))
}
