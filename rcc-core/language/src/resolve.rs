//! The resolve pass: types, devices, channels, parameters and links are looked up by name in the catalogue, the cell
//! and the net itself. Unresolved names are reported and left out, so that one error does not cause others. Runs on the
//! loader's threads.

mod cell;
mod suggest;

use std::collections::HashMap;

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::Key;
use rcc_core::plan::Rate;
use rcc_core::primitive::{
    CatalogueEntry, DefaultValue as Default, Parameter, ParameterKind, Port, Spec,
};
use rcc_core::primitives;
use rcc_core::unit::Unit;

use crate::codes;
use crate::devices::DeviceTable;
use crate::expand::{self, ExpandedNet};
use crate::rate;
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::part::{ListPosition, ValuePart};
use crate::syntax::reference::Reference;
use crate::syntax::{Link, Net, Primitive, Source};
use suggest::Suggestions;

/// A net whose names are resolved to indices. A resolved primitive is called an item.
pub struct NetGraph<'a> {
    /// The expanded net.
    pub net: &'a Net,
    /// The cell.
    pub cell: &'a DeviceTable,
    /// The cycles in which the net is evaluated.
    pub rate: Rate,
    /// Primitives of known type, in the order of the file.
    pub items: Vec<ResolvedPrimitive<'a>>,
    /// Discarded outputs with the spans of their references.
    pub discarded: Vec<(OutputId, Span)>,
    /// Outputs that count as read because fragments export them, or because unknown inputs or primitives read them.
    pub counted_as_read: Vec<OutputId>,
    /// Regions, outer ones first.
    pub regions: Vec<ResolvedRegion<'a>>,
    /// Declared types and units of fragment inputs.
    pub declarations: Vec<DeclaredInput<'a>>,
    /// True if the net has a primitive of unknown type, so that missing definitions may belong to it.
    pub has_unknown_types: bool,
}

/// Primitives that are evaluated only while a condition is true.
#[derive(Clone, Debug)]
pub struct ResolvedRegion<'a> {
    /// Id of the instance or primitive that has the condition.
    pub id: &'a Key,
    /// The condition.
    pub condition: InputSource<'a>,
    /// Index of the enclosing region.
    pub parent: Option<usize>,
}

/// The type and unit that a fragment declares for its input, applied to an input that it feeds.
#[derive(Clone, Copy, Debug)]
pub struct DeclaredInput<'a> {
    /// Index of the item.
    pub item: usize,
    /// Index of the input in its spec.
    pub input: usize,
    /// The declaration.
    pub declaration: &'a expand::InputDeclaration,
}

/// A primitive with its type, device and links resolved.
pub struct ResolvedPrimitive<'a> {
    /// As written.
    pub primitive: &'a Primitive,
    /// Index of its type in the catalogue.
    pub row: usize,
    /// Its entry in the catalogue.
    pub entry: &'static CatalogueEntry,
    /// Index of its device.
    pub device: Option<usize>,
    /// Index and unit of its channel.
    pub channel: Option<(u32, Unit)>,
    /// Sources, by input of the spec.
    pub inputs: Vec<InputSource<'a>>,
    /// Index of its innermost region.
    pub region: Option<usize>,
    /// By parameter of the spec; `None` if it is not given, or refused and reported.
    pub parameters: Vec<Option<&'a Literal>>,
}

/// The source of an input.
#[derive(Clone, Debug)]
pub enum InputSource<'a> {
    /// None, and the spec has no default.
    Missing,
    /// Refused; the error is reported.
    Refused,
    /// A link from an output.
    Link(ResolvedLink<'a>),
    /// A constant of the text.
    Literal(&'a Literal),
    /// The default of the spec.
    Default(Default),
    /// A list of links and constants.
    List(ResolvedList<'a>),
}

/// A list of links and constants, flattened: each element has its position.
#[derive(Clone, Debug)]
pub struct ResolvedList<'a> {
    /// Its elements; refused ones are left out.
    pub elements: Vec<ListElement<'a>>,
    /// Number of elements.
    pub count: u32,
    /// Span of the list.
    pub span: Span,
}

/// An element of a list.
#[derive(Clone, Copy, Debug)]
pub enum ListElement<'a> {
    /// A link from an output.
    Link(ResolvedLink<'a>),
    /// A constant and its position in the list.
    Literal(&'a Literal, ListPosition),
}

impl<'a> InputSource<'a> {
    /// Returns the links of the source.
    pub fn links(&self) -> impl Iterator<Item = &ResolvedLink<'a>> {
        let whole = match self {
            InputSource::Link(link) => Some(link),
            _ => None,
        };
        let elements = match self {
            InputSource::List(list) => list.elements.as_slice(),
            _ => &[],
        };
        let elements = elements.iter().filter_map(|element| match element {
            ListElement::Link(link) => Some(link),
            ListElement::Literal(..) => None,
        });
        whole.into_iter().chain(elements)
    }
}

/// A link from an output or from a part of its value.
#[derive(Clone, Copy, Debug)]
pub struct ResolvedLink<'a> {
    /// The output.
    pub from: OutputId,
    /// The selected part of the value; `None` for all of it.
    pub part: Option<ValuePart>,
    /// The position in the list at the target input.
    pub position: ListPosition,
    /// True if it carries the value of the previous cycle.
    pub delayed: bool,
    /// The initial value of a delayed link.
    pub initial: Option<&'a Literal>,
    /// Span of the link.
    pub span: Span,
    /// Span of the port's name.
    pub port_span: Span,
}

