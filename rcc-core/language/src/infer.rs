//! The infer pass, [`NetGraph`] → [`Inferred`]: the types and units of all ports. Those fixed by the catalogue propagate
//! along the links to ports that leave them open. Literals adapt. A type that nothing determines is Real, a unit is 1.
//! Runs on the loader's threads.

mod type_solver;
mod unit_solver;

use std::borrow::Cow;

use rcc_core::primitive::{Dim, Port, PortType, Spec, UnitRule};
use rcc_core::primitives::CATALOGUE;
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use crate::resolve::{
    DeclaredInput, InputSource, ListElement, NetGraph, OutputId, ResolvedLink, ResolvedPrimitive,
};
use crate::syntax::literal::Literal;
use crate::syntax::part::{ListPosition, PartUnit, unit_of};
use type_solver::TypeVariables;
use unit_solver::{UnitConstraint, UnitSolver};

/// Types and units of all ports of a net.
#[derive(Debug)]
pub struct Inferred {
    open: Vec<TypeVariables>,
    /// Number of joints of its device, by item.
    joints: Vec<Option<u16>>,
    unit_variables: UnitVariables,
    units: Vec<Option<Unit>>,
}

/// A text that is nearly always one of the catalogue.
type Text = Cow<'static, str>;

/// A resolved net with its inferred types and units.
#[derive(Clone, Copy)]
pub struct Typed<'a> {
    /// The resolved net.
    pub graph: &'a NetGraph<'a>,
    /// The types and units of its ports.
    pub inferred: &'a Inferred,
}

impl Typed<'_> {
    /// Returns type and unit of a port of item `number` as text; the unit is `None` if the type implies it or has none.
    pub(crate) fn port_texts(self, number: usize, port: &Port) -> (Text, Option<Text>) {
        let ty = self.inferred.port_type(self.graph, number, port.ty);
        let unit = self.inferred.port_unit(self.graph, number, port.unit);
        let unit = unit.filter(|_| ty.is_some_and(has_unit));
        let of_type = |ty: Type| match ty.name() {
            Some(name) => Text::Borrowed(name),
            None => Text::Owned(ty.to_string()),
        };
        let of_unit = |unit: Unit| match unit.name() {
            Some(name) => Text::Borrowed(name),
            None => Text::Owned(unit.to_string()),
        };
        (ty.map_or(Text::Borrowed(""), of_type), unit.map(of_unit))
    }
}

/// Returns true for a type with a unit that the type itself does not imply.
pub(crate) fn has_unit(ty: Type) -> bool {
    matches!(
        ty,
        Type::Real | Type::Vector3 | Type::Reals(_) | Type::Matrix(..)
    )
}

/// The unit variables of all items: one for each unit that the spec of an item leaves open.
#[derive(Debug, Default)]
struct UnitVariables {
    /// Open units of a primitive, by row of the catalogue; `None` for rows that the net does not use.
    rules: Vec<Option<Vec<UnitRule>>>,
    /// Index of its first variable in the solver, by item.
    first: Vec<usize>,
    count: usize,
}

impl UnitVariables {
    fn of(graph: &NetGraph<'_>) -> UnitVariables {
        let mut variables = UnitVariables {
            rules: vec![None; CATALOGUE.len()],
            ..UnitVariables::default()
        };
        for item in &graph.items {
            variables.first.push(variables.count);
            if let Some(rules) = variables.rules.get_mut(item.row) {
                let rules = rules.get_or_insert_with(|| open_units(item.spec()));
                variables.count += rules.len();
            }
        }
        variables
    }

    /// Returns the variables of an item with their rules.
    fn item(&self, graph: &NetGraph<'_>, number: usize) -> impl Iterator<Item = (UnitRule, usize)> {
        let item = graph.items.get(number);
        let rules = item.and_then(|item| self.rules.get(item.row)?.as_deref());
        let first = self.first.get(number).copied().unwrap_or(0);
        rules.unwrap_or(&[]).iter().copied().zip(first..)
    }

