//! Names become numbers: types, devices, channels, parameters and links of a net are looked up in the catalogue, the
//! cell and the net itself. What is not found is reported and left out, so that one fault does not cause others.

mod cell;
mod suggest;

use std::collections::HashMap;

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::Key;
use rcc_core::plan::Rate;
use rcc_core::primitive::{Entry, Literal as Default, Parameter, ParameterKind, Port, Spec};
use rcc_core::primitives;
use rcc_core::unit::Unit;

use crate::devices::DeviceTable;
use crate::expand::{self, Flat};
use crate::fault;
use crate::rate;
use crate::syntax::literal::{Literal, Shape};
use crate::syntax::part::{Part, Place};
use crate::syntax::reference::Reference;
use crate::syntax::{Link, Net, Primitive, Source};
use suggest::Suggestions;

/// A net whose names are numbers.
pub struct Graph<'a> {
    /// As written, without instances.
    pub net: &'a Net,
    /// The cell.
    pub cell: &'a DeviceTable,
    /// In which cycles it is evaluated.
    pub rate: Rate,
    /// Primitives of known type, in the order of the file.
    pub items: Vec<Item<'a>>,
    /// Outputs that are discarded, with the place.
    pub discarded: Vec<(Output, Span)>,
    /// Outputs read by inputs or primitives that do not exist.
    pub read_in_vain: Vec<Output>,
    /// What is evaluated only under a condition; those around others come first.
    pub regions: Vec<Region<'a>>,
    /// What fragments say of the types and units of their inputs.
    pub pins: Vec<Pin<'a>>,
    /// The net has a primitive of unknown type: what is missing may be hidden there.
    pub has_unknown_types: bool,
}

/// Primitives that are evaluated only while a condition is true.
#[derive(Clone, Debug)]
pub struct Region<'a> {
    /// Id of the instance or primitive that has the condition.
    pub id: &'a Key,
    /// The condition.
    pub condition: Feed<'a>,
    /// Index of the region around it.
    pub parent: Option<usize>,
}

/// The type and unit that a fragment gives its input, at an input that it feeds.
#[derive(Clone, Copy, Debug)]
pub struct Pin<'a> {
    /// Index of the item.
    pub item: usize,
    /// Input of its spec.
    pub input: usize,
    /// What is said.
    pub said: &'a expand::Pin,
}

/// One primitive.
pub struct Item<'a> {
    /// As written.
    pub primitive: &'a Primitive,
    /// Row of the catalogue.
    pub row: usize,
    /// The row.
    pub entry: &'static Entry,
    /// Index of its device.
    pub device: Option<usize>,
    /// Index and unit of its channel.
    pub channel: Option<(u32, Unit)>,
    /// By input of the spec.
    pub inputs: Vec<Feed<'a>>,
    /// Index of its innermost region.
    pub region: Option<usize>,
    /// By parameter of the spec; `None`: not given, or reported.
    pub parameters: Vec<Option<&'a Literal>>,
}

/// What feeds an input.
#[derive(Clone, Debug)]
pub enum Feed<'a> {
    /// Nothing.
    Missing,
    /// Something whose fault is reported.
    Refused,
    /// An output.
    Wire(Wire<'a>),
    /// A constant of the text.
    Literal(&'a Literal),
    /// The constant of the spec.
    Default(Default),
    /// Links and constants side by side.
    List(List<'a>),
}

/// A list of links and constants, flat: each with its place.
#[derive(Clone, Debug)]
pub struct List<'a> {
    /// What it consists of; what was refused is left out.
    pub leaves: Vec<Leaf<'a>>,
    /// How many elements it has.
    pub count: u32,
    /// Where it stands.
    pub span: Span,
}

/// What feeds an element of a list.
#[derive(Clone, Copy, Debug)]
pub enum Leaf<'a> {
    /// An output.
    Wire(Wire<'a>),
    /// A constant and its place in the list.
    Literal(&'a Literal, Place),
}

impl<'a> Feed<'a> {
    /// The links in it.
    pub fn wires(&self) -> impl Iterator<Item = &Wire<'a>> {
        let whole = match self {
            Feed::Wire(wire) => Some(wire),
            _ => None,
        };
        let leaves = match self {
            Feed::List(list) => list.leaves.as_slice(),
            _ => &[],
        };
        let leaves = leaves.iter().filter_map(|leaf| match leaf {
            Leaf::Wire(wire) => Some(wire),
            Leaf::Literal(..) => None,
        });
        whole.into_iter().chain(leaves)
    }
}

/// A link from an output or from a part of its value.
#[derive(Clone, Copy, Debug)]
pub struct Wire<'a> {
    /// The output.
    pub from: Output,
    /// The part of its value; `None`: all of it.
    pub part: Option<Part>,
    /// Where it ends in the list that feeds the input.
    pub place: Place,
    /// It carries the value of the cycle before.
    pub delayed: bool,
    /// Its first value.
    pub initial: Option<&'a Literal>,
    /// Its place.
    pub span: Span,
    /// The place of the port's name in it.
    pub port_span: Span,
}