/// An output of an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct OutputId {
    /// Index of the item.
    pub item: usize,
    /// Index of the output in the spec.
    pub port: usize,
}

impl ResolvedPrimitive<'_> {
    /// Returns the spec.
    #[must_use]
    pub fn spec(&self) -> &'static Spec {
        &self.entry.spec
    }

    /// Returns the id.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.primitive.id.name
    }

    /// Returns the links to the item, each with the index of its input in the spec.
    pub fn links(&self) -> impl Iterator<Item = (usize, &ResolvedLink<'_>)> {
        let inputs = self.inputs.iter().enumerate();
        inputs.flat_map(|(port, input_source)| input_source.links().map(move |link| (port, link)))
    }

    /// Returns true if the stored past values start with a value other than null.
    #[must_use]
    pub fn has_known_initial_value(&self) -> bool {
        let mut rows = self.spec().parameters.iter().zip(&self.parameters);
        rows.any(|(parameter, given)| {
            let default = parameter
                .default
                .is_some_and(|value| value != Default::Null);
            let known = given.map_or(default, |given| given.shape != LiteralShape::Null);
            matches!(parameter.kind, ParameterKind::First(_)) && known
        })
    }

    /// Returns the topic that the item publishes or subscribes to.
    #[must_use]
    pub fn topic(&self) -> Option<&str> {
        self.topic_literal().map(|(topic, _)| topic)
    }

    /// Returns the topic and its span.
    pub(crate) fn topic_literal(&self) -> Option<(&str, Span)> {
        let mut rows = self.spec().parameters.iter().zip(&self.parameters);
        let (_, given) = rows.find(|(parameter, _)| parameter.kind == ParameterKind::Topic)?;
        match given {
            Some(Literal {
                shape: LiteralShape::Text(topic),
                span,
                ..
            }) => Some((topic, *span)),
            _ => None,
        }
    }

    /// Returns the lists at the inputs, each with the index of its input in the spec.
    pub fn lists(&self) -> impl Iterator<Item = (usize, &ResolvedList<'_>)> {
        let inputs = self.inputs.iter().enumerate();
        inputs.filter_map(|(port, input_source)| match input_source {
            InputSource::List(list) => Some((port, list)),
            _ => None,
        })
    }
}

impl<'a> NetGraph<'a> {
    /// Returns the regions that contain an item, from the innermost to the outermost.
    pub fn regions_of(
        &self,
        item: &ResolvedPrimitive<'_>,
    ) -> impl Iterator<Item = &ResolvedRegion<'a>> {
        let first = item.region.and_then(|region| self.regions.get(region));
        std::iter::successors(first, |region| self.regions.get(region.parent?))
    }

    /// Returns all links that an item depends on, each with the name of its input. Links of conditions are included, as
    /// `active`.
    pub fn dependencies(
        &self,
        item: &'a ResolvedPrimitive<'a>,
    ) -> impl Iterator<Item = (&'static str, &ResolvedLink<'a>)> {
        let inputs = item.links().map(|(port, link)| {
            let input = item.spec().inputs.get(port);
            (input.map_or("", |input| input.name), link)
        });
        let conditions = self
            .regions_of(item)
            .filter_map(|region| match &region.condition {
                InputSource::Link(link) => Some(("active", link)),
                _ => None,
            });
        inputs.chain(conditions)
    }

    /// Returns true if region `inner` is region `outer` or is nested in it.
    #[must_use]
    pub fn is_within(&self, inner: Option<usize>, outer: usize) -> bool {
        let parent = |region: &usize| self.regions.get(*region).and_then(|region| region.parent);
        std::iter::successors(inner, parent).any(|region| region == outer)
    }

    /// Returns the number of evaluations per second, Hz.
    #[must_use]
    pub fn evaluations_hz(&self) -> f64 {
        self.cell.cycle_hz() / f64::from(self.rate.every)
    }

    /// Returns an output as `id.port`.
    #[must_use]
    pub fn output_name(&self, output: OutputId) -> String {
        let item = self.items.get(output.item);
        let port = item.and_then(|item| item.spec().outputs.get(output.port));
        format!(
            "{}.{}",
            item.map_or("", ResolvedPrimitive::id),
            port.map_or("", |port| port.name)
        )
    }
}

