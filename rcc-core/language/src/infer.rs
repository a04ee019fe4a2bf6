//! Types and units of all ports: what the catalogue fixes goes along the links to where it leaves a choice.
//! Literals adapt; what nothing decides is a Real, and of unit 1. The loader's threads.

mod constraint;

use rcc_core::primitive::{Port, PortType, UnitRule};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use crate::resolve::{Feed, Graph, Item, Output, Pin, Wire};
use crate::syntax::literal::Literal;
use constraint::{Constraint, Solver};

/// Types and units of every port of a net.
#[derive(Debug)]
pub struct Inferred {
    types: Vec<Option<Type>>,
    cells: Vec<Cells>,
    units: Vec<Option<Unit>>,
}

/// The unit variables of one item: its rules and their number in the solver.
type Cells = Vec<(UnitRule, usize)>;

/// Something with a type or unit: fixed, a variable of the solver, or nothing that could be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Term<T> {
    Fixed(T),
    Open(usize),
    None,
}

impl Inferred {
    /// The type that a port of item `number` carries; `None` if a fault hides it.
    #[must_use]
    pub fn port_type(&self, graph: &Graph<'_>, number: usize, ty: PortType) -> Option<Type> {
        match type_term(graph.items.get(number)?, graph, number, ty) {
            Term::Fixed(ty) => Some(ty),
            Term::Open(variable) => self.types.get(variable).copied().flatten(),
            Term::None => None,
        }
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

    /// The unit of what a link carries: that of the output, but for elements that have none.
    #[must_use]
    pub fn wire_unit(&self, graph: &Graph<'_>, wire: &Wire<'_>) -> Option<Unit> {
        if self.has_unit(graph, wire) {
            self.output_unit(graph, wire.from)
        } else {
            Some(Unit::ONE)
        }
    }

    /// False if a link carries an element that has no unit, whatever that of the output is.
    fn has_unit(&self, graph: &Graph<'_>, wire: &Wire<'_>) -> bool {
        match (wire.index, self.output_type(graph, wire.from)) {
            (Some(index), Some(ty)) => ty.element_has_unit(index),
            _ => true,
        }
    }

    /// The unit of an output.
    #[must_use]
    pub fn output_unit(&self, graph: &Graph<'_>, output: Output) -> Option<Unit> {
        let port = port_of(graph, output)?;
        self.port_unit(graph, output.item, port.unit)
    }

    /// What a link carries: the output or one of its elements.
    #[must_use]
    pub fn wire_type(&self, graph: &Graph<'_>, wire: &Wire<'_>) -> Option<Type> {
        let ty = self.output_type(graph, wire.from)?;
        match wire.index {
            None => Some(ty),
            Some(index) if index < ty.width() => ty.element(),
            Some(_) => None,
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

fn type_term(item: &Item<'_>, graph: &Graph<'_>, number: usize, ty: PortType) -> Term<Type> {
    match ty {
        PortType::Is(ty) => Term::Fixed(ty),
        PortType::Any | PortType::Scalar | PortType::Number => Term::Open(number),
        PortType::Joints => {
            let device = item.device.and_then(|index| graph.cell.devices.get(index));
            device.map_or(Term::None, |device| {
                // At most JOINTS_MAX = 8.
                Term::Fixed(Type::Reals(device.model.joints as u16))
            })
        }
    }
}

fn unit_term(item: &Item<'_>, cells: &Cells, rule: UnitRule) -> Term<Unit> {
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
    let types = infer_types(graph);
    let mut inferred = Inferred {
        types,
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

/// The links of a net with the number of the item that each ends at.
fn wires<'g>(graph: &'g Graph<'_>) -> impl Iterator<Item = (usize, &'static Port, &'g Wire<'g>)> {
    graph.items.iter().enumerate().flat_map(|(number, item)| {
        item.wires().filter_map(move |(port, wire)| {
            let port = item.spec().inputs.get(port)?;
            Some((number, port, wire))
        })
    })
}

fn infer_types(graph: &Graph<'_>) -> Vec<Option<Type>> {
    let mut solver = Solver::new(graph.items.len());
    for (number, item) in graph.items.iter().enumerate() {
        let mut ports = item.spec().inputs.iter().chain(item.spec().outputs);
        if ports.any(|port| port.ty == PortType::Number) {
            solver.allow(number, |ty| matches!(ty, Type::Int | Type::Real));
        }
    }
    for Pin { item, input, said } in &graph.pins {
        let sink = graph
            .items
            .get(*item)
            .zip(said.ty)
            .and_then(|(sink, (ty, _))| {
                let port = sink.spec().inputs.get(*input)?;
                Some((ty, type_term(sink, graph, *item, port.ty)))
            });
        if let Some((ty, sink)) = sink {
            solver.add(Constraint::Equal(Term::Fixed(ty), sink));
        }
    }
    for (number, port, wire) in wires(graph) {
        let Some((source, from)) = graph
            .items
            .get(wire.from.item)
            .zip(port_of(graph, wire.from))
        else {
            continue;
        };
        let source = type_term(source, graph, wire.from.item, from.ty);
        let sink = graph
            .items
            .get(number)
            .map_or(Term::None, |item| type_term(item, graph, number, port.ty));
        solver.add(match wire.index {
            None => Constraint::Equal(source, sink),
            Some(_) => Constraint::Element(source, sink),
        });
        // The first value of a delayed link says as much as a literal.
        if let (Some(ty), None) = (wire.initial.and_then(Literal::firm_type), wire.index) {
            solver.add(Constraint::Equal(Term::Fixed(ty), sink));
        }
    }
    for (number, item) in graph.items.iter().enumerate() {
        for (literal, ty, _) in literals(item) {
            if let Some(firm) = literal.firm_type() {
                solver.add(Constraint::Equal(
                    Term::Fixed(firm),
                    type_term(item, graph, number, ty),
                ));
            }
        }
    }
    solver.solve();
    for (number, item) in graph.items.iter().enumerate() {
        let usual = literals(item)
            .filter(|(_, ty, _)| ty.is_open())
            .find_map(|(literal, ..)| literal.usual_type());
        if let Some(usual) = usual {
            solver.decide(number, usual);
        }
    }
    for number in 0..graph.items.len() {
        solver.decide(number, Type::Real);
    }
    solver.values
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
        for (port, wire) in item.wires() {
            let (Some(port), Some(from)) =
                (item.spec().inputs.get(port), port_of(graph, wire.from))
            else {
                continue;
            };
            let sink = term(number, port.unit);
            let source = if inferred.has_unit(graph, wire) {
                term(wire.from.item, from.unit)
            } else {
                Term::Fixed(Unit::ONE)
            };
            solver.add(Constraint::Equal(source, sink));
            for (unit, _) in wire.initial.map(Literal::units).unwrap_or_default() {
                solver.add(Constraint::Equal(Term::Fixed(unit), sink));
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
        UnitRule::PerSecond(a) | UnitRule::PerSecond2(a) | UnitRule::Root(a) => {
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
