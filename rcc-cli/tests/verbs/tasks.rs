//! `rcc-cli` with task files: pick and place in virtual time, with every branch of its rules, drawn and explained. Run by
//! the threads of the test harness.

use std::process::Output;

use serde_json::Value;

use crate::program::{config as path, rcc_cli, run_to};

fn cli(arguments: &[&str]) -> Output {
    let mut command = rcc_cli(arguments);
    command.output().expect("rcc-cli runs")
}

fn text(exit: i32, arguments: &[&str]) -> String {
    run_to(exit, arguments).0
}

/// Simulates the pick-and-place task; returns what happened, as `what: words`, and the times.
fn simulate(exit: i32, further: &[&str]) -> (Vec<String>, Vec<f64>) {
    simulate_task("tasks/pick-and-place.yaml", exit, further)
}

fn simulate_task(task: &str, exit: i32, further: &[&str]) -> (Vec<String>, Vec<f64>) {
    let (task, cell) = (path(task), path("cells/pick.yaml"));
    let arguments = [
        &["--output", "json", "simulate", &task, "--config", &cell][..],
        further,
    ]
    .concat();
    let report: Value = serde_json::from_str(&text(exit, &arguments)).expect("JSON");
    let events = report["events"].as_array().expect("a list");
    let field = |event: &Value, name: &str| event[name].as_str().expect("a text").to_owned();
    let said = events
        .iter()
        .map(|event| format!("{}: {}", field(event, "what"), field(event, "words")));
    let times = events
        .iter()
        .map(|event| event["time_s"].as_f64().expect("a time"));
    (said.collect(), times.collect())
}

fn place(said: &[String], what: &str) -> usize {
    let found = said.iter().position(|line| line == what);
    found.unwrap_or_else(|| panic!("{what} is not in {said:#?}"))
}

#[test]
fn a_part_is_taken_on_contact_lifted_carried_and_let_go() {
    let (said, times) = simulate(0, &[]);
    let order = [
        "approach: running",
        "down: running",
        "grip: running",
        "grip: finished: held",
        "lift: running",
        "carry: running",
        "release: running",
        "release: finished: open",
        "home: running",
        "home: finished: there",
    ];
    let places = order.map(|what| place(&said, what));
    assert!(places.is_sorted(), "{said:#?}");
    // A rule fires when the net ends; the command ends when its arm has played all set-points.
    for (ended, next) in [
        ("down: finished: touched", "grip: running"),
        ("carry: finished: there", "release: running"),
    ] {
        assert!(place(&said, ended) > place(&said, next), "{said:#?}");
    }
    // The arm is handed over in flight: what follows begins in the cycle after.
    let fired = place(&said, "rule `swing over while lifting`: fired");
    let begun = place(&said, "carry: running");
    assert_eq!(times[fired], times[begun]);
    assert!(said.contains(&"lift: aborted".to_owned()), "{said:#?}");
    // The rules that did not fire can never fire any more, and say so.
    let expired = said.iter().filter(|line| line.contains("expired"));
    assert_eq!(expired.count(), 2, "{said:#?}");
}

#[test]
fn without_a_part_or_a_table_the_arm_returns() {
    let (said, _) = simulate(0, &["--input", "lwr.part_held=false"]);
    let empty = place(&said, "grip: finished: empty");
    assert!(place(&said, "rule `return without a part`: fired") > empty);
    assert!(!said.contains(&"lift: running".to_owned()), "{said:#?}");
    assert!(
        said.contains(&"home: finished: there".to_owned()),
        "{said:#?}"
    );
    // A wall far below: the arm meets nothing.
    let (said, _) = simulate(0, &["--wall", "0,0,0.1,0,0,1"]);
    assert!(
        said.contains(&"down: finished: missed".to_owned()),
        "{said:#?}"
    );
    assert!(
        said.contains(&"home: finished: there".to_owned()),
        "{said:#?}"
    );
}

