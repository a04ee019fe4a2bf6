//! Resolves the inputs of primitives: links, lists and constants, and the outputs that references name. Runs on the
//! loader's threads.

use rcc_config::diagnostic::Span;
use rcc_config::yaml::Key;
use rcc_core::plan::OUTCOMES_MAX;
use rcc_core::primitive::{Port, PortType, Role, Spec};

use super::{
    IdTarget, InputSource, ListElement, OutputId, ResolvedLink, ResolvedList, ResolvedOutcomes,
    Resolver, given, is_known, suggest,
};
use crate::codes;
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::part::ListPosition;
use crate::syntax::reference::Reference;
use crate::syntax::{Link, List, Outcomes, Primitive, Source};

/// Returns `a/b/` of `a/b/id`: the instance that contains the primitive. Empty for the net itself.
fn scope_of(id: &str) -> &str {
    id.rfind('/').map_or("", |slash| &id[..=slash])
}

impl<'a> Resolver<'a, '_> {
    pub(super) fn inputs(
        &mut self,
        primitive: &'a Primitive,
        spec: &'static Spec,
    ) -> Vec<InputSource<'a>> {
        let mut has_unknown = false;
        let names = spec.inputs.iter().map(|port| port.name);
        for (place, (key, _)) in primitive.inputs.iter().enumerate() {
            if !is_known(place, key, names.clone()) {
                has_unknown = true;
                let names = names.clone();
                let is_parameter = spec.parameters.iter().any(|known| known.name == key.name);
                let help = self.suggestions.word(
                    &key.name,
                    "inputs",
                    names,
                    is_parameter.then_some("a parameter"),
                );
                self.unknown(codes::UNKNOWN_INPUT, key, spec, "input", help);
            }
        }
        let mut input_sources = Vec::with_capacity(spec.inputs.len());
        for (place, port) in spec.inputs.iter().enumerate() {
            input_sources.push(match given(&primitive.inputs, place, port.name) {
                Some(Source::Outcomes(outcomes)) => {
                    self.resolve_outcomes(outcomes, port, spec.role)
                }
                Some(source) => self.resolve_source(source, port),
                None => match port.default {
                    Some(default) => InputSource::Default(default),
                    // The missing input may be the one with the unknown name.
                    None if has_unknown => InputSource::Refused,
                    None => InputSource::Missing,
                },
            });
        }
        if has_unknown {
            let inputs = primitive.inputs.iter();
            self.count_inputs_as_read(inputs.filter(|(key, _)| spec.input(&key.name).is_none()));
        }
        input_sources
    }

    /// Counts the outputs that unknown inputs read as read, and reports unresolved references in them.
    pub(super) fn count_inputs_as_read(
        &mut self,
        inputs: impl IntoIterator<Item = &'a (Key, Source)>,
    ) {
        for (_, source) in inputs {
            self.count_elements_as_read(std::slice::from_ref(source));
        }
    }

    fn count_elements_as_read(&mut self, elements: &'a [Source]) {
        for element in elements {
            match element {
                Source::Link(link) => {
                    let output = self.output(&link.from);
                    self.counted_as_read.extend(output);
                }
                Source::List(list) => self.count_elements_as_read(&list.elements),
                Source::Outcomes(outcomes) => self.count_outcomes_as_read(outcomes),
                Source::Literal(_) | Source::Formula(_) | Source::Refused => {}
            }
        }
    }

    fn count_outcomes_as_read(&mut self, outcomes: &'a Outcomes) {
        for condition in outcomes.sources() {
            self.count_elements_as_read(std::slice::from_ref(condition));
        }
    }

    /// Resolves named conditions, which only a `Termination` takes.
    fn resolve_outcomes(
        &mut self,
        outcomes: &'a Outcomes,
        port: &Port,
        role: Role,
    ) -> InputSource<'a> {
        let count = outcomes.rows.len();
        if role != Role::Termination {
            self.count_outcomes_as_read(outcomes);
            let message = format!("`{}` cannot be connected to a mapping", port.name);
            let help = "connect an output, or a constant; a pose is `{xyz: …, rpy: …}`, a delayed link `{from: …, delayed: true}`; only `done` of a Termination takes conditions by name";
            self.error(
                codes::WRONG_SHAPE,
                outcomes.span,
                message,
                Some(help.to_owned()),
            );
            return InputSource::Refused;
        }
        if count > OUTCOMES_MAX as usize {
            self.count_outcomes_as_read(outcomes);
            let message =
                format!("the net has {count} outcomes, at most {OUTCOMES_MAX} are allowed");
            let help = "combine some of them with Or".to_owned();
            self.error(codes::NET_TOO_LARGE, outcomes.span, message, Some(help));
            return InputSource::Refused;
        }
        let mut conditions = Vec::with_capacity(count);
        for condition in outcomes.sources() {
            if matches!(condition, Source::List(_) | Source::Outcomes(_)) {
                // Reported when it was read.
                self.count_elements_as_read(std::slice::from_ref(condition));
                continue;
            }
            match self.resolve_source(condition, port) {
                InputSource::Link(link) => conditions.push(ListElement::Link(link)),
                InputSource::Literal(literal) => {
                    conditions.push(ListElement::Literal(literal, ListPosition::default()));
                }
                _ => {}
            }
        }
        if conditions.len() < count {
            // One is refused; the outputs that the others read count as read.
            let links = conditions.iter().filter_map(ListElement::link);
            self.counted_as_read.extend(links.map(|link| link.from));
            return InputSource::Refused;
        }
        InputSource::Outcomes(ResolvedOutcomes {
            names: outcomes
                .rows
                .iter()
                .map(|(name, _)| name.name.as_str())
                .collect(),
            conditions,
        })
    }

    pub(super) fn resolve_source(&mut self, source: &'a Source, port: &Port) -> InputSource<'a> {
        match source {
            Source::Formula(_) | Source::Refused => InputSource::Refused,
            Source::Outcomes(outcomes) => self.resolve_outcomes(outcomes, port, Role::Plain),
            Source::Literal(literal) => match (&literal.shape, port.ty) {
                (LiteralShape::List(values), PortType::Many(_)) if !values.is_empty() => {
                    InputSource::List(list_of_constants(values, literal.span))
                }
                (LiteralShape::Text(text), _) => {
                    let message =
                        format!("`{}` cannot be connected to the text `{text}`", port.name);
                    self.error(codes::WRONG_SHAPE, literal.span, message, None);
                    InputSource::Refused
                }
                _ => InputSource::Literal(literal),
            },
            Source::Link(link) => {
                let link = self.resolve_link(link, ListPosition::default());
                link.map_or(InputSource::Refused, InputSource::Link)
            }
            Source::List(list) => {
                let mut elements = Vec::new();
                if self.flatten_list(list, ListPosition::default(), &mut elements) {
                    InputSource::List(ResolvedList {
                        elements,
                        count: list.elements.len() as u32,
                        span: list.span,
                    })
                } else {
                    // The resolved links of a refused list count as read.
                    let links = elements.iter().filter_map(ListElement::link);
                    self.counted_as_read.extend(links.map(|link| link.from));
                    InputSource::Refused
                }
            }
        }
    }

    fn resolve_link(&mut self, link: &'a Link, position: ListPosition) -> Option<ResolvedLink<'a>> {
        Some(ResolvedLink {
            from: self.output(&link.from)?,
            part: link.from.part,
            position,
            delayed: link.delayed,
            initial: link
                .initial
                .as_deref()
                .filter(|initial| !initial.is_refused()),
            span: link.span,
            port_span: link.from.port_span,
        })
    }

    /// Flattens the elements of a list; returns false if one of them is refused.
    fn flatten_list(
        &mut self,
        list: &'a List,
        position: ListPosition,
        elements: &mut Vec<ListElement<'a>>,
    ) -> bool {
        // Longer and deeper lists are refused when they are read.
        let count = list.elements.len() as u32;
        let mut good = true;
        for (element, index) in list.elements.iter().zip(0u32..) {
            let Some(position) = position.inside(index, count) else {
                let message = "lists are nested at most twice: a matrix is a list of rows";
                self.error(codes::WRONG_SHAPE, list.span, message.to_string(), None);
                return false;
            };
            match element {
                Source::Link(link) => match self.resolve_link(link, position) {
                    Some(link) => elements.push(ListElement::Link(link)),
                    None => good = false,
                },
                Source::Literal(literal) => elements.push(ListElement::Literal(literal, position)),
                Source::List(list) => good &= self.flatten_list(list, position, elements),
                Source::Outcomes(outcomes) => {
                    self.count_outcomes_as_read(outcomes);
                    let message = "an element of a list cannot be a mapping of names".to_owned();
                    self.error(codes::WRONG_SHAPE, outcomes.span, message, None);
                    good = false;
                }
                Source::Formula(_) | Source::Refused => good = false,
            }
        }
        good
    }

    /// Returns the output that a reference names, or reports that there is none. The outputs of a suggested primitive
    /// count as read.
    pub(super) fn output(&mut self, reference: &Reference) -> Option<OutputId> {
        match self.ids.get(reference.primitive.as_str()).copied() {
            Some(IdTarget::Unknown) => None,
            Some(IdTarget::Item(item, spec)) => {
                if let Some((port, _)) = spec.output(&reference.port) {
                    return Some(OutputId { item, port });
                }
                let (name, port) = (spec.name, &reference.port);
                let (message, span) = if port.is_empty() {
                    let message = format!("`{reference}` is a primitive: name one of its outputs");
                    (message, reference.span)
                } else {
                    let message = format!("output not found: {name} has no output `{port}`");
                    (message, reference.port_span)
                };
                let help = self.suggestions.output(reference, spec);
                self.error(codes::UNKNOWN_OUTPUT, span, message, Some(help));
                self.count_as_read(item, spec);
                None
            }
            None => {
                self.unknown_primitive(reference);
                None
            }
        }
    }

    fn unknown_primitive(&mut self, reference: &Reference) {
        let primitives = self.net.primitives.iter();
        let ids = primitives.map(|primitive| primitive.id.name.as_str());
        let ids = ids.chain(self.instances.iter().map(String::as_str));
        // Suggest only ids of the same fragment instance.
        let scope = scope_of(&reference.primitive);
        let ids = ids.filter(|id| scope_of(id) == scope);
        let near = self.suggestions.near(&reference.primitive, ids);
        let target = near.and_then(|near| self.ids.get(near).copied());
        let help = match (near, target) {
            (Some(near), Some(IdTarget::Item(item, spec))) => {
                self.count_as_read(item, spec);
                suggest::primitive(near, &reference.port, spec)
            }
            (Some(near), _) => format!("did you mean `{near}`?"),
            (None, _) => "add it under `primitives`, or read another output".to_string(),
        };
        let place = if scope.is_empty() { "net" } else { "fragment" };
        let message = format!("the {place} has no primitive `{}`", reference.primitive);
        let span = reference.primitive_span;
        self.error(codes::UNKNOWN_PRIMITIVE, span, message, Some(help));
    }

    fn count_as_read(&mut self, item: usize, spec: &Spec) {
        let outputs = (0..spec.outputs.len()).map(|port| OutputId { item, port });
        self.counted_as_read.extend(outputs);
    }

    pub(super) fn discarded(&mut self) -> Vec<(OutputId, Span)> {
        let mut discarded = Vec::new();
        for reference in &self.net.discard {
            let target = self.ids.get(reference.primitive.as_str()).copied();
            let found = match target {
                Some(IdTarget::Unknown) => continue,
                Some(IdTarget::Item(item, spec)) => spec
                    .output(&reference.port)
                    .map(|(port, _)| OutputId { item, port }),
                None => None,
            };
            let message = match (found, reference.part) {
                (Some(output), None) => {
                    discarded.push((output, reference.span));
                    continue;
                }
                (Some(_), Some(_)) => "an output can only be discarded as a whole".to_string(),
                (None, _) => format!("unknown output `{reference}` in `discard`"),
            };
            let help = match (target, found) {
                (Some(IdTarget::Item(_, spec)), None) => self.suggestions.output(reference, spec),
                (_, Some(_)) => format!("write `{}.{}`", reference.primitive, reference.port),
                (_, None) => "remove it from `discard`".to_string(),
            };
            let help = Some(help);
            self.error(codes::BAD_DISCARD, reference.span, message, help);
        }
        discarded
    }
}

/// Returns a list of values in which every value is a constant. Where one value is expected, such a list is an array.
fn list_of_constants(values: &[Literal], span: Span) -> ResolvedList<'_> {
    // Longer lists are refused when they are read.
    let count = values.len() as u32;
    let positions = (0..count).filter_map(|index| ListPosition::default().inside(index, count));
    let elements = values.iter().zip(positions);
    ResolvedList {
        elements: elements
            .map(|(value, position)| ListElement::Literal(value, position))
            .collect(),
        count,
        span,
    }
}
