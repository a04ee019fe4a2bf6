//! A net written as text reads back as the same net: example nets and generated nets. Spans differ, so they are
//! excluded from the comparison.

use std::fs;
use std::path::Path;

use proptest::prelude::*;
use rcc_config::diagnostic::Span;
use rcc_config::yaml::{self, Key, ShortText};
use rcc_core::printable::first_unprintable;
use rcc_core::types::Type;
use rcc_core::unit::Unit;
use rcc_language::syntax::fragment::{Fragment, FragmentInput, FragmentOutput, FragmentParameter};
use rcc_language::syntax::literal::{Literal, LiteralShape};
use rcc_language::syntax::reference::Reference;
use rcc_language::syntax::{Link, Net, Primitive, PrimitiveKind, Source, Timing};
use rcc_language::{parse, write};

/// Reads a text without syntax errors.
fn read(text: &str) -> Option<Net> {
    let mut faults = Vec::new();
    let net = parse::read_net(&yaml::parse(text).ok()?, &mut faults);
    net.filter(|_| faults.is_empty())
}

/// Returns the whole model except for the spans.
fn said(net: &Net) -> String {
    let text = format!("{net:?}");
    let mut parts = text.split("Span { ");
    let mut said = parts.next().unwrap_or_default().to_string();
    for part in parts {
        said.push_str(part.split_once('}').map_or("", |(_, rest)| rest));
    }
    said
}

fn nets() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut nets = Vec::new();
    for folder in ["configs/nets", "tests/nets/ok", "tests/nets/bad"] {
        let Ok(files) = fs::read_dir(root.join(folder)) else {
            continue;
        };
        for file in files {
            let path = file.unwrap().path();
            if path.extension().is_some_and(|end| end == "yaml") {
                let text = fs::read_to_string(&path).unwrap();
                nets.push((path.display().to_string(), text));
            }
        }
    }
    assert!(nets.len() > 50);
    nets
}

fn holds(net: &Net, name: &str) {
    let text = write::yaml(net);
    let again = read(&text).unwrap_or_else(|| panic!("{name} does not read back:\n{text}"));
    assert_eq!(said(&again), said(net), "{name}\n{text}");
    assert_eq!(write::yaml(&again), text, "{name}");
    let json = write::json(net);
    serde_json::from_str::<serde_json::Value>(&json).unwrap();
    let again = read(&json).unwrap_or_else(|| panic!("{name} does not read back:\n{json}"));
    assert_eq!(said(&again), said(net), "{name}\n{json}");
}

#[test]
fn the_example_nets_are_written_as_they_were_read() {
    let mut read_well = 0;
    for (name, text) in nets() {
        if let Some(net) = read(&text) {
            holds(&net, &name);
            read_well += 1;
        }
    }
    assert!(read_well > 40, "{read_well}");
}

#[test]
fn the_notation_of_constants_is_kept() {
    let text = "net: a
description: What it does.
on_device_loss: null
period: 5 ms
phase: 0.001 s
use: [library/filters.yaml]
fragments:
  smooth:
    description: What it does.
    parameters: {gain: {type: Real, unit: 1, default: 0.2}, size: {type: 'Real[7]'}}
    inputs: {x: {unit: m/s, default: 20 mm/s, description: what is smoothed}, free: {}}
    outputs: {y: filter.out, z: {from: 'filter.out[0]', description: the first one}}
    primitives:
      filter: {type: Filter, parameters: {gain: $gain, all: [$gain, 1.0, 2]}, inputs: {in: x}, active: free}
primitives:
  short:     {type: Constant, parameters: {value: deg(30)}}
  list:      {type: Constant, parameters: {value: [1, 2.0, 20 mm, -deg(5)]}}
  pose:      {type: Constant, parameters: {value: {xyz: [0.1, 20 mm, 3], rpy: [deg(180), 0, 0]}}}
  delayed:   {type: Add, inputs: {a: {from: short.out, delayed: true, initial: 0.5 rad}, b: 'list.out[3]'}}
  nothing:   {type: Add, inputs: {a: null, b: 1e-9}}
  fragment:  {fragment: smooth, parameters: {gain: 0.5}, inputs: {x: short.out}, active: nothing.out}
  long_name: {type: Text, parameters: {text: 'a, b'}}
discard: [short.out, 'list.out[3]']
";
    let net = read(text).unwrap();
    assert_eq!(write::yaml(&net), text);
}

