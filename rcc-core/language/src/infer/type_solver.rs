//! Inference of port types: each item has one open type and a few open lengths, determined by links and literals.
//! Linear in the number of links, and deterministic. Runs on the loader's threads.

use std::collections::VecDeque;

use rcc_core::linear::SIDE_MAX;
use rcc_core::primitive::{DIMS_MAX, Dim, ElementType, ParameterKind, PortType, Spec};
use rcc_core::types::Type;

use crate::adjacency::Adjacency;
use crate::resolve::{InputSource, ListElement, NetGraph, ResolvedLink, ResolvedPrimitive};
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::part::{ListPosition, ValuePart};

/// The open type and the open lengths of one item, as far as they are known.
#[derive(Clone, Copy, Debug, Default)]
pub struct TypeVariables {
    ty: Option<Type>,
    dims: [Option<u16>; DIMS_MAX],
}

impl TypeVariables {
    /// Returns the open type.
    pub fn open(&self) -> Option<Type> {
        self.ty
    }

    /// Returns the type of a port; `None` if it is not known.
    pub fn port(&self, joints: Option<u16>, ty: PortType) -> Option<Type> {
        match ty {
            PortType::Is(ty) => Some(ty),
            PortType::Any
            | PortType::Scalar
            | PortType::Number
            | PortType::Linear
            | PortType::Of(_)
            | PortType::Many(_) => self.ty,
            PortType::Part => self.ty.map(Type::scalar),
            PortType::Array(elements, length) => {
                let element = match elements {
                    ElementType::Are(ty) => ty,
                    ElementType::Open => self.ty?,
                };
                element.array(self.dim(length)?)
            }
            PortType::Matrix(rows, columns) => {
                let count = |dim| u8::try_from(self.dim(dim)?).ok();
                Some(Type::Matrix(count(rows)?, count(columns)?))
            }
            PortType::Joints => joints.map(Type::Reals),
            PortType::JointColumns(rows) => Some(Type::Matrix(rows, u8::try_from(joints?).ok()?)),
        }
    }

    /// Returns a length; `None` if it is not known.
    pub fn dim(&self, dim: Dim) -> Option<u16> {
        let get = |index: u8| self.dims.get(usize::from(index)).copied().flatten();
        match dim {
            Dim::Is(length) => Some(length),
            Dim::Var(index) | Dim::Small(index) => get(index),
            Dim::Sum(a, b) => get(a)?.checked_add(get(b)?),
        }
    }

    /// Learns from the type of a port; returns false if nothing new is learned.
    fn learn(&mut self, spec: &Spec, port: PortType, ty: Type) -> bool {
        match port {
            PortType::Is(_) | PortType::Joints | PortType::JointColumns(_) | PortType::Part => {
                false
            }
            PortType::Any
            | PortType::Scalar
            | PortType::Number
            | PortType::Linear
            | PortType::Of(_)
            | PortType::Many(_) => self.learn_type(spec, ty),
            PortType::Array(elements, length) => {
                let of = ty.scalar();
                let Some(count) = array_length(ty) else {
                    return false;
                };
                match elements {
                    ElementType::Are(element) if element != of => false,
                    ElementType::Are(_) => self.learn_length(length, count),
                    ElementType::Open => {
                        let new = self.learn_type(spec, of);
                        self.learn_length(length, count) || new
                    }
                }
            }
            PortType::Matrix(rows, columns) => {
                let Type::Matrix(r, c) = ty else {
                    return false;
                };
                let new = self.learn_length(rows, r.into());
                self.learn_length(columns, c.into()) || new
            }
        }
    }

    fn learn_type(&mut self, spec: &Spec, ty: Type) -> bool {
        let new = self.ty.is_none() && spec.types().all(|port| port.admits(ty));
        if new {
            self.ty = Some(ty);
        }
        new
    }

    fn learn_length(&mut self, dim: Dim, length: u16) -> bool {
        let place = match dim {
            Dim::Is(_) => None,
            Dim::Var(index) => Some((index, length)),
            Dim::Small(index) => Some((index, length)).filter(|_| length <= SIDE_MAX as u16),
            Dim::Sum(a, b) => match (self.dim(Dim::Var(a)), self.dim(Dim::Var(b))) {
                (Some(known), None) => Some((b, length.saturating_sub(known))),
                (None, Some(known)) => Some((a, length.saturating_sub(known))),
                _ => None,
            },
        };
        let Some((index, length)) = place.filter(|(_, length)| *length > 0) else {
            return false;
        };
        match self.dims.get_mut(usize::from(index)) {
            Some(place @ None) => {
                *place = Some(length);
                true
            }
            _ => false,
        }
    }
}

