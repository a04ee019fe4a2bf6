//! `a * b` in a formula is `Multiply` for two numbers, and `Scale` for a number and a vector, array or matrix. Which of
//! them is decided after the expansion of fragments, from the types of the outputs that are multiplied. Runs on the
//! loader's threads.

use std::collections::HashMap;

use rcc_core::primitive::{ParameterKind, Port, PortType, Spec};
use rcc_core::primitives;

use crate::syntax::literal::LiteralShape;
use crate::syntax::part::ValuePart;
use crate::syntax::{Primitive, PrimitiveKind, Source};

/// Whether a value has several elements; `None` if its primitive does not determine it.
type IsWide = Option<bool>;

#[derive(Clone, Copy, PartialEq)]
enum Progress {
    New,
    Begun,
    Known(IsWide),
}

struct Widths<'a> {
    primitives: &'a [Primitive],
    by_id: HashMap<&'a str, usize>,
    /// Whether the open type has several elements, by primitive.
    open: Vec<Progress>,
}

/// Decides for every product of the net, whose fragments are expanded.
pub fn choose_products(primitives: &mut [Primitive]) {
    let is_product = |primitive: &Primitive| primitive.kind == PrimitiveKind::Product;
    if !primitives.iter().any(is_product) {
        return;
    }
    let by_id = primitives.iter().enumerate();
    let by_id = by_id.map(|(number, primitive)| (primitive.id.name.as_str(), number));
    let mut widths = Widths {
        by_id: by_id.collect(),
        open: vec![Progress::New; primitives.len()],
        primitives,
    };
    let mut wide = Vec::new();
    for (number, primitive) in primitives.iter().enumerate() {
        if is_product(primitive) {
            let mut operands = primitive.inputs.iter();
            let first = operands.next().map(|(_, source)| widths.settled(source));
            let second = operands.next().map(|(_, source)| widths.settled(source));
            wide.push((number, [first, second].map(Option::flatten)));
        }
    }
    for (number, operands) in wide {
        if let Some(primitive) = primitives.get_mut(number) {
            choose(primitive, operands);
        }
    }
}

fn choose(primitive: &mut Primitive, wide: [IsWide; 2]) {
    primitive.kind = PrimitiveKind::Type;
    let is_scale = match wide {
        [Some(true), second] => second != Some(true),
        [_, Some(true)] => {
            primitive.inputs.reverse();
            true
        }
        _ => false,
    };
    let (name, ports) = match is_scale {
        true => ("Scale", ["in", "factor"]),
        false => ("Multiply", ["a", "b"]),
    };
    primitive.type_name.name = name.into();
    for ((key, _), port) in primitive.inputs.iter_mut().zip(ports) {
        key.name = port.into();
    }
}

