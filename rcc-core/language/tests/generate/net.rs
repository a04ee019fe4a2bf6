//! Random nets, valid by construction: every input is connected to an earlier output of its type and unit, to an output
//! of the previous cycle, or to a constant.

use std::collections::HashMap;
use std::fmt::Write as _;

use rcc_core::primitive::{
    CatalogueEntry, Dim, ParameterKind, Port, PortType, Role, Spec, UnitRule,
};
use rcc_core::primitives::CATALOGUE;
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use super::{OPEN, TestRandom, constant, many, parameters, type_of};

/// A random net.
#[derive(Debug)]
pub struct RandomNet {
    /// Its text.
    pub text: String,
    /// Number of primitives.
    #[allow(dead_code)] // Not every test counts.
    pub primitives: usize,
}

/// An output that can be read.
struct AvailableOutput {
    name: String,
    unit: Unit,
    read: bool,
    constant: bool,
}

#[derive(Default)]
struct NetUnderConstruction {
    text: String,
    sources: Vec<AvailableOutput>,
    /// Indices of the sources, by type.
    of_type: HashMap<Type, Vec<usize>>,
    discard: Vec<String>,
    count: usize,
    outside: usize,
}

/// Generates a net of about `size` primitives, determined by the seed.
pub fn random_net(size: usize, seed: u64) -> RandomNet {
    let mut random = TestRandom(seed);
    let entries: Vec<&CatalogueEntry> = CATALOGUE.iter().copied().filter(|e| grows(e)).collect();
    let mut net = NetUnderConstruction::default();
    while net.count < size {
        // Inputs first, then whatever can be connected.
        let entry = match random.pick(&entries) {
            Some(entry) => entry,
            None => break,
        };
        net.add(entry, &mut random);
    }
    let discard = net.sources.iter().filter(|source| !source.read);
    let mut discard: Vec<&str> = discard.map(|source| source.name.as_str()).collect();
    discard.extend(net.discard.iter().map(String::as_str));
    let text = format!(
        "net: random\nprimitives:\n{}  end: {{type: Termination, inputs: {{done: false}}}}\ndiscard: [{}]\n",
        net.text,
        discard.join(", ")
    );
    RandomNet {
        text,
        primitives: net.count + 1,
    }
}

/// Returns true for primitives that may occur any number of times.
fn grows(entry: &CatalogueEntry) -> bool {
    let spec = &entry.spec;
    let devices = spec.parameters.iter().any(|parameter| {
        let kind = parameter.kind;
        matches!(
            kind,
            ParameterKind::Arm | ParameterKind::Device | ParameterKind::Channel(_)
        )
    });
    let role = matches!(
        spec.role,
        Role::Plain | Role::Monitor | Role::Constant | Role::Input | Role::Publish
    );
    // Two lists of numbers do not determine the length of each.
    let sum = |port: &Port| matches!(port.ty, PortType::Array(_, Dim::Sum(..)));
    let sums = spec.inputs.iter().chain(spec.outputs).any(sum);
    role && !sums && (!devices || spec.outputs.len() < 4)
}

/// Returns true for primitives of which a net may have only a few.
fn goes_outside(spec: &Spec) -> bool {
    let mut kinds = spec.parameters.iter().map(|parameter| parameter.kind);
    spec.role == Role::Monitor || kinds.any(|kind| kind == ParameterKind::Topic)
}

/// Returns true if the types that the ports allow can also be computed.
fn has_kernel(entry: &CatalogueEntry, open: Type) -> bool {
    let mut stores = entry.kernels.iter().map(|kernel| kernel.store);
    entry.kernels.is_empty() || stores.any(|store| store.is_none() || store == open.store())
}

impl NetUnderConstruction {
    fn add(&mut self, entry: &CatalogueEntry, random: &mut TestRandom) {
        let spec = &entry.spec;
        if goes_outside(spec) && (self.outside >= 20 || !random.once_in(8)) {
            return;
        }
        let ports = || spec.inputs.iter().chain(spec.outputs);
        let possible: Vec<Type> = OPEN
            .into_iter()
            .filter(|open| ports().all(|port| port.ty.admits(*open)))
            .filter(|open| has_kernel(entry, *open))
            .collect();
        let Some(open) = random.pick(&possible).copied() else {
            return;
        };
        let Some(given) = parameters(spec, open, random) else {
            return;
        };
        let mut linked = LinkedInputs {
            delays: spec.role != Role::Monitor,
            ..LinkedInputs::default()
        };
        let mut wires = Vec::new();
        for port in spec.inputs {
            if port.default.is_some() && random.once_in(2) {
                continue;
            }
            let Some(feed) = self.feed(port, open, &mut linked, random) else {
                return;
            };
            wires.push(format!("{}: {feed}", port.name));
        }
        // Whole numbers and lists of numbers could have several types.
        if ports().any(|port| port.ty.is_open()) && !says_itself(open) && !linked.open_link {
            return;
        }
        // A number in rad has no root.
        let rooted = ports().filter_map(|port| match port.unit {
            UnitRule::Root(variable) => Some(linked.units.get(&variable)?.root().is_some()),
            _ => None,
        });
        if rooted.into_iter().any(|possible| !possible) {
            return;
        }
        for number in &linked.read {
            self.sources[*number].read = true;
        }
        let units = linked.units;
        let id = format!("p{}", self.count);
        writeln!(
            self.text,
            "  {id}: {{type: {}, parameters: {given}, inputs: {{{}}}}}",
            spec.name,
            wires.join(", ")
        )
        .expect("memory");
        self.count += 1;
        self.outside += usize::from(goes_outside(spec));
        for port in spec.outputs {
            let name = format!("{id}.{}", port.name);
            match (type_of(port.ty, open), unit_of(port.unit, &units)) {
                (Some(ty), Some(unit)) => {
                    let sources = &mut self.sources;
                    self.of_type.entry(ty).or_default().push(sources.len());
                    sources.push(AvailableOutput {
                        name,
                        unit,
                        read: port.diagnostic,
                        constant: spec.role == Role::Constant,
                    });
                }
                _ if port.diagnostic => {}
                _ => self.discard.push(name),
            }
        }
    }

