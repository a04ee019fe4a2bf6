//! Types and units of all ports: what the catalogue fixes goes along the links to where it leaves a choice.
//! Literals adapt; what nothing decides is a Real, and of unit 1. The loader's threads.

mod constraint;
mod types;

use rcc_core::primitive::{Dim, Port, PortType, UnitRule};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use crate::resolve::{Feed, Graph, Item, Leaf, Output, Pin, Wire};
use crate::syntax::literal::Literal;
use crate::syntax::part::{PartUnit, Place, unit_of};
use constraint::{Constraint, Solver};
use types::Open;

/// Types and units of every port of a net.
#[derive(Debug)]
pub struct Inferred {
    open: Vec<Open>,
    /// By item: joints of its device.
    joints: Vec<Option<u16>>,
    cells: Vec<Cells>,
    units: Vec<Option<Unit>>,
}

/// The unit variables of one item: its rules and their number in the solver.
type Cells = Vec<(UnitRule, usize)>;

/// Something with a unit: fixed, a variable of the solver, or nothing that could be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Term {
    Fixed(Unit),
    Open(usize),
    None,
}

impl Inferred {
    /// The type that a port of item `number` carries; `None` if a fault hides it.
    #[must_use]
    pub fn port_type(&self, _: &Graph<'_>, number: usize, ty: PortType) -> Option<Type> {
        let joints = self.joints.get(number).copied().flatten();
        self.open.get(number)?.port(joints, ty)
    }

    /// The open type of item `number`.
    #[must_use]
    pub fn open_type(&self, number: usize) -> Option<Type> {
        self.open.get(number)?.open()
    }

    /// A length of item `number`; `None` if nothing says it.
    #[must_use]
    pub fn length(&self, number: usize, dim: Dim) -> Option<u16> {
        self.open.get(number)?.dim(dim)
    }

    /// The unit of a port of item `number`; `None`: its type says it, or a fault hides it.
    #[must_use]
    pub fn port_unit(&self, graph: &Graph<'_>, number: usize, rule: UnitRule) -> Option<Unit> {
        match unit_term(graph.items.get(number)?, self.cells.get(number)?, rule) {
            Term::Fixed(unit) => Some(unit),
            Term::Open(variable) => self.units.get(variable).copied().flatten(),
            Term::None => None,
        }
    }

    /// The type of an output.
    #[must_use]
    pub fn output_type(&self, graph: &Graph<'_>, output: Output) -> Option<Type> {
        let port = port_of(graph, output)?;
        self.port_type(graph, output.item, port.ty)
    }

    /// The unit of what a link carries: that of the output, but for parts that have another one.
    #[must_use]
    pub fn wire_unit(&self, graph: &Graph<'_>, wire: &Wire<'_>) -> Option<Unit> {
        match self.source_unit(graph, wire) {
            PartUnit::Port => self.output_unit(graph, wire.from),
            PartUnit::Is(unit) => Some(unit),
            PartUnit::None => None,
        }
    }

    /// The unit that a link must have where it ends: that of the input, but for elements of a list that have another one.
    #[must_use]
    pub fn place_unit(
        &self,
        graph: &Graph<'_>,
        number: usize,
        port: &Port,
        place: Place,
    ) -> Option<Unit> {
        match self.sink_unit(number, port, place) {
            PartUnit::Port => self.port_unit(graph, number, port.unit),
            PartUnit::Is(unit) => Some(unit),
            PartUnit::None => None,
        }
    }

    fn source_unit(&self, graph: &Graph<'_>, wire: &Wire<'_>) -> PartUnit {
        let whole = self.output_type(graph, wire.from);
        let part = whole.zip(wire.part);
        let part = part.and_then(|(whole, part)| Some((whole, part.of(whole)?)));
        part.map_or(PartUnit::Port, |(whole, (offset, part))| {
            unit_of(whole, offset, part)
        })
    }

    fn sink_unit(&self, number: usize, port: &Port, place: Place) -> PartUnit {
        let joints = self.joints.get(number).copied().flatten();
        let open = self.open.get(number);
        let whole = open.and_then(|open| open.port(joints, port.ty));
        let part = whole.and_then(|whole| Some((whole, place.of(whole)?)));
        match part {
            _ if matches!(port.ty, PortType::Many(_)) => PartUnit::Port,
            Some((whole, (offset, part))) => unit_of(whole, offset, part),
            None => PartUnit::Port,
        }
    }

