//! Lists of links and parts of values, from the text to the values of a cycle.

use crate::harness::{NetHarness, cell};
use rcc_language::{Compiled, Faults, compile};

fn try_run(primitives: &str, discard: &str) -> Result<Compiled, Faults> {
    let text = format!(
        "net: example\nprimitives:\n  end: {{type: Termination, inputs: {{done: false}}}}\n{primitives}\ndiscard: [{discard}]\n"
    );
    compile(&text, "net", &cell("tests/nets/cell.yaml"))
}

/// Runs a net of these primitives for the golden cell.
fn run(primitives: &str, discard: &str) -> NetHarness {
    let net = try_run(primitives, discard).unwrap_or_else(|faults| panic!("{faults}"));
    NetHarness::new(net, &cell("tests/nets/cell.yaml"), [0.0; 7])
}

fn codes(primitives: &str, discard: &str) -> Vec<String> {
    let faults = match try_run(primitives, discard) {
        Ok(_) => return Vec::new(),
        Err(faults) => faults,
    };
    let faults = faults.rows().into_iter();
    faults.map(|fault| fault.code.to_string()).collect()
}

fn copies(harness: &NetHarness) -> usize {
    let (row, _) = rcc_core::primitives::find("Copy").unwrap();
    let runs = harness.net.plan.runs.iter();
    runs.filter(|run| usize::from(run.kernel) / rcc_core::primitives::KERNELS_MAX == row)
        .count()
}

#[test]
fn a_list_of_links_is_computed_in_place() {
    let mut harness = run(
        "  one: {type: Add, inputs: {a: 1.0, b: 0.0}}
  two: {type: Add, inputs: {a: one.out, b: 1.0}}
  sum: {type: Add, inputs: {a: [one.out, 0.5, two.out], b: [10, 20, 30]}}",
        "sum.out",
    );
    harness.step();
    assert_eq!(harness.values("sum.out"), [11.0, 20.5, 32.0]);
    assert_eq!(copies(&harness), 0);
}

#[test]
fn outputs_computed_elsewhere_are_copied() {
    let mut harness = run(
        "  t: {type: Time}
  ticks: {type: Counter, inputs: {in: true}}
  now: {type: ToReal, inputs: {in: ticks.out}}
  first: {type: Negate, inputs: {in: [now.out, 2.0]}}
  second: {type: Negate, inputs: {in: ['first.out[1]', now.out, 'first.out[0]']}}
  third: {type: Negate, inputs: {in: ['second.out[0..2]', 'first.out[0..2]']}}",
        "t.out, third.out",
    );
    harness.step();
    assert_eq!(harness.values("first.out"), [-1.0, -2.0]);
    assert_eq!(harness.values("second.out"), [2.0, -1.0, 1.0]);
    assert_eq!(harness.values("third.out"), [-2.0, 1.0, 1.0, 2.0]);
    harness.step();
    assert_eq!(harness.values("second.out"), [2.0, -2.0, 2.0]);
}

#[test]
fn a_delayed_link_in_a_list_carries_its_initial_value_and_then_the_previous_one() {
    let mut harness = run(
        "  ticks: {type: Counter, inputs: {in: true}}
  both: {type: Negate, inputs: {in: [ticks.out, {from: ticks.out, delayed: true, initial: 7}]}}",
        "both.out",
    );
    harness.step();
    assert_eq!(harness.values("both.out"), [-1.0, -7.0]);
    harness.step();
    assert_eq!(harness.values("both.out"), [-2.0, -1.0]);
    assert_eq!(copies(&harness), 0);
}

#[test]
fn null_is_per_element() {
    let mut harness = run(
        "  no: {type: NullIf, inputs: {in: 1.0, condition: true}}
  sum: {type: Add, inputs: {a: [no.out, 1.0, null], b: [1, 1, 1]}}
  lacks: {type: IsNull, inputs: {in: sum.out}}
  whole: {type: OrElse, inputs: {in: sum.out, other: [0, 0, 0]}}",
        "lacks.out, whole.out",
    );
    harness.step();
    let sum = harness.values("sum.out");
    assert!(
        sum[0].is_nan() && sum[1] == 2.0 && sum[2].is_nan(),
        "{sum:?}"
    );
    assert_eq!(harness.value("lacks.out"), 1.0);
    assert_eq!(harness.values("whole.out"), [0.0; 3]);
}

