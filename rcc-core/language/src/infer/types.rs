//! Types of ports: each item has one open type and a few open lengths, and links and literals tell what they are.
//! Linear in the number of links, and the same for the same text. The loader's threads.

use std::collections::VecDeque;

use rcc_core::linear::SIDE_MAX;
use rcc_core::primitive::{DIMS_MAX, Dim, Elements, ParameterKind, PortType, Spec};
use rcc_core::types::Type;

use crate::resolve::{Feed, Graph, Item, Leaf, Wire};
use crate::syntax::literal::{Literal, Shape};
use crate::syntax::part::{Part, Place};

/// What is known of the open type and the open lengths of one item.
#[derive(Clone, Copy, Debug, Default)]
pub struct Open {
    ty: Option<Type>,
    dims: [Option<u16>; DIMS_MAX],
}

impl Open {
    /// The open type.
    pub fn open(&self) -> Option<Type> {
        self.ty
    }

    /// The type of a port; `None` if it is not known.
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
                    Elements::Are(ty) => ty,
                    Elements::Open => self.ty?,
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

    /// A length; `None` if it is not known.
    pub fn dim(&self, dim: Dim) -> Option<u16> {
        let get = |index: u8| self.dims.get(usize::from(index)).copied().flatten();
        match dim {
            Dim::Is(length) => Some(length),
            Dim::Var(index) | Dim::Small(index) => get(index),
            Dim::Sum(a, b) => get(a)?.checked_add(get(b)?),
        }
    }