    fn term(&self, graph: &NetGraph<'_>, number: usize, rule: UnitRule) -> UnitTerm {
        match rule {
            UnitRule::Is(unit) => UnitTerm::Fixed(unit),
            UnitRule::Typed => UnitTerm::None,
            UnitRule::Channel => {
                let channel = graph.items.get(number).and_then(|item| item.channel);
                channel.map_or(UnitTerm::None, |(_, unit)| UnitTerm::Fixed(unit))
            }
            UnitRule::Joint(order) => {
                let item = graph.items.get(number);
                let device = item.and_then(|item| graph.cell.devices.get(item.device?));
                let linear = device.is_some_and(|device| device.model.is_linear());
                UnitTerm::Fixed(Unit::of_joints(linear, order))
            }
            _ => {
                let found = self.item(graph, number).find(|(known, _)| *known == rule);
                found.map_or(UnitTerm::None, |(_, variable)| UnitTerm::Variable(variable))
            }
        }
    }
}

/// A unit: fixed, a variable of the solver, or nothing to compare.
#[derive(Clone, Copy, Debug, PartialEq)]
enum UnitTerm {
    Fixed(Unit),
    Variable(usize),
    None,
}

impl UnitTerm {
    fn is_variable(self) -> bool {
        matches!(self, UnitTerm::Variable(_))
    }
}

impl Inferred {
    /// Returns the type of a port of item `number`; `None` if it is unknown because of an error.
    #[must_use]
    pub fn port_type(&self, _: &NetGraph<'_>, number: usize, ty: PortType) -> Option<Type> {
        let joints = self.joints.get(number).copied().flatten();
        self.open.get(number)?.port(joints, ty)
    }

    /// Returns the open type of item `number`.
    #[must_use]
    pub fn open_type(&self, number: usize) -> Option<Type> {
        self.open.get(number)?.open()
    }

    /// Returns a length of item `number`; `None` if nothing determines it.
    #[must_use]
    pub fn length(&self, number: usize, dim: Dim) -> Option<u16> {
        self.open.get(number)?.dim(dim)
    }

    /// Returns the unit of a port of item `number`; `None` if its type implies it, or if it is unknown because of an
    /// error.
    #[must_use]
    pub fn port_unit(&self, graph: &NetGraph<'_>, number: usize, rule: UnitRule) -> Option<Unit> {
        match self.unit_variables.term(graph, number, rule) {
            UnitTerm::Fixed(unit) => Some(unit),
            UnitTerm::Variable(variable) => self.units.get(variable).copied().flatten(),
            UnitTerm::None => None,
        }
    }

    /// Returns the type of an output.
    #[must_use]
    pub fn output_type(&self, graph: &NetGraph<'_>, output: OutputId) -> Option<Type> {
        let port = port_of(graph, output)?;
        self.port_type(graph, output.item, port.ty)
    }

    /// Returns the unit of the value that a link carries: that of the output, except for parts with a unit of their
    /// own.
    #[must_use]
    pub fn link_unit(&self, graph: &NetGraph<'_>, link: &ResolvedLink<'_>) -> Option<Unit> {
        match self.source_unit(graph, link) {
            PartUnit::Port => self.output_unit(graph, link.from),
            PartUnit::Is(unit) => Some(unit),
            PartUnit::None => None,
        }
    }

    /// Returns the unit required at the target of a link: that of the input, except for list elements with a unit of
    /// their own.
    #[must_use]
    pub fn position_unit(
        &self,
        graph: &NetGraph<'_>,
        number: usize,
        port: &Port,
        position: ListPosition,
    ) -> Option<Unit> {
        match self.sink_unit(number, port, position) {
            PartUnit::Port => self.port_unit(graph, number, port.unit),
            PartUnit::Is(unit) => Some(unit),
            PartUnit::None => None,
        }
    }

