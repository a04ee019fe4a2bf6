//! The values of the terms of expressions, and the primitives that compute them. Equal terms of a net or fragment are one
//! primitive (value numbering: Cocke and Schwartz, "Programming languages and their compilers", 1970). Runs on the
//! loader's threads.

use std::collections::HashMap;
use std::fmt::Write as _;

use rcc_config::diagnostic::Span;
use rcc_config::yaml::Key;
use rcc_core::primitive::{PortType, Spec};
use rcc_core::types::Type;

use super::fold::fold;
use super::functions::spec;
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::part::ValuePart;
use crate::syntax::reference::Reference;
use crate::syntax::{Link, List, Primitive, PrimitiveKind, Source};

/// Marks references to operations, which get their ids at the end. It is in no id.
const MARK: &str = "#";

/// The value of a term.
#[derive(Clone, Debug)]
pub enum Value {
    /// A constant, or a parameter of the fragment.
    Constant(Literal),
    /// An output, or an input of the fragment; delayed or not.
    Link(Link),
    /// A list with at least one link in it.
    List(Vec<(Value, Span)>),
    /// An output of an operation.
    Operation(OperationOutput),
    /// Refused; the error is reported.
    Refused,
}

/// An output of an operation, or a part of it.
#[derive(Clone, Debug)]
pub struct OperationOutput {
    /// The operation.
    pub number: usize,
    /// The output; `None` until one of several is named.
    pub port: Option<&'static str>,
    /// The part.
    pub part: Option<ValuePart>,
    /// Of the previous cycle.
    pub delayed: bool,
    /// Value in the first cycle.
    pub initial: Option<Box<Literal>>,
}

/// A primitive that stands for a term.
#[derive(Clone, Debug)]
pub struct Operation {
    /// The primitive; `None` for `*`.
    pub spec: Option<&'static Spec>,
    /// As written: `+`, `clamp`.
    pub symbol: String,
    /// Its inputs, in the order of the ports.
    pub inputs: Vec<(Value, Span)>,
    /// Span of the term.
    pub span: Span,
    /// Number of the primitive with the first expression that has this term.
    pub owner: usize,
    /// Id, if the term is a whole `Formula`.
    pub id: Option<String>,
}

/// The operations of a net or fragment.
#[derive(Debug, Default)]
pub struct Operations {
    /// The operations, each after its operands.
    pub all: Vec<Operation>,
    /// Whether the place of use determines type and unit of an operation; one for each of `all`.
    is_open: Vec<bool>,
    by_key: HashMap<String, usize>,
}

impl Operations {
    /// Returns the value of an operation: a constant if all operands are, the value of the same operation elsewhere, or
    /// that of a new one. An operation whose type and unit follow from its place of use is new at each place.
    pub fn value(&mut self, operation: Operation) -> Value {
        if let Some(folded) = folded(&operation) {
            return Value::Constant(folded);
        }
        let outputs = operation.spec.map_or(1, |spec| spec.outputs.len());
        let port = match operation.spec {
            _ if outputs != 1 => None,
            Some(spec) => spec.outputs.first().map(|port| port.name),
            None => Some("out"),
        };
        let next = self.all.len();
        let is_open = self.is_open(&operation);
        let number = match is_open {
            // `if a then 0 else 1` is a speed at one place and a time at another.
            true => next,
            false => *self.by_key.entry(key_of(&operation)).or_insert(next),
        };
        if number == next {
            self.all.push(operation);
            self.is_open.push(is_open);
        }
        Value::Operation(OperationOutput {
            number,
            port,
            part: None,
            delayed: false,
            initial: None,
        })
    }

    /// Returns true if all operands that are not truth values leave type and unit open.
    fn is_open(&self, operation: &Operation) -> bool {
        let is_truth = |index: usize| {
            let port = operation.spec.and_then(|spec| spec.inputs.get(index));
            port.is_some_and(|port| port.ty == PortType::Is(Type::Bool))
        };
        let operands = operation.inputs.iter().enumerate();
        let mut operands = operands.filter(|(index, _)| !is_truth(*index)).peekable();
        operands.peek().is_some() && operands.all(|(_, (value, _))| self.is_value_open(value))
    }

    /// Returns true for null, a number without a unit, a list of such values, and an operation on them alone. A
    /// parameter of the fragment may be one.
    fn is_value_open(&self, value: &Value) -> bool {
        match value {
            Value::Constant(literal) => is_constant_open(literal),
            Value::Operation(output) => self.is_open.get(output.number).copied().unwrap_or(false),
            Value::List(elements) => elements.iter().all(|(value, _)| self.is_value_open(value)),
            Value::Link(_) | Value::Refused => false,
        }
    }

