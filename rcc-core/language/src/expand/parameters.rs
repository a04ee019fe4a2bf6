//! `$parameters`: what an instance sets, put where the fragment names it.
//! The loader's threads.

use std::collections::HashMap;

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::{Entry, Key, Node, Value};
use rcc_core::types::Type;

use crate::fault;
use crate::sources::Shift;
use crate::syntax::fragment::{Fragment, FragmentParameter};
use crate::syntax::literal::{self, Literal, Shape};
use crate::syntax::{Primitive, Timing};

/// The values of the parameters of an instance, by name.
#[derive(Debug, Default)]
pub struct Parameters<'a> {
    values: HashMap<&'a str, Literal>,
}

impl<'a> Parameters<'a> {
    /// What an instance sets, and the defaults of what it does not; what does not fit is reported and refused.
    pub fn bind(
        fragment: &'a Fragment,
        mut given: HashMap<&str, Literal>,
        shift: Shift,
        faults: &mut Vec<Diagnostic>,
    ) -> Parameters<'a> {
        let mut values = HashMap::new();
        for parameter in &fragment.parameters {
            let name = parameter.name.name.as_str();
            let default = || Some(shift.literal(parameter.default.as_ref()?));
            // What is missing is reported where the fragment is used.
            let Some(mut value) = given.remove(name).or_else(default) else {
                continue;
            };
            if let Err(fault) = fit(fragment, parameter, &mut value) {
                faults.push(*fault);
                value.shape = Shape::Refused;
            }
            values.insert(name, value);
        }
        Parameters { values }
    }

    /// A constant of the fragment with these values in it. Alone, a parameter keeps the place where it was set.
    pub fn fill(&self, constant: &Literal, shift: Shift, faults: &mut Vec<Diagnostic>) -> Literal {
        let Shape::Open(node) = &constant.shape else {
            return shift.literal(constant);
        };
        let refused = Literal::new(Shape::Refused, shift.span(constant.span));
        if let Some(name) = name_of(node) {
            return self.values.get(name).cloned().unwrap_or(refused);
        }
        let mut node = node.clone();
        shift.node(&mut node);
        match self.fill_node(&mut node) {
            Some(()) => literal::read(&node, faults),
            None => refused,
        }
    }

    fn fill_node(&self, node: &mut Node) -> Option<()> {
        if let Some(name) = name_of(node) {
            node.value = value_of(self.values.get(name)?, node.span)?;
            return Some(());
        }
        match &mut node.value {
            Value::List(nodes) => nodes.iter_mut().try_for_each(|node| self.fill_node(node)),
            Value::Map(entries) => {
                let mut values = entries.iter_mut().map(|entry| &mut entry.value);
                values.try_for_each(|node| self.fill_node(node))
            }
            _ => Some(()),
        }
    }
}

/// `gain` of `$gain`.
fn name_of(node: &Node) -> Option<&str> {
    node.text()?.strip_prefix('$')
}

/// A constant as it would be written; `None`: it was refused.
fn value_of(literal: &Literal, span: Span) -> Option<Value> {
    let number = |value: &f64| Node {
        value: Value::Real(*value),
        span,
    };
    let entry = |name: &str, values: &[f64]| Entry {
        key: Key {
            name: name.to_owned(),
            span,
        },
        value: Node {
            value: Value::List(values.iter().map(number).collect()),
            span,
        },
    };
    Some(match &literal.shape {
        Shape::Null => Value::Null,
        Shape::Bool(value) => Value::Bool(*value),
        Shape::Int(value) => Value::Int(*value),
        Shape::Real(value, None) => Value::Real(*value),
        Shape::Real(value, Some(unit)) => Value::Text(format!("{value} {unit}")),
        Shape::Text(text) => Value::Text(text.clone()),
        Shape::Rotation(quat) => Value::Map(vec![entry("quat", quat)]),
        Shape::Pose([x, y, z, quat @ ..]) => {
            Value::Map(vec![entry("xyz", &[*x, *y, *z]), entry("quat", quat)])
        }
        Shape::List(elements) => {
            let nodes = elements.iter().map(|element| {
                let value = value_of(element, span)?;
                Some(Node { value, span })
            });
            Value::List(nodes.collect::<Option<_>>()?)
        }
        _ => return None,
    })
}