/// An output of an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Output {
    /// Index of the item.
    pub item: usize,
    /// Output of the spec.
    pub port: usize,
}

impl Item<'_> {
    /// Its spec.
    #[must_use]
    pub fn spec(&self) -> &'static Spec {
        &self.entry.spec
    }

    /// Its id.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.primitive.id.name
    }

    /// The links that end at it, with the input's place in the spec.
    pub fn wires(&self) -> impl Iterator<Item = (usize, &Wire<'_>)> {
        let inputs = self.inputs.iter().enumerate();
        inputs.flat_map(|(port, feed)| feed.wires().map(move |wire| (port, wire)))
    }

    /// True if what it remembers begins as a value that is not null.
    #[must_use]
    pub fn begins_known(&self) -> bool {
        let mut rows = self.spec().parameters.iter().zip(&self.parameters);
        rows.any(|(parameter, given)| {
            let default = parameter
                .default
                .is_some_and(|value| value != Default::Null);
            let known = given.map_or(default, |given| given.shape != Shape::Null);
            matches!(parameter.kind, ParameterKind::First(_)) && known
        })
    }

    /// The topic that it publishes or subscribes to.
    #[must_use]
    pub fn topic(&self) -> Option<&str> {
        self.topic_literal().map(|(topic, _)| topic)
    }

    /// The same with its place.
    pub(crate) fn topic_literal(&self) -> Option<(&str, Span)> {
        let mut rows = self.spec().parameters.iter().zip(&self.parameters);
        let (_, given) = rows.find(|(parameter, _)| parameter.kind == ParameterKind::Topic)?;
        match given {
            Some(Literal {
                shape: Shape::Text(topic),
                span,
                ..
            }) => Some((topic, *span)),
            _ => None,
        }
    }

    /// The lists that feed it, with the input's place in the spec.
    pub fn lists(&self) -> impl Iterator<Item = (usize, &List<'_>)> {
        let inputs = self.inputs.iter().enumerate();
        inputs.filter_map(|(port, feed)| match feed {
            Feed::List(list) => Some((port, list)),
            _ => None,
        })
    }
}