impl<'a> Widths<'a> {
    fn spec(&self, number: usize) -> Option<&'static Spec> {
        let primitive = self.primitives.get(number)?;
        let (_, entry) = primitives::find(&primitive.type_name.name)?;
        Some(&entry.spec)
    }

    /// Returns the width of a source, after that of every primitive that it depends on. Without recursion, because a net
    /// may be a chain of a hundred thousand primitives.
    fn settled(&mut self, source: &'a Source) -> IsWide {
        let mut path: Vec<usize> = self.depends_on(source).collect();
        while let Some(&number) = path.last() {
            match self.open.get(number) {
                Some(Progress::New) => {
                    self.open[number] = Progress::Begun;
                    let sources = self.determining(number);
                    let next = sources
                        .into_iter()
                        .flat_map(|source| self.depends_on(source));
                    let open = |next: &usize| self.open.get(*next) == Some(&Progress::New);
                    let next: Vec<usize> = next.filter(open).collect();
                    path.extend(next);
                }
                Some(Progress::Begun) => {
                    path.pop();
                    self.open[number] = Progress::Known(self.of_open_type(number));
                }
                _ => {
                    path.pop();
                }
            }
        }
        self.of(source)
    }

    /// Returns the primitive whose open type decides about a source.
    fn depends_on(&self, source: &Source) -> impl Iterator<Item = usize> + use<> {
        let number = match source {
            Source::Link(link) if part_is_wide(link.from.part).is_none() => {
                self.by_id.get(link.from.primitive.as_str()).copied()
            }
            _ => None,
        };
        number.into_iter()
    }

    /// Returns the sources of inputs of the open type.
    fn determining(&self, number: usize) -> Vec<&'a Source> {
        let Some(primitive) = self.primitives.get(number) else {
            return Vec::new();
        };
        let spec = self.spec(number);
        let is_open = |name: &str| match (primitive.kind, spec) {
            (PrimitiveKind::Product, _) => true,
            (_, Some(spec)) => spec.input(name).is_some_and(|(_, port)| is_open(port.ty)),
            (_, None) => false,
        };
        let inputs = primitive.inputs.iter();
        let inputs = inputs.filter(|(key, _)| is_open(&key.name));
        let elements = inputs.flat_map(|(key, source)| {
            let port = spec.and_then(|spec| spec.input(&key.name));
            let is_many = port.is_some_and(|(_, port)| matches!(port.ty, PortType::Many(_)));
            match source {
                Source::List(list) if is_many => list.elements.iter().collect(),
                source => vec![source],
            }
        });
        elements.collect()
    }

    fn of_open_type(&self, number: usize) -> IsWide {
        let primitive = self.primitives.get(number)?;
        let sources = self.determining(number);
        let mut widths = sources.into_iter().map(|source| self.of(source));
        if primitive.kind == PrimitiveKind::Product {
            let both: Vec<IsWide> = widths.collect();
            let wide = both.contains(&Some(true));
            return (wide || both.iter().all(|one| *one == Some(false))).then_some(wide);
        }
        widths
            .find(Option::is_some)
            .flatten()
            .or_else(|| self.of_parameters(number))
    }

    /// Returns the width that the parameters give the open type: a value of it, or its name.
    fn of_parameters(&self, number: usize) -> IsWide {
        let (primitive, spec) = (self.primitives.get(number)?, self.spec(number)?);
        primitive.parameters.iter().find_map(|(key, literal)| {
            let mut known = spec.parameters.iter();
            let parameter = known.find(|parameter| parameter.name == key.name)?;
            match (parameter.kind, &literal.shape) {
                (ParameterKind::Type, LiteralShape::Text(name)) => {
                    Some(!matches!(name.as_str(), "Bool" | "Int" | "Real"))
                }
                (ParameterKind::Value(ty, _), shape) if is_open(ty) => constant(shape),
                (ParameterKind::First(_), shape) => constant(shape),
                _ => None,
            }
        })
    }

    fn of(&self, source: &Source) -> IsWide {
        match source {
            Source::Literal(literal) => constant(&literal.shape),
            Source::List(_) => Some(true),
            Source::Link(link) => part_is_wide(link.from.part).or_else(|| {
                let number = *self.by_id.get(link.from.primitive.as_str())?;
                if self.primitives.get(number)?.kind == PrimitiveKind::Product {
                    return self.known(number);
                }
                let (_, port) = self.spec(number)?.output(&link.from.port)?;
                self.of_port(port, number)
            }),
            Source::Formula(_) | Source::Outcomes(_) | Source::Refused => None,
        }
    }

    fn of_port(&self, port: &Port, number: usize) -> IsWide {
        match port.ty {
            PortType::Is(ty) => Some(ty.width() > 1),
            PortType::Scalar | PortType::Number | PortType::Part => Some(false),
            PortType::Any | PortType::Linear | PortType::Many(_) => self.known(number),
            _ => Some(true),
        }
    }

    fn known(&self, number: usize) -> IsWide {
        match self.open.get(number)? {
            Progress::Known(wide) => *wide,
            _ => None,
        }
    }
}

fn is_open(ty: PortType) -> bool {
    matches!(
        ty,
        PortType::Any | PortType::Linear | PortType::Of(_) | PortType::Many(_)
    )
}

fn constant(shape: &LiteralShape) -> IsWide {
    match shape {
        LiteralShape::Bool(_) | LiteralShape::Int(_) | LiteralShape::Real(..) => Some(false),
        LiteralShape::List(_) | LiteralShape::Pose(_) | LiteralShape::Rotation(_) => Some(true),
        _ => None,
    }
}

/// Returns whether a part has several elements; `None` for the whole value.
fn part_is_wide(part: Option<ValuePart>) -> IsWide {
    match part? {
        ValuePart::Element(_) | ValuePart::Cell(..) => Some(false),
        ValuePart::Slice(..) | ValuePart::Row(_) => Some(true),
        ValuePart::Member(name) => Some(!matches!(name, "x" | "y" | "z" | "w")),
    }
}