    fn source_unit(&self, graph: &NetGraph<'_>, link: &ResolvedLink<'_>) -> PartUnit {
        let Some(part) = link.part else {
            return PartUnit::Port;
        };
        let whole = self.output_type(graph, link.from);
        let part = whole.and_then(|whole| Some((whole, part.of(whole)?)));
        part.map_or(PartUnit::Port, |(whole, (offset, part))| {
            unit_of(whole, offset, part)
        })
    }

    fn sink_unit(&self, number: usize, port: &Port, position: ListPosition) -> PartUnit {
        // The whole value, or each value of many.
        if position == ListPosition::default() || matches!(port.ty, PortType::Many(_)) {
            return PartUnit::Port;
        }
        let joints = self.joints.get(number).copied().flatten();
        let open = self.open.get(number);
        let whole = open.and_then(|open| open.port(joints, port.ty));
        let part = whole.and_then(|whole| Some((whole, position.of(whole)?)));
        part.map_or(PartUnit::Port, |(whole, (offset, part))| {
            unit_of(whole, offset, part)
        })
    }

    /// Returns the type required at a position in an input's list, or the type of the whole input if it is not a list.
    #[must_use]
    pub fn position_type(
        &self,
        graph: &NetGraph<'_>,
        number: usize,
        port: &Port,
        position: ListPosition,
    ) -> Option<Type> {
        let whole = self.port_type(graph, number, port.ty)?;
        match port.ty {
            PortType::Many(_) => Some(whole),
            _ => position.of(whole).map(|(_, ty)| ty),
        }
    }

    /// Returns the unit of an output.
    #[must_use]
    pub fn output_unit(&self, graph: &NetGraph<'_>, output: OutputId) -> Option<Unit> {
        let port = port_of(graph, output)?;
        self.port_unit(graph, output.item, port.unit)
    }

    /// Returns the type of the value that a link carries: that of the output or of a part of it.
    #[must_use]
    pub fn link_type(&self, graph: &NetGraph<'_>, link: &ResolvedLink<'_>) -> Option<Type> {
        let ty = self.output_type(graph, link.from)?;
        match link.part {
            None => Some(ty),
            Some(part) => part.of(ty).map(|(_, ty)| ty),
        }
    }
}

fn port_of(graph: &NetGraph<'_>, output: OutputId) -> Option<&'static Port> {
    graph
        .items
        .get(output.item)?
        .spec()
        .outputs
        .get(output.port)
}

/// Infers the types and units of all ports.
#[must_use]
pub fn infer(graph: &NetGraph<'_>) -> Inferred {
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
        open: type_solver::infer(graph, &joints),
        joints,
        unit_variables: UnitVariables::of(graph),
        units: Vec::new(),
    };
    infer_units(graph, &mut inferred);
    inferred
}

/// Returns the constants of an item with the types and units of their ports.
pub fn literals<'g>(
    item: &'g ResolvedPrimitive<'_>,
) -> impl Iterator<Item = (&'g Literal, PortType, UnitRule)> {
    let inputs = item.inputs.iter().zip(item.spec().inputs);
    let inputs = inputs.filter_map(|(input_source, port)| match input_source {
        InputSource::Literal(literal) => Some((*literal, port.ty, port.unit)),
        _ => None,
    });
    let parameters = item.parameters.iter().zip(item.spec().parameters);
    let parameters = parameters.filter_map(|(literal, parameter)| {
        let (ty, unit) = parameter.kind.value()?;
        Some(((*literal)?, ty, unit))
    });
    inputs.chain(parameters)
}

