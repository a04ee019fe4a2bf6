//! The table of the predecessor's types: every row is complete, the document is current, and what it promises loads.

#[allow(dead_code)] // Nothing runs here.
#[path = "../../language/tests/harness/mod.rs"]
mod harness;

use std::collections::BTreeSet;

use harness::{cell, folder};
use rcc_core::primitive::Spec;
use rcc_core::primitives;
use rcc_directionet::compiler;
use rcc_directionet::document;
use rcc_directionet::table::{self, Counterpart, TypeEntry};
use rcc_directionet::text::{AstArgument, AstFragment, AstPrimitive, AstValue};
use rcc_directionet::values::ForeignType;
use rcc_language::devices::DeviceTable;

/// Types of the predecessor: 304 of its core (168 of them in families), 17 that only its library knows.
const TYPES: usize = 321;

/// Names in the notation that are not primitives.
const WORDS: [&str; 3] = ["List", "At", "Else"];

fn entries() -> Vec<&'static TypeEntry> {
    let mut entries: Vec<&TypeEntry> = table::all().values().collect();
    entries.sort_by_key(|entry| &entry.name);
    entries
}

#[test]
fn every_type_has_a_counterpart_or_a_reason() {
    assert_eq!(table::all().len(), TYPES);
    for entry in entries() {
        match entry.row.to {
            Counterpart::None(_) => {
                assert!(!entry.row.note.is_empty(), "{} has no reason", entry.name)
            }
            Counterpart::Net(_) => assert_eq!(entry.nets.len(), 1, "{}", entry.name),
            Counterpart::By(..) => assert_eq!(entry.nets.len(), 2, "{}", entry.name),
            Counterpart::Special(_) => {}
        }
    }
}

#[test]
fn every_output_has_a_counterpart_or_a_note() {
    for entry in entries() {
        for net in &entry.nets {
            let given: Vec<&str> = net
                .items
                .iter()
                .map(|item| item.name.name.as_str())
                .collect();
            let missing = entry
                .outputs
                .iter()
                .find(|port| !given.contains(&port.name));
            if let Some(port) = missing {
                assert!(
                    !entry.row.note.is_empty(),
                    "{}: nothing gives `{}`",
                    entry.name,
                    port.name
                );
            }
        }
    }
}

/// Describes what is wrong with the net of a row; empty if nothing is.
fn check_row(entry: &TypeEntry, net: &AstFragment) -> Vec<String> {
    let mut wrong = Vec::new();
    for item in &net.items {
        check_primitive(entry, net, &item.primitive, &mut wrong);
        if let (Some(port), primitive) = (&item.port, &item.primitive) {
            check_port(entry, net, primitive, &port.name, &mut wrong);
        }
    }
    wrong
}

fn spec(name: &str) -> Option<&'static Spec> {
    primitives::find(name).map(|(_, entry)| &entry.spec)
}

fn check_primitive(
    entry: &TypeEntry,
    net: &AstFragment,
    primitive: &AstPrimitive,
    wrong: &mut Vec<String>,
) {
    let AstPrimitive::Typed(ty, arguments) = primitive else {
        return;
    };
    for AstArgument { value, .. } in arguments {
        if let AstValue::Link(from, port) = value {
            check_primitive(entry, net, from, wrong);
            check_port(entry, net, from, &port.name, wrong);
        }
    }
    if WORDS.contains(&ty.name.as_str()) {
        return;
    }
    let Some(spec) = spec(&ty.name) else {
        return wrong.push(format!("there is no `{}`", ty.name));
    };
    let given = |name: &str| arguments.iter().any(|argument| argument.name.name == name);
    for port in spec
        .inputs
        .iter()
        .filter(|port| port.default.is_none() && !given(port.name))
    {
        wrong.push(format!("{} is not fed at `{}`", ty.name, port.name));
    }
    for parameter in spec
        .parameters
        .iter()
        .filter(|it| it.default.is_none() && !given(it.name))
    {
        wrong.push(format!("{} has no `{}`", ty.name, parameter.name));
    }
    for AstArgument { name, .. } in arguments {
        let parameter = spec.parameters.iter().any(|it| it.name == name.name);
        if !parameter && spec.input(&name.name).is_none() {
            wrong.push(format!("{} knows no `{}`", ty.name, name.name));
        }
    }
}

