//! `Input` from text to plan: types and units inferred from links, expiry, bounds, and the names for clients.

#[allow(dead_code)] // Only its cell is used.
use crate::harness::cell;
use rcc_core::types::{NULL_INT, Store};
use rcc_language::names::Names;
use rcc_language::{Compiled, compile, input_values};

fn net(input: &str, rest: &str) -> Compiled {
    let text = format!(
        "net: n\nperiod: 2 ms\nprimitives:\n  x: {{type: Input{input}}}\n  end: {{type: Termination, inputs: {{done: false}}}}\n{rest}"
    );
    let cell = cell("configs/cells/demo.yaml");
    compile(&text, "n", &cell).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn links_determine_its_type_and_unit() {
    let sink = "  y: {type: AnalogOutput, parameters: {device: io, channel: belt_speed}, inputs: {in: x.value}}\n";
    let names = net("", sink).names;
    let input = &names.inputs[0];
    assert_eq!(
        (input.primitive.as_str(), input.type_name.as_str()),
        ("x", "Real")
    );
    assert_eq!(input.unit.as_deref(), Some("m/s"));
    let sink = "  y: {type: DigitalOutput, parameters: {device: io, channel: lamp}, inputs: {in: x.value}}\n";
    assert_eq!(net("", sink).names.inputs[0].type_name, "Bool");
}

#[test]
fn its_initial_value_determines_type_and_unit() {
    let sink = "  y: {type: Monitor, inputs: {value: x.value}}\n";
    for (initial, ty) in [
        ("{xyz: [0.5, 0, 0.3], rpy: [0, 0, 0]}", "Pose"),
        ("[0 rad, 1 rad, 2 rad]", "Real[3]"),
        ("[true, false]", "Bool[2]"),
        ("7 N", "Real"),
    ] {
        let parameters = format!(", parameters: {{initial: {initial}}}");
        let compiled = net(&parameters, sink);
        assert_eq!(compiled.names.inputs[0].type_name, ty);
        let point = compiled.plan.inputs[0];
        let value = input_values::read(&format!("x: {initial}"), "v", &compiled.names);
        let words = value.map(|values| values[0].words.clone());
        let first = point.slot as usize..(point.slot + point.width) as usize;
        let initial: Vec<u64> = match point.store {
            Store::Real => compiled.plan.reals[first]
                .iter()
                .map(|x| x.to_bits())
                .collect(),
            Store::Bool => compiled.plan.bools[first]
                .iter()
                .map(|x| u64::from(*x))
                .collect(),
            Store::Int => Vec::new(),
        };
        assert_eq!(
            words.ok(),
            Some(initial),
            "what is set is as what is written"
        );
    }
}

#[test]
fn it_expires_after_whole_evaluations_and_keeps_its_bounds() {
    let sink = "  y: {type: Monitor, inputs: {value: x.value}}\n";
    let parameters = ", parameters: {expires: 100 ms, at_least: -1 m, at_most: 2 m}";
    let compiled = net(parameters, sink);
    let point = compiled.plan.inputs[0];
    assert_eq!(point.expires, 50, "every 2 ms");
    assert_eq!(compiled.plan.ints[point.since as usize], NULL_INT);
    assert!(compiled.plan.reals[point.age as usize].is_nan());
    let bound = |slot: Option<u32>| slot.map(|slot| compiled.plan.reals[slot as usize]);
    assert_eq!(
        (bound(point.at_least), bound(point.at_most)),
        (Some(-1.0), Some(2.0))
    );
    let names = &compiled.names.inputs[0];
    assert_eq!(
        (names.at_least.as_slice(), names.at_most.as_slice()),
        (&[-1.0][..], &[2.0][..])
    );
    assert_eq!(names.expires_s, Some(0.1));
    assert_eq!(
        net(", parameters: {expires: 1 us}", sink).plan.inputs[0].expires,
        1
    );
}

#[test]
fn inputs_with_equal_initial_values_share_no_slot() {
    let rest = "  z: {type: Input, parameters: {initial: 1}}\n  y: {type: Monitor, inputs: {value: x.value}}\n  w: {type: Monitor, inputs: {value: z.value}}\n";
    let plan = net(", parameters: {initial: 1}", rest).plan;
    let [x, z] = plan.inputs.as_slice() else {
        panic!("{:?}", plan.inputs)
    };
    assert!(x.slot != z.slot && x.since != z.since && x.age != z.age);
}

#[test]
fn names_with_bounds_of_some_elements_are_read_back_from_json() {
    let sink = "  y: {type: Monitor, inputs: {value: x.value}}\n";
    for ty in ["Real[2]", "Int[2]"] {
        let parameters = format!(", parameters: {{type: '{ty}', at_most: [1, null]}}");
        let names = net(&parameters, sink).names;
        let text = serde_json::to_string(&names).unwrap();
        assert!(text.contains(r#""at_most":[1.0,null]"#), "{text}");
        let read: Names = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&read).unwrap(), text);
        let [one, none] = read.inputs[0].at_most[..] else {
            panic!("{text}");
        };
        assert_eq!((one, none.is_nan()), (1.0, true), "{ty}");
        for (value, is_accepted) in [("[1, 100]", true), ("[2, 0]", false)] {
            let set = input_values::read(&format!("x: {value}"), "v", &read);
            assert_eq!(set.is_ok(), is_accepted, "{ty} {value}");
        }
    }
}

#[test]
fn bounds_apply_to_the_elements_at_their_places() {
    let sink = "  y: {type: Monitor, inputs: {value: x.value}}\n";
    for (bound, value, is_accepted) in [
        ("at_most: [5, 10]", "[null, 7]", true),
        ("at_most: [10, 5]", "[null, 7]", false),
        ("at_most: [null, 5]", "[1, 9]", false),
        ("at_most: [null, 5]", "[7, 3]", true),
        ("at_least: [null, 5]", "[1, 9]", true),
        ("at_least: [null, 5]", "[7, 3]", false),
    ] {
        let free = net(&format!(", parameters: {{type: 'Real[2]', {bound}}}"), sink);
        let set = input_values::read(&format!("x: {value}"), "v", &free.names);
        assert_eq!(set.is_ok(), is_accepted, "{bound}, set {value}");
        let text = format!(
            "net: n\nprimitives:\n  x: {{type: Input, parameters: {{type: 'Real[2]', {bound}, initial: {value}}}}}\n  end: {{type: Termination, inputs: {{done: false}}}}\n{sink}"
        );
        let compiled = compile(&text, "n", &cell("configs/cells/demo.yaml"));
        assert_eq!(compiled.is_ok(), is_accepted, "{bound}, initial {value}");
    }
}