    /// The type that must be at a place of an input's list; of the whole input if it is no list.
    #[must_use]
    pub fn place_type(
        &self,
        graph: &Graph<'_>,
        number: usize,
        port: &Port,
        place: Place,
    ) -> Option<Type> {
        let whole = self.port_type(graph, number, port.ty)?;
        match port.ty {
            PortType::Many(_) => Some(whole),
            _ => place.of(whole).map(|(_, ty)| ty),
        }
    }

    /// The unit of an output.
    #[must_use]
    pub fn output_unit(&self, graph: &Graph<'_>, output: Output) -> Option<Unit> {
        let port = port_of(graph, output)?;
        self.port_unit(graph, output.item, port.unit)
    }

    /// What a link carries: the output or a part of it.
    #[must_use]
    pub fn wire_type(&self, graph: &Graph<'_>, wire: &Wire<'_>) -> Option<Type> {
        let ty = self.output_type(graph, wire.from)?;
        match wire.part {
            None => Some(ty),
            Some(part) => part.of(ty).map(|(_, ty)| ty),
        }
    }
}

fn port_of(graph: &Graph<'_>, output: Output) -> Option<&'static Port> {
    graph
        .items
        .get(output.item)?
        .spec()
        .outputs
        .get(output.port)
}

fn unit_term(item: &Item<'_>, cells: &Cells, rule: UnitRule) -> Term {
    match rule {
        UnitRule::Is(unit) => Term::Fixed(unit),
        UnitRule::Typed => Term::None,
        UnitRule::Channel => item
            .channel
            .map_or(Term::None, |(_, unit)| Term::Fixed(unit)),
        _ => {
            let cell = cells.iter().find(|(known, _)| *known == rule);
            cell.map_or(Term::None, |(_, variable)| Term::Open(*variable))
        }
    }
}

/// Finds the types and units of all ports.
#[must_use]
pub fn infer(graph: &Graph<'_>) -> Inferred {
    let joints: Vec<Option<u16>> = graph
        .items
        .iter()
        .map(|item| {
            let device = item.device.and_then(|index| graph.cell.devices.get(index));
            // At most JOINTS_MAX = 8.
            device.map(|device| device.model.joints as u16)
        })
        .collect();
    let mut inferred = Inferred {
        open: types::infer(graph, &joints),
        joints,
        cells: Vec::new(),
        units: Vec::new(),
    };
    infer_units(graph, &mut inferred);
    inferred
}

/// The constants of an item with the type and unit of their places.
pub fn literals<'g>(item: &'g Item<'_>) -> impl Iterator<Item = (&'g Literal, PortType, UnitRule)> {
    let inputs = item.inputs.iter().zip(item.spec().inputs);
    let inputs = inputs.filter_map(|(feed, port)| match feed {
        Feed::Literal(literal) => Some((*literal, port.ty, port.unit)),
        _ => None,
    });
    let parameters = item.parameters.iter().zip(item.spec().parameters);
    let parameters = parameters.filter_map(|(literal, parameter)| {
        let (ty, unit) = parameter.kind.value()?;
        Some(((*literal)?, ty, unit))
    });
    inputs.chain(parameters)
}