/// Resolves all names of a net.
pub fn resolve<'a>(
    flat: &'a ExpandedNet,
    cell: &'a DeviceTable,
    diagnostics: &mut Vec<Diagnostic>,
) -> NetGraph<'a> {
    let net = &flat.net;
    let rate = rate::rate_of(&net.timing, cell, diagnostics);
    let mut resolver = Resolver {
        net,
        instances: &flat.instances,
        cell,
        diagnostics,
        ids: HashMap::new(),
        rows: Vec::new(),
        counted_as_read: Vec::new(),
        suggestions: Suggestions::default(),
    };
    resolver.find_types();
    let mut items = Vec::new();
    let rows = net.primitives.iter().zip(resolver.rows.clone());
    for (number, (primitive, row)) in rows.enumerate() {
        let region = flat.region_of.get(number).copied().flatten();
        match row {
            Some((row, entry)) => items.push(ResolvedPrimitive {
                region,
                ..resolver.item(primitive, row, entry)
            }),
            None => resolver.count_inputs_as_read(&primitive.inputs),
        }
    }
    let regions = flat.regions.iter().map(|region| ResolvedRegion {
        id: &region.id,
        condition: resolver.resolve_source(&region.condition, &CONDITION),
        parent: region.parent,
    });
    let regions = regions.collect();
    for reference in &flat.read {
        let output = resolver.output(reference);
        resolver.counted_as_read.extend(output);
    }
    let discarded = resolver.discarded();
    let has_unknown_types = resolver.rows.iter().any(Option::is_none) || flat.is_incomplete;
    let declarations = flat
        .declarations
        .iter()
        .filter_map(|declaration| resolver.declared_input(declaration));
    NetGraph {
        net,
        cell,
        rate,
        items,
        discarded,
        declarations: declarations.collect(),
        regions,
        counted_as_read: resolver.counted_as_read,
        has_unknown_types,
    }
}

/// `active`, treated as an input.
const CONDITION: Port = Port::bool("active", "the condition");

/// Returns `a/b/` of `a/b/id`: the instance that contains the primitive. Empty for the net itself.
fn scope_of(id: &str) -> &str {
    id.rfind('/').map_or("", |slash| &id[..=slash])
}

/// The target of an id.
#[derive(Clone, Copy)]
enum IdTarget {
    /// A primitive of unknown type.
    Unknown,
    Item(usize, &'static Spec),
}

struct Resolver<'a, 'f> {
    net: &'a Net,
    instances: &'a [String],
    cell: &'a DeviceTable,
    diagnostics: &'f mut Vec<Diagnostic>,
    ids: HashMap<&'a str, IdTarget>,
    rows: Vec<Option<(usize, &'static CatalogueEntry)>>,
    counted_as_read: Vec<OutputId>,
    suggestions: Suggestions,
}

impl<'a> Resolver<'a, '_> {
    fn error(&mut self, code: &'static str, span: Span, message: String, help: Option<String>) {
        self.diagnostics
            .push(Diagnostic::error(code, span, message).help_if(help));
    }

    fn find_types(&mut self) {
        let mut count = 0;
        for primitive in &self.net.primitives {
            let name = &primitive.type_name;
            let row = primitives::find(&name.name);
            if row.is_none() && !name.name.is_empty() {
                let message = format!("unknown primitive type `{}`", name.name);
                let help = self.suggestions.primitive_type(&name.name);
                self.error(codes::UNKNOWN_TYPE, name.span, message, Some(help));
            }
            let target = row.map_or(IdTarget::Unknown, |(_, entry)| {
                IdTarget::Item(count, &entry.spec)
            });
            count += usize::from(row.is_some());
            self.ids.insert(&primitive.id.name, target);
            self.rows.push(row);
        }
    }

    fn declared_input(
        &self,
        declaration: &'a expand::InputDeclaration,
    ) -> Option<DeclaredInput<'a>> {
        let primitive = self.net.primitives.get(declaration.primitive)?;
        let IdTarget::Item(item, spec) = self.ids.get(primitive.id.name.as_str())? else {
            return None;
        };
        let (input, _) = spec.input(&declaration.input)?;
        Some(DeclaredInput {
            item: *item,
            input,
            declaration,
        })
    }