/// Returns true for a primitive with a parameter that is its type or a length, or with inputs that determine a length.
fn declares_type_or_length(spec: &Spec) -> bool {
    let mut kinds = spec.parameters.iter().map(|parameter| parameter.kind);
    let mut inputs = spec.inputs.iter().map(|port| port.ty);
    kinds.any(|kind| matches!(kind, ParameterKind::Type | ParameterKind::Length(_)))
        || inputs.any(|port| matches!(port, PortType::Many(_) | PortType::Array(..)))
}

/// Returns true for a port whose type tells an item something.
fn learns(port: PortType) -> bool {
    !matches!(
        port,
        PortType::Is(_) | PortType::Joints | PortType::JointColumns(_) | PortType::Part
    )
}

fn array_length(ty: Type) -> Option<u16> {
    match ty {
        Type::Reals(length) | Type::Bools(length) | Type::Ints(length) => Some(length),
        _ => None,
    }
}

/// A port of an item.
#[derive(Clone, Copy)]
struct PortSite {
    item: usize,
    port: PortType,
}

/// A link as a constraint: a part of an output has the type of a position of an input.
#[derive(Clone, Copy)]
struct TypeConstraint {
    source: PortSite,
    part: Option<ValuePart>,
    sink: PortSite,
    position: ListPosition,
}

/// Infers the open types and lengths of all items.
pub fn infer(graph: &NetGraph<'_>, joints: &[Option<u16>]) -> Vec<TypeVariables> {
    let links = graph.items.iter().map(|item| item.inputs.len());
    let mut constraints = Vec::with_capacity(links.sum());
    for (number, item) in graph.items.iter().enumerate() {
        for (port, link) in item.links() {
            let sink = item.spec().inputs.get(port);
            if let (Some(from), Some(sink)) = (super::port_of(graph, link.from), sink)
                && (learns(from.ty) || learns(sink.ty))
            {
                constraints.push(TypeConstraint {
                    source: PortSite {
                        item: link.from.item,
                        port: from.ty,
                    },
                    part: link.part,
                    sink: PortSite {
                        item: number,
                        port: sink.ty,
                    },
                    position: link.position,
                });
            }
        }
    }
    let items = constraints.iter().map(|it| [it.source.item, it.sink.item]);
    let mut solver = TypeSolver {
        graph,
        joints,
        open: vec![TypeVariables::default(); graph.items.len()],
        users: items.collect::<Adjacency>().reversed(graph.items.len()),
        constraints: &constraints,
        queue: VecDeque::new(),
        backwards: false,
    };
    solver.solve();
    solver.open
}

struct TypeSolver<'g, 'a> {
    graph: &'g NetGraph<'a>,
    /// Number of joints of its device, by item.
    joints: &'g [Option<u16>],
    open: Vec<TypeVariables>,
    constraints: &'g [TypeConstraint],
    /// The links that begin or end at it, by item.
    users: Adjacency,
    queue: VecDeque<usize>,
    backwards: bool,
}

impl TypeSolver<'_, '_> {
    /// Propagates what is known: first only from sources to sinks, so that a conflict is reported where two sources
    /// meet and not somewhere before, then in both directions. What is still open then takes its default.
    fn solve(&mut self) {
        let items = self.graph.items.iter().enumerate();
        for declared in &self.graph.declarations {
            let item = self.graph.items.get(declared.item);
            let port = item.and_then(|item| item.spec().inputs.get(declared.input));
            if let (Some(port), Some((ty, _))) = (port, declared.declaration.ty) {
                self.learn(declared.item, port.ty, ty);
            }
        }
        let graph = self.graph;
        for (number, item) in graph.items_of(declares_type_or_length) {
            if let Some(ty) = item.declared_type() {
                self.learn(number, PortType::Any, ty);
            }
            self.learn_lengths(number, item);
        }
        self.run_all();
        for (number, item) in items {
            self.learn_certain(number, item);
        }
        self.run();
        self.backwards = true;
        self.run_all();
        for region in &self.graph.regions {
            let InputSource::Link(ResolvedLink {
                from, part: None, ..
            }) = &region.condition
            else {
                continue;
            };
            let item = self.graph.items.get(from.item);
            if let Some(port) = item.and_then(|item| item.spec().outputs.get(from.port)) {
                self.learn(from.item, port.ty, Type::Bool);
                self.run();
            }
        }
        let is_open = |spec: &'static Spec| spec.types().any(PortType::is_open);
        for (number, item) in graph.items_of(is_open) {
            if let Some((port, ty)) = self.default_type(item) {
                self.learn(number, port, ty);
                self.run();
            }
        }
        for (number, _) in graph.items_of(is_open) {
            if self.open.get(number).is_some_and(|open| open.ty.is_none()) {
                self.decide(number, Type::Real);
                self.run();
            }
        }
    }

