//! Hand-overs in a living cell, counted: the arm goes from net to net in consecutive cycles while a large net is loading.
//! Run by a test's thread.

use std::cell::RefCell;

use rcc_core::message::{CommandImage, Measurement};
use rcc_ipc::control::{MEASUREMENT, command_board};
use rcc_ipc::{BoardReader, CommandReader, Role, Session};
use serde_json::{Value, json};

use crate::cell_fixture::{CellFixture, await_some};

/// Holds the arm where its driver holds it, and the torch's line, until CANCEL.
const HOLD: &str = "net: hold
primitives:
  cancel: {type: Cancel}
  state: {type: JointState, parameters: {device: lwr}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: state.hold}}
  gun: {type: DigitalOutput, parameters: {device: lwr, channel: gun}, inputs: {in: true}}
  end: {type: Termination, inputs: {done: cancel.requested}}
discard: [state.position]
";

/// Set-points around a hand-over that are looked at.
const AROUND: usize = 16;

/// What came of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Hand-overs asked for.
    pub asked: usize,
    /// The old net's last cycle was the one before the new one's first.
    pub consecutive: usize,
    /// The arm's set-points went on without a gap and in one engagement.
    pub unbroken: usize,
    /// The large net was still loading when the hand-over was done.
    pub while_loading: usize,
}

/// The text of a net of so many primitives that runs beside anything.
#[must_use]
pub fn large_net(primitives: usize) -> String {
    let mut text = String::from("net: large\nprimitives:\n  n0: {type: Time}\n");
    let sums = primitives.saturating_sub(3);
    for number in 1..=sums {
        let before = number - 1;
        text.push_str(&format!(
            "  n{number}: {{type: Add, inputs: {{a: n{before}.out, b: 1 ms}}}}\n"
        ));
    }
    text.push_str(&format!(
        "  over: {{type: Greater, inputs: {{a: n{sums}.out, b: 1000000 s}}}}\n  end: {{type: Termination, inputs: {{done: over.out}}}}\n"
    ));
    text
}

/// Hands the arm over so many times, each time while a net of `large` primitives is loading; `tell` hears of each.
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

/// The rows of both, as soon as the table shows the hand-over.
fn is_consecutive(place: &CellFixture, (old, new): (u64, u64), cycle: u64) -> bool {
    // The tables are written in the cycle of the hand-over; a request may still see the ones before.
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

/// The set-points of the cycles around the hand-over, looked at before the ring forgets them, else those that are left:
/// since an engagement never comes back, its number tells.
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

/// What the arm of the demo cell is told, and what its driver tells.
pub struct Arm {
    image: RefCell<CommandReader>,
    measurement: BoardReader<Measurement>,
    _session: Session,
}

impl Arm {
    /// Opens the boards of the living executor and driver.
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

    /// The newest set-points.
    pub fn image(&self) -> CommandImage {
        *self.image.borrow_mut().read()
    }

    /// The newest measurement.
    pub fn measurement(&self) -> Measurement {
        self.measurement.read()
    }
}