    /// Returns a source for an input, and records the units that it determines.
    fn feed(
        &self,
        port: &Port,
        open: Type,
        linked: &mut LinkedInputs,
        random: &mut TestRandom,
    ) -> Option<String> {
        if let Some(count) = many(port.ty) {
            let one = |_| self.one(open, port, linked, random);
            let words: Vec<String> = (0..count).map(one).collect();
            // Poses, and lists within a list, are given by links.
            let constant = |word: &String| {
                word.starts_with("{xyz") || word.starts_with("{rpy") || word.starts_with('[')
            };
            // A list of nulls has no type.
            if words.iter().any(constant) || words.iter().all(|word| word == "null") {
                return None;
            }
            return Some(format!("[{}]", words.join(", ")));
        }
        Some(self.one(type_of(port.ty, open)?, port, linked, random))
    }

    fn one(
        &self,
        ty: Type,
        port: &Port,
        linked: &mut LinkedInputs,
        random: &mut TestRandom,
    ) -> String {
        let known = self.of_type.get(&ty).map(Vec::as_slice).unwrap_or_default();
        for _ in 0..8 {
            let Some(number) = random.pick(known).copied() else {
                break;
            };
            let source = &self.sources[number];
            // A constant must be within the range of the port.
            if (source.constant && port.least.is_some()) || !linked.fits(port.unit, source.unit) {
                continue;
            }
            linked.read.push(number);
            linked.open_link |= port.ty.is_open() && port.ty != PortType::Part;
            let initial = constant(ty, random);
            return match linked.delays && random.once_in(10) {
                false => source.name.clone(),
                true => format!(
                    "{{from: {}, delayed: true, initial: {initial}}}",
                    source.name
                ),
            };
        }
        // A bare number takes the unit of its port; otherwise it has none.
        linked.fits(port.unit, Unit::ONE);
        match (port.least, port.greatest) {
            (Some(least), Some(greatest)) => {
                (least + random.share() * (greatest - least)).to_string()
            }
            _ => constant(ty, random),
        }
    }
}

/// Units and sources chosen for the inputs of a primitive so far.
#[derive(Default)]
struct LinkedInputs {
    units: HashMap<u8, Unit>,
    read: Vec<usize>,
    /// True except for a monitor, which cannot read delayed links.
    delays: bool,
    /// True once a link has determined the open type.
    open_link: bool,
}

impl LinkedInputs {
    /// Returns true if a value of this unit can be connected to a port, and determines the unit variables of the port.
    fn fits(&mut self, rule: UnitRule, unit: Unit) -> bool {
        match rule {
            UnitRule::Is(wanted) => wanted == unit,
            UnitRule::Joint(order) => Unit::of_joints(false, order) == unit,
            UnitRule::Var(variable) => *self.units.entry(variable).or_insert(unit) == unit,
            UnitRule::Typed => true,
            _ => false,
        }
    }
}

/// Returns true if every constant of the type has no other type.
fn says_itself(ty: Type) -> bool {
    matches!(ty, Type::Real | Type::Bool | Type::Pose | Type::Rotation)
}

/// Returns the unit of an output; `None` if it cannot be inferred.
fn unit_of(rule: UnitRule, units: &HashMap<u8, Unit>) -> Option<Unit> {
    let of = |variable: u8| units.get(&variable).copied().unwrap_or(Unit::ONE);
    match rule {
        UnitRule::Is(unit) => Some(unit),
        UnitRule::Joint(order) => Some(Unit::of_joints(false, order)),
        UnitRule::Typed => Some(Unit::ONE),
        UnitRule::Var(a) => Some(of(a)),
        UnitRule::Product(a, b) => Some(of(a).times(of(b))),
        UnitRule::Quotient(a, b) => Some(of(a).per(of(b))),
        UnitRule::PerSecond(a) => Some(of(a).per(Unit::SECOND)),
        _ => None,
    }
}
