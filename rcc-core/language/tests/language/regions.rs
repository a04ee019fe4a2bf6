//! Regions: inactive primitives are not evaluated, their outputs are null, their states are kept, and the rest of the
//! net is not affected. Runs on a thread of the test harness.

use crate::harness::{NetHarness, cell};
use rcc_core::plan::{NO_REGION, PlanError};
use rcc_language::{Compiled, compile};

fn good(text: &str) -> Compiled {
    compile(text, "net.yaml", &cell("tests/nets/cell.yaml"))
        .unwrap_or_else(|faults| panic!("{faults}"))
}

/// Returns codes and lines of the diagnostics of a text.
fn bad(text: &str) -> Vec<String> {
    let faults = compile(text, "net.yaml", &cell("tests/nets/cell.yaml")).unwrap_err();
    let rows = faults.rows().into_iter();
    rows.map(|row| format!("{} {}", row.code, row.line))
        .collect()
}

/// Runs one cycle with these values of the contact (channel 0 of device 0) and the button (channel 0 of device 1).
fn step(harness: &mut NetHarness, contact: bool, button: bool) {
    harness.inputs[0].measurement.digital = u64::from(contact);
    harness.inputs[1].measurement.digital = u64::from(button);
    harness.step();
}

fn begin(text: &str) -> NetHarness {
    NetHarness::new(good(text), &cell("tests/nets/cell.yaml"), [0.0; 7])
}

const COUNT: &str = "net: count
fragments:
  count:
    inputs: {x: {}, more: {default: true}}
    outputs: {n: counter.out, lamp: both.out}
    primitives:
      both: {type: And, inputs: {a: x, b: more}}
      counter: {type: Counter, inputs: {in: both.out}}
  outer:
    inputs: {x: {}, inner: {}}
    outputs: {n: deep.n, own: counter.out}
    primitives:
      deep: {fragment: count, inputs: {x: x}, active: inner_flag.out}
      inner_flag: {type: And, inputs: {a: inner, b: true}}
      counter: {type: Counter, inputs: {in: x}}
    discard: [deep.lamp]
primitives:
  contact: {type: DigitalInput, parameters: {device: lwr, channel: contact}}
  button: {type: DigitalInput, parameters: {device: io, channel: button}}
  end: {type: Termination, inputs: {done: false}}
";

#[test]
fn an_inactive_region_is_null_and_keeps_its_states() {
    let mut harness = begin(&format!(
        "{COUNT}  a: {{fragment: count, inputs: {{x: button.out}}, active: contact.out}}
  none: {{type: IsNull, inputs: {{in: a.n}}}}
  lamp: {{type: DigitalOutput, parameters: {{device: io, channel: lamp}}, inputs: {{in: a.lamp}}}}
  before: {{type: OrElse, inputs: {{in: {{from: a.n, delayed: true}}, other: -1}}}}
discard: [none.out, before.out]
"
    ));
    let mut seen = Vec::new();
    for (contact, button) in [
        (false, true),
        (true, true),
        (true, true),
        (false, true),
        (false, true),
        (true, false),
        (true, true),
    ] {
        step(&mut harness, contact, button);
        let count = harness.value("a/counter.out");
        let commanded = harness.outputs[1].digital_commanded & 1 == 1;
        seen.push((
            count.is_nan(),
            count,
            harness.value("none.out"),
            harness.value("before.out"),
            commanded,
        ));
    }
    let nothing = f64::NAN;
    let want = [
        (true, nothing, 1.0, -1.0, false),
        (false, 1.0, 0.0, -1.0, true),
        (false, 2.0, 0.0, 1.0, true),
        (true, nothing, 1.0, 2.0, false),
        (true, nothing, 1.0, -1.0, false),
        (false, 2.0, 0.0, -1.0, true),
        (false, 3.0, 0.0, 2.0, true),
    ];
    assert_eq!(format!("{seen:?}"), format!("{want:?}"));
}

#[test]
fn a_nested_region_is_active_only_within_its_parent() {
    // Also if its own condition comes from outside of both.
    for inner in ["inner_flag.out", "inner"] {
        let text = format!(
            "{COUNT}  a: {{fragment: outer, inputs: {{x: true, inner: button.out}}, active: contact.out}}
discard: [a.n, a.own]
"
        );
        let text = text.replace("active: inner_flag.out", &format!("active: {inner}"));
        let text = match inner {
            "inner" => text.replace(
                "      inner_flag: {type: And, inputs: {a: inner, b: true}}\n",
                "",
            ),
            _ => text,
        };
        let mut harness = begin(&text);
        let mut seen = Vec::new();
        for (contact, button) in [(true, true), (true, false), (false, true), (true, true)] {
            step(&mut harness, contact, button);
            seen.push([
                harness.value("a/counter.out"),
                harness.value("a/deep/counter.out"),
            ]);
        }
        let want = "[[1.0, 1.0], [2.0, NaN], [NaN, NaN], [3.0, 2.0]]";
        assert_eq!(format!("{seen:?}"), want, "{inner}");
    }
}