fn check_port(
    entry: &TypeEntry,
    net: &AstFragment,
    from: &AstPrimitive,
    port: &str,
    wrong: &mut Vec<String>,
) {
    let ty = match from {
        AstPrimitive::Named(name) if name.name == "parent" => {
            if entry.input(port).is_none() && entry.parameter(port).is_none() {
                wrong.push(format!("it has no `{port}`"));
            }
            return;
        }
        AstPrimitive::Named(name) => {
            let item = net
                .items
                .iter()
                .find(|item| item.name == *name || item.name.name == name.name);
            match item.map(|item| &item.primitive) {
                Some(AstPrimitive::Typed(ty, _)) => ty,
                _ => return wrong.push(format!("the net has no `{}`", name.name)),
            }
        }
        AstPrimitive::Typed(ty, _) => ty,
        AstPrimitive::Fragment(..) => {
            return wrong.push("fragments have no place here".to_string());
        }
    };
    if !WORDS.contains(&ty.name.as_str())
        && spec(&ty.name).is_some_and(|spec| spec.output(port).is_none())
    {
        wrong.push(format!("{} has no output `{port}`", ty.name));
    }
}

#[test]
fn every_row_uses_names_of_the_catalogue() {
    let mut wrong = BTreeSet::new();
    for entry in entries() {
        for net in &entry.nets {
            let found = check_row(entry, net);
            wrong.extend(
                found
                    .into_iter()
                    .map(|it| format!("{}: {it}", entry.row.name)),
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_document_is_current() {
    let path = folder("docs/from-the-predecessor.md");
    let made = document::markdown();
    if std::env::var_os("RCC_BLESS").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    let there = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        there == made,
        "cargo run -p rcc-directionet --example from_the_predecessor > docs/from-the-predecessor.md"
    );
}

/// Pseudo-random numbers from a printed seed.
struct TestRandom(u64);

impl TestRandom {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % bound.max(1)
    }
}

/// Returns a constant of a type in the predecessor's notation.
fn constant(ty: ForeignType, random: &mut TestRandom) -> String {
    let mut number = || format!("{}.{}", random.below(3), random.below(10));
    match ty {
        ForeignType::Bool => ["true", "false"][random.below(2)].to_string(),
        ForeignType::Int => random.below(5).to_string(),
        ForeignType::Vector => format!("{{x:{},y:{},z:{}}}", number(), number(), number()),
        ForeignType::Rotation => format!("{{a:{},b:{},c:{}}}", number(), number(), number()),
        ForeignType::Frame => format!("{{pos:{{x:{}}},rot:{{a:{}}}}}", number(), number()),
        ForeignType::Twist => format!("{{vel:{{x:{}}},rot:{{y:{}}}}}", number(), number()),
        ForeignType::Wrench => format!("{{force:{{x:{}}},torque:{{y:{}}}}}", number(), number()),
        ForeignType::Text => String::new(),
        _ => number(),
    }
}

/// Returns the prefix of the family for a type.
fn family(ty: ForeignType) -> &'static str {
    let row = table::FAMILIES.iter().find(|row| row.1 == ty);
    row.map_or("Core::Double", |row| row.0)
}

/// Generates a net of `count` primitives that the table promises to load.
fn net(count: usize, random: &mut TestRandom) -> String {
    let usable: Vec<&TypeEntry> = entries()
        .into_iter()
        .filter(|entry| {
            let array = entry
                .inputs
                .iter()
                .chain(&entry.outputs)
                .any(|port| port.array);
            let device = entry
                .parameters
                .iter()
                .any(|port| port.ty == ForeignType::Text && port.name != "Key");
            let whole = entry
                .nets
                .iter()
                .all(|net| check_row(entry, net).is_empty());
            !matches!(entry.row.to, Counterpart::None(_)) && !array && !device && whole
        })
        .collect();
    let mut text = String::from("{");
    // Outputs so far, by type: the possible sources of links.
    let mut outputs: Vec<(ForeignType, String)> = Vec::new();
    for number in 0..count {
        let entry = usable[random.below(usable.len())];
        let mut arguments = Vec::new();
        for port in &entry.inputs {
            let optional = !port.required && random.below(3) == 0;
            if optional || ["inReset", "inActive"].contains(&port.name) {
                continue;
            }
            let fitting: Vec<&String> = outputs
                .iter()
                .filter(|(ty, _)| *ty == port.ty)
                .map(|(_, name)| name)
                .collect();
            if fitting.is_empty() || random.below(6) == 0 {
                let value = constant(port.ty, random);
                let ty = if port.ty == ForeignType::Time {
                    "Core::TimeNet".to_string()
                } else {
                    format!("{}Value", family(port.ty))
                };
                let value = if port.ty == ForeignType::Time {
                    String::new()
                } else {
                    format!("Value='{value}'")
                };
                arguments.push(format!("{}={ty}({value}).outValue", port.name));
            } else {
                arguments.push(format!(
                    "{}={}",
                    port.name,
                    fitting[random.below(fitting.len())]
                ));
            }
        }
        for port in &entry.parameters {
            let value = match (port.name, port.ty) {
                ("Key", _) => format!("k{number}"),
                ("Duration" | "MaxAge", _) => "0.05".to_string(),
                ("Age" | "Constant", _) => "0.02".to_string(),
                (_, ty) => constant(ty, random),
            };
            arguments.push(format!("{}='{value}'", port.name));
        }
        text += &format!("p{number}={}({}),", entry.name, arguments.join(","));
        let unread = ["outLastUpdated"];
        for port in entry
            .outputs
            .iter()
            .filter(|port| !unread.contains(&port.name))
        {
            outputs.push((port.ty, format!("p{number}.{}", port.name)));
        }
    }
    text + "no=Core::BooleanValue(Value='false'),outTerminate=no.outValue}"
}

#[test]
fn random_nets_of_the_predecessors_types_load() {
    let cell = cell("tests/nets/cell.yaml");
    for seed in 1..200_u64 {
        let mut random = TestRandom(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let text = net(1 + random.below(60), &mut random);
        if let Err(faults) = compiler(&DeviceTable::from(&cell)).compile(&text, "net") {
            panic!("seed {seed}:\n{text}\n{faults}");
        }
    }
}

#[test]
fn broken_nets_are_refused_with_a_place_and_never_break_the_reader() {
    let cell = cell("tests/nets/cell.yaml");
    for seed in 1..400_u64 {
        let mut random = TestRandom(seed.wrapping_mul(0xd134_2543_de82_ef95));
        let mut bytes = net(1 + random.below(12), &mut random).into_bytes();
        for _ in 0..=random.below(4) {
            let at = random.below(bytes.len());
            match random.below(3) {
                0 => bytes[at] = b"{}()=.,'[]ao1:"[random.below(14)],
                1 => drop(bytes.remove(at)),
                _ => {
                    let end = (at + random.below(40)).min(bytes.len());
                    let part = bytes[at..end].to_vec();
                    let to = random.below(bytes.len());
                    bytes.splice(to..to, part);
                }
            }
        }
        let text = String::from_utf8(bytes).unwrap();
        if let Err(faults) = compiler(&DeviceTable::from(&cell)).compile(&text, "net") {
            for fault in &faults.diagnostics {
                let placed = fault
                    .place
                    .is_some_and(|place| text.get(place.start..place.end).is_some());
                let whole = fault.place.is_none();
                assert!(placed || whole, "seed {seed}: {fault:?}\n{text}");
            }
        }
    }
}