    fn run_all(&mut self) {
        self.queue.extend(0..self.constraints.len());
        self.run();
    }

    fn run(&mut self) {
        while let Some(number) = self.queue.pop_front() {
            if let Some(constraint) = self.constraints.get(number) {
                self.propagate(constraint);
            }
        }
    }

    fn type_at(&self, at: PortSite) -> Option<Type> {
        let joints = self.joints.get(at.item).copied().flatten();
        self.open.get(at.item)?.port(joints, at.port)
    }

    fn propagate(&mut self, constraint: &TypeConstraint) {
        let source = self.type_at(constraint.source);
        let part = match constraint.part {
            None => source,
            Some(part) => source.and_then(|ty| part.of(ty)).map(|(_, ty)| ty),
        };
        if let Some(ty) = part {
            if let Some(whole) = whole_of(constraint.position, constraint.sink.port, ty) {
                self.learn(constraint.sink.item, constraint.sink.port, whole);
            }
        } else if self.backwards
            && constraint.part.is_none()
            && let Some(sink) = self.type_at(constraint.sink)
            && let Some((_, ty)) = constraint.position.of(sink)
        {
            self.learn(constraint.source.item, constraint.source.port, ty);
        }
    }

    fn learn(&mut self, number: usize, port: PortType, ty: Type) {
        let spec = self.graph.items.get(number).map(ResolvedPrimitive::spec);
        if let (Some(open), Some(spec)) = (self.open.get_mut(number), spec)
            && open.learn(spec, port, ty)
        {
            self.queue.extend(self.users.of(number));
        }
    }

    fn decide(&mut self, number: usize, ty: Type) {
        if let Some(open) = self.open.get_mut(number) {
            open.ty = Some(ty);
            self.queue.extend(self.users.of(number));
        }
    }

    /// Learns lengths from parameters and from lists of values.
    fn learn_lengths(&mut self, number: usize, item: &ResolvedPrimitive<'_>) {
        for (port, list) in item.lists() {
            let port = item.spec().inputs.get(port).map(|port| port.ty);
            if let (Some(PortType::Many(length)), Some(open)) = (port, self.open.get_mut(number)) {
                open.learn_length(length, u16::try_from(list.count).unwrap_or(0));
            }
        }
        for (input_source, port) in item.inputs.iter().zip(item.spec().inputs) {
            // An array that is left to its default has one element.
            if let (InputSource::Default(_), PortType::Array(_, length)) = (input_source, port.ty)
                && let Some(open) = self.open.get_mut(number)
            {
                open.learn_length(length, 1);
            }
        }
        for (given, parameter) in item.parameters.iter().zip(item.spec().parameters) {
            let ParameterKind::Length(dim) = parameter.kind else {
                continue;
            };
            let given = given.and_then(Literal::number);
            let default = match parameter.default {
                Some(rcc_core::primitive::DefaultValue::Int(length)) => Some(length as f64),
                _ => None,
            };
            // A length out of 1 to the maximum is reported as out of range.
            let length = given.or(default).map_or(0, |length| length as u16);
            if let Some(open) = self.open.get_mut(number) {
                open.learn_length(Dim::Var(dim), length);
            }
        }
    }

