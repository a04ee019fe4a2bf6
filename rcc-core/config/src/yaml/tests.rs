//! Tests of the parser: values, positions and refusals.

use super::*;

fn codes(text: &str) -> Vec<&'static str> {
    parse(text)
        .unwrap_err()
        .iter()
        .map(|fault| fault.code)
        .collect()
}

fn value(text: &str) -> Value {
    parse(&format!("x: {text}\n"))
        .unwrap()
        .get("x")
        .unwrap()
        .value
        .clone()
}

#[test]
fn scalars_are_what_they_look_like() {
    let text = |text: &str| Value::Text(text.into());
    for (given, expected) in [
        ("null", Value::Null),
        ("~", Value::Null),
        ("", Value::Null),
        ("true", Value::Bool(true)),
        ("no", text("no")),
        ("12", Value::Int(12)),
        ("-3", Value::Int(-3)),
        ("1.5e3", Value::Real(1500.0)),
        ("010", text("010")),
        ("0x10", text("0x10")),
        (".inf", text(".inf")),
        ("1e999", text("1e999")),
        (
            "9223372036854775808",
            Value::Real(9_223_372_036_854_775_808.0),
        ),
        ("'12'", text("12")),
        ("\"a\\u00e9\"", text("aé")),
        ("deg(30)", text("deg(30)")),
        ("0.25 m/s", text("0.25 m/s")),
    ] {
        assert_eq!(value(given), expected, "{given}");
    }
}

#[test]
fn terminal_control_characters_are_refused_everywhere() {
    for text in [
        "a: \"x\\e[2J\"",
        "a: \"x\\u202E\"",
        "a: x\u{202e}",
        "{\"a\": \"\\u009b31m\"}",
        "\"a\\x07\": 1",
        "a: [x, \"\\x7f\"]",
        "a: \"\\r\"",
    ] {
        assert_eq!(codes(text), [UNPRINTABLE], "{text}");
    }
    let fine =
        "a: |\r\n  two\r\n  lines\r\nb: \"tab\\tand\\nline\"\r\nc: grün 日本 🤖 # c\u{202e}\r\n";
    let tree = parse(&format!("\u{feff}{fine}")).unwrap();
    assert_eq!(tree.get("a").and_then(Node::text), Some("two\nlines\n"));
    // Other faults of the text are reported as well.
    let (root, faults) = read("a: \"\\e\"\nb: 1\nb: 2\n");
    assert_eq!((root.is_some(), faults.len()), (true, 2));
}

#[test]
fn yaml_and_json_give_the_same_tree() {
    let yaml = parse("net: a\nlist: [1, 2.5, b.c]\nmap:\n  x: {y: null}\n").unwrap();
    let json = parse("{\n\t\"net\": \"a\",\n\t\"list\": [1, 2.5, \"b.c\"],\n\t\"map\": {\"x\": {\"y\": null}}\n}").unwrap();
    assert_eq!(yaml.to_json(), json.to_json());
}

#[test]
fn every_value_knows_its_place() {
    let text = "a: ü\nlist:\n  - one\n  - {b: two}\nend: 'x'\n";
    let root = parse(text).unwrap();
    let slice = |node: &Node| &text[node.span.start..node.span.end];
    assert_eq!(slice(root.get("a").unwrap()), "ü");
    let list = root.get("list").unwrap();
    assert_eq!(slice(list), "- one\n  - {b: two}");
    assert_eq!(slice(&list.list().unwrap()[1]), "{b: two}");
    assert_eq!(slice(root.get("end").unwrap()), "'x'");
    let key = &root.map().unwrap()[1].key;
    assert_eq!(&text[key.span.start..key.span.end], "list");
}

#[test]
fn all_duplicate_keys_are_found() {
    assert_eq!(
        codes("a: 1\nb: {c: 1, c: 2}\na: 2\n"),
        [DUPLICATE_KEY, DUPLICATE_KEY]
    );
    assert_eq!(codes("{\"a\": 1, \"a\": 2}"), [DUPLICATE_KEY]);
}

#[test]
fn broken_text_is_refused_with_a_place() {
    for text in [
        "a: [1, 2",
        "a: b: c",
        "{\"a\": 1,, }",
        "a: 'x",
        "a:\n\tb: 1",
        "a: @b",
    ] {
        let faults = parse(text).unwrap_err();
        assert_eq!(faults[0].code, BROKEN, "{text}");
        assert!(faults[0].place.is_some(), "{text}");
    }
}

#[test]
fn unsupported_yaml_is_refused() {
    for text in [
        "a: &x 1\nb: *x",
        "a: !t 1",
        "a: !!str 1",
        "a: 1\n---\nb: 2",
        "? [a]\n: 1",
        "{[a]: 1}",
    ] {
        assert_eq!(codes(text), [NOT_SUPPORTED], "{text}");
    }
}

#[test]
fn length_and_depth_are_bounded() {
    assert_eq!(codes(&" ".repeat(BYTES_MAX + 1)), [TOO_LARGE]);
    let deeper = format!("{}{}", "[".repeat(100), "]".repeat(100));
    assert_eq!(codes(&deeper), [TOO_LARGE]);
    let deep = format!("{}{}", "[".repeat(DEPTH_MAX), "]".repeat(DEPTH_MAX));
    assert!(parse(&deep).is_ok());
}

#[test]
fn an_empty_document_is_null() {
    assert_eq!(parse("").unwrap().value, Value::Null);
    assert_eq!(parse("# only a comment\n").unwrap().value, Value::Null);
}

#[test]
fn every_fault_lies_inside_of_the_text() {
    for text in [
        "a: [",
        "a: {b: 1",
        "a: \"b",
        "ä: [ö",
        "a:\n\tb: 1",
        "a: 1\n b: ü\n- ü",
        "\u{feff}: [",
    ] {
        for fault in parse(text).unwrap_err() {
            let place = fault.place.unwrap();
            assert!(
                text.get(place.start..place.end).is_some(),
                "{text:?}: {place:?}"
            );
        }
    }
}

#[test]
fn a_part_without_quotes_in_brackets_is_explained() {
    for (text, part) in [
        ("x: {a: start.out[5], b: 1}", "start.out[5]"),
        ("x: [a.out, m.out[1, 2], b]", "m.out[1, 2]"),
        ("x: {a: a.out[2..5]}", "a.out[2..5]"),
    ] {
        let faults = parse(text).unwrap_err();
        let help = faults[0].help.clone().unwrap_or_default();
        assert!(help.ends_with(&format!("in quotes: \"{part}\"")), "{help}");
    }
    let other = parse("x: {a: [1, 2}").unwrap_err()[0].help.clone();
    assert!(
        other
            .unwrap_or_default()
            .starts_with("check the indentation")
    );
}
