//! One mistake in an example net gives one error: what follows from a reported error is not reported.

use std::path::Path;

use rcc_config::CellConfig;
use rcc_config::diagnostic::Severity;
use rcc_language::compile;

/// Inserts `x` behind the word that follows the first `before`.
fn misspelled(text: &str, before: &str, word: fn(char) -> bool) -> Option<String> {
    let start = text.find(before)? + before.len();
    let length = text[start..].find(|c| !word(c))?;
    let (head, tail) = text.split_at(start + length);
    Some(format!("{head}x{tail}"))
}

fn is_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// The source of the first input that is a link: `inputs: {in: PRIMITIVE.PORT`.
fn first_link(text: &str) -> Option<(usize, usize)> {
    let start = text.find("inputs: {")?;
    let start = start + text[start..].find(": {")? + 3;
    let start = start + text[start..].find(": ")? + 2;
    let length = text[start..].find(|c: char| !is_name(c) && c != '.')?;
    text[start..start + length]
        .contains('.')
        .then_some((start, start + length))
}

type Mistake = (&'static str, fn(&str) -> Option<String>);

/// The lines of the first entry of a primitive of this type, as a range; entries begin with two spaces.
fn entry(text: &str, ty: &str) -> Option<(usize, usize)> {
    let at = text.find(&format!("{{type: {ty}"))?;
    let start = text[..at].rfind('\n')? + 1;
    let is_entry = text[start..].starts_with("  ") && !text[start..].starts_with("   ");
    let next = |line: &str| !line.starts_with("   ");
    let mut end = start + text[start..].find('\n')? + 1;
    while text[end..]
        .lines()
        .next()
        .is_some_and(|line| !line.is_empty() && !next(line))
    {
        end += text[end..].find('\n')? + 1;
    }
    is_entry.then_some((start, end))
}

const MISTAKES: [Mistake; 8] = [
    ("unknown type", |text| misspelled(text, "{type: ", is_name)),
    ("unknown input", |text| {
        misspelled(text, "inputs: {", is_name)
    }),
    ("unknown parameter", |text| {
        misspelled(text, "parameters: {", is_name)
    }),
    ("unknown device", |text| {
        misspelled(text, "device: ", is_name)
    }),
    ("unknown output", |text| {
        let (_, end) = first_link(text)?;
        Some(format!("{}x{}", &text[..end], &text[end..]))
    }),
    ("unknown primitive", |text| {
        // With `x` in front, `xft` is too far from `ft` to be suggested, and the output of `ft` counts as unread.
        let (start, end) = first_link(text)?;
        let dot = start + text[start..end].find('.')?;
        Some(format!("{}x{}", &text[..dot], &text[dot..]))
    }),
    ("missing Termination", |text| {
        let (start, end) = entry(text, "Termination")?;
        Some(format!("{}{}", &text[..start], &text[end..]))
    }),
    ("a truth value for a number", |text| {
        // The constants of an `Input` determine its type: another one changes what all its readers get.
        let mut parts = text.match_indices(": ").map(|(at, _)| at);
        let is_number = |at: &usize| {
            let value = text[at + 2..].starts_with(|c: char| c.is_ascii_digit());
            let inside = text[..*at].rfind("parameters: {") > text[..*at].rfind('}');
            let of_input = ["initial", "at_least", "at_most"];
            value && inside && !of_input.iter().any(|name| text[..*at].ends_with(name))
        };
        let start = parts.find(is_number)? + 2;
        let length = text[start..].find([',', '}'])?;
        Some(format!("{}true{}", &text[..start], &text[start + length..]))
    }),
];

#[test]
fn one_mistake_in_an_example_gives_one_error() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let cell = CellConfig::load_offline(&configs.join("cells/demo.yaml")).expect("the demo's cell");
    let (mut count, mut wrong) = (0, Vec::new());
    for entry in std::fs::read_dir(configs.join("nets")).expect("the nets") {
        let path = entry.expect("an entry").path();
        let text = std::fs::read_to_string(&path).expect("a net");
        let name = path.display().to_string();
        // A net for another cell, or with a library, has errors of its own here.
        if compile(&text, &name, &cell).is_err() {
            continue;
        }
        for (what, mistake) in MISTAKES {
            let Some(changed) = mistake(&text) else {
                continue;
            };
            let errors: Vec<String> = match compile(&changed, &name, &cell) {
                Ok(_) => Vec::new(),
                Err(faults) => faults
                    .rows()
                    .into_iter()
                    .filter(|row| row.severity == Severity::Error)
                    .map(|row| format!("{}: {}", row.code, row.message))
                    .collect(),
            };
            count += 1;
            if errors.len() != 1 {
                wrong.push(format!("{what} in {name}: {errors:#?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count >= 60, "{count}");
}
