//! Goals that become null during a motion: the motion comes to rest on its path, does not turn back, stays at rest, and
//! continues when a goal is known again, as the manual of JointGoal, PoseGoal and ScalarGoal promises.

use crate::harness::{NetHarness, cell};
use rcc_language::compile;

const START: [f64; 7] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4];

/// The net, the port with the current position, and the number of its elements that are not part of a quaternion.
const NETS: [(&str, &str, usize); 3] = [
    (
        "  goal: {type: Input, parameters: {initial: [0.5, 0.3, -0.1, -1.0, 0.2, 1.1, 0.6]}}
  it: {type: JointGoal, parameters: {device: lwr, scale: 0.5}, inputs: {goal: goal.value}}
discard: [it.velocity]
",
        "it.position",
        7,
    ),
    (
        "  goal: {type: Input, parameters: {initial: {xyz: [-0.45, 0.1, 0.5], rpy: [3.0, 0.1, 2.8]}}}
  it: {type: PoseGoal, parameters: {device: lwr, velocity: 0.2, acceleration: 1, jerk: 10}, inputs: {goal: goal.value}}
",
        "it.pose",
        3,
    ),
    (
        "  goal: {type: Input, parameters: {initial: 0.4}}
  it: {type: ScalarGoal, parameters: {velocity: 0.2, acceleration: 1, jerk: 10, initial: 0}, inputs: {goal: goal.value}}
",
        "it.position",
        1,
    ),
];

fn harness(rows: &str) -> NetHarness {
    let cell = cell("tests/nets/cell.yaml");
    let (primitives, discard) = rows.split_once("discard").unwrap_or((rows, ""));
    let ports = ["pose", "position", "done", "flange_speed", "accepted"];
    let spec = |port: &&&str| {
        let ty = rows.split("type: ").nth(2).unwrap();
        let name = ty.split(',').next().unwrap();
        let (_, entry) = rcc_core::primitives::find(name).unwrap();
        let mut outputs = entry.spec.outputs.iter();
        outputs.any(|output| output.name == **port && !output.diagnostic)
    };
    let mut unread: Vec<String> = ports
        .iter()
        .filter(spec)
        .map(|port| format!("it.{port}"))
        .collect();
    unread.extend(
        discard
            .contains("velocity")
            .then(|| "it.velocity".to_owned()),
    );
    let text = format!(
        "net: goals\nprimitives:\n{primitives}  end: {{type: Termination, inputs: {{done: false}}}}\ndiscard: [{}]\n",
        unread.join(", ")
    );
    let net = compile(&text, "goals", &cell).unwrap_or_else(|faults| panic!("{text}\n{faults}"));
    NetHarness::new(net, &cell, START)
}

#[test]
fn a_null_goal_stops_the_motion_on_its_path_and_a_known_one_continues_it() {
    for (rows, port, count) in NETS {
        let (mut it, known) = (harness(rows), harness(rows));
        let place = |it: &NetHarness| it.values(port)[..count].to_vec();
        (0..150).for_each(|_| it.step());
        let from = place(&it);
        it.step();
        let first = place(&it);
        let ways: Vec<f64> = first.iter().zip(&from).map(|(b, a)| b - a).collect();
        assert!(ways.iter().any(|way| way.abs() > 1e-6), "{port}: it moves");
        it.copy_from(&known, "goal.value", true);
        let mut last = first;
        for _ in 0..1500 {
            it.step();
            let now = place(&it);
            for ((now, last), way) in now.iter().zip(&last).zip(&ways) {
                assert!((now - last) * way.signum() >= -1e-12, "{port} turns back");
            }
            last = now;
        }
        it.step();
        assert_eq!(place(&it), last, "{port}: at rest");
        assert_eq!(it.value("it.done"), 0.0, "{port}: it is not at a goal");
        it.copy_from(&known, "goal.value", false);
        (0..5000).for_each(|_| it.step());
        let ends = place(&it);
        let goal = &known.values("goal.value")[..count];
        for (end, goal) in ends.iter().zip(goal) {
            assert!((end - goal).abs() < 1e-9, "{port}: {end} {goal}");
        }
        assert_eq!(it.value("it.done"), 1.0, "{port}");
    }
}
