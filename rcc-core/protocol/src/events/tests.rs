//! Sentences of events, and the table of their kinds.

use std::fs;

use super::*;

fn fault() -> EventKind {
    EventKind::Command {
        command: 3,
        state: "terminated".into(),
        reason: Some("fault".into()),
        outcome: None,
        cycles: Some(8),
        fault: Some(CommandFault {
            code: "limit".into(),
            device: Some("lwr".into()),
            joint: Some(4),
            rule: Some("velocity".into()),
            value: Some(2.5),
            limit: Some(2.0),
            unit: Some("rad/s".into()),
        }),
    }
}

#[test]
fn a_fault_names_net_joint_value_limit_unit_and_remedy() {
    let event = Event::now(
        EventSource::this(EventOrigin::Executor, "exec"),
        Some(42),
        fault(),
    );
    let words = event.sentence(&|_, id| format!("line#{id}"));
    for part in ["line#3", "lwr joint 4", "2.5", "2.0", "rad/s", "correct"] {
        assert!(words.contains(part), "{part} in {words}");
    }
    assert_eq!(event.severity, EventSeverity::Error);
}

#[test]
fn an_event_text_is_one_line_and_bounded() {
    assert_eq!(event_text("a\x1b[31m\nb"), "a [31m b");
    assert!(event_text(&"ä".repeat(1000)).len() <= TEXT_MAX + 3);
}

#[test]
fn every_kind_has_a_row_with_its_name() {
    for row in EVENT_KINDS {
        assert!(!row.summary.is_empty() && !row.writer.is_empty());
        let same = EVENT_KINDS.iter().filter(|other| other.name == row.name);
        assert_eq!(same.count(), 1, "{}", row.name);
    }
    assert!(EVENT_KINDS.iter().any(|row| row.name == fault().name()));
}

#[test]
fn the_table_in_the_docs_matches_the_program() {
    const END: &str = "<!-- end of kinds -->";
    const BEGIN: &str = "<!-- kinds: this table is compared with the program by a test -->\n";
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/events.md");
    let text = fs::read_to_string(path).unwrap();
    let (before, rest) = text.split_once(BEGIN).unwrap();
    let (table, after) = rest.split_once(END).unwrap();
    let mut expected =
        String::from("| kind | who | usually | what it says | fields |\n|---|---|---|---|---|\n");
    for row in EVENT_KINDS {
        let severity = format!("{:?}", row.severity).to_lowercase();
        let (summary, fields) = (row.summary.trim(), row.fields.join(", "));
        expected += &format!(
            "| `{}` | {} | {severity} | {summary} | {fields} |\n",
            row.name, row.writer
        );
    }
    if std::env::var_os("RCC_BLESS").is_some() {
        fs::write(path, format!("{before}{BEGIN}{expected}{END}{after}")).unwrap();
    } else {
        assert_eq!(table, expected, "run with RCC_BLESS=1");
    }
}

#[test]
fn a_fault_without_device_and_numbers_is_a_whole_sentence() {
    let fault = CommandFault {
        code: "overrun".into(),
        device: None,
        joint: None,
        rule: None,
        value: None,
        limit: None,
        unit: None,
    };
    let words = fault.sentence();
    assert!(words.starts_with("overrun; make the net"), "{words}");
}