#[test]
fn parts_of_composites_have_names_and_units() {
    let mut harness = run(
        "  goal: {type: Constant, parameters: {value: {xyz: [0.1, 0.2, 0.3], quat: [0, 0, 0, 1]}}}
  same: {type: Invert, inputs: {in: goal.out}}
  twice: {type: Scale, inputs: {in: same.out.position, factor: 2.0}}
  high: {type: Greater, inputs: {a: same.out.z, b: -250 mm}}
  turning: {type: Copy, inputs: {in: same.out.rotation}}
  turn: {type: Abs, inputs: {in: turning.out.w}}",
        "twice.out, high.out, turn.out",
    );
    harness.step();
    let twice = harness.values("twice.out");
    assert_eq!(twice, [-0.2, -0.4, -0.6]);
    assert_eq!(harness.value("high.out"), 0.0);
}

#[test]
fn a_list_of_rows_is_a_matrix() {
    let mut harness = run(
        "  x: {type: Add, inputs: {a: 1.0, b: 0.5}}
  row: {type: Negate, inputs: {in: [x.out, 2.0]}}
  m: {type: Negate, inputs: {in: [[x.out, 1], row.out]}}
  cell: {type: Abs, inputs: {in: 'm.out[1,0]'}}
  last: {type: Abs, inputs: {in: 'm.out[1,..]'}}",
        "cell.out, last.out",
    );
    harness.step();
    assert_eq!(harness.values("m.out"), [-1.5, -1.0, 1.5, 2.0]);
    assert_eq!(harness.value("cell.out"), 1.5);
    assert_eq!(harness.values("last.out"), [1.5, 2.0]);
}

#[test]
fn joints_are_commanded_one_by_one() {
    let mut harness = run(
        "  state: {type: JointState, parameters: {device: lwr}}
  first: {type: Add, inputs: {a: 'state.position[0]', b: 0.001 rad}}
  cancel: {type: Cancel}
  robot:
    type: JointPositionCommand
    parameters: {device: lwr}
    inputs: {position: [first.out, 'state.position[1]', 0, 0, 0 rad, 0, 0]}",
        "cancel.requested, state.hold, state.torque, state.external_torque",
    );
    harness.step();
    assert!(harness.outputs[0].has_position);
    assert_eq!(harness.outputs[0].position[..2], [0.001, 0.0]);
}

#[test]
fn type_and_unit_errors_are_reported_by_element() {
    for (primitives, want) in [
        (
            "  a: {type: Time}\n  s: {type: Add, inputs: {a: [a.out, true], b: [1, 2]}}",
            "RCC1303",
        ),
        (
            "  a: {type: Time}\n  s: {type: Add, inputs: {a: [a.out, 1 m], b: [1 s, 2 s]}}",
            "RCC1304",
        ),
        (
            "  a: {type: Time}\n  s: {type: Add, inputs: {a: [a.out, 1 s], b: [1, 2, 3]}}",
            "RCC1303",
        ),
        (
            "  a: {type: Time}\n  s: {type: Add, inputs: {a: ['a.out[0]', 1 s], b: [1, 2]}}",
            "RCC1206",
        ),
        (
            "  a: {type: Time}\n  s: {type: Add, inputs: {a: [b.out, 1 s], b: [1, 2]}}",
            "RCC1202",
        ),
    ] {
        let codes = codes(primitives, "s.out");
        assert!(
            codes.iter().any(|code| code == want),
            "{primitives}: {codes:?}"
        );
    }
}

#[test]
fn a_list_of_constants_is_a_list_of_values_where_one_is_expected() {
    let mut harness = run(
        "  count: {type: Counter, inputs: {in: true}}
  speed: {type: Multiplexer, inputs: {index: count.out, in: [0.1 m/s, 0.2 m/s, 0.3 m/s]}}
  whole: {type: Multiplexer, inputs: {index: count.out, in: [10, 20, 30]}}
  axis: {type: Multiplexer, inputs: {index: count.out, in: [[1.0, 0.0], [0.0, 1.0]]}}
  none: {type: Multiplexer, inputs: {index: count.out, in: [null, 1.5, null]}}
  twice: {type: Add, inputs: {a: whole.out, b: count.out}}",
        "speed.out, axis.out, none.out, twice.out",
    );
    harness.step();
    assert_eq!(harness.values("speed.out"), [0.2]);
    assert_eq!(harness.values("axis.out"), [0.0, 1.0]);
    assert_eq!(harness.values("none.out"), [1.5]);
    harness.step();
    assert_eq!(harness.values("speed.out"), [0.3]);
    assert!(harness.values("none.out")[0].is_nan());
    for wrong in ["5.0", "[]"] {
        let text = format!("  a: {{type: Multiplexer, inputs: {{index: 0, in: {wrong}}}}}");
        assert!(!codes(&text, "a.out").is_empty(), "{wrong}");
    }
    let mixed = "  a: {type: Multiplexer, inputs: {index: 0, in: [true, 1.5]}}";
    assert_eq!(codes(mixed, "a.out"), ["RCC1102"]);
}
