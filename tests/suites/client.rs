//! The Rust client: what `rcc-net` builds is run, canceled, handed over, set and watched, through all processes. Each
//! test has a cell of its own.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use rcc_client::{Cell, ClientError, OnClientLoss};
use rcc_net::{NetBuilder, Real, pose};
use rcc_tests::{TestCell, await_some};
use serde_json::json;

const LIMIT: Duration = Duration::from_secs(60);

fn line(name: &str, y: f64, velocity: &str) -> String {
    let net = NetBuilder::new(name);
    let cancel = net.cancel("cancel");
    let goal = pose([0.538, y, 0.384], [0.0, std::f64::consts::PI, 0.0]);
    let line = net.linear_motion("move", "lwr", goal).velocity(velocity);
    let line = line.stop(cancel.requested);
    net.joint_position_command("robot", "lwr", line.joints);
    net.termination("end", line.done);
    net.to_yaml().expect("a valid net")
}

/// A net that runs until it is canceled, or until `level` exceeds 1.
fn waiting(name: &str) -> String {
    let net = NetBuilder::new(name);
    let level = net.input::<Real>("level").initial(0.0);
    let over = net.greater("over", level.value, 1.0);
    let cancel = net.cancel("cancel");
    net.termination("end", over.out | cancel.requested);
    net.discard_rest();
    net.to_yaml().expect("a valid net")
}

#[test]
fn a_net_is_run_and_whatever_is_not_finished_is_an_error() {
    let tested = TestCell::demo();
    let cell = Cell::at(&tested.cell().socket()).expect("a cell");
    let outcome = cell.run(&line("there", 0.02, "0.1 m/s")).expect("finished");
    assert_eq!(outcome.reason, "finished", "{outcome}");
    let rejected = cell.run("net: a\nprimitives:\n  t: {type: Tme}\n");
    let told = rejected.expect_err("it is not valid").to_string();
    assert!(told.contains("Tme"), "{told}");
    let slow = cell.load(&line("slow", 0.1, "0.01 m/s")).expect("loaded");
    slow.start().expect("started");
    let busy = cell.run(&line("other", 0.0, "0.1 m/s")).expect_err("busy");
    let ClientError::Request(refused) = &busy else {
        panic!("{busy}");
    };
    assert_eq!(refused.body.code, "RCC3004", "{refused}");
    assert!(refused.body.message.contains("slow#"), "{refused}");
    let early = slow.wait(Some(Duration::from_millis(20)));
    assert!(matches!(early, Err(ClientError::Timeout(_))), "{early:?}");
    slow.cancel().expect("canceled");
    let ended = slow.wait(Some(LIMIT)).expect("ended").finished();
    assert!(matches!(ended, Err(ClientError::NotFinished(_))));
    slow.unload().expect("unloaded");
    assert_eq!(cell.commands().expect("a list").len(), 0);
    tested.stop();
}

#[test]
fn values_are_set_and_watched_and_a_hand_over_has_no_gap() {
    let tested = TestCell::demo();
    let cell = Cell::at(&tested.cell().socket()).expect("a cell");
    let first = cell.load(&waiting("first")).expect("loaded");
    first.start().expect("started");
    let mut watch = cell.watch(&["first/level.value"], 100.0).expect("a stream");
    first.set(&json!({"level": 0.5})).expect("set");
    let seen = watch.by_ref().find_map(|sample| {
        let sample = sample.expect("a sample");
        (sample.values["level.value"] == 0.5).then_some(sample)
    });
    assert_eq!(seen.map(|sample| sample.id), Some(first.id()));
    drop(watch);
    let refused = first.set(&json!({"levle": 1})).expect_err("no such input");
    assert!(refused.to_string().contains("RCC3040"), "{refused}");
    let second = cell.load(&waiting("second")).expect("loaded");
    let cycle = cell.switch(&[&first], &[&second]).expect("handed over");
    let (ended, begun) = (first.state(), second.state());
    assert_eq!(ended.expect("a state").ended_cycle + 1, cycle);
    assert_eq!(begun.expect("a state").started_cycle, cycle);
    let values = second.values(&["level.value"]).expect("values");
    assert_eq!(values.values[0].value, 0.0);
    second.set(&json!({"level": 2})).expect("set");
    let outcome = second.wait(Some(LIMIT)).expect("ended");
    assert_eq!(
        outcome.finished().map(|outcome| outcome.id),
        Ok(second.id())
    );
    assert!(cell.watch(&["nothing/*"], 10.0).is_err());
    tested.stop();
}