    /// Learns what constants and initial values of delayed links determine.
    fn learn_certain(&mut self, number: usize, item: &ResolvedPrimitive<'_>) {
        for (literal, port, _) in super::literals(item) {
            if let Some(ty) = certain_port_type(literal, port) {
                self.learn(number, port, ty);
            }
        }
        for (port, link) in item.links() {
            let sink = item.spec().inputs.get(port);
            if let (Some(initial), Some(sink)) = (link.initial, sink)
                && let Some(ty) = certain_port_type(initial, sink.ty)
                && let Some(whole) = whole_of(link.position, sink.ty, ty)
            {
                self.learn(number, sink.ty, whole);
            }
        }
        for (port, list) in item.lists() {
            let Some(sink) = item.spec().inputs.get(port) else {
                continue;
            };
            for element in &list.elements {
                if let ListElement::Literal(literal, position) = element
                    && let Some(ty) = literal.certain_type()
                    && let Some(whole) = whole_of(*position, sink.ty, ty)
                {
                    self.learn(number, sink.ty, whole);
                }
            }
        }
    }

    /// Returns the type that an open port takes from its constants and lists if nothing else determines it.
    fn default_type(&self, item: &ResolvedPrimitive<'_>) -> Option<(PortType, Type)> {
        let literals = super::literals(item).filter(|(_, port, _)| port.is_open());
        let literals =
            literals.filter_map(|(literal, port, _)| Some((port, literal.default_type()?)));
        let input_sources = item.inputs.iter().zip(item.spec().inputs);
        let lists = input_sources.filter_map(|(input_source, port)| match input_source {
            InputSource::List(list) if port.ty.is_open() => {
                let types = list.elements.iter().filter_map(|element| match element {
                    ListElement::Literal(literal, position) => {
                        Some((*position, literal.default_type()?))
                    }
                    ListElement::Link(link) => Some((link.position, self.link_type(link)?)),
                });
                // A link determines a type, but a number may still be of another one, so Real comes last.
                let mut types: Vec<(ListPosition, Type)> = types.collect();
                types.sort_by_key(|(_, ty)| *ty == Type::Real);
                let mut types = types.into_iter();
                let whole = match port.ty {
                    // Each element is a value of its own.
                    PortType::Many(_) => types.next().map(|(_, ty)| ty),
                    _ => types.find_map(|(position, ty)| place_in(position, ty)),
                };
                Some((port.ty, whole?))
            }
            _ => None,
        });
        literals.chain(lists).next()
    }

    fn link_type(&self, link: &crate::resolve::ResolvedLink<'_>) -> Option<Type> {
        let port = super::port_of(self.graph, link.from)?.ty;
        let ty = self.type_at(PortSite {
            item: link.from.item,
            port,
        })?;
        match link.part {
            None => Some(ty),
            Some(part) => part.of(ty).map(|(_, ty)| ty),
        }
    }
}

/// Returns the type that a constant determines for a port: for an array at least the length.
fn certain_port_type(literal: &Literal, port: PortType) -> Option<Type> {
    match (port, &literal.shape) {
        (PortType::Array(ElementType::Are(element), _), LiteralShape::List(elements)) => {
            element.array(u16::try_from(elements.len()).ok()?)
        }
        (PortType::Many(_), _) => None,
        _ => literal.certain_type(),
    }
}

/// Returns the type of a port's whole value if the element at `position` of its list is a `ty`. Returns `None` if that
/// does not determine it: a list of three numbers may be an array or a vector.
fn whole_of(position: ListPosition, port: PortType, ty: Type) -> Option<Type> {
    let certain = matches!(port, PortType::Array(..) | PortType::Matrix(..));
    match port {
        _ if position == ListPosition::default() => Some(ty),
        PortType::Many(_) => Some(ty),
        _ if certain => place_in(position, ty),
        _ => None,
    }
}

/// Returns the array or matrix that has a `ty` at `position` of its list.
fn place_in(position: ListPosition, ty: Type) -> Option<Type> {
    let count = |count: u32| u8::try_from(count).ok();
    match (position.steps, ty) {
        ([Some((_, rows)), Some((_, columns))], _) => {
            Some(Type::Matrix(count(rows)?, count(columns)?))
        }
        ([Some((_, rows)), None], Type::Reals(columns)) => {
            Some(Type::Matrix(count(rows)?, u8::try_from(columns).ok()?))
        }
        ([Some((_, length)), None], _) => ty.array(u16::try_from(length).ok()?),
        _ => Some(ty),
    }
}
