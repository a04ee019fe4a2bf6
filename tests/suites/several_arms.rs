//! Two arms in one net, each with a driver of its own: started, canceled and stopped as one. Two LWRs, and an LWR and an iiwa.
//! Each test has a cell of its own.

use rcc_protocol::Role;
use rcc_tests::records::RecordCollector;
use rcc_tests::simulator::assert_within_limits;
use rcc_tests::{TestCell, await_some, repository};
use serde_json::Value;

/// Maximum movement of one flange relative to the other while they hold the load, m.
const SLIP: f64 = 1e-9;

const CELLS: [&str; 2] = ["two-arms.yaml", LWR_AND_IIWA];
/// The cell whose left arm has a simulator of its controller; the arms of the other one are inside of their drivers.
const LWR_AND_IIWA: &str = "lwr-and-iiwa.yaml";

/// Commands nothing; shows where the left arm is until CANCEL.
const WHERE_LEFT: &str = "net: where-left
primitives:
  state:  {type: JointState, parameters: {device: left}}
  cancel: {type: Cancel}
  end:    {type: Termination, inputs: {done: cancel.requested}}
discard: [state.position, state.hold, state.torque, state.external_torque]
";

fn cell(config: &str) -> TestCell {
    TestCell::start(&repository().join("configs/cells").join(config), |text| {
        text
    })
}

fn shared_load() -> String {
    let path = repository().join("configs/two-arms/shared-load.yaml");
    std::fs::read_to_string(path).expect("the example")
}

/// Waits until the line has covered the distance `way`, m.
fn await_way(cell: &TestCell, id: u64, way: f64) {
    let path = format!("/commands/{id}/values?ports=move.distance");
    await_some("the load to move", || {
        let reply = cell.rest("GET", &path, "");
        let distance = reply.body["values"][0]["value"].as_f64()?;
        (distance > way).then_some(())
    });
}

/// Asserts that the right flange does not move relative to the left one, by the records of the net's first monitor: one
/// per cycle, at least `least` of them.
fn assert_held(records: RecordCollector, least: usize) {
    let records = records.finish();
    let slips: Vec<f64> = records
        .iter()
        .filter(|record| record.width == 1)
        .map(|record| record.values[0])
        .collect();
    assert!(slips.len() >= least, "{} records", slips.len());
    let worst = slips.iter().copied().fold(0.0, f64::max);
    assert!(slips.iter().all(|slip| *slip <= SLIP), "{worst} m");
}

/// Asserts that no net commands the left arm, and that it does not move, for some hundred cycles; `shown` is the command of
/// [`WHERE_LEFT`].
fn assert_left_rests(cell: &TestCell, shown: u64) {
    let joints = || {
        let row = cell.value(shown, "state.position");
        let joints = row.as_array().into_iter().flatten();
        let joints: Vec<f64> = joints.filter_map(Value::as_f64).collect();
        assert!(joints.len() >= 7, "no position: {row}");
        joints
    };
    let watch = cell.watch();
    let (rests, begun) = (joints(), watch.status().cycle);
    await_some("some hundred cycles", || {
        let is = joints();
        let mut moved = is.iter().zip(&rests).map(|(is, was)| (is - was).abs());
        assert!(moved.all(|way| way < 1e-5), "from {rests:?} to {is:?}");
        let row = cell.device("left")?;
        assert!(row["holder"].is_null(), "{row}");
        (watch.status().cycle > begun + 500).then_some(())
    });
}

#[test]
fn two_arms_carry_a_load_and_are_canceled_as_one() {
    CELLS.into_iter().for_each(carried_and_canceled);
}

fn carried_and_canceled(config: &str) {
    let cell = cell(config);
    let records = RecordCollector::follow(&cell);
    let id = cell.run(&shared_load());
    for device in ["left", "right"] {
        let holder = format!("shared-load#{id}");
        await_some("one net to command both arms", || {
            (cell.device(device)?["holder"] == holder).then_some(())
        });
    }
    await_way(&cell, id, 0.01);
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    for device in ["left", "right"] {
        cell.await_device(device, "ready");
    }
    // From where they rest now to the end of the line.
    let id = cell.run(&shared_load());
    cell.assert_ends(id, "finished");
    assert_held(records, 500);
    cell.stop();
}

#[test]
fn when_one_arm_is_lost_the_other_comes_to_rest() {
    CELLS.into_iter().for_each(one_is_lost);
}

fn one_is_lost(config: &str) {
    let cell = cell(config);
    let mut left = (config == LWR_AND_IIWA).then(|| cell.simulator("lwr-sim"));
    let shown = cell.run(WHERE_LEFT);
    let id = cell.run(&shared_load());
    await_way(&cell, id, 0.01);
    if let Some(left) = &mut left {
        left.reset_statistics();
    }
    let dead = cell.kill(Role::Driver, "right");
    let row = cell.await_end(id);
    assert_eq!(row["fault"]["fault"], "device lost", "{row}");
    assert_eq!(row["fault"]["device"], "right", "{row}");
    cell.await_device("left", "ready");
    await_some("the other arm to be commanded by no net", || {
        cell.device("left")?["holder"].is_null().then_some(())
    });
    if let Some(left) = &mut left {
        assert_within_limits(&left.await_rest(), &[]);
    }
    assert_left_rests(&cell, shown);
    cell.await_successor(Role::Driver, "right", dead);
    cell.await_device("right", "ready");
    // Nothing goes on by itself when the other arm is back.
    assert_left_rests(&cell, shown);
    cell.done(shown, "cancel");
    cell.assert_ends(shown, "canceled");
    cell.stop();
}