#[test]
fn a_flange_motion_begins_where_contact_stops_a_line_in_flight_and_a_line_where_it_ends() {
    let (said, times) = simulate_task("tasks/probe.yaml", 0, &[]);
    let order = ["feel: running", "retreat: running", "aside: running"];
    assert!(order.map(|what| place(&said, what)).is_sorted());
    let fired = place(&said, "rule `back off on contact`: fired");
    let begun = place(&said, "retreat: running");
    assert_eq!(times[fired], times[begun]);
    for ended in [
        "feel: aborted",
        "retreat: finished: there",
        "aside: finished: there",
    ] {
        place(&said, ended);
    }
    // Without a table there is no contact, and the rule that waits for it can never fire any more.
    let (said, _) = simulate_task("tasks/probe.yaml", 0, &["--wall", "0,0,0.1,0,0,1"]);
    let expired = place(
        &said,
        "rule `back off on contact`: expired: its condition can never hold any more",
    );
    assert!(expired > place(&said, "feel: finished: missed"));
    assert!(!said.contains(&order[1].to_owned()), "{said:#?}");
}

#[test]
fn a_person_who_cancels_ends_the_task_wherever_it_is() {
    let (_, times) = simulate(0, &[]);
    let end = times.last().copied().expect("an end");
    for tenth in 1..10 {
        let at = format!("{:.3}s", end * f64::from(tenth) / 10.0);
        let (said, cut) = simulate(0, &["--cancel-at", &at]);
        let last = cut.last().copied().expect("an end");
        let running = said.iter().filter(|line| line.ends_with(": running"));
        let ended = said.iter().filter(|line| {
            let word = line.split(": ").nth(1).unwrap_or_default();
            ["finished", "canceled", "aborted"].contains(&word) && !line.starts_with("rule")
        });
        assert_eq!(running.count(), ended.count(), "{at}: {said:#?}");
        // The nets that only switch the gripper have no `Cancel`, and end at once; a motion brakes first.
        assert!(last < end, "{at}: {last}");
        let disarmed = said.iter().any(|line| line.contains("disarmed"));
        // On the way home no rule is left.
        let is_last = said.contains(&"rule `return`: fired".to_owned());
        assert!(disarmed || is_last, "{at}: {said:#?}");
    }
}

#[test]
fn nets_and_rules_are_drawn_together_and_explained() {
    let task = path("tasks/pick-and-place.yaml");
    for (format, part) in [
        ("svg", "<svg"),
        ("dot", "digraph"),
        ("mermaid", "flowchart"),
    ] {
        let drawn = text(0, &["graph", &task, "--format", format]);
        assert!(drawn.contains(part), "{format}: {drawn}");
        for name in ["approach", "touched", "carry"] {
            assert!(drawn.contains(name), "{format}: {name}");
        }
    }
    let said = text(0, &["explain", &task]);
    for part in [
        "in the cycle after lift computes high.out",
        "started by `return`, `return if nothing is there`, `return without a part`",
        "stop lift; start carry",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let short = text(
        0,
        &[
            "--output",
            "json",
            "explain",
            &path("tasks/blink-twice.yaml"),
        ],
    );
    let short: Value = serde_json::from_str(&short).expect("JSON");
    assert_eq!(short["rules"][0]["rule"], "and again");
}

#[test]
fn a_wrong_task_is_refused_with_its_place() {
    let folder = rcc_testing::folder();
    let file = folder.path().join("task.yaml");
    std::fs::write(
        &file,
        "task: t\nrules:\n  - {when: a.outcom == b, start: c}\n",
    )
    .expect("written");
    let output = cli(&["simulate", &file.display().to_string()]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(errors.contains("task.yaml:3"), "{errors}");
    assert!(errors.contains("a.outcome"), "{errors}");
    let task = path("tasks/blink-twice.yaml");
    let refused = cli(&["simulate", &task, "--csv", "x.csv"]);
    assert!(!refused.status.success());
}
