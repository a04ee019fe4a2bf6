//! Counts hand-overs by rules in a running cell: the arm passes in flight from net to net in consecutive cycles while a
//! large net is loading, within its limits. Runs on the test's thread.

use rcc_core::message::CommandImage;
use rcc_testing::{Random, Rng};
use serde_json::{Value, json};

use crate::cell_fixture::CellFixture;
use crate::handover::{Arm, large_net};
use crate::waiting::await_some;

/// Period of the demo cell, s.
const PERIOD_S: f64 = 1e-3;
/// Number of the newest set-points that are looked at after a hand-over.
const AROUND: u64 = 200;

/// Numbers of hand-overs by property.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    /// Rules that were installed.
    pub asked: usize,
    /// Rules that fired.
    pub fired: usize,
    /// Hand-overs in which the old net's last cycle directly precedes the new net's first.
    pub consecutive: usize,
    /// Hand-overs around which the arm's set-points have no gap and belong to one engagement.
    pub unbroken: usize,
    /// Hand-overs while the large net was still loading.
    pub while_loading: usize,
    /// Largest velocity, acceleration and jerk of any joint relative to its limit.
    pub shares: [f64; 3],
}

/// A net that moves all joints to a goal from however the arm moves; `near` is true after `cycles`.
fn go_on(joint1_rad: f64, cycles: usize) -> String {
    let end = cycles as f64 * PERIOD_S;
    format!(
        "net: go-on
primitives:
  cancel: {{type: Cancel}}
  time: {{type: Time}}
  near: {{type: Greater, inputs: {{a: time.out, b: {end} s}}}}
  move:
    type: JointGoal
    parameters: {{device: lwr, scale: 0.3, start: continue}}
    inputs: {{goal: [{joint1_rad}, deg(-30), 0, deg(90), 0, deg(-60), 0], stop: cancel.requested}}
  robot: {{type: JointPositionCommand, parameters: {{device: lwr}}, inputs: {{position: move.position}}}}
  end: {{type: Termination, inputs: {{done: cancel.requested}}}}
discard: [near.out]
"
    )
}

/// Hands the arm over `times` times by rules, each time while a net of `large` primitives is loading; calls `tell` after
/// each. `limits` are the velocity, acceleration and jerk limits of every joint, rad/s, rad/s² and rad/s³.
pub fn hand_over(
    place: &CellFixture,
    (times, large): (usize, usize),
    limits: [[f64; 7]; 3],
    mut tell: impl FnMut(&Report),
) -> Report {
    let arm = Arm::of(place);
    let mut random = Rng::with_seed(7);
    let large = large_net(large);
    let mut report = Report::default();
    // Longer than what is looked at: before it the arm has no set-points.
    let mut old = place.run(&go_on(0.2, 400));
    await_some("the driver to follow", || {
        (place.device("lwr")?["state"] == "commanded").then_some(())
    });
    for _ in 0..times {
        let cycles = 20 + random.below(60);
        let new = place.load(&go_on(random.uniform(-0.3, 0.3), cycles));
        let loading = place.rest("POST", "/commands", &large);
        assert_eq!(loading.status, 202, "{loading:?}");
        let large_id = loading.body["id"].as_u64().expect("an id");
        let rule = json!({
            "when": format!("#{old}.near.out"), "stop": old, "start": new, "on_client_loss": "go on",
        });
        let installed = place.rest("POST", "/rules", &json!({"rules": [rule]}).to_string());
        assert_eq!(installed.status, 200, "{installed:?}\n{}", place.logs());
        let number = installed.body["rules"][0]["rule"].clone();
        report.asked += 1;
        let ended = await_some("the rule to fire", || {
            let row = place.rest("GET", &format!("/rules/{number}"), "").body;
            (row["state"] != "armed" && row["state"] != "due").then_some(row)
        });
        assert_eq!(ended["state"], "fired", "{ended}\n{}", place.logs());
        report.fired += 1;
        report.while_loading += usize::from(place.state(large_id)["state"] == "loading");
        let cycle = ended["cycle"].as_u64().expect("a cycle");
        report.consecutive += usize::from(is_consecutive(place, (old, new), cycle));
        let image = arm.image();
        report.unbroken += usize::from(is_unbroken(&image));
        for (share, now) in report.shares.iter_mut().zip(shares(&image, limits)) {
            *share = share.max(now);
        }
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

/// True if the old net ended in the cycle before the rule fired and the new net started in that cycle.
fn is_consecutive(place: &CellFixture, (old, new): (u64, u64), cycle: u64) -> bool {
    let row = await_some("the table after the hand-over", || {
        let row: Value = place.state(new);
        (row["state"] != "ready").then_some(row)
    });
    let ended = place.state(old);
    let (first, last) = (row["started_cycle"].as_u64(), ended["ended_cycle"].as_u64());
    (first, last) == (Some(cycle), cycle.checked_sub(1))
}

/// The newest set-points, newest first.
fn newest(image: &CommandImage) -> Vec<rcc_core::message::SetPoint> {
    let from = image.head.sequence.saturating_sub(AROUND);
    let points = (from..=image.head.sequence)
        .rev()
        .map_while(|cycle| image.at(cycle));
    points.copied().collect()
}

fn is_unbroken(image: &CommandImage) -> bool {
    let points = newest(image);
    let Some(first) = points.first() else {
        return false;
    };
    points
        .iter()
        .all(|point| point.has_position == 1 && point.owner == first.owner && first.owner != 0)
}

/// Largest velocity, acceleration and jerk of any joint among the newest set-points, relative to its limit: differences of
/// two, three and four of them.
fn shares(image: &CommandImage, limits: [[f64; 7]; 3]) -> [f64; 3] {
    let points = newest(image);
    let mut shares = [0.0f64; 3];
    for window in points.windows(4) {
        for joint in 0..7 {
            let [d, c, b, a] = [0, 1, 2, 3].map(|index| window[index].position[joint]);
            let rates = [
                (d - c) / PERIOD_S,
                (d - 2.0 * c + b) / PERIOD_S.powi(2),
                (d - 3.0 * c + 3.0 * b - a) / PERIOD_S.powi(3),
            ];
            for ((share, rate), limits) in shares.iter_mut().zip(rates).zip(limits) {
                *share = share.max(rate.abs() / limits[joint]);
            }
        }
    }
    shares
}