fn infer_units(graph: &Graph<'_>, inferred: &mut Inferred) {
    let mut count = 0;
    for item in &graph.items {
        inferred.cells.push(cells_of(item, &mut count));
    }
    let mut solver = Solver::new(count);
    let term = |number: usize, rule: UnitRule| {
        let cell = graph.items.get(number).zip(inferred.cells.get(number));
        cell.map_or(Term::None, |(item, cells)| unit_term(item, cells, rule))
    };
    for Pin { item, input, said } in &graph.pins {
        let port = graph.items.get(*item);
        let port = port.and_then(|item| item.spec().inputs.get(*input));
        if let (Some(port), Some((unit, _))) = (port, said.unit) {
            solver.add(Constraint::Equal(Term::Fixed(unit), term(*item, port.unit)));
        }
    }
    for (number, item) in graph.items.iter().enumerate() {
        if let Some((variable, unit)) = item.said_unit() {
            let variable = term(number, UnitRule::Var(variable));
            solver.add(Constraint::Equal(Term::Fixed(unit), variable));
        }
        for (port, wire) in item.wires() {
            let (Some(port), Some(from)) =
                (item.spec().inputs.get(port), port_of(graph, wire.from))
            else {
                continue;
            };
            let of = |unit: PartUnit, port: Term| match unit {
                PartUnit::Port => port,
                PartUnit::Is(unit) => Term::Fixed(unit),
                PartUnit::None => Term::None,
            };
            let place = inferred.sink_unit(number, port, wire.place);
            let sink = of(place, term(number, port.unit));
            let source = inferred.source_unit(graph, wire);
            let source = of(source, term(wire.from.item, from.unit));
            solver.add(Constraint::Equal(source, sink));
            for (unit, _) in wire.initial.map(Literal::units).unwrap_or_default() {
                solver.add(Constraint::Equal(Term::Fixed(unit), sink));
            }
        }
        for (port, list) in item.lists() {
            let port = item.spec().inputs.get(port);
            for (leaf, port) in list.leaves.iter().zip(std::iter::repeat(port)) {
                let (Leaf::Literal(literal, place), Some(port)) = (leaf, port) else {
                    continue;
                };
                if inferred.sink_unit(number, port, *place) == PartUnit::Port {
                    for (unit, _) in literal.units() {
                        let sink = term(number, port.unit);
                        solver.add(Constraint::Equal(Term::Fixed(unit), sink));
                    }
                }
            }
        }
        for (literal, _, rule) in literals(item) {
            for (unit, _) in literal.units() {
                solver.add(Constraint::Equal(Term::Fixed(unit), term(number, rule)));
            }
        }
        for (rule, variable) in inferred.cells.get(number).into_iter().flatten() {
            let open = |index: u8| term(number, UnitRule::Var(index));
            let result = Term::Open(*variable);
            solver.add(match *rule {
                UnitRule::Product(a, b) => Constraint::Product(open(a), open(b), result),
                UnitRule::Quotient(a, b) => Constraint::Product(result, open(b), open(a)),
                UnitRule::PerSecond(a) => {
                    Constraint::Product(result, Term::Fixed(Unit::SECOND), open(a))
                }
                UnitRule::PerSecond2(a) => {
                    let square = Unit::SECOND.times(Unit::SECOND);
                    Constraint::Product(result, Term::Fixed(square), open(a))
                }
                UnitRule::PerSecond3(a) => {
                    let cube = Unit::SECOND.times(Unit::SECOND).times(Unit::SECOND);
                    Constraint::Product(result, Term::Fixed(cube), open(a))
                }
                UnitRule::Root(a) => Constraint::Product(result, result, open(a)),
                _ => continue,
            });
        }
    }
    solver.solve();
    for variable in 0..count {
        solver.decide(variable, Unit::ONE);
    }
    inferred.units = solver.values;
}

/// One variable for each unit that the spec of an item leaves open, in the order of the spec, plain ones first.
fn cells_of(item: &Item<'_>, count: &mut usize) -> Cells {
    let spec = item.spec();
    let ports = spec.inputs.iter().chain(spec.outputs).map(|port| port.unit);
    let parameters = spec
        .parameters
        .iter()
        .filter_map(|parameter| Some(parameter.kind.value()?.1));
    let rules: Vec<UnitRule> = ports.chain(parameters).collect();
    let derived = rules.iter().flat_map(|rule| match *rule {
        UnitRule::Product(a, b) | UnitRule::Quotient(a, b) => {
            vec![UnitRule::Var(a), UnitRule::Var(b)]
        }
        UnitRule::PerSecond(a)
        | UnitRule::PerSecond2(a)
        | UnitRule::PerSecond3(a)
        | UnitRule::Root(a) => {
            vec![UnitRule::Var(a)]
        }
        _ => Vec::new(),
    });
    let plain = rules
        .iter()
        .copied()
        .filter(|rule| matches!(rule, UnitRule::Var(_)));
    let others = rules.iter().copied().filter(|rule| {
        matches!(
            rule,
            UnitRule::Product(..)
                | UnitRule::Quotient(..)
                | UnitRule::PerSecond(_)
                | UnitRule::PerSecond2(_)
                | UnitRule::PerSecond3(_)
                | UnitRule::Root(_)
        )
    });
    let mut cells = Cells::new();
    for rule in plain.chain(derived).chain(others) {
        if !cells.iter().any(|(known, _)| *known == rule) {
            cells.push((rule, *count));
            *count += 1;
        }
    }
    cells
}
