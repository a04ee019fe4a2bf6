//! Values that a client sets: a mapping from names of `Input`s to constants of the language, checked for type, unit and
//! range. Runs on blocking threads of the server; not real-time.

use rcc_config::article::with_article;
use rcc_config::diagnostic::{Diagnostic, Faults, Severity, closest};
use rcc_config::yaml::{self, Entry, Value};
use rcc_core::types::Type;
use rcc_core::unit::Unit;
use rcc_protocol::control::{InputValue, SET_ELEMENTS_MAX, SET_MAX};

use crate::check::literal_fits;
use crate::codes;
use crate::names::{InputNames, Names};
use crate::parse::literal;
use crate::syntax::literal::Literal;

/// Reads the values to be set in the net with these names. `file` is the name that diagnostics show.
///
/// # Errors
/// Returns all errors of the text.
pub fn read(text: &str, file: &str, names: &Names) -> Result<Vec<InputValue>, Faults> {
    let (root, mut diagnostics) = yaml::read(text);
    let mut values = Vec::new();
    if let Some(root) = &root {
        match &root.value {
            Value::Map(entries) if !entries.is_empty() => {
                let read = entries
                    .iter()
                    .filter_map(|entry| value(entry, names, &mut diagnostics));
                values.extend(read);
            }
            _ => {
                let message = format!(
                    "expected a mapping from input names to values, found {}",
                    root.kind()
                );
                let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, root.span, message);
                diagnostics.push(
                    diagnostic
                        .help("write `NAME: VALUE`, or {\"NAME\": VALUE}; null clears a value"),
                );
            }
        }
        let elements: usize = values.iter().map(|value| value.words.len()).sum();
        if values.len() > SET_MAX || elements > SET_ELEMENTS_MAX {
            let message = format!(
                "{} values with {elements} elements are too many: at most {SET_MAX} values with {SET_ELEMENTS_MAX} elements are allowed",
                values.len()
            );
            let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, root.span, message);
            diagnostics.push(diagnostic.help("set them in several requests"));
        }
    }
    if diagnostics
        .iter()
        .any(|diagnostic| diagnostic.severity == Severity::Error)
        || root.is_none()
    {
        for diagnostic in &mut diagnostics {
            if diagnostic.help.is_none() {
                diagnostic.help = codes::remedy(diagnostic.code).map(str::to_owned);
            }
        }
        return Err(Faults::new(file, text, diagnostics));
    }
    Ok(values)
}

fn value(entry: &Entry, names: &Names, diagnostics: &mut Vec<Diagnostic>) -> Option<InputValue> {
    let name = &entry.key.name;
    let mut settable = names.settable();
    let Some((index, input)) = settable.find(|(_, input)| input.primitive == *name) else {
        diagnostics.push(unknown(entry, names));
        return None;
    };
    let before = diagnostics.len();
    let literal = literal::read(&entry.value, diagnostics);
    if diagnostics.len() > before {
        return None;
    }
    let Some(ty) = type_of(&input.type_name) else {
        let message = format!(
            "`{name}` has the type `{}`, which this program does not know",
            input.type_name
        );
        let diagnostic = Diagnostic::error(codes::TYPE_MISMATCH, entry.key.span, message);
        diagnostics
            .push(diagnostic.help("install loader and executor from one build and restart them"));
        return None;
    };
    let unit = input.unit.as_deref().and_then(Unit::parse);
    literal_fits(&literal, ty, unit.map(|(unit, _)| unit), name, diagnostics);
    within(input, &literal, diagnostics);
    if diagnostics.len() > before {
        return None;
    }
    let words = literal.stored(ty)?.words().to_vec();
    Some(InputValue {
        input: index,
        words,
    })
}

fn unknown(entry: &Entry, names: &Names) -> Diagnostic {
    let name = &entry.key.name;
    let known = names.settable().map(|(_, input)| input.primitive.as_str());
    let all: Vec<&str> = known.clone().take(16).collect();
    let net = &names.net;
    let other = names
        .primitives
        .iter()
        .find(|primitive| primitive.id == *name);
    let message = match other {
        Some(other) => format!(
            "`{name}` of `{net}` is {}: only an Input can be set",
            with_article(&other.type_name)
        ),
        None => format!("`{net}` has no Input `{name}`"),
    };
    let help = match closest(name, known) {
        Some(near) => format!("did you mean `{near}`?"),
        None if all.is_empty() => {
            "the net has no Input: add `NAME: {type: Input}` to its text".to_owned()
        }
        None => format!("inputs: {}", all.join(", ")),
    };
    Diagnostic::error(codes::UNKNOWN_PRIMITIVE, entry.key.span, message).help(help)
}

/// Checks that each element is within the bounds of the input.
fn within(input: &InputNames, literal: &Literal, diagnostics: &mut Vec<Diagnostic>) {
    let unit = input
        .unit
        .as_ref()
        .map_or(String::new(), |unit| format!(" {unit}"));
    for (bounds, least) in [(&input.at_least, true), (&input.at_most, false)] {
        // A null element is within all bounds, and a bound that is NaN holds nothing back.
        let pairs = literal.elements_or_null().zip(bounds);
        let pairs = pairs.filter_map(|(value, bound)| Some((value?, *bound)));
        let mut outside = pairs.filter(|(value, bound)| match least {
            true => value < bound,
            false => value > bound,
        });
        if let Some((value, bound)) = outside.next() {
            let wanted = if least { "at least" } else { "at most" };
            let name = &input.primitive;
            let message = format!("`{name}` must be {wanted} {bound}{unit}, found {value}{unit}");
            diagnostics.push(Diagnostic::error(
                codes::OUT_OF_RANGE,
                literal.span,
                message,
            ));
        }
    }
}

