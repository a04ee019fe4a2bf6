//! Named outcomes of a `Termination`: the first one that is true, in the order of the text, ends the net. Runs on a
//! thread of the test harness.

use crate::harness::{NetHarness, cell};
use rcc_language::{Compiled, compile, parse, write};

fn good(text: &str) -> Compiled {
    compile(text, "net.yaml", &cell("tests/nets/cell.yaml"))
        .unwrap_or_else(|faults| panic!("{faults}"))
}

/// Returns code, line and message of each diagnostic of a text.
fn bad(text: &str) -> Vec<String> {
    let Err(faults) = compile(text, "net.yaml", &cell("tests/nets/cell.yaml")) else {
        panic!("it is valid:\n{text}");
    };
    let rows = faults.rows().into_iter();
    rows.map(|row| format!("{} {} {}", row.code, row.line, row.message))
        .collect()
}

/// A net that ends by a contact or by a button.
fn net(done: &str) -> String {
    format!(
        "net: outcomes
primitives:
  contact: {{type: DigitalInput, parameters: {{device: lwr, channel: contact}}}}
  button: {{type: DigitalInput, parameters: {{device: io, channel: button}}}}
  end: {{type: Termination, inputs: {{done: {done}}}}}
"
    )
}

/// Runs one cycle with these values; returns the name of the outcome, if the net ended.
fn outcome(harness: &mut NetHarness, contact: bool, button: bool) -> Option<String> {
    harness.inputs[0].measurement.digital = u64::from(contact);
    harness.inputs[1].measurement.digital = u64::from(button);
    harness.step();
    let number = harness.terminated.then_some(harness.outcome + 1)?;
    harness.net.names.outcome(number).map(str::to_owned)
}

fn begin(text: &str) -> NetHarness {
    NetHarness::new(good(text), &cell("tests/nets/cell.yaml"), [0.0; 7])
}

#[test]
fn the_first_true_condition_in_the_order_of_the_text_is_the_outcome() {
    for (done, both) in [
        ("{touched: contact.out, pressed: button.out}", "touched"),
        ("{pressed: button.out, touched: contact.out}", "pressed"),
    ] {
        for (contact, button, wanted) in [
            (true, false, Some("touched")),
            (false, true, Some("pressed")),
            (true, true, Some(both)),
        ] {
            let mut harness = begin(&net(done));
            assert_eq!(outcome(&mut harness, false, false), None, "{done}");
            assert!(!harness.terminated, "{done}");
            let found = outcome(&mut harness, contact, button);
            assert_eq!(found.as_deref(), wanted, "{done}");
        }
    }
}

#[test]
fn one_condition_needs_no_name() {
    for done in [
        "button.out",
        "{from: button.out, delayed: true, initial: false}",
    ] {
        let mut harness =
            begin(&net(done).replace("primitives:", "discard: [contact.out]\nprimitives:"));
        assert!(harness.net.names.outcomes.is_empty());
        harness.inputs[1].measurement.digital = 1;
        (0..2).for_each(|_| harness.step());
        assert!(harness.terminated, "{done}");
    }
}

#[test]
fn a_condition_is_a_link_a_delayed_link_or_a_constant_and_null_does_not_end_the_net() {
    let mut harness = begin(&net(
        "{never: false, unknown: null, later: {from: contact.out, delayed: true, initial: false}, now: button.out}",
    ));
    assert_eq!(
        harness.net.names.outcomes,
        ["never", "unknown", "later", "now"]
    );
    assert_eq!(outcome(&mut harness, true, false), None);
    assert_eq!(outcome(&mut harness, false, true).as_deref(), Some("later"));
}

#[test]
fn every_outcome_is_an_input_that_can_be_watched() {
    let net = good(&net("{touched: contact.out, pressed: button.out}"));
    let end = net.names.primitives.iter().find(|one| one.id == "end");
    let inputs = end.expect("it is there").inputs.iter();
    let inputs: Vec<(&str, Option<&str>)> = inputs
        .map(|port| (&*port.name, port.source.as_deref()))
        .collect();
    let wanted = [
        ("touched", Some("contact.out")),
        ("pressed", Some("button.out")),
    ];
    assert_eq!(inputs, wanted);
}

#[test]
fn fragments_and_json_have_outcomes() {
    let text = "net: outcomes
fragments:
  ending:
    inputs: {a: {}, b: {}}
    primitives:
      end: {type: Termination, inputs: {done: {touched: a, pressed: b}}}
  given:
    inputs: {done: {}}
    primitives:
      end: {type: Termination, inputs: {done: done}}
primitives:
  contact: {type: DigitalInput, parameters: {device: lwr, channel: contact}}
  button: {type: DigitalInput, parameters: {device: io, channel: button}}
";
    for instance in [
        "  last: {fragment: ending, inputs: {a: contact.out, b: button.out}}\n",
        "  last: {fragment: given, inputs: {done: {touched: contact.out, pressed: button.out}}}\n",
    ] {
        let used = text.to_owned() + instance;
        let cell = cell("tests/nets/cell.yaml");
        let mut diagnostics = Vec::new();
        let devices = rcc_language::devices::DeviceTable::from(&cell);
        let tree = parse::parse(&used, "net.yaml", &devices, &[], &mut diagnostics);
        let tree = tree.expect("it is valid");
        for form in [used.clone(), write::yaml(&tree), write::json(&tree)] {
            let compiled = compile(&form, "net.yaml", &cell);
            let unused = if instance.contains("ending") {
                "given"
            } else {
                "ending"
            };
            let compiled = compiled.unwrap_or_else(|faults| panic!("{faults}\n{unused}"));
            let mut harness = NetHarness::new(compiled, &cell, [0.0; 7]);
            let found = outcome(&mut harness, false, true);
            assert_eq!(found.as_deref(), Some("pressed"), "{form}");
        }
    }
}

#[test]
fn what_is_no_outcome_is_refused_with_its_place() {
    for (done, wanted) in [
        (
            "{Touched: contact.out, pressed: button.out}",
            "RCC1104 5 `Touched`",
        ),
        (
            "{touched: [contact.out, button.out]}",
            "RCC1102 5 the outcome `touched`",
        ),
        (
            "{touched: contact.outt, pressed: button.out}",
            "RCC1203 5 output not found",
        ),
        (
            "{touched: 1 N, pressed: button.out, other: contact.out}",
            "RCC1303 5 type mismatch: `end.touched`",
        ),
    ] {
        let found = bad(&net(done));
        assert!(found[0].starts_with(wanted), "{done}: {found:?}");
    }
    let found = bad(&net("{}"));
    assert!(
        found.iter().any(|row| row.starts_with("RCC1102 5")),
        "{found:?}"
    );
    let real = net("{touched: time.out, other: contact.out, third: button.out}")
        .replace("primitives:\n", "primitives:\n  time: {type: Time}\n");
    let found = bad(&real);
    assert!(
        found
            .iter()
            .any(|row| row.contains("`end.touched` expects Bool")),
        "{found:?}"
    );
    // Only a Termination has outcomes.
    let other = net("not.out").replace(
        "primitives:\n",
        "primitives:\n  not: {type: Not, inputs: {in: {a: contact.out, b: button.out}}}\n",
    );
    let found = bad(&other);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(
        found[0].contains("cannot be connected to a mapping"),
        "{found:?}"
    );
    let many: Vec<String> = (0..33)
        .map(|number| format!("o{number}: contact.out"))
        .collect();
    let found = bad(&net(&format!("{{{}, last: button.out}}", many.join(", "))));
    assert!(found[0].contains("34 outcomes, at most 32"), "{found:?}");
}
