//! Properties of every primitive, derived from its spec: no input (null, subnormal or extreme) causes a
//! panic or an allocation; the outputs are null, or finite and in range as the spec says; and whatever was put in, the
//! outputs are known again once the inputs are moderate.

mod generate;
mod harness;

use std::collections::BTreeSet;

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use generate::{OPEN, TestRandom, constant, many, parameters, type_of};
use harness::{NetHarness, cell};
use rcc_config::CellConfig;
use rcc_core::primitive::{MemorySpec, NullRule, PROPAGATES, PortType, Role, Spec, StateSpec};
use rcc_core::primitives::CATALOGUE;
use rcc_core::types::{NULL_INT, Store, Type};
use rcc_language::{Compiled, compile};

#[global_allocator]
static NO_HEAP: AllocDisabler = AllocDisabler;

/// Cycles run for one variant of a primitive.
const CYCLES: usize = 400;
/// Cycles of moderate inputs after which extreme ones have no effect: more than the longest window of the generated nets.
const RECOVERY: usize = 60;
/// Times that extreme inputs are followed by moderate ones.
const ROUNDS: usize = 10;
/// Primitives with inputs that a table of worked values cannot express: a list of links, or three numbers as a vector.
/// They have tests of their own.
const NO_TABLE: [&str; 2] = ["Multiplexer", "Rotate"];
const HOLD: [f64; 7] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4];

/// The kind of inputs.
#[derive(Clone, Copy, PartialEq)]
enum Inputs {
    /// Known, finite, between -8 and 8.
    Moderate,
    /// Any bits that fit into a slot.
    Anything,
}

/// A primitive alone in a net, connected to `Input`s.
fn text(spec: &Spec, open: Type, random: &mut TestRandom) -> Option<String> {
    let mut given = parameters(spec, open, random)?;
    let (mut wires, mut more) = (Vec::new(), String::new());
    for port in spec.inputs {
        if port.name == "conditions" {
            // Made from the legs.
            given = given.replace("blend: 20 mm", "wait: ready.value, until: over.value");
            for name in ["ready", "over"] {
                let initial = constant(Type::Bool, random);
                more.push_str(&format!(
                    "  {name}: {{type: Input, parameters: {{initial: {initial}}}}}\n"
                ));
            }
            continue;
        }
        let mut input = |name: String, ty: Type| {
            let initial = constant(ty, random);
            more.push_str(&format!(
                "  {name}: {{type: Input, parameters: {{initial: {initial}}}}}\n"
            ));
            format!("{name}.value")
        };
        let feed = match many(port.ty) {
            Some(count) => {
                let words = (0..count).map(|n| input(format!("in_{}_{n}", port.name), open));
                format!("[{}]", words.collect::<Vec<_>>().join(", "))
            }
            None => input(format!("in_{}", port.name), type_of(port.ty, open)?),
        };
        wires.push(format!("{}: {feed}", port.name));
    }
    let mut discard: Vec<String> = spec
        .outputs
        .iter()
        .filter(|port| !port.diagnostic || (spec.role == Role::Motion && port.name == "joints"))
        .map(|port| format!("it.{}", port.name))
        .collect();
    // A list of numbers alone is not a Vector3; the reader of the output determines the type.
    if let (Some(split), Some(port)) = (split(open), spec.outputs.iter().find(|p| is_open(p.ty))) {
        more.push_str(&format!(
            "  sink: {{type: {}, inputs: {{in: it.{}}}}}\n",
            split.name, port.name
        ));
        discard.retain(|name| *name != format!("it.{}", port.name));
        let outputs = split.outputs.iter().filter(|port| !port.diagnostic);
        discard.extend(outputs.map(|port| format!("sink.{}", port.name)));
    }
    let end = match spec.role {
        Role::Termination => "",
        _ => "  end: {type: Termination, inputs: {done: false}}\n",
    };
    Some(format!(
        "net: alone\nprimitives:\n  it: {{type: {}, parameters: {given}, inputs: {{{}}}}}\n{more}{end}discard: [{}]\n",
        spec.name,
        wires.join(", "),
        discard.join(", ")
    ))
}

/// Returns a primitive that accepts only values of the type, which links must determine.
fn split(open: Type) -> Option<&'static Spec> {
    let name = match open {
        Type::Vector3 => "SplitVector",
        Type::Twist => "SplitTwist",
        Type::Wrench => "SplitWrench",
        _ => return None,
    };
    Some(&rcc_core::primitives::find(name)?.1.spec)
}

fn is_open(ty: PortType) -> bool {
    matches!(ty, PortType::Any | PortType::Linear | PortType::Of(_))
}

/// Returns all variants of a primitive that compile: one for each open type.
fn variants(spec: &Spec, cell: &CellConfig, random: &mut TestRandom) -> Vec<(String, Compiled)> {
    let mut found = Vec::new();
    let mut texts = BTreeSet::new();
    let mut last = String::new();
    for open in OPEN {
        let Some(text) = text(spec, open, random) else {
            continue;
        };
        match compile(&text, spec.name, cell) {
            Ok(compiled) if texts.insert(text.clone()) => found.push((text, compiled)),
            Ok(_) => {}
            Err(faults) => last = format!("{text}\n{faults}"),
        }
    }
    assert!(
        !found.is_empty(),
        "{}: no net of it compiles\n{last}",
        spec.name
    );
    found
}

