//! Evaluates the terms of an expression: names to outputs and inputs, operators and functions to operations. Runs on the
//! loader's threads.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use rcc_config::diagnostic::{Span, closest};
use rcc_config::yaml::{Node, Value as Tree};
use rcc_core::primitive::Spec;

use super::error::{ExpressionError, Problem};
use super::functions::spec;
use super::lexer::KEYWORDS;
use super::parser::{Application, Expression, Term, TermKind};
use super::places::Place;
use super::values::{Operation, OperationOutput, Operations, Value};
use super::{LIST_ELEMENTS_MAX, ListCount};
use crate::parse::reference;
use crate::syntax::Link;
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::part::ValuePart;
use crate::syntax::reference::Reference;

/// The named inputs of a `Formula`.
#[derive(Default)]
pub struct NamedInputs {
    pub values: HashMap<String, Value>,
    pub used: HashSet<String>,
}

/// An expression while its terms are evaluated.
pub struct Scope<'s> {
    pub inputs: &'s mut NamedInputs,
    pub place: Place,
    /// Number of the primitive with the expression.
    pub owner: usize,
    /// Values of the terms so far, with their spans.
    pub values: Vec<(Value, Span)>,
}

/// State that the terms of all expressions of one net or fragment share.
#[derive(Default)]
pub struct Terms {
    /// Inputs of the fragment.
    pub fragment_inputs: HashSet<String>,
    /// Ids of the net's own primitives.
    pub ids: HashSet<String>,
    /// Operations so far.
    pub operations: Operations,
    /// List elements so far.
    pub(super) lists: ListCount,
}

type Evaluated = Result<Value, ExpressionError>;

impl Terms {
    /// Evaluates the terms of an expression in their order.
    pub fn evaluate(
        &mut self,
        expression: &Expression,
        scope: &mut Scope<'_>,
    ) -> Result<(), ExpressionError> {
        for term in &expression.terms {
            let span = scope.place.at(&term.place);
            let value = self.term(term, span, scope)?;
            self.count_list(&value, term)?;
            scope.values.push((value, span));
        }
        let last = expression.terms.last();
        match (scope.values.last(), last) {
            (Some((value, _)), Some(term)) => needs_output(value, term, &self.operations),
            _ => Ok(()),
        }
    }

    /// Counts the elements of a term that is a list.
    fn count_list(&mut self, value: &Value, term: &Term) -> Result<(), ExpressionError> {
        let elements = &mut self.lists.elements;
        *elements = elements.saturating_add(list_elements(value));
        if *elements <= LIST_ELEMENTS_MAX {
            return Ok(());
        }
        let error = Problem::ListElements.at(term.place.clone());
        Err(error.help("name the list once: give it to a `Copy`, and read the output of that"))
    }

    fn term(&mut self, term: &Term, span: Span, scope: &mut Scope<'_>) -> Evaluated {
        match &term.kind {
            TermKind::Constant(shape) => Ok(constant(shape.clone(), span)),
            TermKind::Parameter(name) => {
                let node = Node {
                    value: Tree::Text(name.as_str().into()),
                    span,
                };
                Ok(constant(LiteralShape::Parameterised(Box::new(node)), span))
            }
            TermKind::Name(name) => self.name(name, term, span, scope.inputs),
            TermKind::Apply(application) => {
                let operands = scope.operands(&application.operands);
                self.application(application, operands, term, scope.owner, span)
            }
            TermKind::Product(a, b) => {
                let inputs = scope.operands(&[*a, *b]);
                self.have_outputs(&inputs, term)?;
                Ok(self.operations.value(Operation {
                    spec: None,
                    symbol: "*".to_owned(),
                    inputs,
                    span,
                    owner: scope.owner,
                    id: None,
                }))
            }
            TermKind::Previous(value, initial) => {
                let value = scope.operands(&[*value]).pop();
                let initial = initial.and_then(|initial| scope.operands(&[initial]).pop());
                self.previous(value, initial, term, scope.owner)
            }
            TermKind::List(elements) => {
                let elements = scope.operands(elements);
                self.have_outputs(&elements, term)?;
                Ok(list(elements, span))
            }
            TermKind::Part(value, part) => match scope.operands(&[*value]).pop() {
                Some((value, _)) => self.part(value, part, term),
                None => Ok(Value::Refused),
            },
        }
    }