#[test]
fn long_entries_are_written_on_several_lines() {
    let numbers = (0..60).map(|n| format!("{n}.5")).collect::<Vec<_>>();
    let words = "word ".repeat(60);
    let text = format!(
        "net: a\ndescription: {}\nprimitives: {{x: {{type: Constant, parameters: {{value: [{}]}}}}}}",
        words.trim(),
        numbers.join(", ")
    );
    let written = write::yaml(&read(&text).unwrap());
    assert!(written.lines().all(|line| line.len() <= 120), "{written}");
    assert!(written.contains("description: >-\n  word"), "{written}");
    assert!(
        written.contains("  x:\n    type: Constant\n    parameters:\n      value: [0.5, "),
        "{written}"
    );
    holds(&read(&text).unwrap(), "long");
}

fn key() -> impl Strategy<Value = Key> {
    "[a-z][a-z0-9_]{0,12}".prop_map(|name| Key {
        name: name.into(),
        span: Span::default(),
    })
}

fn any_text() -> impl Strategy<Value = String> {
    prop_oneof![
        "[a-zA-Z_ .,:#'\"-]{0,40}",
        "\\PC{0,60}".prop_filter("printable", |text| first_unprintable(text).is_none()),
        "([a-z ]{0,30}\n){0,4}[a-z]{0,4}",
        proptest::collection::vec("[a-z]{1,9}", 0..60).prop_map(|words| words.join(" ")),
    ]
}

fn number() -> impl Strategy<Value = LiteralShape> {
    let finite = any::<u64>()
        .prop_map(f64::from_bits)
        .prop_filter("finite", |x| x.is_finite());
    let unit = prop_oneof![
        Just(None),
        Just(Some(Unit::ONE)),
        Just(Some(Unit::NEWTON_METRE)),
        proptest::array::uniform6(-3_i8..4).prop_map(|exponents| Some(Unit { exponents })),
    ];
    prop_oneof![
        any::<i64>()
            .prop_filter("null", |x| *x != i64::MIN)
            .prop_map(LiteralShape::Int),
        (finite, unit).prop_map(|(value, unit)| LiteralShape::Real(value, unit)),
    ]
}

fn shape() -> impl Strategy<Value = LiteralShape> {
    let of = |shapes: Vec<LiteralShape>| {
        let literals = shapes
            .into_iter()
            .map(|shape| Literal::new(shape, Span::default()));
        LiteralShape::List(literals.collect())
    };
    let turn = (-1.0..1.0, -1.0..1.0, -1.0..1.0, 0.1..1.0).prop_map(
        |(x, y, z, w): (f64, f64, f64, f64)| {
            let length = (x * x + y * y + z * z + w * w).sqrt();
            [x / length, y / length, z / length, w / length]
        },
    );
    let place = proptest::array::uniform3(-1e3..1e3);
    prop_oneof![
        number(),
        Just(LiteralShape::Null),
        any::<bool>().prop_map(LiteralShape::Bool),
        "[a-zA-Z][a-z_/ ,']{0,20}".prop_map(LiteralShape::Text),
        turn.clone().prop_map(LiteralShape::Rotation),
        (place, turn)
            .prop_map(|([x, y, z], [a, b, c, d])| LiteralShape::Pose([x, y, z, a, b, c, d])),
        proptest::collection::vec(number(), 1..40).prop_map(of),
        proptest::collection::vec(any::<bool>().prop_map(LiteralShape::Bool), 1..9).prop_map(of),
        proptest::collection::vec(proptest::collection::vec(number(), 3), 1..4)
            .prop_map(move |rows| of(rows.into_iter().map(of).collect())),
    ]
}

fn literal() -> impl Strategy<Value = Literal> {
    shape().prop_map(|shape| Literal::new(shape, Span::default()))
}

fn reference() -> impl Strategy<Value = Reference> {
    (key(), key(), proptest::option::of(any::<u32>())).prop_map(|(primitive, port, index)| {
        let text = match index {
            Some(index) => format!("{}.{}[{index}]", primitive.name, port.name),
            None => format!("{}.{}", primitive.name, port.name),
        };
        let root = yaml::parse(&format!("x: '{text}'")).unwrap();
        parse::reference::read(root.get("x").unwrap(), &text, &mut Vec::new()).unwrap()
    })
}

fn source() -> impl Strategy<Value = Source> {
    let link = (reference(), any::<bool>(), proptest::option::of(literal()));
    prop_oneof![
        link.prop_map(|(from, delayed, initial)| Source::Link(Link {
            from,
            delayed,
            initial: initial.filter(|_| delayed).map(Box::new),
            span: Span::default(),
        })),
        // Text in the place of a link would be read as a link.
        literal()
            .prop_filter("text", |literal| !matches!(
                literal.shape,
                LiteralShape::Text(_)
            ))
            .prop_map(Source::Literal),
    ]
}