impl<'a> Graph<'a> {
    /// The conditions that an item depends on, from the innermost to the outermost, with the region of each.
    pub fn conditions(&self, item: &Item<'_>) -> impl Iterator<Item = &Region<'a>> {
        let first = item.region.and_then(|region| self.regions.get(region));
        std::iter::successors(first, |region| self.regions.get(region.parent?))
    }

    /// All links that an item depends on, each with the name of its input: those of its conditions too.
    pub fn links(&self, item: &'a Item<'a>) -> impl Iterator<Item = (&'static str, &Wire<'a>)> {
        let inputs = item.wires().map(|(port, wire)| {
            let input = item.spec().inputs.get(port);
            (input.map_or("", |input| input.name), wire)
        });
        let conditions = self
            .conditions(item)
            .filter_map(|region| match &region.condition {
                Feed::Wire(wire) => Some(("active", wire)),
                _ => None,
            });
        inputs.chain(conditions)
    }

    /// True if everything of region `inner` is in region `outer` too.
    #[must_use]
    pub fn is_within(&self, inner: Option<usize>, outer: usize) -> bool {
        let parent = |region: &usize| self.regions.get(*region).and_then(|region| region.parent);
        std::iter::successors(inner, parent).any(|region| region == outer)
    }

    /// Evaluations per second.
    #[must_use]
    pub fn evaluations_hz(&self) -> f64 {
        self.cell.cycle_hz() / f64::from(self.rate.every)
    }

    /// `id.port` of an output.
    #[must_use]
    pub fn output_name(&self, output: Output) -> String {
        let item = self.items.get(output.item);
        let port = item.and_then(|item| item.spec().outputs.get(output.port));
        format!(
            "{}.{}",
            item.map_or("", Item::id),
            port.map_or("", |port| port.name)
        )
    }
}

/// Looks every name of a net up.
pub fn resolve<'a>(
    flat: &'a Flat,
    cell: &'a DeviceTable,
    faults: &mut Vec<Diagnostic>,
) -> Graph<'a> {
    let net = &flat.net;
    let rate = rate::of(&net.timing, cell, faults);
    let mut resolver = Resolver {
        net,
        instances: &flat.instances,
        cell,
        faults,
        ids: HashMap::new(),
        rows: Vec::new(),
        read_in_vain: Vec::new(),
        suggestions: Suggestions::default(),
    };
    resolver.find_types();
    let mut items = Vec::new();
    let rows = net.primitives.iter().zip(resolver.rows.clone());
    for (number, (primitive, row)) in rows.enumerate() {
        let region = flat.region_of.get(number).copied().flatten();
        match row {
            Some((row, entry)) => items.push(Item {
                region,
                ..resolver.item(primitive, row, entry)
            }),
            None => resolver.read_in_vain(&primitive.inputs),
        }
    }
    let regions = flat.regions.iter().map(|region| Region {
        id: &region.id,
        condition: resolver.feed(&region.condition, &CONDITION),
        parent: region.parent,
    });
    let regions = regions.collect();
    for reference in &flat.read {
        let output = resolver.output(reference);
        resolver.read_in_vain.extend(output);
    }
    let discarded = resolver.discarded();
    let has_unknown_types = resolver.rows.iter().any(Option::is_none) || flat.is_incomplete;
    let pins = flat.pins.iter().filter_map(|said| resolver.pin(said));
    Graph {
        net,
        cell,
        rate,
        items,
        discarded,
        pins: pins.collect(),
        regions,
        read_in_vain: resolver.read_in_vain,
        has_unknown_types,
    }
}

/// `active`, as if it were an input.
const CONDITION: Port = Port::bool("active", "the condition");

/// `a/b/` of `a/b/id`: the instance that a primitive is in; empty: the net itself.
fn scope_of(id: &str) -> &str {
    id.rfind('/').map_or("", |slash| &id[..=slash])
}

/// Where an id leads.
#[derive(Clone, Copy)]
enum Target {
    /// A primitive whose type is not known.
    Unknown,
    Item(usize, &'static Spec),
}

struct Resolver<'a, 'f> {
    net: &'a Net,
    instances: &'a [String],
    cell: &'a DeviceTable,
    faults: &'f mut Vec<Diagnostic>,
    ids: HashMap<&'a str, Target>,
    rows: Vec<Option<(usize, &'static Entry)>>,
    read_in_vain: Vec<Output>,
    suggestions: Suggestions,
}

impl<'a> Resolver<'a, '_> {
    fn error(&mut self, code: &'static str, span: Span, message: String, help: Option<String>) {
        self.faults
            .push(Diagnostic::error(code, span, message).help_if(help));
    }

