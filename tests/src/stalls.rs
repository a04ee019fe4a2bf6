//! Motions in cells whose clock follows a device, on a machine that may stall: such a clock bridges only 10 ms. Runs on the
//! threads of the test harness.

use rcc_driver_kit::host::reason::{STARVED, meaning};
use serde_json::Value;

use crate::cell_fixture::CellFixture;
use crate::waiting::await_some;

/// Number of times that a motion is run at most. Each run goes on where the one before has ended.
const RUNS_MAX: usize = 10;

/// Runs a motion of `device` until it is finished. If the machine suspends the executor for longer than its clock bridges,
/// the motion ends at rest, because set-points are missing; the driver says so in the event log. For this cause alone it is
/// run again, from where the device rests.
pub fn run_until_finished(cell: &CellFixture, device: &str, text: &str) {
    let mut ends = Vec::new();
    while ends.len() < RUNS_MAX {
        let before = position_in_log(cell);
        let id = cell.run(text);
        let row = cell.await_end(id);
        if row["reason"] == "finished" {
            return;
        }
        let fault = &row["fault"];
        assert!(
            fault["fault"] == "device lost" && fault["device"] == device,
            "{row}\n{}",
            cell.logs()
        );
        // The driver writes it some time after the executor has seen the stop.
        let begun = await_some("the driver to say why it stopped", || {
            rest_begun(cell, device, &before)
        });
        assert_eq!(
            begun["fields"]["reason"],
            meaning(STARVED, &[]),
            "{begun}\n{row}\n{}",
            cell.logs()
        );
        ends.push(row);
    }
    panic!("no run of {RUNS_MAX} has finished: {ends:#?}");
}

/// Returns the position after the newest event.
fn position_in_log(cell: &CellFixture) -> String {
    let page = cell.rest("GET", "/events?limit=1", "");
    let next = page.body["next"].as_str();
    next.unwrap_or_else(|| panic!("{page:?}")).to_owned()
}

/// Returns the first event after this position with which the driver of `device` began to bring it to rest.
fn rest_begun(cell: &CellFixture, device: &str, after: &str) -> Option<Value> {
    let page = cell.rest("GET", &format!("/events?after={after}"), "");
    let events = page.body["events"].as_array()?;
    let is_begin =
        |event: &&Value| event["kind"] == "rest-begun" && event["source"]["label"] == device;
    events.iter().find(is_begin).cloned()
}