    /// Returns the source of an input with this value.
    pub fn source(value: &Value, span: Span) -> Source {
        match value {
            Value::Constant(literal) => Source::Literal(literal.clone()),
            Value::Link(link) => Source::Link(Link {
                span,
                ..link.clone()
            }),
            Value::List(elements) => {
                let elements = elements.iter();
                let elements = elements.map(|(value, span)| Operations::source(value, *span));
                Source::List(List {
                    elements: elements.collect(),
                    span,
                })
            }
            Value::Operation(output) => Source::Link(Link {
                from: Reference {
                    primitive: format!("{MARK}{}", output.number).into(),
                    port: output.port.unwrap_or("").into(),
                    part: output.part,
                    span,
                    primitive_span: span,
                    port_span: span,
                },
                delayed: output.delayed,
                initial: output.initial.clone(),
                span,
            }),
            Value::Refused => Source::Refused,
        }
    }

    /// Returns the primitive of an operation.
    pub fn primitive(operation: &Operation, id: &str) -> Primitive {
        let key = |name: &str| Key {
            name: name.into(),
            span: operation.span,
        };
        let ports: Vec<&str> = match operation.spec {
            Some(spec) => spec.inputs.iter().map(|port| port.name).collect(),
            None => vec!["a", "b"],
        };
        let inputs = operation.inputs.iter().zip(ports);
        let inputs = inputs.map(|((value, span), port)| {
            let port = Key {
                name: port.into(),
                span: *span,
            };
            (port, Operations::source(value, *span))
        });
        Primitive {
            id: key(id),
            kind: match operation.spec {
                Some(_) => PrimitiveKind::Type,
                None => PrimitiveKind::Product,
            },
            type_name: key(operation.spec.map_or("Multiply", |spec| spec.name)),
            parameters: Vec::new(),
            inputs: inputs.collect(),
            active: None,
        }
    }
}

/// Returns the number of the operation that a link refers to, before it has an id.
pub fn marked(reference: &Reference) -> Option<usize> {
    reference.primitive.strip_prefix(MARK)?.parse().ok()
}

fn folded(operation: &Operation) -> Option<Literal> {
    let constants = operation.inputs.iter().map(|(value, _)| match value {
        Value::Constant(literal) => Some(&literal.shape),
        _ => None,
    });
    let constants: Vec<&LiteralShape> = constants.collect::<Option<_>>()?;
    let spec = operation.spec.unwrap_or_else(|| spec("Multiply"));
    let shape = fold(spec, &constants)?;
    Some(Literal::new(shape, operation.span))
}

fn is_constant_open(literal: &Literal) -> bool {
    match &literal.shape {
        LiteralShape::Null
        | LiteralShape::Int(_)
        | LiteralShape::Real(_, None)
        | LiteralShape::Parameterised(_) => true,
        LiteralShape::List(elements) => elements.iter().all(is_constant_open),
        _ => false,
    }
}

/// Returns a text that is the same for equal operations only.
fn key_of(operation: &Operation) -> String {
    let mut key = operation.spec.map_or("*", |spec| spec.name).to_owned();
    for (value, _) in &operation.inputs {
        key.push('(');
        write_key(value, &mut key);
    }
    key
}

/// Writes a text that is the same for equal values only.
fn write_key(value: &Value, key: &mut String) {
    match value {
        Value::Constant(literal) => write_constant(literal, key),
        Value::Link(link) => {
            // Writing to a string never fails.
            let _ = write!(key, "{}", link.from);
            write_delay(link.delayed, link.initial.as_deref(), key);
        }
        Value::List(elements) => {
            key.push('[');
            for (element, _) in elements {
                write_key(element, key);
                key.push(',');
            }
            key.push(']');
        }
        Value::Operation(output) => {
            let port = output.port.unwrap_or("");
            let _ = write!(key, "{MARK}{}.{port}", output.number);
            if let Some(part) = output.part {
                let _ = write!(key, "{part}");
            }
            write_delay(output.delayed, output.initial.as_deref(), key);
        }
        Value::Refused => key.push('!'),
    }
}

fn write_delay(delayed: bool, initial: Option<&Literal>, key: &mut String) {
    if delayed {
        key.push('@');
    }
    if let Some(initial) = initial {
        write_constant(initial, key);
    }
}

fn write_constant(literal: &Literal, key: &mut String) {
    // Writing to a string never fails.
    let _ = match &literal.shape {
        LiteralShape::List(elements) => {
            key.push('[');
            for element in elements {
                write_constant(element, key);
                key.push(',');
            }
            key.push(']');
            Ok(())
        }
        LiteralShape::Real(value, unit) => write!(key, "={:x}{unit:?}", value.to_bits()),
        LiteralShape::Parameterised(node) => match node.text() {
            Some(text) => write!(key, "={text}"),
            None => write!(key, "={node:?}"),
        },
        shape => write!(key, "={shape:?}"),
    };
}
