//! Tests of conditions. Run by the test harness.

use super::*;

fn outcome(command: &str, outcome: &str) -> ConditionTerm {
    ConditionTerm::Outcome {
        command: command.to_owned(),
        outcome: outcome.to_owned(),
    }
}

fn value(command: &str, primitive: &str, port: &str) -> ConditionTerm {
    ConditionTerm::Value {
        command: command.to_owned(),
        primitive: primitive.to_owned(),
        port: port.to_owned(),
    }
}

fn compare([command, primitive, port]: [&str; 3], relation: Relation, limit: f64) -> ConditionTerm {
    ConditionTerm::Compare {
        command: command.to_owned(),
        primitive: primitive.to_owned(),
        port: port.to_owned(),
        relation,
        limit,
    }
}

#[test]
fn an_output_may_lack_its_command_where_that_is_allowed() {
    let terms = vec![
        compare(["", "ft", "fz"], Relation::AtLeast, -1e-3),
        value("", "touch", "out"),
        ConditionTerm::Or,
    ];
    assert_eq!(parse_short("ft.fz>=-1e-3 or touch.out"), Ok(terms));
    assert!(parse("ft.fz > 30").is_err());
    let state = parse_short("line.stat == running").expect_err("no such word");
    assert!(state.help.contains("line.state"), "{state:?}");
}

#[test]
fn a_condition_becomes_postfix() {
    let topic = ConditionTerm::Topic {
        topic: "part/there".to_owned(),
    };
    let cases = [
        ("true", vec![ConditionTerm::True]),
        (
            "guarded-move.outcome == touched",
            vec![outcome("guarded-move", "touched")],
        ),
        (
            "a#7.outcome != touched",
            vec![outcome("a#7", "touched"), ConditionTerm::Not],
        ),
        (
            "a.t.out or a.t.out and not topic(part/there)",
            vec![
                value("a", "t", "out"),
                value("a", "t", "out"),
                topic.clone(),
                ConditionTerm::Not,
                ConditionTerm::And,
                ConditionTerm::Or,
            ],
        ),
        (
            "(a.t.out or #3.state == running) and a.arm.t.out",
            vec![
                value("a", "t", "out"),
                ConditionTerm::State {
                    command: "#3".to_owned(),
                    state: CommandState::Running,
                },
                ConditionTerm::Or,
                value("a", "arm.t", "out"),
                ConditionTerm::And,
            ],
        ),
        (
            "a.ft.fz > 30.5 and a.ik.joints[3] <= deg(-90)",
            vec![
                compare(["a", "ft", "fz"], Relation::Above, 30.5),
                compare(
                    ["a", "ik", "joints[3]"],
                    Relation::AtMost,
                    (-90f64).to_radians(),
                ),
                ConditionTerm::And,
            ],
        ),
        (
            "a.reason == fault",
            vec![ConditionTerm::Reason {
                command: "a".to_owned(),
                reason: EndReason::Fault,
            }],
        ),
    ];
    for (text, terms) in cases {
        assert_eq!(parse(text), Ok(terms), "{text}");
    }
}

#[test]
fn names_of_commands_are_replaced_and_nothing_else() {
    let named = |name: &str| format!("{name}#1");
    for (text, expected) in [
        (
            "a.outcome == b.c  or(d.e.f)",
            "a#1.outcome == b.c  or(d#1.e.f)",
        ),
        (
            "not topic(a.b) and x.state != ready",
            "not topic(a.b) and x#1.state != ready",
        ),
        (
            "a.t.out < 1.5 or b.t.q[2] > deg(1.5)",
            "a#1.t.out < 1.5 or b#1.t.q[2] > deg(1.5)",
        ),
        ("ä.t.out and true", "ä#1.t.out and true"),
        ("a.outcome = b", "a.outcome = b"),
    ] {
        assert_eq!(with_commands(text, &named), expected);
    }
}

#[test]
fn a_fault_has_its_place_and_a_remedy() {
    for (text, column, part) in [
        ("", 1, "outcome =="),
        ("a.outcome", 10, "=="),
        ("a.outcome = done", 11, "`==`"),
        ("a.outcome == done b.t.out", 19, "`and`"),
        ("a.outcme == done", 1, "a.outcome"),
        ("a.state == runing", 12, "running"),
        ("a.reason == touched", 13, "finished"),
        ("line", 1, "line.outcome"),
        ("a.t.out == true", 9, "not a.t.out"),
        ("(a.t.out", 9, "close"),
        ("topic part/there", 7, "topic(part/there)"),
        ("not and", 5, "outcome =="),
        ("a.t.out & b.t.out", 9, "`and`"),
        ("a.t.out >", 10, "unit of the port"),
        ("a.t.out > x", 11, "unit of the port"),
        ("a.t.out > inf", 11, "unit of the port"),
        ("a.t.out > deg 3", 15, "deg(30)"),
        ("a.state > 3", 9, "=="),
        ("a..out", 1, "net.primitive.port"),
    ] {
        let fault = parse(text).expect_err(text);
        assert_eq!(fault.column, column, "{text}: {fault:?}");
        assert!(fault.help.contains(part), "{text}: {fault:?}");
    }
    let deep = format!("{}true", "not ".repeat(100_000));
    assert!(parse(&deep).is_err());
}