    fn application(
        &mut self,
        application: &Application,
        inputs: Vec<(Value, Span)>,
        term: &Term,
        owner: usize,
        span: Span,
    ) -> Evaluated {
        self.have_outputs(&inputs, term)?;
        Ok(self.operations.value(Operation {
            spec: Some(application.spec),
            symbol: application.symbol.clone(),
            inputs,
            span,
            owner,
            id: None,
        }))
    }

    fn have_outputs(&self, values: &[(Value, Span)], term: &Term) -> Result<(), ExpressionError> {
        let mut values = values.iter();
        values.try_for_each(|(value, _)| needs_output(value, term, &self.operations))
    }

    /// Returns the value of a name: a named input or a part of it, an output, or an input of the fragment.
    fn name(&mut self, name: &str, term: &Term, span: Span, inputs: &mut NamedInputs) -> Evaluated {
        let end = name.find(['.', '[']).unwrap_or(name.len());
        let (first, part) = name.split_at(end);
        if let Some(value) = inputs.values.get(first).cloned() {
            inputs.used.insert(first.to_owned());
            return match part {
                "" => Ok(value),
                part => self.part(value, part, term),
            };
        }
        let reference = reference::parse(name, span);
        let Some(reference) = reference.filter(|_| !KEYWORDS.contains(&first)) else {
            let help = "write an output as `primitive.port`, a part of it as `primitive.port[index]`, `[from..to]`, `[row,column]`, `[row,..]`, `.x` or `.position`";
            let name = name.to_owned();
            return Err(Problem::Reference { name }
                .at(term.place.clone())
                .help(help));
        };
        if reference.port.is_empty() && !self.fragment_inputs.contains(first) {
            return Err(self.unknown_input(first, term.place.clone(), inputs));
        }
        Ok(Value::Link(link_to(reference, span)))
    }

    fn unknown_input(
        &self,
        name: &str,
        place: Range<usize>,
        inputs: &NamedInputs,
    ) -> ExpressionError {
        let mut known: Vec<&str> = inputs.values.keys().map(String::as_str).collect();
        known.extend(self.fragment_inputs.iter().map(String::as_str));
        known.sort_unstable();
        let help = match closest(name, known) {
            Some(near) => format!("did you mean `{near}`?"),
            None if self.ids.contains(name) => {
                format!("`{name}` is a primitive: name one of its outputs, as in `{name}.out`")
            }
            None => "add it under `inputs`, or name an output: `primitive.port`".to_owned(),
        };
        let name = name.to_owned();
        Problem::Input { name }.at(place).help(help)
    }

    /// Selects a part, or one of several outputs of a function.
    fn part(&mut self, value: Value, text: &str, term: &Term) -> Evaluated {
        let refused = || {
            let part = text.to_owned();
            Problem::Part { part }.at(term.place.clone())
        };
        if let Value::Operation(output) = &value
            && output.port.is_none()
        {
            let operation = self.operations.all.get(output.number);
            let spec = operation.and_then(|operation| operation.spec);
            let (name, rest) = split_member(text);
            let port = spec.and_then(|spec| spec.output(name));
            let Some((_, port)) = port else {
                return Err(refused().help(outputs_of(spec)));
            };
            let output = Value::Operation(OperationOutput {
                port: Some(port.name),
                ..output.clone()
            });
            return match rest {
                "" => Ok(output),
                rest => self.part(output, rest, term),
            };
        }
        let Some(part) = reference::part(text) else {
            return Err(refused().help("parts are `[index]`, `[from..to]`, `[row,column]`, `[row,..]`, `.x` and the like; a part has no parts"));
        };
        match (value, part) {
            (Value::Link(mut link), part) if link.from.part.is_none() => {
                link.from.part = Some(part);
                Ok(Value::Link(link))
            }
            (Value::Operation(output), part) if output.part.is_none() => {
                Ok(Value::Operation(OperationOutput {
                    part: Some(part),
                    ..output
                }))
            }
            (Value::List(elements), ValuePart::Element(index)) => {
                let element = elements.into_iter().nth(index as usize);
                element.map(|(value, _)| value).ok_or_else(refused)
            }
            (Value::Constant(literal), ValuePart::Element(index)) => match literal.shape {
                LiteralShape::List(elements) => {
                    let element = elements.into_iter().nth(index as usize);
                    element.map(Value::Constant).ok_or_else(refused)
                }
                _ => Err(refused()),
            },
            (Value::Refused, _) => Ok(Value::Refused),
            _ => Err(refused()),
        }
    }