    fn find_types(&mut self) {
        let mut count = 0;
        for primitive in &self.net.primitives {
            let name = &primitive.type_name;
            let row = primitives::find(&name.name);
            if row.is_none() && !name.name.is_empty() {
                let message = format!("there is no primitive type `{}`", name.name);
                let help = self.suggestions.primitive_type(&name.name);
                self.error(fault::UNKNOWN_TYPE, name.span, message, Some(help));
            }
            let target = row.map_or(Target::Unknown, |(_, entry)| {
                Target::Item(count, &entry.spec)
            });
            count += usize::from(row.is_some());
            self.ids.insert(&primitive.id.name, target);
            self.rows.push(row);
        }
    }

    fn pin(&self, said: &'a expand::Pin) -> Option<Pin<'a>> {
        let primitive = self.net.primitives.get(said.primitive)?;
        let Target::Item(item, spec) = self.ids.get(primitive.id.name.as_str())? else {
            return None;
        };
        let (input, _) = spec.input(&said.input)?;
        Some(Pin {
            item: *item,
            input,
            said,
        })
    }

    fn item(&mut self, primitive: &'a Primitive, row: usize, entry: &'static Entry) -> Item<'a> {
        let parameters = self.parameters(primitive, &entry.spec);
        let (device, channel) = self.device_and_channel(&entry.spec, &parameters);
        Item {
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
                self.unknown(fault::UNKNOWN_PARAMETER, key, spec, "parameter", help);
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
        self.error(fault::MISSING_PARAMETER, span, message, Some(help));
    }

    fn inputs(&mut self, primitive: &'a Primitive, spec: &'static Spec) -> Vec<Feed<'a>> {
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
                self.unknown(fault::UNKNOWN_INPUT, key, spec, "input", help);
            }
        }
        let mut feeds = Vec::new();
        for port in spec.inputs {
            let given = primitive
                .inputs
                .iter()
                .find(|(key, _)| key.name == port.name);
            feeds.push(match given {
                Some((_, source)) => self.feed(source, port),
                None => port.default.map_or(Feed::Missing, Feed::Default),
            });
        }
        let inputs = primitive.inputs.iter();
        self.read_in_vain(inputs.filter(|(key, _)| spec.input(&key.name).is_none()));
        feeds
    }

    /// What a mistyped input reads is read; what is wrong there is found all the same.
    fn read_in_vain(&mut self, inputs: impl IntoIterator<Item = &'a (Key, Source)>) {
        for (_, source) in inputs {
            self.read_elements_in_vain(std::slice::from_ref(source));
        }
    }

    fn read_elements_in_vain(&mut self, elements: &'a [Source]) {
        for element in elements {
            match element {
                Source::Link(link) => {
                    let output = self.output(&link.from);
                    self.read_in_vain.extend(output);
                }
                Source::List(list) => self.read_elements_in_vain(&list.elements),
                Source::Literal(_) | Source::Refused => {}
            }
        }
    }

    fn feed(&mut self, source: &'a Source, port: &Port) -> Feed<'a> {
        match source {
            Source::Refused => Feed::Refused,
            Source::Literal(literal) => match &literal.shape {
                Shape::Text(text) => {
                    let message = format!("`{}` cannot be fed by the text `{text}`", port.name);
                    self.error(fault::WRONG_SHAPE, literal.span, message, None);
                    Feed::Refused
                }
                _ => Feed::Literal(literal),
            },
            Source::Link(link) => {
                let wire = self.wire(link, Place::default());
                wire.map_or(Feed::Refused, Feed::Wire)
            }
            Source::List(list) => {
                let mut leaves = Vec::new();
                if self.leaves(list, Place::default(), &mut leaves) {
                    Feed::List(List {
                        leaves,
                        count: list.elements.len() as u32,
                        span: list.span,
                    })
                } else {
                    // The links that are good count as read.
                    let wires = leaves.iter().filter_map(|leaf| match leaf {
                        Leaf::Wire(wire) => Some(wire.from),
                        Leaf::Literal(..) => None,
                    });
                    self.read_in_vain.extend(wires);
                    Feed::Refused
                }
            }
        }
    }

    fn wire(&mut self, link: &'a Link, place: Place) -> Option<Wire<'a>> {
        Some(Wire {
            from: self.output(&link.from)?,
            part: link.from.part,
            place,
            delayed: link.delayed,
            initial: link
                .initial
                .as_ref()
                .filter(|initial| !initial.is_refused()),
            span: link.span,
            port_span: link.from.port_span,
        })
    }

    /// The elements of a list with their places; false if one of them is refused.
    fn leaves(
        &mut self,
        list: &'a crate::syntax::List,
        place: Place,
        leaves: &mut Vec<Leaf<'a>>,
    ) -> bool {
        // Reading has refused lists that are too long or too deep.
        let count = list.elements.len() as u32;
        let mut good = true;
        for (element, index) in list.elements.iter().zip(0u32..) {
            let Some(place) = place.inside(index, count) else {
                let message = "lists are nested at most twice: a matrix is a list of rows";
                self.error(fault::WRONG_SHAPE, list.span, message.to_string(), None);
                return false;
            };
            match element {
                Source::Link(link) => match self.wire(link, place) {
                    Some(wire) => leaves.push(Leaf::Wire(wire)),
                    None => good = false,
                },
                Source::Literal(literal) => leaves.push(Leaf::Literal(literal, place)),
                Source::List(list) => good &= self.leaves(list, place, leaves),
                Source::Refused => good = false,
            }
        }
        good
    }

    /// The output that a reference names; reports it if there is none. What was probably meant counts as read.
    fn output(&mut self, reference: &Reference) -> Option<Output> {
        match self.ids.get(reference.primitive.as_str()).copied() {
            Some(Target::Unknown) => None,
            Some(Target::Item(item, spec)) => {
                if let Some((port, _)) = spec.output(&reference.port) {
                    return Some(Output { item, port });
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
                self.error(fault::UNKNOWN_OUTPUT, span, message, Some(help));
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
        // What is meant stands in the same fragment.
        let scope = scope_of(&reference.primitive);
        let ids = ids.filter(|id| scope_of(id) == scope);
        let near = self.suggestions.near(&reference.primitive, ids);
        let target = near.and_then(|near| self.ids.get(near).copied());
        let help = match (near, target) {
            (Some(near), Some(Target::Item(item, spec))) => {
                self.count_as_read(item, spec);
                suggest::primitive(near, &reference.port, spec)
            }
            (Some(near), _) => format!("did you mean `{near}`?"),
            (None, _) => "add it under `primitives`, or read another output".to_string(),
        };
        let place = if scope.is_empty() { "net" } else { "fragment" };
        let message = format!("the {place} has no primitive `{}`", reference.primitive);
        let span = reference.primitive_span;
        self.error(fault::UNKNOWN_PRIMITIVE, span, message, Some(help));
    }

    fn count_as_read(&mut self, item: usize, spec: &Spec) {
        let outputs = (0..spec.outputs.len()).map(|port| Output { item, port });
        self.read_in_vain.extend(outputs);
    }

    fn discarded(&mut self) -> Vec<(Output, Span)> {
        let mut discarded = Vec::new();
        for reference in &self.net.discard {
            let target = self.ids.get(reference.primitive.as_str()).copied();
            let found = match target {
                Some(Target::Unknown) => continue,
                Some(Target::Item(item, spec)) => spec
                    .output(&reference.port)
                    .map(|(port, _)| Output { item, port }),
                None => None,
            };
            let message = match (found, reference.part) {
                (Some(output), None) => {
                    discarded.push((output, reference.span));
                    continue;
                }
                (Some(_), Some(_)) => {
                    "an output is discarded as a whole, not by element".to_string()
                }
                (None, _) => format!("`discard` names `{reference}`, and there is no such output"),
            };
            let help = match (target, found) {
                (Some(Target::Item(_, spec)), None) => self.suggestions.output(reference, spec),
                (_, Some(_)) => format!("write `{}.{}`", reference.primitive, reference.port),
                (_, None) => "take it out of `discard`".to_string(),
            };
            let help = Some(help);
            self.error(fault::BAD_DISCARD, reference.span, message, help);
        }
        discarded
    }
}
