//! Tests of the layout: what stays, what moves, and that nothing is lost.

use proptest::prelude::*;

use super::*;

fn formatted(text: &str) -> String {
    format(text, "test").unwrap_or_else(|error| panic!("{error:?}\n{text}"))
}

#[test]
fn comments_stay_at_their_entries() {
    let text = "# About the net.

net:   a
primitives:
    # First.
    one: {type: Time}       # behind one
    three: {type: Add,      # behind the type
       inputs: {a: one.out, b: 1}}


    # Before four.

    # And again.
    four:   # its head
      type: Abs
      # before inputs
      inputs:
        in: three.out   # behind in
        # below in
      # below inputs
    # the last of primitives
discard: [ four.out,   one.out ]
# the end
";
    let wanted = "# About the net.

net: a
primitives:
  # First.
  one: {type: Time}  # behind one
  three:
    type: Add  # behind the type
    inputs: {a: one.out, b: 1}

  # Before four.

  # And again.
  four:  # its head
    type: Abs
    # before inputs
    inputs:
      in: three.out  # behind in
      # below in
    # below inputs
  # the last of primitives
discard: [four.out, one.out]
# the end
";
    assert_eq!(formatted(text), wanted);
}

#[test]
fn adjacent_primitives_are_aligned_in_columns() {
    let text = "net: a
primitives:
  a: {type: Time} # one
  longer: {type: Time} # two
  b: {type: Time}

  c: {type: Time}
";
    let wanted = "net: a
primitives:
  a:      {type: Time}  # one
  longer: {type: Time}  # two
  b:      {type: Time}

  c: {type: Time}
";
    assert_eq!(formatted(text), wanted);
}

#[test]
fn long_lines_are_broken() {
    let long = (0..40)
        .map(|n| format!("primitive{n}.out"))
        .collect::<Vec<_>>();
    let numbers = "0.125, ".repeat(12);
    let text = format!(
        "net: a\nprimitives: {{x: {{type: Lookup, parameters: {{x: [{numbers}1], y: [{numbers}1]}}}}}}\ndiscard: [{}]\n",
        long.join(", ")
    );
    let written = formatted(&text);
    assert!(
        written.lines().all(|line| line.chars().count() <= 120),
        "{written}"
    );
    assert!(
        written.contains("  x:\n    type: Lookup\n    parameters:\n      x: [0.125,"),
        "{written}"
    );
    assert!(written.contains("discard: [primitive0.out, "), "{written}");
}

#[test]
fn fragments_are_laid_out_like_nets() {
    let text = "library: l
fragments: {f: {inputs: {x: {}}, outputs: {y: a.out}, primitives: {a: {type: Abs, inputs: {in: x}}, bc: {type: Time}}}}
";
    let wanted = "library: l
fragments:
  f:
    inputs: {x: {}}
    outputs: {y: a.out}
    primitives:
      a:  {type: Abs, inputs: {in: x}}
      bc: {type: Time}
";
    assert_eq!(formatted(text), wanted);
}

#[test]
fn multi_line_texts_stay_multi_line() {
    let text = "net: a\ndescription: |\n    one\n\n    two   # no comment\nprimitives: {}\n";
    let wanted = "net: a\ndescription: |\n  one\n\n  two   # no comment\nprimitives: {}\n";
    assert_eq!(formatted(text), wanted);
    let text = "net: a\ndescription: >2- # folded\n  one\n  two\n\n# below\nprimitives: {}\n";
    let wanted = "net: a\ndescription: one two  # folded\n\n# below\nprimitives: {}\n";
    assert_eq!(formatted(text), wanted);
    let words = "word ".repeat(30);
    let text = format!("net: a\ndescription: {words} # long\n# below\nprimitives: {{}}\n");
    let written = formatted(&text);
    assert!(
        written.starts_with("net: a\ndescription: >-  # long\n  word word"),
        "{written}"
    );
}

#[test]
fn numbers_and_quantities_stay_as_they_are_written() {
    let text = "net: a\nprimitives:\n  a: {type: X, parameters: {a: 0.10, b: 1e3, c: +5, d: deg(30), e: 12.0, f: '12 N', g: \"x\"}}\n";
    let wanted = text.replace("\"x\"", "x").replace("'12 N'", "12 N");
    assert_eq!(formatted(text), wanted);
}

#[test]
fn texts_that_are_not_nets_are_left_unchanged() {
    assert!(matches!(
        format("net: [", "test"),
        Err(FormatError::Faulty(_))
    ));
    assert!(matches!(
        format("cell: demo\n", "test"),
        Err(FormatError::Faulty(_))
    ));
    assert_eq!(
        format("{\"net\": \"a\", \"primitives\": {}}", "test"),
        Err(FormatError::Json)
    );
    let directive = "%YAML 1.2\n---\nnet: a\nprimitives: {}\n";
    assert!(matches!(
        format(directive, "test"),
        Err(FormatError::WouldLose(_))
    ));
}

/// Lines of a net with comments and empty lines wherever they can be.
fn commented() -> impl Strategy<Value = String> {
    const LINES: &[&str] = &[
        "net: a",
        "description: some words",
        "primitives:",
        "  a: {type: Time}",
        "  b:",
        "    type: Add",
        "    parameters: {",
        "      x: 1,",
        "      y: [1,",
        "        2]",
        "    }",
        "    inputs:",
        "      a: a.out",
        "      b: {from: b.out, delayed: true,",
        "        initial: 0}",
        "  c: {type: Table, parameters: {rows: [",
        "      [1, 2],",
        "      [3, 4]]}}",
        "discard:",
        "  - a.out",
        "  - b.out",
        "",
    ];
    let line = (0..4_u8, 0..12_usize);
    proptest::collection::vec(line, LINES.len()).prop_map(|places| {
        let mut text = String::new();
        for (number, (line, (what, indent))) in LINES.iter().zip(places).enumerate() {
            let indent = " ".repeat(indent);
            match what {
                0 => text.push_str(&format!("{indent}# before {number}\n{line}\n")),
                1 => text.push_str(&format!("{line}  # behind {number}\n")),
                2 => text.push_str(&format!("\n{indent}# a\n\n# b {number}\n{line} # c\n")),
                _ => text.push_str(&format!("{line}\n")),
            }
        }
        text
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn no_comment_is_ever_lost(text in commented()) {
        let written = formatted(&text);
        prop_assert_eq!(written.matches('#').count(), text.matches('#').count(), "{}\n{}", text, written);
        prop_assert_eq!(formatted(&written), written);
    }

    #[test]
    fn any_text_is_formatted_or_left_unchanged(text in "(net: a\n)?(primitives:\n)?([ a-c{}\\[\\],:#'\"|>\n-]{0,60})") {
        if let Ok(written) = format(&text, "test") {
            prop_assert_eq!(formatted(&written), written);
        }
    }
}
