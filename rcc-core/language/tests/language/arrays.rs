//! Tests of arrays, matrices, windows and tables beyond the worked values of the specs.

use crate::harness::{NetHarness, cell};
use rcc_language::{Compiled, Faults, compile};

fn try_run(primitives: &str, discard: &str) -> Result<Compiled, Faults> {
    let text = format!(
        "net: example\nprimitives:\n  end: {{type: Termination, inputs: {{done: false}}}}\n{primitives}\ndiscard: [{discard}]\n"
    );
    compile(&text, "net", &cell("tests/nets/cell.yaml"))
}

fn run(primitives: &str, discard: &str) -> NetHarness {
    let net = try_run(primitives, discard).unwrap_or_else(|faults| panic!("{faults}"));
    NetHarness::new(net, &cell("tests/nets/cell.yaml"), [0.0; 7])
}

#[test]
fn one_of_several_poses_is_chosen() {
    let mut harness = run(
        "  ticks: {type: Counter, inputs: {in: true}}
  a: {type: Constant, parameters: {value: {xyz: [1, 0, 0], quat: [0, 0, 0, 1]}}}
  b: {type: Invert, inputs: {in: a.out}}
  goal: {type: Multiplexer, inputs: {index: ticks.out, in: [null, a.out, b.out]}}
  x: {type: Abs, inputs: {in: goal.out.x}}",
        "x.out",
    );
    harness.step();
    assert_eq!(
        harness.values("goal.out"),
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    );
    harness.step();
    assert_eq!(harness.values("goal.out")[..1], [-1.0]);
    harness.step();
    assert!(
        harness
            .values("goal.out")
            .iter()
            .all(|value| value.is_nan())
    );
}

#[test]
fn lengths_go_through_matrices() {
    let mut harness = run(
        "  m: {type: Transpose, inputs: {in: [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]}}
  p: {type: MatrixMultiply, inputs: {a: m.out, b: [[1.0, 0.0], [0.0, 2.0]]}}
  v: {type: MatrixApply, inputs: {matrix: p.out, in: [1.0, 1.0]}}
  n: {type: Norm, inputs: {in: v.out}}
  all: {type: Concatenate, inputs: {a: v.out, b: 'v.out[0..2]'}}
  last: {type: Abs, inputs: {in: 'all.out[4]'}}",
        "n.out, last.out",
    );
    harness.step();
    assert_eq!(harness.values("p.out"), [1.0, 8.0, 2.0, 10.0, 3.0, 12.0]);
    assert_eq!(harness.values("v.out"), [9.0, 12.0, 15.0]);
    assert_eq!(harness.values("all.out"), [9.0, 12.0, 15.0, 9.0, 12.0]);
}

#[test]
fn a_window_is_the_fold_of_its_values_for_every_length() {
    for cycles in [1, 2, 3, 5, 8, 13, 100] {
        let mut harness = run(
            &format!(
                "  t: {{type: Time}}
  wave: {{type: Sine, inputs: {{in: angle.out}}}}
  angle: {{type: Multiply, inputs: {{a: t.out, b: 700 rad/s}}}}
  least: {{type: WindowMin, parameters: {{window: {cycles} ms}}, inputs: {{in: wave.out}}}}
  mean: {{type: WindowMean, parameters: {{window: {cycles} ms}}, inputs: {{in: wave.out}}}}"
            ),
            "least.out, mean.out",
        );
        let mut values = Vec::new();
        for _ in 0..250 {
            harness.step();
            values.push(harness.value("wave.out"));
            let window = &values[values.len().saturating_sub(cycles)..];
            let least = window.iter().copied().fold(f64::INFINITY, f64::min);
            assert_eq!(harness.value("least.out"), least, "{cycles}");
            let mean = window.iter().sum::<f64>() / window.len() as f64;
            let have = harness.values("mean.out");
            assert!((have[0] - mean).abs() < 1e-13, "{cycles}: {have:?}");
        }
    }
}

#[test]
fn a_loop_through_last_known_recovers_from_null() {
    let mut harness = run(
        "  last: {type: LastKnown, parameters: {initial: 1.0}, inputs: {in: {from: sum.out, delayed: true, initial: null}}}
  sum: {type: Add, inputs: {a: last.out, b: 1.0}}",
        "",
    );
    harness.step();
    harness.step();
    assert_eq!(harness.value("sum.out"), 3.0);
}

#[test]
fn equations_are_solved_up_to_eight_unknowns() {
    let row = |i: usize| {
        let cells = (0..8).map(|j| format!("{}.0", if i == j { 10 } else { (3 * i + j) % 5 }));
        format!("[{}]", cells.collect::<Vec<_>>().join(", "))
    };
    let matrix: Vec<String> = (0..8).map(row).collect();
    let matrix = matrix.join(", ");
    let mut harness = run(
        &format!(
            "  m: {{type: Constant, parameters: {{value: [{matrix}]}}}}
  x: {{type: Solve, inputs: {{matrix: m.out, in: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]}}}}
  b: {{type: MatrixApply, inputs: {{matrix: m.out, in: x.out}}}}
  i: {{type: Inverse, inputs: {{in: m.out}}}}
  one: {{type: MatrixMultiply, inputs: {{a: i.out, b: m.out}}}}"
        ),
        "b.out, one.out",
    );
    harness.step();
    for (have, want) in harness.values("b.out").iter().zip(1..) {
        assert!((have - f64::from(want)).abs() < 1e-12);
    }
    for (place, value) in harness.values("one.out").iter().enumerate() {
        let want = if place % 9 == 0 { 1.0 } else { 0.0 };
        assert!((value - want).abs() < 1e-12, "{place}: {value}");
    }
}