#[test]
fn a_watch_of_a_command_ends_with_its_last_values_when_the_net_ends() {
    let tested = TestCell::demo();
    let cell = Cell::at(&tested.cell().socket()).expect("a cell");
    let command = cell.start(&waiting("over")).expect("started");
    let mut watch = command.watch(&["level.value"], 0.5).expect("a stream");
    let first = watch.next().expect("a sample").expect("values");
    assert_eq!(first.values["level.value"], 0.0);
    command.set(&json!({"level": 2})).expect("set");
    // The net ends between two samples.
    let last: Vec<_> = watch.map(|sample| sample.expect("values")).collect();
    let last = last.last().expect("its last values");
    assert_eq!(last.values["level.value"], 2.0);
    let state = command.state().expect("a state");
    assert_eq!(
        (state.state.as_str(), state.ended_cycle),
        ("terminated", last.cycle)
    );
    let again = command.watch(&["*"], 10.0).expect("a stream");
    let again: Vec<_> = again.map(|sample| sample.expect("values")).collect();
    assert_eq!(again.len(), 1);
    assert!(command.wait(None).expect("ended").finished().is_ok());
    let other = cell.start(&waiting("unloaded")).expect("started");
    let mut watch = other.watch(&["*"], 10.0).expect("a stream");
    other.abort().expect("aborted");
    other.wait(Some(LIMIT)).expect("ended");
    other.unload().expect("unloaded");
    assert!(watch.all(|sample| sample.is_ok()));
    // Its values are gone; how it ended is not.
    assert!(other.watch(&["*"], 10.0).is_err());
    assert_eq!(other.wait(None).expect("ended").reason, "aborted");
    tested.stop();
}

#[test]
fn a_connection_that_is_dropped_ends_what_was_started_with_it_and_a_hand_over_keeps_that() {
    let tested = TestCell::demo();
    let socket = tested.cell().socket();
    let watching = Cell::at(&socket).expect("a cell");
    let cell = Cell::at(&socket).expect("a cell");
    let cell = cell.with_lost_after(Duration::from_secs(3600));
    let first = cell.start(&waiting("first")).expect("started");
    let second = cell.load(&waiting("second")).expect("loaded");
    cell.switch(&[&first], &[&second]).expect("handed over");
    let free = cell.load(&waiting("free")).expect("loaded");
    free.start().expect("started");
    drop(cell);
    let ended = watching.command("second").expect("a command");
    let ended = ended.wait(Some(LIMIT)).expect("ended");
    assert_eq!(ended.reason, "canceled", "{ended}");
    let free = watching.command("free").expect("a command");
    assert_eq!(free.state().expect("a state").state, "running");
    tested.stop();
}

/// The program that is killed: the harness runs this very test in a process of its own.
fn program(socket: &str) {
    let cell = Cell::at(Path::new(socket)).expect("a cell");
    let cell = cell.with_lost_after(Duration::from_millis(500));
    let bound = cell
        .start(&line("bound", 0.1, "0.01 m/s"))
        .expect("started");
    let free = cell.load(&waiting("free")).expect("loaded");
    free.start_with(OnClientLoss::GoOn).expect("started");
    println!("\nready {}", bound.id());
    // Its harness kills it; if that is gone, so is the pipe.
    let _ = std::io::stdin().read_line(&mut String::new());
}

#[test]
fn a_program_that_is_killed_leaves_what_on_client_loss_says() {
    if let Ok(socket) = std::env::var("RCC_TEST_CLIENT_SOCKET") {
        return program(&socket);
    }
    let tested = TestCell::demo();
    let own = std::env::current_exe().expect("this program");
    let mut killed = Command::new(own)
        .args([
            "a_program_that_is_killed_leaves_what_on_client_loss_says",
            "--nocapture",
        ])
        .env("RCC_TEST_CLIENT_SOCKET", tested.cell().socket())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("a program");
    let mut lines = BufReader::new(killed.stdout.take().expect("its output")).lines();
    let is_ready = lines.any(|line| line.expect("a line").starts_with("ready"));
    killed.kill().expect("killed");
    killed.wait().expect("dead");
    assert!(is_ready, "{}", tested.logs());
    let cell = Cell::at(&tested.cell().socket()).expect("a cell");
    let bound = cell.command("bound").expect("a command");
    let ended = bound.wait(Some(LIMIT)).expect("ended");
    assert_eq!(ended.reason, "canceled", "{ended}");
    await_some("the arm to rest", || {
        let devices = cell.devices().expect("devices");
        devices
            .iter()
            .find(|device| device.name == "lwr" && device.state == "ready")
            .map(drop)
    });
    let free = cell.command("free").expect("a command");
    assert_eq!(free.state().expect("a state").state, "running");
    tested.stop();
}

#[test]
fn a_cell_that_is_not_there_is_told() {
    let missing = std::env::temp_dir().join("rcc-no-such.sock");
    let told = Cell::at(&missing).expect_err("nobody listens").to_string();
    assert!(
        told.contains("RCC4004") && told.contains("rcc-cli up"),
        "{told}"
    );
}
