//! Counts hand-overs in a running cell: the arm passes from net to net in consecutive cycles while a large net is
//! loading. Runs on the test's thread.

use std::cell::RefCell;

use rcc_core::message::{CommandImage, Measurement};
use rcc_ipc::{BoardReader, CommandReader, Session};
use rcc_protocol::Role;
use rcc_protocol::control::{MEASUREMENT, command_board};
use serde_json::{Value, json};

use crate::cell_fixture::CellFixture;
use crate::waiting::await_some;

/// Commands the driver's hold position and keeps the output `gun` on until CANCEL.
const HOLD: &str = "net: hold
primitives:
  cancel: {type: Cancel}
  state: {type: JointState, parameters: {device: lwr}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: state.hold}}
  gun: {type: DigitalOutput, parameters: {device: lwr, channel: gun}, inputs: {in: true}}
  end: {type: Termination, inputs: {done: cancel.requested}}
discard: [state.position]
";

/// Number of the newest set-points that are checked after a hand-over.
const AROUND: usize = 16;

/// Numbers of hand-overs by property.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Requested hand-overs.
    pub asked: usize,
    /// Hand-overs in which the old net's last cycle directly precedes the new net's first.
    pub consecutive: usize,
    /// Hand-overs in which the arm's set-points continue without a gap and in one engagement.
    pub unbroken: usize,
    /// Hand-overs that were done while the large net was still loading.
    pub while_loading: usize,
}

/// Returns primitives (lines of the section `primitives`): `n0` is the time, and each of `sums` adds to the one before.
#[must_use]
pub fn chain_of_sums(sums: usize) -> String {
    let mut text = String::from("  n0: {type: Time}\n");
    for number in 1..=sums {
        let before = number - 1;
        text.push_str(&format!(
            "  n{number}: {{type: Add, inputs: {{a: n{before}.out, b: 1 ms}}}}\n"
        ));
    }
    text
}

/// Returns the text of a net with this many primitives that uses no device.
#[must_use]
pub fn large_net(primitives: usize) -> String {
    let sums = primitives.saturating_sub(3);
    let mut text = format!("net: large\nprimitives:\n{}", chain_of_sums(sums));
    text.push_str(&format!(
        "  over: {{type: Greater, inputs: {{a: n{sums}.out, b: 1000000 s}}}}\n  end: {{type: Termination, inputs: {{done: over.out}}}}\n"
    ));
    text
}

/// Hands the arm over `times` times, each time while a net of `large` primitives is loading; calls `tell` after each.
pub fn hand_over(
    place: &CellFixture,
    times: usize,
    large: usize,
    mut tell: impl FnMut(&Report),
) -> Report {
    let arm = Arm::of(place);
    let large = large_net(large);
    let mut report = Report::default();
    let mut old = place.run(HOLD);
    await_some("the driver to follow", || {
        (place.device("lwr")?["state"] == "commanded").then_some(())
    });
    for _ in 0..times {
        let new = place.load(HOLD);
        let owner = newest_owner(&arm.image());
        let loading = place.rest("POST", "/commands", &large);
        assert_eq!(loading.status, 202, "{loading:?}");
        let body = json!({"stop": [old], "start": [new]}).to_string();
        let switched = place.rest("POST", "/switch", &body);
        assert_eq!(switched.status, 200, "{switched:?}\n{}", place.logs());
        let large_id = loading.body["id"].as_u64().expect("an id");
        report.asked += 1;
        report.while_loading += usize::from(place.state(large_id)["state"] == "loading");
        let cycle = switched.body["cycle"].as_u64().expect("a cycle");
        report.consecutive += usize::from(is_consecutive(place, (old, new), cycle));
        report.unbroken += usize::from(is_unbroken(&arm, cycle, owner));
        await_some("the large net to be loaded", || {
            (place.state(large_id)["state"] == "ready").then_some(())
        });
        for id in [large_id, old] {
            let unloaded = place.rest("DELETE", &format!("/commands/{id}"), "");
            assert_eq!(unloaded.status, 200, "{unloaded:?}");
        }
        old = new;
        tell(&report);
    }
    place.done(old, "cancel");
    place.assert_ends(old, "canceled");
    report
}

/// True if the old net ended in the cycle before the hand-over and the new net started in the cycle of the hand-over.
fn is_consecutive(place: &CellFixture, (old, new): (u64, u64), cycle: u64) -> bool {
    // The tables are written in the cycle of the hand-over; a request may still read the previous ones.
    let row = await_some("the table after the hand-over", || {
        let row: Value = place.state(new);
        (row["state"] != "ready").then_some(row)
    });
    let ended = place.state(old);
    let (first, last) = (row["started_cycle"].as_u64(), ended["ended_cycle"].as_u64());
    row["state"] == "running"
        && (&ended["state"], &ended["reason"]) == (&json!("terminated"), &json!("aborted"))
        && (first, last) == (Some(cycle), cycle.checked_sub(1))
}

/// True if the newest set-points on the command board all have a position and belong to the engagement `owner`. The
/// board may have overwritten those of the hand-over already; an engagement number is never reused, so that the
/// remaining ones suffice.
fn is_unbroken(arm: &Arm, cycle: u64, owner: u64) -> bool {
    let image = await_some("the set-point of that cycle", || {
        let image = arm.image();
        (image.head.sequence >= cycle).then_some(image)
    });
    let points = (0..image.head.sequence + 1)
        .rev()
        .map_while(|sequence| image.at(sequence))
        .take(AROUND);
    owner != 0
        && points
            .into_iter()
            .all(|point| point.has_position == 1 && point.owner == owner)
}

fn newest_owner(image: &CommandImage) -> u64 {
    image.at(image.head.sequence).map_or(0, |point| point.owner)
}

/// Readers of the command board and the measurement board of the demo cell's arm.
pub struct Arm {
    image: RefCell<CommandReader>,
    measurement: BoardReader<Measurement>,
    _session: Session,
}

impl Arm {
    /// Opens the boards of the running executor and driver.
    pub fn of(place: &CellFixture) -> Arm {
        let session = Session::join(place.cell(), Role::Monitor, "arm").expect("a cell");
        let executor = place.announced(Role::Executor, "exec");
        let driver = place.announced(Role::Driver, "lwr");
        let image = session.open_commands(&executor.services[&command_board("lwr")]);
        let measurement = session.open_board(&driver.services[MEASUREMENT]);
        Arm {
            image: RefCell::new(image.expect("the executor's commands")),
            measurement: measurement.expect("the driver's board"),
            _session: session,
        }
    }

    /// Returns the newest set-points.
    pub fn image(&self) -> CommandImage {
        *self.image.borrow_mut().read()
    }

    /// Returns the newest measurement.
    pub fn measurement(&self) -> Measurement {
        self.measurement.read()
    }
}
