//! Set-point channels and streams of values, states and events, through all processes. Each test has a cell of its own.

use std::process::{Command, Stdio};

use rcc_tests::set_points::{LineChannel, MeasurementPlan, events, measure, next_event};
use rcc_tests::{TestCell, await_some, nets, repository};
use serde_json::{Value, json};

fn belt() -> String {
    let path = repository().join("configs/nets/belt.yaml");
    std::fs::read_to_string(path).expect("the example")
}

fn open(cell: &TestCell, path: &str) -> LineChannel {
    LineChannel::open(&cell.cell().socket(), path)
}

fn value(cell: &TestCell, net: &str, port: &str) -> Value {
    let reply = cell.rest("GET", &format!("/commands/{net}/values?ports={port}"), "");
    reply.body["values"][0]["value"].clone()
}

#[test]
fn a_channel_sets_values_and_says_what_became_of_each_line() {
    let cell = TestCell::demo();
    let id = cell.run(&belt());
    let mut channel = open(&cell, "/commands/belt/inputs/stream?answers=all");
    let mut answers = channel.answers();
    let mut next = || answers.next().expect("an answer");
    assert_eq!(next(), json!({"id": id, "net": "belt"}));
    channel.line(r#"{"lamp": true, "speed": "0.2 m/s"}"#);
    let set = next();
    assert_eq!(set["line"], 1, "{set}");
    let now = cell.rest("GET", "/commands/belt/values?ports=*.value", "");
    assert!(
        now.body["cycle"].as_u64() >= set["cycle"].as_u64(),
        "{now:?} {set}"
    );
    assert_eq!(now.body["values"][0]["value"], 0.2, "{now:?}");
    assert_eq!(now.body["values"][1]["value"], true, "{now:?}");
    channel.line(r#"{"sped": 0.2}"#);
    let refused = next();
    assert_eq!(
        (&refused["line"], &refused["error"]["code"]),
        (&json!(2), &json!("RCC3040")),
        "{refused}"
    );
    channel.line(r#"{"lamp": false}"#);
    assert_eq!(next()["line"], 3);
    assert_eq!(value(&cell, "belt", "lamp.value"), false);
    channel.end();
    let end = next();
    let counts =
        ["lines", "set", "superseded", "refused", "unreported"].map(|key| end[key].as_u64());
    assert_eq!(counts, [3, 2, 0, 1, 0].map(Some), "{end}");
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    cell.stop();
}

#[test]
fn every_line_of_a_burst_is_accounted_for_and_the_newest_one_wins() {
    let cell = TestCell::demo();
    cell.run(&belt());
    let mut channel = open(&cell, "/commands/belt/inputs/stream");
    for number in 0..500 {
        channel.line(&format!("{{\"speed\": {}}}", f64::from(number) / 1000.0));
    }
    channel.end();
    let end = channel.answers().last().expect("an end");
    let count = |key: &str| end[key].as_u64().expect("a count");
    assert_eq!(count("lines"), 500, "{end}");
    assert_eq!(count("set") + count("superseded"), 500, "{end}");
    assert!(count("superseded") > 0, "faster than the cycle: {end}");
    assert_eq!(value(&cell, "belt", "speed.value"), 0.499);
    cell.stop();
}

#[test]
fn a_channel_ends_with_its_net_and_a_dead_client_lets_its_value_expire() {
    let cell = TestCell::demo();
    let id = cell.run(&belt());
    let mut dying = open(&cell, "/commands/belt/inputs/stream?answers=all");
    dying.line(r#"{"speed": 0.2}"#);
    assert!(dying.answers().nth(1).is_some_and(|set| set["line"] == 1));
    dying.leave();
    await_some("the value to expire", || {
        value(&cell, "belt", "speed.value").is_null().then_some(())
    });
    let mut channel = open(&cell, "/commands/belt/inputs/stream");
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    channel.line(r#"{"lamp": true}"#);
    let answers: Vec<Value> = channel.answers().collect();
    let [_, error, end] = answers.as_slice() else {
        panic!("{answers:?}");
    };
    assert_eq!(error["error"]["code"], "RCC3003", "{error}");
    assert_eq!(end["is_closed"], true, "{end}");
    let refused = cell.rest("POST", "/commands/nothing/inputs/stream", "");
    assert_eq!(
        (refused.status, refused.code()),
        (404, "RCC3001"),
        "{refused:?}"
    );
    cell.stop();
}

#[test]
fn there_is_a_limit_of_channels_and_of_streams() {
    let cell = TestCell::demo();
    cell.run(&belt());
    let path = "/commands/belt/inputs/stream";
    // One client has three of them at most, so that others can open theirs.
    let channels: Vec<_> = (0..3).map(|_| open(&cell, path)).collect();
    let refused = cell.rest("POST", path, "");
    assert_eq!(
        (refused.status, refused.code()),
        (429, "RCC4010"),
        "{refused:?}"
    );
    channels.into_iter().for_each(LineChannel::leave);
    await_some("a place", || {
        let reply = cell.rest("POST", path, "{\"lamp\": true}\n");
        // One line with a known length: the answer is several lines, so no JSON.
        (reply.status == 200).then_some(())
    });
    let refused = cell.rest("GET", "/stream", "");
    assert_eq!(
        (refused.status, refused.code()),
        (400, "RCC4011"),
        "{refused:?}"
    );
    let refused = cell.rest("GET", "/stream?ports=belt/sofd.out", "");
    assert_eq!(
        (refused.status, refused.code()),
        (404, "RCC3041"),
        "{refused:?}"
    );
    cell.stop();
}

#[test]
fn one_stream_shows_values_of_several_nets_states_and_events() {
    let cell = TestCell::demo();
    let belt = cell.run(&belt());
    let clock = cell.run(&nets::clock("clock"));
    let path =
        "/stream?ports=belt/lamp.value,belt/soft.out,clock/*&rate=100&states=true&events=true";
    let mut stream = events(&cell.cell().socket(), path);
    let mut seen: Vec<(String, Value)> = Vec::new();
    let mut until = |what: &str, such: &dyn Fn(&str, &Value) -> bool| {
        loop {
            let (event, data) = next_event(&mut stream);
            let found = such(&event, &data);
            seen.push((event, data.clone()));
            if found {
                return data;
            }
            assert!(seen.len() < 10_000, "no {what} in {seen:?}");
        }
    };
    let running = until("state", &|event, data| {
        event == "state" && data["id"] == belt
    });
    assert_eq!(
        (&running["net"], &running["state"]),
        (&json!("belt"), &json!("running"))
    );
    let ports = until("ports", &|event, data| {
        event == "ports" && data["id"] == belt
    });
    assert_eq!(
        ports["ports"][1],
        json!({"port": "soft.out", "type": "Real", "unit": "m/s"})
    );
    let first = until("values", &|event, data| {
        event == "values" && data["id"] == clock
    });
    let later = until("more values", &|event, data| {
        event == "values" && data["id"] == clock && data["cycle"].as_u64() > first["cycle"].as_u64()
    });
    assert!(
        later["net_cycle"].as_u64() > first["net_cycle"].as_u64(),
        "{later}"
    );
    let set = cell.rest("PUT", "/commands/belt/inputs", r#"{"lamp": true}"#);
    assert_eq!(set.status, 200, "{set:?}");
    let lit = until("the lamp", &|event, data| {
        event == "values" && data["values"]["lamp.value"] == true
    });
    assert!(
        lit["cycle"].as_u64() >= set.body["cycle"].as_u64(),
        "{lit} {set:?}"
    );
    cell.done(belt, "cancel");
    let ended = until("the end", &|event, data| {
        event == "state" && data["id"] == belt && data["state"] == "terminated"
    });
    assert_eq!(ended["reason"], "canceled", "{ended}");
    until("an event", &|event, _| event == "event");
    // The name stands for the next command of that name.
    let next = cell.run(&self::belt());
    until("values of the next command", &|event, data| {
        event == "values" && data["id"] == next
    });
    drop(stream);
    cell.stop();
}

#[test]
fn a_stream_samples_at_the_rate_of_the_cell_and_one_client_has_one_of_them() {
    let cell = TestCell::demo();
    let id = cell.run(&nets::clock("clock"));
    let refused = cell.rest("GET", "/stream?ports=clock/*&rate=1001", "");
    assert_eq!(
        (refused.status, refused.code()),
        (400, "RCC4011"),
        "{refused:?}"
    );
    let path = "/stream?ports=clock/*&rate=1000";
    let mut stream = events(&cell.cell().socket(), path);
    let refused = cell.rest("GET", path, "");
    assert_eq!(
        (refused.status, refused.code()),
        (429, "RCC4010"),
        "{refused:?}"
    );
    let mut cycles = Vec::new();
    while cycles.len() < 200 {
        let (event, data) = next_event(&mut stream);
        if event == "values" {
            cycles.push(data["cycle"].as_u64().expect("a cycle"));
        }
    }
    assert!(
        cycles.windows(2).all(|pair| pair[0] < pair[1]),
        "{cycles:?}"
    );
    drop(stream);
    cell.done(id, "cancel");
    cell.stop();
}

#[test]
fn the_python_programs_of_the_page_about_values_run() {
    if Command::new("python3").arg("--version").output().is_err() {
        eprintln!("skipped: no python3 (the_python_programs_of_the_page_about_values_run)");
        return;
    }
    let page = std::fs::read_to_string(repository().join("docs/values.md")).expect("the page");
    let programs: Vec<&str> = page
        .split("```python\n")
        .skip(1)
        .filter_map(|rest| rest.split("```").next())
        .collect();
    let [teleoperation, watcher, history] = programs.as_slice() else {
        panic!("{} programs", programs.len());
    };
    let cell = TestCell::demo();
    let id = cell.run(&belt());
    let clock = cell.run(&nets::clock("clock"));
    let python = |program: &str| {
        let mut python = Command::new("python3");
        python
            .args(["-u", "-c", program])
            .env("RCC_SOCKET", cell.cell().socket());
        python
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("python3")
    };
    let watching = python(watcher);
    let output = python(history).wait_with_output().expect("python3");
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(output.status.success(), "{out}\n{err}");
    assert!(out.contains("clock/"), "{out}");
    let output = python(teleoperation).wait_with_output().expect("python3");
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(output.status.success(), "{out}\n{err}");
    assert!(out.contains("'refused': 0"), "{out}\n{err}");
    assert!(!out.contains("'set': 0,"), "{out}");
    // It ends by itself when the net has ended.
    cell.done(clock, "cancel");
    cell.done(id, "cancel");
    let output = watching.wait_with_output().expect("python3");
    let out = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(
        out.contains("soft.out") && out.contains("canceled"),
        "{out}"
    );
    cell.stop();
}

#[test]
fn the_measurement_of_set_points_runs() {
    let plan = MeasurementPlan {
        rates: vec![100],
        seconds: 0.3,
    };
    let rows = measure(&plan);
    assert_eq!(rows.len(), 6, "{rows:?}");
    for row in rows.iter().filter(|row| row.written > 0) {
        assert_eq!(row.set as u64 + row.superseded, row.written as u64, "{row}");
        assert!(!row.latencies.is_empty() && !row.cycles.is_empty(), "{row}");
    }
}