fn real(inputs: Inputs, random: &mut TestRandom) -> f64 {
    const SPECIAL: [f64; 12] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        f64::MAX,
        f64::MIN,
        f64::MIN_POSITIVE,
        5e-324,
        f64::EPSILON,
        1e308,
        -1e-308,
        9_223_372_036_854_775_808.0,
    ];
    let value = match (inputs, random.below(4)) {
        (Inputs::Anything, 0) => f64::NAN,
        (Inputs::Anything, 1) => *random.pick(&SPECIAL).expect("special numbers"),
        (Inputs::Anything, 2) => f64::from_bits(random.bits()),
        _ => random.share() * 16.0 - 8.0,
    };
    // A slot of an arena never holds an infinite value.
    if value.is_infinite() { f64::NAN } else { value }
}

fn int(inputs: Inputs, random: &mut TestRandom) -> i64 {
    const SPECIAL: [i64; 6] = [0, -1, 1, i64::MAX, i64::MIN + 1, 1 << 53];
    match (inputs, random.below(4)) {
        (Inputs::Anything, 0) => NULL_INT,
        (Inputs::Anything, 1) => *random.pick(&SPECIAL).expect("special numbers"),
        (Inputs::Anything, 2) => random.bits() as i64,
        _ => random.below(17) as i64 - 8,
    }
}

/// Writes a value to each `Input`. Returns whether all are known, and whether one of them is null as a whole.
fn poke(harness: &mut NetHarness, inputs: Inputs, random: &mut TestRandom) -> (bool, bool) {
    let (mut all_known, mut one_null) = (true, false);
    for index in 0..harness.net.names.primitives.len() {
        let primitive = &harness.net.names.primitives[index];
        if primitive.type_name != "Input" {
            continue;
        }
        let port = primitive.outputs[0].clone();
        let null = inputs == Inputs::Anything && random.once_in(6);
        let rotation = match &*port.type_name {
            "Pose" => Some(3),
            "Rotation" => Some(0),
            _ => None,
        };
        let mut nulls = 0;
        for element in 0..port.width {
            let slot = (port.slot + element) as usize;
            nulls += usize::from(match port.store {
                Store::Bool => {
                    harness.bools[slot] = match inputs {
                        _ if null => 2,
                        Inputs::Anything => random.below(3) as u8,
                        Inputs::Moderate => random.below(2) as u8,
                    };
                    harness.bools[slot] == 2
                }
                Store::Int => {
                    harness.ints[slot] = if null { NULL_INT } else { int(inputs, random) };
                    harness.ints[slot] == NULL_INT
                }
                Store::Real => {
                    // A pose is null as a whole; a known one has a normalised rotation.
                    let whole = rotation.is_some();
                    let value = match whole {
                        true => random.share() * 2.0 - 1.0,
                        false => real(inputs, random),
                    };
                    harness.reals[slot] = if null { f64::NAN } else { value };
                    harness.reals[slot].is_nan()
                }
            });
        }
        if let (Some(first), false) = (rotation, null) {
            let slots = (port.slot as usize + first)..(port.slot as usize + first + 4);
            let length = harness.reals[slots.clone()]
                .iter()
                .map(|x| x * x)
                .sum::<f64>()
                .sqrt();
            harness.reals[slots].iter_mut().for_each(|x| *x /= length);
        }
        all_known &= nulls == 0;
        one_null |= nulls == port.width as usize;
    }
    (all_known, one_null)
}

/// Checks the outputs against the spec for any inputs, and describes a violation.
fn check_outputs(
    spec: &Spec,
    harness: &NetHarness,
    known: bool,
    null: bool,
    inputs: Inputs,
) -> Result<(), String> {
    for port in spec.outputs {
        let values = harness.values(&format!("it.{}", port.name));
        let nulls = values.iter().filter(|value| value.is_nan()).count();
        let said = |what: &str| Err(format!("`{}` {what}: {values:?}", port.name));
        if values.iter().any(|value| value.is_infinite()) {
            return said("is infinite");
        }
        let remembers = spec.state != StateSpec::NONE || spec.memory != MemorySpec::NONE;
        if known && !remembers && spec.undefined.is_empty() && nulls > 0 {
            return said("is null although every input is known");
        }
        if spec.null == PROPAGATES && null && nulls != values.len() {
            return said("is known although an input is null");
        }
        if spec.null_rule == NullRule::Known && spec.undefined.is_empty() && nulls > 0 {
            return said("is null, and the spec says that it never is");
        }
        let is_defined = inputs == Inputs::Moderate && known && spec.undefined.is_empty();
        if is_defined && nulls > 0 {
            return said("is null although every input is known");
        }
        let (least, greatest) = (
            port.least.unwrap_or(f64::NEG_INFINITY),
            port.greatest.unwrap_or(f64::INFINITY),
        );
        let outside = |value: &f64| *value < least || *value > greatest;
        if values.iter().any(outside) {
            return said("is out of its range");
        }
    }
    Ok(())
}

