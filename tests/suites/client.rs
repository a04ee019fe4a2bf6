//! The Rust client: what `rcc-net` builds is run, canceled, handed over, set and watched, through all processes. Each
//! test has a cell of its own.

use std::time::Duration;

use rcc_client::{Cell, ClientError};
use rcc_net::{NetBuilder, Real, pose};
use rcc_tests::TestCell;
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
fn a_cell_that_is_not_there_is_told() {
    let missing = std::env::temp_dir().join("rcc-no-such.sock");
    let told = Cell::at(&missing).expect_err("nobody listens").to_string();
    assert!(
        told.contains("RCC4004") && told.contains("rcc-cli up"),
        "{told}"
    );
}