    /// Learns from the type that a port has; false if that says nothing new.
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
                    Elements::Are(element) if element != of => false,
                    Elements::Are(_) => self.learn_length(length, count),
                    Elements::Open => {
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

fn array_length(ty: Type) -> Option<u16> {
    match ty {
        Type::Reals(length) | Type::Bools(length) | Type::Ints(length) => Some(length),
        _ => None,
    }
}

/// A port of an item.
#[derive(Clone, Copy)]
struct At {
    item: usize,
    port: PortType,
}

/// A link: what a part of an output is, a place of an input is.
#[derive(Clone, Copy)]
struct Tie {
    source: At,
    part: Option<Part>,
    sink: At,
    place: Place,
}

/// Finds the open types and lengths of all items.
pub fn infer(graph: &Graph<'_>, joints: &[Option<u16>]) -> Vec<Open> {
    let mut solver = Solver {
        graph,
        joints,
        open: vec![Open::default(); graph.items.len()],
        ties: Vec::new(),
        users: vec![Vec::new(); graph.items.len()],
        queue: VecDeque::new(),
        backwards: false,
    };
    for (number, item) in graph.items.iter().enumerate() {
        for (port, wire) in item.wires() {
            let sink = item.spec().inputs.get(port);
            if let (Some(from), Some(sink)) = (super::port_of(graph, wire.from), sink) {
                solver.tie(Tie {
                    source: At {
                        item: wire.from.item,
                        port: from.ty,
                    },
                    part: wire.part,
                    sink: At {
                        item: number,
                        port: sink.ty,
                    },
                    place: wire.place,
                });
            }
        }
    }
    solver.solve();
    solver.open
}

struct Solver<'g, 'a> {
    graph: &'g Graph<'a>,
    /// By item: joints of its device.
    joints: &'g [Option<u16>],
    open: Vec<Open>,
    ties: Vec<Tie>,
    /// By item: the links that begin or end at it.
    users: Vec<Vec<usize>>,
    queue: VecDeque<usize>,
    backwards: bool,
}

impl Solver<'_, '_> {
    fn tie(&mut self, tie: Tie) {
        let number = self.ties.len();
        for item in [tie.source.item, tie.sink.item] {
            if let Some(users) = self.users.get_mut(item) {
                users.push(number);
            }
        }
        self.ties.push(tie);
    }

    /// Carries on what is known: first only from sources to sinks, so that a fault is found where two sources meet and
    /// not somewhere before, then in all directions. What is still open then is what is usual.
    fn solve(&mut self) {
        let items = self.graph.items.iter().enumerate();
        for pin in &self.graph.pins {
            let item = self.graph.items.get(pin.item);
            let port = item.and_then(|item| item.spec().inputs.get(pin.input));
            if let (Some(port), Some((ty, _))) = (port, pin.said.ty) {
                self.learn(pin.item, port.ty, ty);
            }
        }
        for (number, item) in items.clone() {
            if let Some(ty) = item.said_type() {
                self.learn(number, PortType::Any, ty);
            }
            self.learn_lengths(number, item);
        }
        self.run_all();
        for (number, item) in items.clone() {
            self.learn_firm(number, item);
        }
        self.run();
        self.backwards = true;
        self.run_all();
        for region in &self.graph.regions {
            let Feed::Wire(Wire {
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
        for (number, item) in items.clone() {
            if let Some((port, ty)) = self.usual(item) {
                self.learn(number, port, ty);
                self.run();
            }
        }
        for (number, item) in items {
            let open = item.spec().types().find(|port| port.is_open());
            if open.is_some() && self.open.get(number).is_some_and(|open| open.ty.is_none()) {
                self.decide(number, Type::Real);
                self.run();
            }
        }
    }

    fn run_all(&mut self) {
        self.queue.extend(0..self.ties.len());
        self.run();
    }

    fn run(&mut self) {
        while let Some(number) = self.queue.pop_front() {
            if let Some(tie) = self.ties.get(number).copied() {
                self.carry(tie);
            }
        }
    }

    fn type_at(&self, at: At) -> Option<Type> {
        let joints = self.joints.get(at.item).copied().flatten();
        self.open.get(at.item)?.port(joints, at.port)
    }

    fn carry(&mut self, tie: Tie) {
        let source = self.type_at(tie.source);
        let part = match tie.part {
            None => source,
            Some(part) => source.and_then(|ty| part.of(ty)).map(|(_, ty)| ty),
        };
        if let Some(ty) = part {
            if let Some(whole) = whole_of(tie.place, tie.sink.port, ty) {
                self.learn(tie.sink.item, tie.sink.port, whole);
            }
        } else if self.backwards
            && tie.part.is_none()
            && let Some(sink) = self.type_at(tie.sink)
            && let Some((_, ty)) = tie.place.of(sink)
        {
            self.learn(tie.source.item, tie.source.port, ty);
        }
    }

    fn learn(&mut self, number: usize, port: PortType, ty: Type) {
        let spec = self.graph.items.get(number).map(Item::spec);
        if let (Some(open), Some(spec)) = (self.open.get_mut(number), spec)
            && open.learn(spec, port, ty)
        {
            self.queue
                .extend(self.users.get(number).into_iter().flatten());
        }
    }

    fn decide(&mut self, number: usize, ty: Type) {
        if let Some(open) = self.open.get_mut(number) {
            open.ty = Some(ty);
            self.queue
                .extend(self.users.get(number).into_iter().flatten());
        }
    }

    /// The lengths that parameters and lists of values say.
    fn learn_lengths(&mut self, number: usize, item: &Item<'_>) {
        for (port, list) in item.lists() {
            let port = item.spec().inputs.get(port).map(|port| port.ty);
            if let (Some(PortType::Many(length)), Some(open)) = (port, self.open.get_mut(number)) {
                open.learn_length(length, u16::try_from(list.count).unwrap_or(0));
            }
        }
        for (given, parameter) in item.parameters.iter().zip(item.spec().parameters) {
            let ParameterKind::Length(dim) = parameter.kind else {
                continue;
            };
            let given = given.and_then(Literal::number);
            let default = match parameter.default {
                Some(rcc_core::primitive::Literal::Int(length)) => Some(length as f64),
                _ => None,
            };
            // A length that is none of 1 to the most is out of its range, which is reported.
            let length = given.or(default).map_or(0, |length| length as u16);
            if let Some(open) = self.open.get_mut(number) {
                open.learn_length(Dim::Var(dim), length);
            }
        }
    }

    /// What constants and first values of delayed links say for certain.
    fn learn_firm(&mut self, number: usize, item: &Item<'_>) {
        for (literal, port, _) in super::literals(item) {
            if let Some(ty) = firm(literal, port) {
                self.learn(number, port, ty);
            }
        }
        for (port, wire) in item.wires() {
            let sink = item.spec().inputs.get(port);
            if let (Some(initial), Some(sink)) = (wire.initial, sink)
                && let Some(ty) = firm(initial, sink.ty)
                && let Some(whole) = whole_of(wire.place, sink.ty, ty)
            {
                self.learn(number, sink.ty, whole);
            }
        }
        for (port, list) in item.lists() {
            let Some(sink) = item.spec().inputs.get(port) else {
                continue;
            };
            for leaf in &list.leaves {
                if let Leaf::Literal(literal, place) = leaf
                    && let Some(ty) = literal.firm_type()
                    && let Some(whole) = whole_of(*place, sink.ty, ty)
                {
                    self.learn(number, sink.ty, whole);
                }
            }
        }
    }

    /// The type that an open port gets from its constants and lists where nothing else decides.
    fn usual(&self, item: &Item<'_>) -> Option<(PortType, Type)> {
        let literals = super::literals(item).filter(|(_, port, _)| port.is_open());
        let literals =
            literals.filter_map(|(literal, port, _)| Some((port, literal.usual_type()?)));
        let feeds = item.inputs.iter().zip(item.spec().inputs);
        let lists = feeds.filter_map(|(feed, port)| match feed {
            Feed::List(list) if port.ty.is_open() => {
                let types = list.leaves.iter().filter_map(|leaf| match leaf {
                    Leaf::Literal(literal, place) => Some((*place, literal.usual_type()?)),
                    Leaf::Wire(wire) => Some((wire.place, self.wire_type(wire)?)),
                });
                // What a wire is says more than what a number may be.
                let mut types: Vec<(Place, Type)> = types.collect();
                types.sort_by_key(|(_, ty)| *ty == Type::Real);
                let whole = types.iter().find_map(|(place, ty)| place_in(*place, *ty));
                Some((port.ty, whole?))
            }
            _ => None,
        });
        literals.chain(lists).next()
    }

    fn wire_type(&self, wire: &crate::resolve::Wire<'_>) -> Option<Type> {
        let port = super::port_of(self.graph, wire.from)?.ty;
        let ty = self.type_at(At {
            item: wire.from.item,
            port,
        })?;
        match wire.part {
            None => Some(ty),
            Some(part) => part.of(ty).map(|(_, ty)| ty),
        }
    }
}

/// What a constant says for certain about a port: of an array at least the length.
fn firm(literal: &Literal, port: PortType) -> Option<Type> {
    match (port, &literal.shape) {
        (PortType::Array(Elements::Are(element), _), Shape::List(elements)) => {
            element.array(u16::try_from(elements.len()).ok()?)
        }
        (PortType::Many(_), _) => None,
        _ => literal.firm_type(),
    }
}

/// What the whole value of a port is if at `place` of its list there is a `ty`; `None` if that does not say it: a list of
/// three numbers may be an array or a vector.
fn whole_of(place: Place, port: PortType, ty: Type) -> Option<Type> {
    let certain = matches!(port, PortType::Array(..) | PortType::Matrix(..));
    match port {
        _ if place == Place::default() => Some(ty),
        PortType::Many(_) => Some(ty),
        _ if certain => place_in(place, ty),
        _ => None,
    }
}

/// The array or matrix that has a `ty` at `place` of its list.
fn place_in(place: Place, ty: Type) -> Option<Type> {
    let count = |count: u32| u8::try_from(count).ok();
    match (place.steps, ty) {
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