    /// Returns the value of the previous cycle.
    fn previous(
        &mut self,
        value: Option<(Value, Span)>,
        initial: Option<(Value, Span)>,
        term: &Term,
        owner: usize,
    ) -> Evaluated {
        let initial = match initial {
            None => None,
            Some((Value::Constant(literal), _)) => Some(Box::new(literal)),
            Some((Value::Refused, _)) => return Ok(Value::Refused),
            Some(_) => return Err(Problem::Initial.at(term.place.clone())),
        };
        let Some((value, span)) = value else {
            return Ok(Value::Refused);
        };
        needs_output(&value, term, &self.operations)?;
        let copied = match value {
            Value::Link(link) if !link.delayed => {
                return Ok(Value::Link(Link {
                    delayed: true,
                    initial,
                    ..link
                }));
            }
            Value::Operation(ref output) if !output.delayed => value,
            Value::Refused => return Ok(Value::Refused),
            // A value that is not an output, or an output that is delayed already: a Copy gives it its own output.
            value => self.operations.value(Operation {
                spec: Some(spec("Copy")),
                symbol: "prev".to_owned(),
                inputs: vec![(value, span)],
                span,
                owner,
                id: None,
            }),
        };
        Ok(match copied {
            Value::Operation(output) => Value::Operation(OperationOutput {
                delayed: true,
                initial,
                ..output
            }),
            constant => constant,
        })
    }
}

impl Scope<'_> {
    fn operands(&self, numbers: &[usize]) -> Vec<(Value, Span)> {
        let values = numbers
            .iter()
            .map(|number| self.values.get(*number).cloned());
        values.flatten().collect()
    }
}

fn constant(shape: LiteralShape, span: Span) -> Value {
    Value::Constant(Literal::new(shape, span))
}

pub fn link_to(from: Reference, span: Span) -> Link {
    Link {
        from,
        delayed: false,
        initial: None,
        span,
    }
}

/// Returns a list: a constant if all its elements are.
fn list(elements: Vec<(Value, Span)>, span: Span) -> Value {
    let literals = elements.iter().map(|(value, _)| match value {
        Value::Constant(literal) => match literal.shape {
            LiteralShape::Parameterised(_) => None,
            _ => Some(literal.clone()),
        },
        _ => None,
    });
    match literals.collect::<Option<Vec<Literal>>>() {
        Some(literals) if !literals.is_empty() => constant(LiteralShape::List(literals), span),
        _ => Value::List(elements),
    }
}

/// Returns the number of elements of a list, those of nested lists included; 0 for a single value.
fn list_elements(value: &Value) -> usize {
    fn of_constant(literal: &Literal) -> usize {
        match &literal.shape {
            LiteralShape::List(elements) => elements.iter().map(|it| 1 + of_constant(it)).sum(),
            _ => 0,
        }
    }
    match value {
        Value::Constant(literal) => of_constant(literal),
        Value::List(elements) => {
            let elements = elements.iter();
            elements
                .map(|(element, _)| 1 + list_elements(element))
                .sum()
        }
        Value::Link(_) | Value::Operation(_) | Value::Refused => 0,
    }
}

/// Splits `.name` from what follows it.
fn split_member(text: &str) -> (&str, &str) {
    let name = text.strip_prefix('.').unwrap_or(text);
    let end = name.find(['.', '[']).unwrap_or(name.len());
    name.split_at(end)
}

fn outputs_of(spec: Option<&'static Spec>) -> String {
    let outputs = spec.map_or(&[][..], |spec| spec.outputs);
    let names: Vec<String> = outputs
        .iter()
        .map(|port| format!("`.{}`", port.name))
        .collect();
    format!("its outputs are {}", names.join(", "))
}

/// Requires that one of several outputs of a function is named.
fn needs_output(
    value: &Value,
    term: &Term,
    operations: &Operations,
) -> Result<(), ExpressionError> {
    let Value::Operation(output) = value else {
        return Ok(());
    };
    let operation = operations.all.get(output.number);
    match operation.filter(|_| output.port.is_none()) {
        None => Ok(()),
        Some(operation) => {
            let name = operation.symbol.clone();
            let error = Problem::Outputs { name }.at(term.place.clone());
            Err(error.help(format!(
                "name one after the call: {}",
                outputs_of(operation.spec)
            )))
        }
    }
}
