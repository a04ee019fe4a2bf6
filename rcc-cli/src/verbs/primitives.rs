//! `primitives [NAME|WORD]`: the manual: all primitives by group, one type in detail, or the types that mention a word.
//! Needs no cell; with `--url` they are those of the cell's build.

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
    /// Name of a type, or a word to search for in names, summaries, formulas, ports, parameters and the names of other
    /// systems (docs/names.md); without it all types are listed
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
/// Fails if the primitive or group does not exist, or if the cell at `--url` cannot be reached.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let all = match context.remote {
        Some(_) => context.client()?.get("/primitives")?,
        None => catalogue::primitives(),
    };
    let found = match (&arguments.name, &arguments.group) {
        (None, None) => all.clone(),
        (None, Some(group)) => of_group(&all, group)?,
        (Some(name), _) => match all.iter().find(|view| view.name.eq_ignore_ascii_case(name)) {
            Some(view) => {
                if arguments.markdown {
                    print_line(manual::page(view).trim_end());
                } else {
                    context.print(view, |view| {
                        describe(view) + &also(&mentioning(&all, name), view)
                    });
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
    let fits = |view: &&PrimitiveView| texts(view).into_iter().any(has);
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

/// Names of blocks in other systems, and of the primitives that correspond to them.
const ELSEWHERE: &str = include_str!("../../../docs/names.md");

/// Returns the texts of a primitive that a search looks into.
fn texts(view: &PrimitiveView) -> Vec<&str> {
    let ports = view.inputs.iter().chain(&view.outputs);
    let ports = ports.flat_map(|port| [port.name.as_str(), &port.doc]);
    let parameters = view.parameters.iter();
    let parameters = parameters.flat_map(|one| [one.name.as_str(), &one.doc]);
    let own = [view.name.as_str(), &view.summary, &view.formula];
    let mut texts: Vec<&str> = own.into_iter().chain(ports).chain(parameters).collect();
    let quoted = format!("`{}`", view.name);
    let rows = ELSEWHERE.lines().filter_map(|line| {
        let (theirs, ours) = line.strip_prefix("| ")?.split_once(" | ")?;
        ours.contains(&quoted).then_some(theirs)
    });
    texts.extend(rows);
    texts
}

/// Returns the types whose texts contain the word as a whole.
fn mentioning<'a>(all: &'a [PrimitiveView], word: &str) -> Vec<&'a PrimitiveView> {
    let same = |part: &str| part.eq_ignore_ascii_case(word);
    let has = |text: &str| text.split(|c: char| !c.is_alphanumeric()).any(same);
    let fits = |view: &&PrimitiveView| texts(view).into_iter().any(has);
    all.iter().filter(fits).collect()
}

/// Lists other types that mention the name of this one; the most that are worth reading.
fn also(mentioning: &[&PrimitiveView], view: &PrimitiveView) -> String {
    const SHOWN_MAX: usize = 8;
    let others = mentioning.iter().filter(|other| other.name != view.name);
    let mut rows = table::table(&["SEE ALSO", "SUMMARY"]);
    for other in others.clone().take(SHOWN_MAX) {
        rows.add_row([&other.name, &other.summary]);
    }
    match others.count() {
        0 => String::new(),
        1..=SHOWN_MAX => format!("\n{}", table::text(&rows)),
        all => format!("\n{}\n… and {} more", table::text(&rows), all - SHOWN_MAX),
    }
}

fn list(all: &[PrimitiveView]) -> String {
    let mut text = String::new();
    for group in SUBJECTS.iter().map(|subject| subject.title) {
        let mut rows = table::table(&[&group.to_uppercase(), "SUMMARY"]);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Names of the types that `primitives WORD` shows.
    fn shown(word: &str) -> Vec<String> {
        let all = catalogue::primitives();
        let exact = all.iter().any(|view| view.name.eq_ignore_ascii_case(word));
        let found = match exact {
            true => mentioning(&all, word).into_iter().cloned().collect(),
            false => with_word(&all, word).unwrap(),
        };
        found.into_iter().map(|view| view.name).collect()
    }

    #[test]
    fn a_word_finds_names_outputs_and_the_names_of_other_systems() {
        for (word, name) in [
            ("sine", "Sine"),
            ("sine", "SignalGenerator"),
            ("siggen", "SignalGenerator"),
            ("sawtooth", "SignalGenerator"),
            ("R_TRIG", "RisingEdge"),
            ("TON", "OnDelay"),
            ("saturation", "Limit"),
            ("MoveL", "LinearMotion"),
            ("ptp", "JointMotion"),
        ] {
            assert!(
                shown(word).iter().any(|found| found == name),
                "{word}: {name}"
            );
        }
    }

    #[test]
    fn a_page_names_the_other_types_that_mention_it() {
        let all = catalogue::primitives();
        let sine = all.iter().find(|view| view.name == "Sine").unwrap();
        let more = also(&mentioning(&all, "sine"), sine);
        assert!(
            more.contains("SEE ALSO") && more.contains("SignalGenerator"),
            "{more}"
        );
        assert!(!more.contains("\nSine "), "{more}");
    }
}