/// A value is of the parameter's type and unit; a bare number gets the unit.
fn fit(
    fragment: &Fragment,
    parameter: &FragmentParameter,
    value: &mut Literal,
) -> Result<(), Box<Diagnostic>> {
    let what = format!(
        "`{}` of the fragment `{}`",
        parameter.name.name, fragment.name.name
    );
    if value.is_refused() {
        return Ok(());
    }
    if let Some((ty, _)) = parameter.ty {
        let fits = match ty {
            Type::Text => matches!(value.shape, Shape::Text(_)),
            ty => value.stored(ty).is_some(),
        };
        if !fits {
            let message = format!("type mismatch: {what} is a {ty}, this is {value}");
            let fault = Diagnostic::error(fault::TYPE_MISMATCH, value.span, message);
            return Err(Box::new(fault.help_if(said(&parameter.description))));
        }
    }
    let Some((unit, _)) = parameter.unit else {
        return Ok(());
    };
    if let Some((have, span)) = value.units().into_iter().find(|(have, _)| *have != unit) {
        let message = format!("unit mismatch: {what} is in {unit}, this is in {have}");
        let fault = Diagnostic::error(fault::UNIT_MISMATCH, span, message);
        return Err(Box::new(fault.help_if(said(&parameter.description))));
    }
    if let Some(number) = value.number() {
        *value = Literal::new(Shape::Real(number, Some(unit)), value.span);
    }
    Ok(())
}

/// A description as a remedy.
fn said(description: &str) -> Option<String> {
    (!description.is_empty()).then(|| description.to_owned())
}

/// All constants of a primitive.
pub fn constants(primitive: &Primitive) -> impl Iterator<Item = &Literal> {
    let parameters = primitive.parameters.iter().map(|(_, literal)| literal);
    let inputs = primitive.inputs.iter().map(|(_, source)| source);
    let sources = inputs.chain(&primitive.active);
    let sources = sources.flat_map(|source| source.constants());
    parameters.chain(sources)
}

/// True if a primitive has constants with parameters in them.
pub fn any_in(primitive: &Primitive) -> bool {
    let mut constants = constants(primitive);
    constants.any(|literal| matches!(literal.shape, Shape::Open(_)))
}

/// The parameters that a constant names, with their places.
pub fn named_in<'n>(literal: &'n Literal, names: &mut Vec<(&'n str, Span)>) {
    if let Shape::Open(node) = &literal.shape {
        named_in_node(node, names);
    }
}

fn named_in_node<'n>(node: &'n Node, names: &mut Vec<(&'n str, Span)>) {
    match &node.value {
        Value::Text(_) => names.extend(name_of(node).map(|name| (name, node.span))),
        Value::List(nodes) => nodes.iter().for_each(|node| named_in_node(node, names)),
        Value::Map(entries) => {
            let nodes = entries.iter().map(|entry| &entry.value);
            nodes.for_each(|node| named_in_node(node, names));
        }
        _ => {}
    }
}

/// A fault: there is no such parameter here.
pub fn unknown(name: &str, span: Span, help: String) -> Diagnostic {
    let message = format!("`${name}` is no parameter of a fragment around it");
    Diagnostic::error(fault::NO_SUCH_PARAMETER, span, message).help(help)
}

/// The period of a net is no parameter of a fragment.
pub fn refuse_in_timing(timing: &mut Timing, faults: &mut Vec<Diagnostic>) {
    for place in [&mut timing.period, &mut timing.rate, &mut timing.phase] {
        let mut names = Vec::new();
        let Some(literal) = place else { continue };
        named_in(literal, &mut names);
        let found = names
            .iter()
            .map(|(name, span)| unknown(name, *span, "write the value".to_owned()));
        let before = faults.len();
        faults.extend(found);
        if faults.len() > before {
            *place = None;
        }
    }
}