/// Returns true if the outputs of a spec do not follow from its inputs alone, because it reads devices.
fn reads_devices(spec: &Spec) -> bool {
    use rcc_core::primitive::ParameterKind::{Arm, Channel, Device};
    let kinds = spec.parameters.iter().map(|parameter| parameter.kind);
    kinds
        .into_iter()
        .any(|kind| matches!(kind, Arm | Device | Channel(_)))
}

fn run(
    spec: &Spec,
    text: &str,
    net: Compiled,
    cell: &CellConfig,
    inputs: Inputs,
    random: &mut TestRandom,
) {
    let mut harness = NetHarness::new(net, cell, HOLD);
    for cycle in 0..CYCLES {
        let (known, null) = poke(&mut harness, inputs, random);
        let present = inputs == Inputs::Moderate || !random.once_in(5);
        harness
            .inputs
            .iter_mut()
            .for_each(|input| input.present = present);
        assert_no_alloc(|| harness.step());
        if let Err(wrong) = check_outputs(spec, &harness, known && present, null, inputs) {
            panic!(
                "{}, cycle {cycle}: {wrong}\nundefined: {:?}\n{text}",
                spec.name, spec.undefined
            );
        }
    }
}

/// Extreme inputs, then the same moderate ones as a net that never had any others: no output is null that is known there.
fn recover(spec: &Spec, text: &str, net: Compiled, cell: &CellConfig, random: &mut TestRandom) {
    let mut fresh = NetHarness::new(net.clone(), cell, HOLD);
    let mut harness = NetHarness::new(net, cell, HOLD);
    for _ in 0..ROUNDS {
        for _ in 0..CYCLES / ROUNDS {
            poke(&mut harness, Inputs::Anything, random);
            harness.step();
        }
        // An unstable filter overflows again and again; it is known in between.
        let mut known = vec![Vec::new(); spec.outputs.len()];
        for cycle in 0..RECOVERY {
            let mut same = random.clone();
            poke(&mut harness, Inputs::Moderate, random);
            poke(&mut fresh, Inputs::Moderate, &mut same);
            harness.step();
            fresh.step();
            for (port, known) in spec.outputs.iter().zip(&mut known) {
                let [have, want] =
                    [&harness, &fresh].map(|net| net.values(&format!("it.{}", port.name)));
                known.resize(have.len(), false);
                for ((known, have), want) in known.iter_mut().zip(have).zip(want) {
                    *known |= cycle >= RECOVERY / 2 && (!have.is_nan() || want.is_nan());
                }
            }
        }
        for (port, known) in spec.outputs.iter().zip(known) {
            let all = known.iter().all(|known| *known);
            assert!(
                all,
                "{}: `{}` stays null after extreme inputs\n{text}",
                spec.name, port.name
            );
        }
    }
}

fn all(seed: u64, run: impl Fn(&Spec, &str, Compiled, &CellConfig, &mut TestRandom)) {
    let cell = cell("tests/nets/cell.yaml");
    let mut wrong = Vec::new();
    for entry in CATALOGUE {
        // Its value is written from outside, by the test itself.
        if entry.spec.role == Role::Input {
            continue;
        }
        let mut random = TestRandom(seed);
        for (text, net) in variants(&entry.spec, &cell, &mut random) {
            let spec = &entry.spec;
            let one = std::panic::AssertUnwindSafe(|| run(spec, &text, net, &cell, &mut random));
            if std::panic::catch_unwind(one).is_err() {
                wrong.push(spec.name);
                break;
            }
        }
    }
    assert!(wrong.is_empty(), "seed {seed}: {wrong:?}");
}

#[test]
fn moderate_inputs_give_known_finite_outputs_in_their_range() {
    all(1, |spec, text, net, cell, random| {
        run(spec, text, net, cell, Inputs::Moderate, random);
    });
}

#[test]
fn any_input_gives_null_or_a_value_in_range_without_panic_or_heap() {
    for seed in 2..6 {
        all(seed, |spec, text, net, cell, random| {
            run(spec, text, net, cell, Inputs::Anything, random);
        });
    }
}

#[test]
fn no_input_makes_an_output_null_for_ever() {
    for seed in 6..10 {
        all(seed, recover);
    }
}

#[test]
fn every_primitive_without_a_device_has_worked_values() {
    let without = CATALOGUE.iter().map(|entry| &entry.spec).filter(|spec| {
        let plain = matches!(spec.role, Role::Plain | Role::Constant) && !reads_devices(spec);
        plain && spec.examples.is_empty() && !NO_TABLE.contains(&spec.name)
    });
    let without: Vec<&str> = without.map(|spec| spec.name).collect();
    assert!(without.is_empty(), "{without:?}");
}