    fn item(
        &mut self,
        primitive: &'a Primitive,
        row: usize,
        entry: &'static CatalogueEntry,
    ) -> ResolvedPrimitive<'a> {
        let parameters = self.parameters(primitive, &entry.spec);
        let (device, channel) = self.device_and_channel(&entry.spec, &parameters);
        ResolvedPrimitive {
            primitive,
            row,
            entry,
            device,
            channel,
            region: None,
            inputs: self.inputs(primitive, &entry.spec),
            parameters,
        }
    }

    fn parameters(&mut self, primitive: &'a Primitive, spec: &Spec) -> Vec<Option<&'a Literal>> {
        for (key, _) in &primitive.parameters {
            if !spec.parameters.iter().any(|known| known.name == key.name) {
                let names = spec.parameters.iter().map(|parameter| parameter.name);
                let is_input = spec.input(&key.name).is_some();
                let help = self.suggestions.word(
                    &key.name,
                    "parameters",
                    names,
                    is_input.then_some("an input"),
                );
                self.unknown(codes::UNKNOWN_PARAMETER, key, spec, "parameter", help);
            }
        }
        let mut found = Vec::new();
        for parameter in spec.parameters {
            let given = primitive
                .parameters
                .iter()
                .find(|(key, _)| key.name == parameter.name);
            let given = given.map(|(_, literal)| literal);
            if given.is_none() && parameter.default.is_none() {
                self.missing_parameter(primitive, parameter);
            }
            found.push(given.filter(|literal| !literal.is_refused()));
        }
        found
    }

    fn unknown(&mut self, code: &'static str, key: &Key, spec: &Spec, what: &str, help: String) {
        let message = format!("{} has no {what} `{}`", spec.name, key.name);
        self.error(code, key.span, message, Some(help));
    }

    fn missing_parameter(&mut self, primitive: &Primitive, parameter: &Parameter) {
        let (id, name) = (&primitive.id.name, parameter.name);
        let message = format!("`{id}` needs the parameter `{name}`");
        let help = format!("add `{name}` to its parameters: {}", parameter.doc);
        let span = primitive.type_name.span;
        self.error(codes::MISSING_PARAMETER, span, message, Some(help));
    }

    fn inputs(&mut self, primitive: &'a Primitive, spec: &'static Spec) -> Vec<InputSource<'a>> {
        for (key, _) in &primitive.inputs {
            if spec.input(&key.name).is_none() {
                let names = spec.inputs.iter().map(|port| port.name);
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
        let mut input_sources = Vec::new();
        for port in spec.inputs {
            let given = primitive
                .inputs
                .iter()
                .find(|(key, _)| key.name == port.name);
            input_sources.push(match given {
                Some((_, source)) => self.resolve_source(source, port),
                None => port
                    .default
                    .map_or(InputSource::Missing, InputSource::Default),
            });
        }
        let inputs = primitive.inputs.iter();
        self.count_inputs_as_read(inputs.filter(|(key, _)| spec.input(&key.name).is_none()));
        input_sources
    }

    /// Counts the outputs that unknown inputs read as read, and reports unresolved references in them.
    fn count_inputs_as_read(&mut self, inputs: impl IntoIterator<Item = &'a (Key, Source)>) {
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
                Source::Literal(_) | Source::Refused => {}
            }
        }
    }

    fn resolve_source(&mut self, source: &'a Source, port: &Port) -> InputSource<'a> {
        match source {
            Source::Refused => InputSource::Refused,
            Source::Literal(literal) => match &literal.shape {
                LiteralShape::Text(text) => {
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
                    let links = elements.iter().filter_map(|element| match element {
                        ListElement::Link(link) => Some(link.from),
                        ListElement::Literal(..) => None,
                    });
                    self.counted_as_read.extend(links);
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
                .as_ref()
                .filter(|initial| !initial.is_refused()),
            span: link.span,
            port_span: link.from.port_span,
        })
    }

    /// Flattens the elements of a list; returns false if one of them is refused.
    fn flatten_list(
        &mut self,
        list: &'a crate::syntax::List,
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
                Source::Refused => good = false,
            }
        }
        good
    }

    /// Returns the output that a reference names, or reports that there is none. The outputs of a suggested primitive
    /// count as read.
    fn output(&mut self, reference: &Reference) -> Option<OutputId> {
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

    fn discarded(&mut self) -> Vec<(OutputId, Span)> {
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
