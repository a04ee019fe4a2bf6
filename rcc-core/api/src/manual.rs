//! The manual of the primitives in Markdown, generated from their specs: `docs/primitives.md` and `rcc-cli primitives
//! --markdown`. Computed on request; a test compares the document with it.

use rcc_core::primitives::SUBJECTS;

use crate::bodies::{ExampleView, ParameterView, PortView, PrimitiveView};

const HEAD: &str = "# Primitives

Made from the catalogue by `rcc-cli primitives --markdown > docs/primitives.md`; `rcc-cli primitives NAME` shows one of them.
Equal letters in the column \"unit\" stand for equal units. A worked value is a table with one row a cycle; a test runs every
one of them through the whole language.
";

/// Returns the whole manual: a table of contents by chapter, and a section for each primitive.
#[must_use]
pub fn document(all: &[PrimitiveView]) -> String {
    let mut text = HEAD.to_owned();
    for group in SUBJECTS.iter().map(|subject| subject.title) {
        let mut rows = all.iter().filter(|view| view.group == group).peekable();
        if rows.peek().is_none() {
            continue;
        }
        push(
            &mut text,
            &format!("\n## {group}\n\n| primitive | what it does |\n|---|---|\n"),
        );
        for view in rows {
            let (name, link) = (&view.name, view.name.to_lowercase());
            push(
                &mut text,
                &format!("| [{name}](#{link}) | {} |\n", cell(&view.summary)),
            );
        }
    }
    for view in all {
        push(&mut text, &format!("\n{}", page(view)));
    }
    text
}

/// Returns the section of one primitive.
#[must_use]
pub fn page(view: &PrimitiveView) -> String {
    let mut text = format!("### {}\n\n{}\n", view.name, view.summary);
    if view.unique {
        push(&mut text, "A unique resource: one net at a time.\n");
    }
    push(&mut text, &format!("\n**Null:** {}.", view.null));
    if !view.undefined.is_empty() {
        push(
            &mut text,
            &format!(" **No result** for {}.", view.undefined),
        );
    }
    if view.remembers {
        push(&mut text, " It remembers from cycle to cycle.");
    }
    push(&mut text, "\n");
    if !view.formula.is_empty() {
        push(&mut text, &format!("\n**Formula:** {}\n", view.formula));
    }
    ports(&mut text, "input", &view.inputs);
    parameters(&mut text, &view.parameters);
    ports(&mut text, "output", &view.outputs);
    for example in &view.examples {
        worked(&mut text, example);
    }
    text
}

fn push(text: &mut String, more: &str) {
    text.push_str(more);
}

/// Escapes a text for a table cell.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

fn ports(text: &mut String, kind: &str, ports: &[PortView]) {
    if ports.is_empty() {
        return;
    }
    push(
        text,
        &format!(
            "\n| {kind} | type | unit | {} | |\n|---|---|---|---|---|\n",
            range_title(kind)
        ),
    );
    for port in ports {
        let more = match (&port.default, port.diagnostic) {
            (Some(default), _) => match range(port) {
                range if range.is_empty() => default.clone(),
                range => format!("{default}; {range}"),
            },
            (None, true) => "may be left unread".to_owned(),
            (None, false) => range(port),
        };
        let row = [&port.ty, &port.unit, &more, &port.doc].map(|text| cell(text));
        push(
            text,
            &format!("| `{}` | {} |\n", port.name, row.join(" | ")),
        );
    }
}

fn range_title(kind: &str) -> &'static str {
    if kind == "input" { "default" } else { "range" }
}

/// Returns the range of an output, or of constants at an input; empty if it has none.
#[must_use]
pub fn range(port: &PortView) -> String {
    match (port.least, port.greatest) {
        (None, None) => String::new(),
        (Some(least), None) => format!("at least {least}"),
        (None, Some(greatest)) => format!("at most {greatest}"),
        (Some(least), Some(greatest)) => format!("{least} to {greatest}"),
    }
}

fn parameters(text: &mut String, parameters: &[ParameterView]) {
    if parameters.is_empty() {
        return;
    }
    push(
        text,
        "\n| parameter | type | unit | default | |\n|---|---|---|---|---|\n",
    );
    for parameter in parameters {
        let default = parameter
            .default
            .clone()
            .unwrap_or_else(|| "required".to_owned());
        let doc = match bounds(parameter).as_str() {
            "" => parameter.doc.clone(),
            bounds => format!("{} ({bounds})", parameter.doc),
        };
        let row = [&parameter.ty, &parameter.unit, &default, &doc].map(|text| cell(text));
        push(
            text,
            &format!("| `{}` | {} |\n", parameter.name, row.join(" | ")),
        );
    }
}

/// Returns the bounds of a parameter in words; empty if it has none.
#[must_use]
pub fn bounds(parameter: &ParameterView) -> String {
    let bounds = [
        parameter.above.map(|bound| format!("more than {bound}")),
        parameter.at_least.map(|bound| format!("at least {bound}")),
        parameter.at_most.map(|bound| format!("at most {bound}")),
    ];
    bounds.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

fn worked(text: &mut String, example: &ExampleView) {
    let mut about = format!("\n**Worked:** {}", example.shows);
    if !example.parameters.is_empty() {
        about = format!("{about}; `parameters: {}`", example.parameters);
    }
    if example.period_ms != 1 {
        about = format!("{about}; every {} ms", example.period_ms);
    }
    push(text, &format!("{about}\n\n"));
    let line = |cells: &[String]| {
        let cells: Vec<String> = cells.iter().map(|text| cell(text)).collect();
        format!("| {} |\n", cells.join(" | "))
    };
    push(text, &line(&example.names));
    push(text, &format!("|{}\n", "---|".repeat(example.names.len())));
    for row in &example.rows {
        push(text, &line(row));
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::catalogue::primitives;

    #[test]
    fn the_document_is_current() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/primitives.md");
        let wanted = document(&primitives());
        if std::env::var_os("RCC_BLESS").is_some() {
            std::fs::write(&path, &wanted).unwrap();
        }
        if !path.exists() {
            return eprintln!("skipped: docs/primitives.md not found; RCC_BLESS=1 creates it");
        }
        let is = std::fs::read_to_string(&path).unwrap_or_default();
        let first = is
            .lines()
            .zip(wanted.lines())
            .find(|(is, wanted)| is != wanted);
        assert!(
            is == wanted,
            "docs/primitives.md is out of date ({first:?}): run RCC_BLESS=1 cargo test -p rcc-api --lib manual"
        );
    }

    #[test]
    fn every_primitive_is_in_the_contents_once() {
        let all = primitives();
        let text = document(&all);
        for view in all {
            let entry = format!("| [{}](", view.name);
            assert_eq!(text.matches(&entry).count(), 1, "{}", view.name);
        }
    }
}
