//! Types, units and initial values that the catalogue leaves open, from the text to the values of a cycle.

use crate::harness::{NetHarness, cell};
use rcc_language::compile;

/// Runs a net of these primitives for the golden cell.
fn run(primitives: &str, discard: &str) -> NetHarness {
    let text = format!(
        "net: example\nprimitives:\n  end: {{type: Termination, inputs: {{done: false}}}}\n{primitives}\ndiscard: [{discard}]\n"
    );
    let cell = cell("tests/nets/cell.yaml");
    let net = compile(&text, "net", &cell).unwrap_or_else(|faults| panic!("{faults}"));
    NetHarness::new(net, &cell, [0.0; 7])
}

/// Returns the inferred unit of an output.
fn unit<'n>(harness: &'n NetHarness, id: &str) -> Option<&'n str> {
    let mut primitives = harness.net.names.primitives.iter();
    let primitive = primitives.find(|primitive| primitive.id == id)?;
    primitive.outputs[0].unit.as_deref()
}

#[test]
fn links_determine_whole_and_real_numbers() {
    let mut harness = run(
        "  ticks: {type: Counter, inputs: {in: true}}
  twice: {type: Multiply, inputs: {a: ticks.out, b: 2}}
  more: {type: Greater, inputs: {a: twice.out, b: 3}}
  half: {type: ToReal, inputs: {in: ticks.out}}
  scaled: {type: Multiply, inputs: {a: half.out, b: 0.5}}
  plain: {type: Add, inputs: {a: 1, b: 2}}",
        "more.out, scaled.out, plain.out",
    );
    harness.step();
    assert_eq!(
        (harness.value("twice.out"), harness.value("more.out")),
        (2.0, 0.0)
    );
    harness.step();
    assert_eq!(
        (harness.value("twice.out"), harness.value("more.out")),
        (4.0, 1.0)
    );
    assert_eq!(
        (harness.value("scaled.out"), harness.value("plain.out")),
        (1.0, 3.0)
    );
    let types = |id: &str| {
        let mut primitives = harness.net.names.primitives.iter();
        let primitive = primitives.find(|primitive| primitive.id == id);
        primitive.map(|primitive| primitive.outputs[0].type_name.clone())
    };
    assert_eq!(types("twice").as_deref(), Some("Int"));
    assert_eq!(types("plain").as_deref(), Some("Real"));
}

#[test]
fn a_state_begins_with_its_initial_value() {
    let mut harness = run(
        "  edge: {type: RisingEdge, inputs: {in: true}}
  first: {type: RisingEdge, parameters: {initial: false}, inputs: {in: true}}
  soft: {type: LowPass, parameters: {gain: 0.5}, inputs: {in: 4}}
  warm: {type: LowPass, parameters: {gain: 0.5, initial: 2}, inputs: {in: 4}}
  hot: {type: LowPass, parameters: {gain: 0.5, initial: null}, inputs: {in: 4}}",
        "edge.out, first.out, soft.out, warm.out, hot.out",
    );
    harness.step();
    assert_eq!(
        (harness.value("edge.out"), harness.value("first.out")),
        (0.0, 1.0)
    );
    let out = ["soft.out", "warm.out", "hot.out"].map(|name| harness.value(name));
    assert_eq!(out, [2.0, 3.0, 4.0]);
}

#[test]
fn units_propagate_through_roots_limits_and_transforms() {
    let harness = run(
        "  ft: {type: ForceTorque, parameters: {device: lwr}}
  square: {type: Multiply, inputs: {a: ft.fx, b: ft.fx}}
  size: {type: SquareRoot, inputs: {in: square.out}}
  soft: {type: LowPass, parameters: {gain: 0.1}, inputs: {in: size.out}}
  bound: {type: Limit, inputs: {in: soft.out, low: 0, high: 20}}
  frame:
    type: TransformFromPosition
    parameters: {rotation: [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}
    inputs: {x: 1 m, y: 2 m, z: 3 m}
  back: {type: Invert, inputs: {in: frame.out}}
  both: {type: Compose, inputs: {a: frame.out, b: back.out}}
  height: {type: Abs, inputs: {in: 'back.out[11]'}}
  axis: {type: Abs, inputs: {in: 'frame.out[1]'}}",
        "ft.fy, ft.fz, ft.tx, ft.ty, ft.tz, bound.out, both.out, height.out, axis.out",
    );
    for (id, want) in [
        ("size", "N"),
        ("bound", "N"),
        ("both", "m"),
        ("height", "m"),
        ("axis", "1"),
    ] {
        assert_eq!(unit(&harness, id), Some(want), "{id}");
    }
}

#[test]
fn a_transform_and_its_inverse_cancel() {
    let mut harness = run(
        "  frame:
    type: TransformFromPosition
    parameters: {rotation: [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}
    inputs: {x: 1 m, y: 2 m, z: 3 m}
  back: {type: Invert, inputs: {in: frame.out}}
  both: {type: Compose, inputs: {a: frame.out, b: back.out}}",
        "both.out",
    );
    harness.step();
    let identity: Vec<f64> = (0..16).map(|i| f64::from(u8::from(i % 5 == 0))).collect();
    assert_eq!(harness.values("both.out"), identity);
    assert_eq!(
        harness.values("back.out")[3..12],
        [-2.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, -3.0]
    );
}

#[test]
fn links_that_carry_the_same_value_share_one_copy() {
    let mut harness = run(
        "  ticks: {type: Counter, inputs: {in: true}}
  a: {type: ToReal, inputs: {in: {from: ticks.out, delayed: true, initial: 0}}}
  b: {type: Negate, inputs: {in: {from: ticks.out, delayed: true, initial: 0}}}
  c: {type: Negate, inputs: {in: {from: ticks.out, delayed: true, initial: 7}}}",
        "a.out, b.out, c.out",
    );
    assert_eq!(harness.net.plan.delays.len(), 2);
    harness.step();
    assert_eq!(
        ["a.out", "b.out", "c.out"].map(|name| harness.value(name)),
        [0.0, 0.0, -7.0]
    );
    harness.step();
    assert_eq!(
        ["a.out", "b.out", "c.out"].map(|name| harness.value(name)),
        [1.0, -1.0, -1.0]
    );
}