fn primitives() -> impl Strategy<Value = Vec<Primitive>> {
    let parameters = proptest::collection::vec((key(), literal()), 0..5);
    let inputs = proptest::collection::vec((key(), source()), 0..5);
    let active = proptest::option::of(source());
    let primitive = (key(), any::<bool>(), key(), parameters, inputs, active);
    let primitive =
        primitive.prop_map(
            |(id, is_type, type_name, parameters, inputs, active)| Primitive {
                id,
                kind: if is_type {
                    PrimitiveKind::Type
                } else {
                    PrimitiveKind::Fragment
                },
                type_name,
                parameters: unique(parameters, |(key, _)| &key.name),
                inputs: unique(inputs, |(key, _)| &key.name),
                active,
            },
        );
    let primitives = proptest::collection::vec(primitive, 0..5);
    primitives.prop_map(|primitives| unique(primitives, |primitive| &primitive.id.name))
}

fn fragment() -> impl Strategy<Value = Fragment> {
    let ty = prop_oneof![
        Just(None),
        Just(Some((Type::Pose, Span::default()))),
        Just(Some((Type::Matrix(3, 4), Span::default()))),
    ];
    let unit = prop_oneof![
        Just(None),
        Just(Some((Unit::ONE, Span::default()))),
        Just(Some((Unit::NEWTON_METRE, Span::default()))),
    ];
    let port = (key(), any_text(), ty, unit, proptest::option::of(literal()));
    let ports =
        proptest::collection::vec(port, 0..4).prop_map(|ports| unique(ports, |port| &port.0.name));
    let outputs = proptest::collection::vec((key(), any_text(), reference()), 0..4);
    let discard = proptest::collection::vec(reference(), 0..4);
    (key(), any_text(), ports, outputs, primitives(), discard).prop_map(
        |(name, description, ports, outputs, primitives, discard)| {
            let parameter =
                |(name, description, ty, unit, default): (_, _, _, _, _)| FragmentParameter {
                    name,
                    description,
                    ty,
                    unit,
                    default,
                };
            let input = |(name, description, ty, unit, default): (_, _, _, _, _)| FragmentInput {
                name,
                description,
                ty,
                unit,
                default,
            };
            let output = |(name, description, from): (_, _, _)| FragmentOutput {
                name,
                description,
                from,
            };
            Fragment {
                name,
                description,
                parameters: ports.clone().into_iter().map(parameter).collect(),
                inputs: ports.into_iter().map(input).collect(),
                outputs: unique(outputs, |(name, _, _)| &name.name)
                    .into_iter()
                    .map(output)
                    .collect(),
                primitives,
                discard,
                span: Span::default(),
            }
        },
    )
}

fn net() -> impl Strategy<Value = Net> {
    let timing = (
        proptest::option::of(literal()),
        proptest::option::of(literal()),
    );
    let timing = timing.prop_map(|(period, phase)| Timing {
        period,
        rate: None,
        phase,
    });
    let uses = proptest::collection::vec(any_text(), 0..3);
    let fragments = proptest::collection::vec(fragment(), 0..3);
    let discard = proptest::collection::vec(reference(), 0..30);
    let rest = (timing, uses, fragments, primitives(), discard);
    (key(), any_text(), any::<bool>(), rest).prop_map(
        |(name, description, survives_device_loss, rest)| {
            let (timing, uses, fragments, primitives, discard) = rest;
            let path = |name: String| Key {
                name: name.into(),
                span: Span::default(),
            };
            Net {
                name: Key {
                    name: name.name.replace('_', "-").into(),
                    ..name
                },
                description,
                survives_device_loss,
                timing,
                uses: uses.into_iter().map(path).collect(),
                fragments: unique(fragments, |fragment| &fragment.name.name),
                primitives,
                discard,
            }
        },
    )
}

#[test]
fn a_library_is_written_as_it_was_read() {
    let text = "library: filters
description: What they do.
use: [other.yaml]
fragments:
  smooth:
    inputs: {x: {}}
    outputs: {y: filter.out}
    primitives:
      filter: {type: Abs, inputs: {in: x}}
    discard: [filter.other]
";
    let mut faults = Vec::new();
    let library = parse::read_library(&yaml::parse(text).unwrap(), &mut faults).unwrap();
    assert_eq!(
        (faults, write::library(&library)),
        (Vec::new(), text.to_string())
    );
}

fn unique<T>(values: Vec<T>, name: impl Fn(&T) -> &ShortText) -> Vec<T> {
    let mut seen = std::collections::HashSet::new();
    let mut kept = Vec::new();
    for value in values {
        if seen.insert(name(&value).clone()) {
            kept.push(value);
        }
    }
    kept
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn any_net_is_written_so_that_it_reads_back(net in net()) {
        holds(&net, "made up");
    }
}
