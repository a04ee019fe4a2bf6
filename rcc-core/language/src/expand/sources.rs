//! Sources in the expanded net: links into and out of instances lead to the primitives behind them. Runs on the loader's
//! threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_config::yaml::Key;

use super::body::{Body, ReferenceTarget};
use super::{DEPTH_MAX, Expander, Scope, elements, source_weight};
use crate::codes;
use crate::source_map::SpanShift;
use crate::syntax::fragment::FragmentInput;
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::part::ValuePart;
use crate::syntax::reference::Reference;
use crate::syntax::{Link, List, Outcomes, Primitive, PrimitiveKind, Source};

/// A source, and the declarations of the fragment inputs that it passes through.
pub type FedSource<'a> = (Source, Vec<(&'a FragmentInput, SpanShift)>);

impl<'a> Expander<'a, '_> {
    pub(super) fn source(
        &mut self,
        source: &'a Source,
        body: &'a Body<'a>,
        scope: &Scope<'a>,
    ) -> FedSource<'a> {
        let link = match source {
            // The formula pass has replaced every formula.
            Source::Formula(_) | Source::Refused => return (Source::Refused, Vec::new()),
            Source::Literal(literal) => {
                let literal = scope
                    .parameters
                    .fill(literal, scope.shift, self.diagnostics);
                let source = match literal.is_refused() {
                    true => Source::Refused,
                    false => Source::Literal(literal),
                };
                return (source, Vec::new());
            }
            Source::List(list) => {
                let elements = list.elements.iter();
                let elements = elements.map(|element| self.source(element, body, scope).0);
                let list = List {
                    elements: elements.collect(),
                    span: scope.shift.span(list.span),
                };
                return (Source::List(list), Vec::new());
            }
            Source::Outcomes(outcomes) => {
                let rows = outcomes.rows.iter().map(|(name, condition)| {
                    let (condition, _) = self.source(condition, body, scope);
                    (scope.shift.key(name), condition)
                });
                let outcomes = Outcomes {
                    rows: rows.collect(),
                    span: scope.shift.span(outcomes.span),
                };
                return (Source::Outcomes(outcomes), Vec::new());
            }
            Source::Link(link) => Link {
                initial: link.initial.as_deref().map(|literal| {
                    let parameters = &scope.parameters;
                    Box::new(parameters.fill(literal, scope.shift, self.diagnostics))
                }),
                span: scope.shift.span(link.span),
                ..link.clone()
            },
        };
        if let ReferenceTarget::Input(input) = self.bodies.target(body, &link.from) {
            let Some(bound) = scope.inputs.get(input.name.name.as_str()) else {
                return (Source::Refused, Vec::new());
            };
            let declarations = match link.from.part {
                None => bound.declarations.clone(),
                Some(_) => Vec::new(),
            };
            return (self.through(&bound.source, link, scope), declarations);
        }
        let from = self.output(body, scope, &link.from);
        let source = from.map_or(Source::Refused, |from| Source::Link(Link { from, ..link }));
        (source, Vec::new())
    }

    /// Resolves a link from an input of a fragment, given the source `outside` that the instance connects to that
    /// input.
    ///
    /// A list is copied wherever the fragment reads it, so its elements count towards the size of the expanded net. A
    /// single link or number is in the weight of the primitive that reads it.
    fn through(&mut self, outside: &Source, inside: Link, scope: &Scope<'_>) -> Source {
        let copied = copied_elements(outside, &inside);
        if copied > 0 && !self.add(copied, inside.span) {
            return Source::Refused;
        }
        match outside {
            Source::Formula(_) | Source::Refused => Source::Refused,
            Source::Literal(literal) if inside.delayed => {
                // In the first cycle the delayed link carries its initial value instead of the constant.
                let from = self.constant(literal, &inside.from, scope);
                Source::Link(Link { from, ..inside })
            }
            Source::List(list) => match inside.from.part {
                None if inside.delayed => {
                    let message = format!("`{}` is a list and cannot be delayed", inside.from);
                    let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, inside.span, message);
                    self.diagnostics.push(
                        diagnostic
                            .help("delay the links in the list that the instance is connected to"),
                    );
                    Source::Refused
                }
                None => Source::List(list.clone()),
                Some(ValuePart::Element(index)) if (index as usize) < list.elements.len() => {
                    let mut whole = inside;
                    whole.from.part = None;
                    self.through(&list.elements[index as usize], whole, scope)
                }
                Some(_) => {
                    let what = format!("a list of {}", list.elements.len());
                    self.no_element(&inside, &what)
                }
            },
            Source::Outcomes(outcomes) => match inside.from.part {
                None if inside.delayed => {
                    let message = format!("`{}` are outcomes and cannot be delayed", inside.from);
                    let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, inside.span, message);
                    self.diagnostics.push(
                        diagnostic.help("delay the conditions that the instance is connected to"),
                    );
                    Source::Refused
                }
                None => Source::Outcomes(outcomes.clone()),
                Some(_) => self.no_element(&inside, "named outcomes"),
            },
            Source::Literal(literal) => match (inside.from.part, &literal.shape) {
                (None, _) => Source::Literal(literal.clone()),
                (Some(ValuePart::Element(index)), LiteralShape::List(elements))
                    if (index as usize) < elements.len() =>
                {
                    Source::Literal(elements[index as usize].clone())
                }
                (Some(_), _) => self.no_element(&inside, &literal.to_string()),
            },
            Source::Link(link) => {
                if link.from.part.is_some() && inside.from.part.is_some() {
                    return self.no_element(&inside, &format!("`{}`", link.from));
                }
                if link.delayed && inside.delayed {
                    let from = &inside.from;
                    let message = format!("`{from}` is delayed here and at the instance");
                    let diagnostic = Diagnostic::error(codes::DELAYED_TWICE, inside.span, message);
                    self.diagnostics.push(diagnostic);
                    return Source::Refused;
                }
                let mut link = link.clone();
                link.from.part = link.from.part.or(inside.from.part);
                link.delayed |= inside.delayed;
                link.initial = link.initial.or(inside.initial);
                Source::Link(link)
            }
        }
    }

    fn no_element(&mut self, inside: &Link, outside: &str) -> Source {
        let from = &inside.from;
        let message = format!("`{from}` does not exist: the instance is connected to {outside}");
        let diagnostic = Diagnostic::error(codes::BAD_ELEMENT, inside.span, message);
        self.diagnostics.push(
            diagnostic.help("connect the instance to a list or an array that has this element"),
        );
        Source::Refused
    }

    /// Returns a `Constant` primitive for a constant, one for each input of an instance.
    fn constant(&mut self, literal: &Literal, from: &Reference, scope: &Scope<'_>) -> Reference {
        let key = |name: &str| Key {
            name: name.into(),
            span: literal.span,
        };
        // The id is unused: inputs and primitives of a fragment have different names.
        let id = format!("{}{}", scope.path, from.primitive);
        if self.constants.insert(id.clone()) {
            let constant = Primitive {
                id: key(&id),
                kind: PrimitiveKind::Type,
                type_name: key("Constant"),
                parameters: vec![(key("value"), literal.clone())],
                inputs: Vec::new(),
                active: None,
            };
            self.push(constant, None);
        }
        Reference {
            primitive: id.into(),
            port: "out".into(),
            ..scope.shift.reference(from)
        }
    }

    /// Returns the output of the expanded net that a reference to a primitive or an instance resolves to.
    pub(super) fn output(
        &mut self,
        body: &'a Body<'a>,
        scope: &Scope<'a>,
        reference: &Reference,
    ) -> Option<Reference> {
        let mut found = scope.named(reference);
        let (mut body, mut at, mut path) = (body, reference, scope.path.clone());
        for _ in scope.depth..=DEPTH_MAX {
            let (instance, output) = match self.bodies.target(body, at) {
                ReferenceTarget::Primitive => {
                    found.primitive = format!("{path}{}", at.primitive).into();
                    found.port.clone_from(&at.port);
                    return Some(found);
                }
                ReferenceTarget::Instance(instance, output) => (instance, output),
                ReferenceTarget::Input(_) | ReferenceTarget::Refused => return None,
            };
            if found.part.is_some() && output.from.part.is_some() {
                let message = format!(
                    "`{}.{}` already selects an element",
                    instance.id.name, output.name.name
                );
                let diagnostic = Diagnostic::error(codes::BAD_ELEMENT, found.span, message);
                self.diagnostics.push(diagnostic.help("remove the index"));
                return None;
            }
            found.part = found.part.or(output.from.part);
            path.push_str(&instance.id.name);
            path.push('/');
            (body, _) = self.bodies.body_of(instance)?;
            at = &output.from;
        }
        None
    }
}

/// Returns the size of the list that a link to an input copies: the source of the input as a whole, or a row of a constant
/// matrix; 0 for a single link or number.
fn copied_elements(outside: &Source, inside: &Link) -> usize {
    match (outside, inside.from.part) {
        (Source::List(_) | Source::Outcomes(_), None) => source_weight(outside),
        (Source::Literal(literal), part) => match (&literal.shape, part) {
            (LiteralShape::List(_), None) => elements(literal),
            (LiteralShape::List(rows), Some(ValuePart::Element(row))) => {
                let row = rows.get(row as usize);
                let row = row.filter(|row| matches!(row.shape, LiteralShape::List(_)));
                row.map_or(0, elements)
            }
            _ => 0,
        },
        _ => 0,
    }
}