/// Returns the type with this printed name.
#[must_use]
pub fn type_of(name: &str) -> Option<Type> {
    let single = [
        Type::Bool,
        Type::Int,
        Type::Real,
        Type::Vector3,
        Type::Rotation,
        Type::Pose,
        Type::Twist,
        Type::Wrench,
    ];
    if let Some(found) = single.into_iter().find(|ty| ty.to_string() == name) {
        return Some(found);
    }
    let (kind, size) = name.strip_suffix(']')?.split_once('[')?;
    match (kind, size.split_once(',')) {
        ("Real", Some((rows, columns))) => {
            Some(Type::Matrix(rows.parse().ok()?, columns.parse().ok()?))
        }
        ("Real", None) => Some(Type::Reals(size.parse().ok()?)),
        ("Bool", None) => Some(Type::Bools(size.parse().ok()?)),
        ("Int", None) => Some(Type::Ints(size.parse().ok()?)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(primitive: &str, type_name: &str, unit: Option<&str>) -> InputNames {
        InputNames {
            primitive: primitive.to_owned(),
            type_name: type_name.to_owned(),
            unit: unit.map(str::to_owned),
            at_least: Vec::new(),
            at_most: Vec::new(),
            expires_s: None,
            topic: None,
        }
    }

    fn names() -> Names {
        let speed = InputNames {
            at_least: vec![0.0],
            at_most: vec![0.25],
            ..input("speed", "Real", Some("m/s"))
        };
        Names {
            net: "jog".to_owned(),
            inputs: vec![
                speed,
                input("goal", "Pose", None),
                input("on", "Bool", None),
                input("count", "Int", None),
                input("joints", "Real[2]", Some("rad")),
            ],
            ..Names::default()
        }
    }

    fn diagnostics(text: &str) -> String {
        let refused = read(text, "values", &names());
        refused.map_or_else(
            |diagnostics| diagnostics.render(false),
            |values| panic!("{values:?}"),
        )
    }

    #[test]
    fn literals_with_units_become_words_in_json_and_in_yaml() {
        let real = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect();
        let want = vec![
            InputValue {
                input: 2,
                words: vec![1],
            },
            InputValue {
                input: 0,
                words: real(&[0.2]),
            },
            InputValue {
                input: 4,
                words: real(&[1.0, 2.0]),
            },
            InputValue {
                input: 3,
                words: vec![(-7i64).cast_unsigned()],
            },
        ];
        let json = r#"{"on": true, "speed": "0.2 m/s", "joints": [1, 2], "count": -7}"#;
        let yaml = "on: true\nspeed: 200 mm/s\njoints: [1, 2 rad]\ncount: -7\n";
        for text in [json, yaml] {
            assert_eq!(
                read(text, "values", &names()).ok().as_ref(),
                Some(&want),
                "{text}"
            );
        }
    }

    #[test]
    fn null_is_null_of_every_type() {
        let values = read(
            "{speed: null, on: ~, count: null, goal: null}",
            "values",
            &names(),
        );
        let values = values.unwrap_or_else(|diagnostics| panic!("{diagnostics}"));
        assert!(f64::from_bits(values[0].words[0]).is_nan());
        assert_eq!((values[1].words[0], values[2].words[0]), (2, 1 << 63));
        assert_eq!(values[3].words.len(), 7);
    }

    #[test]
    fn all_errors_are_reported_with_the_names_of_the_inputs() {
        let text = "{sped: 0.2, speed: 0.3 m/s, on: 1, count: 2 N, joints: [1, 2, 3], goal: {xyz: [1, 2]}}";
        let rendered = diagnostics(text);
        for words in [
            "no Input `sped`",
            "did you mean `speed`?",
            "`speed` must be at most 0.25 m/s, found 0.3 m/s",
            "`on` expects Bool, found 1",
            "`count` expects Int, found 2 N",
            "`joints` expects Real[2]",
            "xyz",
        ] {
            assert!(rendered.contains(words), "{words} is not in\n{rendered}");
        }
        assert!(diagnostics("{speed: 0.2 N}").contains("`speed` expects m/s, found N"));
    }

    #[test]
    fn values_that_are_not_a_mapping_are_refused() {
        for text in [
            "",
            "[1]",
            "7",
            "{}",
            "{speed: 1, speed: 2}",
            "{speed: fast}",
            "{",
        ] {
            assert!(read(text, "values", &names()).is_err(), "{text}");
        }
    }

    #[test]
    fn every_type_is_found_by_its_name() {
        for ty in [
            Type::Bool,
            Type::Pose,
            Type::Reals(7),
            Type::Bools(3),
            Type::Ints(2),
            Type::Matrix(4, 4),
        ] {
            assert_eq!(type_of(&ty.to_string()), Some(ty));
        }
        assert_eq!(type_of("Text"), None);
        assert_eq!(type_of("Real[x]"), None);
    }
}
