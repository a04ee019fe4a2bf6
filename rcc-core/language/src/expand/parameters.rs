//! `$parameters`: substitutes the values that an instance sets into the constants of its fragment. Runs on the loader's
//! threads.

use std::collections::HashMap;

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::{Entry, Key, Node, Value};
use rcc_core::types::Type;

use crate::codes;
use crate::parse::literal;
use crate::source_map::SpanShift;
use crate::syntax::fragment::{Fragment, FragmentParameter};
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::{Primitive, Source, Timing};

/// The values of the parameters of an instance, by name.
#[derive(Debug, Default)]
pub struct Parameters<'a> {
    values: HashMap<&'a str, Literal>,
}

impl<'a> Parameters<'a> {
    /// Binds the values that an instance sets, and the defaults of the others. A value of the wrong type or unit is
    /// reported and refused.
    pub fn bind(
        fragment: &'a Fragment,
        mut given: HashMap<&str, Literal>,
        shift: SpanShift,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Parameters<'a> {
        let mut values = HashMap::new();
        for parameter in &fragment.parameters {
            let name = parameter.name.name.as_str();
            let default = || Some(shift.literal(parameter.default.as_ref()?));
            // A missing parameter is reported where the fragment is used.
            let Some(mut value) = given.remove(name).or_else(default) else {
                continue;
            };
            if let Err(diagnostic) = fit(fragment, parameter, &mut value) {
                diagnostics.push(*diagnostic);
                value.shape = LiteralShape::Refused;
            }
            values.insert(name, value);
        }
        Parameters { values }
    }

    /// Substitutes the parameters in a constant of the fragment. A constant that is nothing but a parameter keeps the
    /// span of the value that the instance sets.
    pub fn fill(
        &self,
        constant: &Literal,
        shift: SpanShift,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Literal {
        let LiteralShape::Parameterised(node) = &constant.shape else {
            return shift.literal(constant);
        };
        let refused = Literal::new(LiteralShape::Refused, shift.span(constant.span));
        if let Some(name) = name_of(node) {
            return self.values.get(name).cloned().unwrap_or(refused);
        }
        let mut node = node.clone();
        shift.node(&mut node);
        match self.fill_node(&mut node) {
            Some(()) => literal::read(&node, diagnostics),
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

/// Returns `gain` for `$gain`.
fn name_of(node: &Node) -> Option<&str> {
    node.text()?.strip_prefix('$')
}

/// Returns the node that a constant would be read from; `None` if the constant was refused.
fn value_of(literal: &Literal, span: Span) -> Option<Value> {
    let number = |value: &f64| Node {
        value: Value::Real(*value),
        span,
    };
    let entry = |name: &str, values: &[f64]| Entry {
        key: Key {
            name: name.into(),
            span,
        },
        value: Node {
            value: Value::List(values.iter().map(number).collect()),
            span,
        },
    };
    Some(match &literal.shape {
        LiteralShape::Null => Value::Null,
        LiteralShape::Bool(value) => Value::Bool(*value),
        LiteralShape::Int(value) => Value::Int(*value),
        LiteralShape::Real(value, None) => Value::Real(*value),
        LiteralShape::Real(value, Some(unit)) => Value::Text(format!("{value} {unit}").into()),
        LiteralShape::Text(text) => Value::Text(text.as_str().into()),
        LiteralShape::Rotation(quat) => Value::Map(vec![entry("quat", quat)]),
        LiteralShape::Pose([x, y, z, quat @ ..]) => {
            Value::Map(vec![entry("xyz", &[*x, *y, *z]), entry("quat", quat)])
        }
        LiteralShape::List(elements) => {
            let nodes = elements.iter().map(|element| {
                let value = value_of(element, span)?;
                Some(Node { value, span })
            });
            Value::List(nodes.collect::<Option<_>>()?)
        }
        _ => return None,
    })
}

/// Checks a value against the type and unit of the parameter; a bare number takes the unit.
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
            Type::Text => matches!(value.shape, LiteralShape::Text(_)),
            ty => value.stored(ty).is_some(),
        };
        if !fits {
            let message = format!("type mismatch: {what} expects {ty}, found {value}");
            let diagnostic = Diagnostic::error(codes::TYPE_MISMATCH, value.span, message);
            return Err(Box::new(
                diagnostic.help_if(description_as_help(&parameter.description)),
            ));
        }
    }
    let Some((unit, _)) = parameter.unit else {
        return Ok(());
    };
    if let Some((have, span)) = value.units().into_iter().find(|(have, _)| *have != unit) {
        let message = format!("unit mismatch: {what} expects {unit}, found {have}");
        let diagnostic = Diagnostic::error(codes::UNIT_MISMATCH, span, message);
        return Err(Box::new(
            diagnostic.help_if(description_as_help(&parameter.description)),
        ));
    }
    if let Some(number) = value.number() {
        *value = Literal::new(LiteralShape::Real(number, Some(unit)), value.span);
    }
    Ok(())
}

/// Returns a description as help text; `None` if it is empty.
fn description_as_help(description: &str) -> Option<String> {
    (!description.is_empty()).then(|| description.to_owned())
}

/// Returns all constants of a primitive.
pub fn constants(primitive: &Primitive) -> impl Iterator<Item = &Literal> {
    let parameters = primitive.parameters.iter().map(|(_, literal)| literal);
    let inputs = primitive.inputs.iter().map(|(_, source)| source);
    let sources = inputs.chain(&primitive.active);
    parameters.chain(sources.flat_map(Source::constants))
}

/// Returns true if a constant of the primitive contains parameters.
pub fn any_in(primitive: &Primitive) -> bool {
    let is_one = |literal: &Literal| matches!(literal.shape, LiteralShape::Parameterised(_));
    let mut any = primitive
        .parameters
        .iter()
        .any(|(_, literal)| is_one(literal));
    let sources = primitive.inputs.iter().map(|(_, source)| source);
    for source in sources.chain(&primitive.active) {
        source.for_each_constant(&mut |literal| any |= is_one(literal));
    }
    any
}

/// Collects the parameters that a constant refers to, with their spans.
pub fn named_in<'n>(literal: &'n Literal, names: &mut Vec<(&'n str, Span)>) {
    if let LiteralShape::Parameterised(node) = &literal.shape {
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

/// Returns the diagnostic of an unknown parameter.
pub fn unknown(name: &str, span: Span, help: String) -> Diagnostic {
    let message = format!("unknown parameter `${name}`: no enclosing fragment declares it");
    Diagnostic::error(codes::NO_SUCH_PARAMETER, span, message).help(help)
}

/// Refuses parameters in `period`, `rate` and `phase`: a net has no parameters.
pub fn refuse_in_timing(timing: &mut Timing, diagnostics: &mut Vec<Diagnostic>) {
    for place in [&mut timing.period, &mut timing.rate, &mut timing.phase] {
        let mut names = Vec::new();
        let Some(literal) = place else { continue };
        named_in(literal, &mut names);
        let found = names
            .iter()
            .map(|(name, span)| unknown(name, *span, "write the value".to_owned()));
        let before = diagnostics.len();
        diagnostics.extend(found);
        if diagnostics.len() > before {
            *place = None;
        }
    }
}