fn infer_units(graph: &NetGraph<'_>, inferred: &mut Inferred) {
    let links = graph.items.iter().map(|item| item.inputs.len());
    let mut constraints = Vec::with_capacity(links.sum());
    let term = |number: usize, rule: UnitRule| inferred.unit_variables.term(graph, number, rule);
    for DeclaredInput {
        item,
        input,
        declaration,
    } in &graph.declarations
    {
        let port = graph.items.get(*item);
        let port = port.and_then(|item| item.spec().inputs.get(*input));
        if let (Some(port), Some((unit, _))) = (port, declaration.unit) {
            constraints.push(UnitConstraint::Equal(
                UnitTerm::Fixed(unit),
                term(*item, port.unit),
            ));
        }
    }
    for (number, item) in graph.items.iter().enumerate() {
        if let Some((variable, unit)) = item.declared_unit() {
            let variable = term(number, UnitRule::Var(variable));
            constraints.push(UnitConstraint::Equal(UnitTerm::Fixed(unit), variable));
        }
        for (port, link) in item.links() {
            let (Some(port), Some(from)) =
                (item.spec().inputs.get(port), port_of(graph, link.from))
            else {
                continue;
            };
            let of = |unit: PartUnit, port: UnitTerm| match unit {
                PartUnit::Port => port,
                PartUnit::Is(unit) => UnitTerm::Fixed(unit),
                PartUnit::None => UnitTerm::None,
            };
            let sink_unit = inferred.sink_unit(number, port, link.position);
            let sink = of(sink_unit, term(number, port.unit));
            let source = inferred.source_unit(graph, link);
            let source = of(source, term(link.from.item, from.unit));
            if source.is_variable() || sink.is_variable() {
                constraints.push(UnitConstraint::Equal(source, sink));
            }
            for (unit, _) in link.initial.map(Literal::units).unwrap_or_default() {
                constraints.push(UnitConstraint::Equal(UnitTerm::Fixed(unit), sink));
            }
        }
        for (port, list) in item.lists() {
            let port = item.spec().inputs.get(port);
            for (element, port) in list.elements.iter().zip(std::iter::repeat(port)) {
                let (ListElement::Literal(literal, position), Some(port)) = (element, port) else {
                    continue;
                };
                if inferred.sink_unit(number, port, *position) == PartUnit::Port {
                    for (unit, _) in literal.units() {
                        let sink = term(number, port.unit);
                        constraints.push(UnitConstraint::Equal(UnitTerm::Fixed(unit), sink));
                    }
                }
            }
        }
        for (literal, _, rule) in literals(item) {
            for (unit, _) in literal.units() {
                constraints.push(UnitConstraint::Equal(
                    UnitTerm::Fixed(unit),
                    term(number, rule),
                ));
            }
        }
        for (rule, variable) in inferred.unit_variables.item(graph, number) {
            let open = |index: u8| term(number, UnitRule::Var(index));
            let result = UnitTerm::Variable(variable);
            constraints.push(match rule {
                UnitRule::Product(a, b) => UnitConstraint::Product(open(a), open(b), result),
                UnitRule::Quotient(a, b) => UnitConstraint::Product(result, open(b), open(a)),
                UnitRule::PerSecond(a) => {
                    UnitConstraint::Product(result, UnitTerm::Fixed(Unit::SECOND), open(a))
                }
                UnitRule::PerSecond2(a) => {
                    let square = Unit::SECOND.times(Unit::SECOND);
                    UnitConstraint::Product(result, UnitTerm::Fixed(square), open(a))
                }
                UnitRule::PerSecond3(a) => {
                    let cube = Unit::SECOND.times(Unit::SECOND).times(Unit::SECOND);
                    UnitConstraint::Product(result, UnitTerm::Fixed(cube), open(a))
                }
                UnitRule::Root(a) => UnitConstraint::Product(result, result, open(a)),
                _ => continue,
            });
        }
    }
    let count = inferred.unit_variables.count;
    let mut solver = UnitSolver::new(count, constraints);
    solver.solve();
    for variable in 0..count {
        solver.decide(variable, Unit::ONE);
    }
    inferred.units = solver.values;
}

/// Returns each unit that a spec leaves open, in the order of the spec, plain variables first.
fn open_units(spec: &Spec) -> Vec<UnitRule> {
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
    let mut open = Vec::new();
    for rule in plain.chain(derived).chain(others) {
        if !open.contains(&rule) {
            open.push(rule);
        }
    }
    open
}
