//! Values that are set in a running net and read from it, through all processes: by REST, by the command line, and by a
//! watcher that dies. Each test has a cell of its own.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use rcc_tests::{TestCell, await_some, program, repository};
use serde_json::{Value, json};

fn belt() -> String {
    let path = repository().join("configs/nets/belt.yaml");
    std::fs::read_to_string(path).expect("the example")
}

#[test]
fn inputs_are_set_by_rest_all_at_once_or_not_at_all() {
    let cell = TestCell::demo();
    let id = cell.load(&belt());
    let path = format!("/commands/{id}/inputs");
    let early = cell.rest("PUT", &path, r#"{"lamp": true}"#);
    assert_eq!(early.status, 200, "{early:?}");
    cell.start_when_ready(id);
    assert_eq!(
        cell.value(id, "lamp.value"),
        json!(true),
        "set before START"
    );
    let set = cell.rest("PUT", &path, r#"{"speed": "200 mm/s", "lamp": false}"#);
    assert_eq!(
        (set.status, &set.body["set"]),
        (200, &json!(["speed", "lamp"])),
        "{set:?}"
    );
    let both = cell.rest("GET", &format!("/commands/{id}/values?ports=*.value"), "");
    let values: Vec<&Value> = (0..2)
        .map(|port| &both.body["values"][port]["value"])
        .collect();
    assert_eq!(values, [&json!(0.2), &json!(false)], "{both:?}");
    assert!(
        both.body["cycle"].as_u64() >= set.body["cycle"].as_u64(),
        "{both:?}"
    );
    let refused = cell.rest(
        "PUT",
        &path,
        r#"{"lamp": true, "sped": 1, "speed": "2 m/s"}"#,
    );
    assert_eq!(
        (refused.status, refused.code()),
        (422, "RCC3040"),
        "{refused:?}"
    );
    let words = refused.error_text();
    assert!(
        words.contains("`sped`") && words.contains("at most 1 m/s"),
        "{words}"
    );
    assert_eq!(
        cell.value(id, "lamp.value"),
        json!(false),
        "nothing was set"
    );
    let expired = || cell.value(id, "speed.value").is_null().then_some(());
    await_some("the value to expire, because it is not set again", expired);
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    let over = cell.rest("PUT", &path, r#"{"lamp": true}"#);
    assert_eq!((over.status, over.code()), (409, "RCC3003"), "{over:?}");
    cell.stop();
}

#[test]
fn every_command_of_the_page_about_values_runs() {
    let cell = TestCell::demo();
    cell.await_devices();
    let page = std::fs::read_to_string(repository().join("docs/values.md")).expect("the page");
    let program = program("rcc-cli");
    let folder = program.parent().expect("a folder").to_owned();
    let path = std::env::var("PATH").unwrap_or_default();
    let commands = page.lines().filter_map(|line| line.strip_prefix("$ "));
    let mut run = 0;
    for command in commands {
        let like = cell.program("rcc-cli");
        let mut shell = Command::new("sh");
        for (name, value) in like.get_envs() {
            match value {
                Some(value) => shell.env(name, value),
                None => shell.env_remove(name),
            };
        }
        let arguments: Vec<_> = like.get_args().collect();
        let named = arguments.windows(2).find(|pair| pair[0] == "--cell");
        shell.env("RCC_CELL", named.expect("the cell's name")[1]);
        shell.env("PATH", format!("{}:{path}", folder.display()));
        let output = shell
            .args(["-c", command])
            .current_dir(repository())
            .output();
        let output = output.expect("a shell");
        let (out, err) = (
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr),
        );
        // The exit code of a verb that waits for a net tells how it ended.
        let canceled = command.contains("cancel") && command.contains("--wait");
        let wanted = if canceled { 8 } else { 0 };
        assert_eq!(
            output.status.code(),
            Some(wanted),
            "{command}: {out}\n{err}"
        );
        run += 1;
    }
    assert!(run >= 16, "{run} commands");
    cell.stop();
}

#[test]
fn a_killed_watcher_leaves_nothing_and_other_watchers_see_the_end() {
    let cell = TestCell::demo();
    let id = cell.run(&belt());
    let watch = |more: &[&str]| {
        let mut watch = cell.program("rcc-cli");
        watch.args(["watch", &id.to_string(), "soft.out", "speed.*", "--json"]);
        watch.args(more).stdout(Stdio::piped());
        watch.spawn().expect("a watcher")
    };
    let mut killed = watch(&["--rate", "100"]);
    let mut other = watch(&["--rate", "20"]);
    let lines = |child: &mut std::process::Child| {
        BufReader::new(child.stdout.take().expect("piped")).lines()
    };
    let (mut of_killed, mut of_other) = (lines(&mut killed), lines(&mut other));
    for lines in [&mut of_killed, &mut of_other] {
        let line = lines.next().expect("a line").expect("text");
        let line: Value = serde_json::from_str(&line).expect("JSON");
        assert_eq!(line["values"][0]["port"], "speed.value", "{line}");
        assert_eq!(line["values"][2]["unit"], "m/s", "{line}");
    }
    killed.kill().expect("SIGKILL");
    killed.wait().expect("dead");
    assert_eq!(cell.state(id)["state"], "running");
    let (out, _) = cell.cli_exits(
        0,
        &["watch", "belt", "soft.*", "--count", "2", "--rate", "50"],
    );
    assert!(out.contains("soft.out") && out.contains("m/s"), "{out}");
    let (_, err) = cell.cli_exits(1, &["watch", "belt", "sofd.out"]);
    assert!(
        err.contains("RCC3041") && err.contains("did you mean `soft.out`?"),
        "{err}"
    );
    cell.done(id, "cancel");
    let last = of_other.last().expect("a line").expect("text");
    assert!(last.contains(r#""state":"terminated""#), "{last}");
    assert_eq!(
        other.wait().expect("it ends").code(),
        Some(8),
        "it was canceled"
    );
    cell.stop();
}

fn net(name: &str) -> String {
    let path = repository().join(format!("configs/nets/{name}.yaml"));
    std::fs::read_to_string(path).expect("an example")
}

#[test]
fn a_net_reads_a_topic_while_its_publisher_runs() {
    let cell = TestCell::demo();
    let lamp = cell.run(&net("touch-lamp"));
    let touches = |cell: &TestCell| cell.value(lamp, "touches.value");
    assert_eq!(touches(&cell), Value::Null, "no net publishes it");
    let touch = cell.run(&net("touch"));
    let known = || (touches(&cell) == json!(false)).then_some(());
    await_some("the published value to be seen", known);
    let topics = cell.rest("GET", "/topics", "");
    let row = |number: usize| &topics.body[number];
    assert_eq!(
        (&row(0)["topic"], &row(0)["unit"]),
        (&json!("flange/force"), &json!("N")),
        "{topics:?}"
    );
    assert_eq!(row(0)["subscribers"], json!([]), "{topics:?}");
    assert_eq!(
        (
            &row(1)["publishers"][0]["id"],
            &row(1)["subscribers"][0]["primitive"]
        ),
        (&json!(touch), &json!("touches")),
        "{topics:?}"
    );
    // A second publisher of the same topic, and a subscriber that expects another unit.
    let second = cell.load(&net("touch"));
    let meters = "net: meters\nprimitives:\n  far: {type: Subscribe, parameters: {topic: flange/touches, unit: m}}\n  \
        much: {type: Greater, inputs: {a: far.value, b: 2 m}}\n  end: {type: Termination, inputs: {done: much.out}}\n";
    let other = cell.load(meters);
    for (id, code, words) in [
        (
            second,
            "RCC3004",
            format!("touch#{second} publishes topic flange/touches, and so does touch#{touch}"),
        ),
        (
            other,
            "RCC3024",
            format!("subscribes to flange/touches as Real in m, and touch#{touch} publishes"),
        ),
    ] {
        let refused = cell.operate(id, "start");
        assert_eq!((refused.status, refused.code()), (409, code), "{refused:?}");
        let message = refused.error_text();
        assert!(message.contains(&words), "{message}");
    }
    cell.done(touch, "abort");
    await_some(
        "the value to become null after its publisher has ended",
        || touches(&cell).is_null().then_some(()),
    );
    cell.done(second, "start");
    await_some("the value of the next publisher", known);
    cell.stop();
}

/// A net whose joint 1 follows an input, so that no rehearsal can predict its motion.
const JOG: &str = "
net: jog
primitives:
  turn:  {type: Input, parameters: {initial: 0 rad}}
  cancel: {type: Cancel}
  move:
    type: JointGoal
    parameters: {device: lwr, scale: 0.3}
    inputs: {goal: [turn.value, deg(-30), deg(0), deg(90), deg(0), deg(-60), deg(0)], stop: cancel.requested}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: move.position}}
  over:  {type: And, inputs: {a: cancel.requested, b: move.done}}
  end:   {type: Termination, inputs: {done: over.out}}
";

#[test]
fn a_value_that_moves_the_arm_out_of_its_workspace_ends_the_net_and_the_fault_names_axis_and_bound()
{
    let cell = TestCell::start(&repository().join("configs/cells/demo.yaml"), |text| {
        text.replace(
            "    first_tolerance: deg(0.1)\n",
            "    first_tolerance: deg(0.1)\n    workspace: {box: {y: [-0.1 m, 0.1 m]}}\n",
        )
    });
    cell.await_devices();
    let set = |id: u64, turn: &str| {
        let body = format!(r#"{{"turn": "{turn}"}}"#);
        let reply = cell.rest("PUT", &format!("/commands/{id}/inputs"), &body);
        assert_eq!(reply.status, 200, "{reply:?}");
    };
    // 10° is inside of the workspace, 30° is outside.
    let id = cell.run(JOG);
    set(id, "deg(10)");
    await_some("the arm to reach 10°", || {
        (cell.value(id, "move.position")[0].as_f64()? > 0.17).then_some(())
    });
    set(id, "deg(30)");
    cell.assert_ends(id, "fault");
    let fault = &cell.state(id)["fault"];
    assert_eq!(fault["fault"], "limit", "{fault}");
    let words = fault["words"].as_str().expect("words");
    assert!(
        words.contains("lwr would leave its workspace: y is 0.1")
            && words.contains("the bound is 0.1000 m"),
        "{words}"
    );
    cell.await_device("lwr", "ready");
    cell.stop();
}