#[test]
fn a_region_may_be_split_by_its_dependencies() {
    // The second half of `a` needs `outside`, which needs the first half.
    let mut harness = begin(
        "net: split
fragments:
  halves:
    inputs: {x: {}, back: {}}
    outputs: {first: first.out, second: second.out}
    primitives:
      first: {type: Add, inputs: {a: x, b: 1}}
      second: {type: Add, inputs: {a: back, b: 1}}
primitives:
  contact: {type: DigitalInput, parameters: {device: lwr, channel: contact}}
  a: {fragment: halves, inputs: {x: 1, back: outside.out}, active: contact.out}
  outside: {type: Multiply, inputs: {a: a.first, b: 10}}
  end: {type: Termination, inputs: {done: false}}
discard: [a.second]
",
    );
    step(&mut harness, true, false);
    assert_eq!(harness.value("a/second.out"), 21.0);
    step(&mut harness, false, false);
    assert!(harness.value("a/second.out").is_nan() && harness.value("outside.out").is_nan());
}

#[test]
fn a_primitive_may_have_a_condition_of_its_own() {
    let mut harness = begin(
        "net: one
primitives:
  contact: {type: DigitalInput, parameters: {device: lwr, channel: contact}}
  counter: {type: Counter, inputs: {in: true}, active: {from: contact.out, delayed: true, initial: true}}
  end: {type: Termination, inputs: {done: false}}
discard: [counter.out]
",
    );
    let mut seen = Vec::new();
    for contact in [false, true, true] {
        step(&mut harness, contact, false);
        seen.push(harness.value("counter.out"));
    }
    assert_eq!(format!("{seen:?}"), "[1.0, NaN, 2.0]");
}

#[test]
fn a_condition_may_be_a_constant() {
    let text = "net: constant
fragments:
  count:
    parameters: {on: {type: Bool}}
    outputs: {n: counter.out}
    primitives: {counter: {type: Counter, inputs: {in: true}, active: $on}}
primitives:
  yes: {fragment: count, parameters: {on: true}}
  no: {fragment: count, parameters: {on: false}}
  end: {type: Termination, inputs: {done: false}}
discard: [yes.n, no.n]
";
    let mut harness = begin(text);
    harness.step();
    assert_eq!(harness.value("yes/counter.out"), 1.0);
    assert!(harness.value("no/counter.out").is_nan());
    assert_eq!(harness.net.plan.regions.len(), 1);
}

#[test]
fn a_net_without_conditions_has_no_regions() {
    let net = good("net: plain\nprimitives:\n  end: {type: Termination, inputs: {done: false}}\n");
    assert!(
        net.plan.blocks.is_empty() && net.plan.regions.is_empty() && net.plan.blanks.is_empty()
    );
}

#[test]
fn conditions_are_part_of_loops() {
    let net = |condition: &str, primitives: &str| {
        bad(&format!(
            "net: loops\nprimitives:\n  a: {{type: Not, inputs: {{in: true}}, active: {condition}}}\n{primitives}  end: {{type: Termination, inputs: {{done: a.out}}}}\n"
        ))
    };
    assert_eq!(net("a.out", ""), ["RCC1405 3"]);
    assert_eq!(
        net("b.out", "  b: {type: Not, inputs: {in: a.out}}\n"),
        ["RCC1405 3"]
    );
    // Once inactive, it would never become active again.
    assert_eq!(
        net("{from: a.out, delayed: true, initial: true}", ""),
        ["RCC1407 3"]
    );
}

#[test]
fn the_plan_check_verifies_regions() {
    let text = format!(
        "{COUNT}  a: {{fragment: outer, inputs: {{x: true, inner: button.out}}, active: contact.out}}\ndiscard: [a.n, a.own]\n"
    );
    let (net, cell) = (good(&text), cell("tests/nets/cell.yaml"));
    let check = |change: &dyn Fn(&mut rcc_protocol::control::PlanData)| {
        let mut plan = net.plan.clone();
        change(&mut plan);
        plan.plan()
            .check(&cell.models(), cell.fingerprint())
            .map(|_| ())
    };
    assert_eq!(check(&|_| ()), Ok(()));
    let far = u32::MAX - 1;
    assert!(matches!(
        check(&|plan| plan.blocks.clear()),
        Err(PlanError::BadRegion { .. })
    ));
    assert!(matches!(
        check(&|plan| plan.blocks[0].runs += 1),
        Err(PlanError::BadBlock { .. })
    ));
    assert!(matches!(
        check(&|plan| plan.blocks[0].region = 1),
        Err(PlanError::BadBlock { .. })
    ));
    assert!(matches!(
        check(&|plan| plan
            .blocks
            .iter_mut()
            .for_each(|block| block.region = NO_REGION)),
        Err(PlanError::BadBlock { .. })
    ));
    for region in 0..2 {
        assert!(matches!(
            check(&|plan| plan.regions[region].condition = far),
            Err(PlanError::BadRegion { .. })
        ));
        assert!(matches!(
            check(&|plan| plan.regions[region].active = far),
            Err(PlanError::BadRegion { .. })
        ));
        assert!(matches!(
            check(&|plan| plan.regions[region].within = far),
            Err(PlanError::BadRegion { .. })
        ));
        assert!(matches!(
            check(&|plan| plan.regions[region].blanks += 1),
            Err(PlanError::BadRegion { .. })
        ));
    }
    assert!(matches!(
        check(&|plan| plan.blanks[0].width = far),
        Err(PlanError::BadBlank { .. })
    ));
    assert!(matches!(
        check(&|plan| plan.blanks[0].width = 0),
        Err(PlanError::BadBlank { .. })
    ));
}
