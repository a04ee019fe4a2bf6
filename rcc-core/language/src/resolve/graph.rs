//! The net graph, the result of the resolve pass: every name is an index. Runs on the loader's threads.

use rcc_config::diagnostic::Span;
use rcc_config::yaml::{Key, ShortText};
use rcc_core::plan::Rate;
use rcc_core::primitive::{CatalogueEntry, DefaultValue as Default, ParameterKind, Spec};
use rcc_core::primitives::CATALOGUE;
use rcc_core::unit::Unit;

use crate::devices::DeviceTable;
use crate::expand::InputDeclaration;
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::part::{ListPosition, ValuePart};
use crate::syntax::{Net, Primitive};

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
    /// Indices of their types in the catalogue, each once.
    pub types: Vec<usize>,
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
    pub declaration: &'a InputDeclaration,
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
    /// The outcomes of the net: conditions with their names.
    Outcomes(ResolvedOutcomes<'a>),
}

/// The outcomes of a net, in the order of the text.
#[derive(Clone, Debug)]
pub struct ResolvedOutcomes<'a> {
    /// Names, by condition.
    pub names: Vec<&'a str>,
    /// Conditions: single values, each in no list.
    pub conditions: Vec<ListElement<'a>>,
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

impl<'a> ListElement<'a> {
    /// Returns the link, if the element is one.
    pub fn link(&self) -> Option<&ResolvedLink<'a>> {
        match self {
            ListElement::Link(link) => Some(link),
            ListElement::Literal(..) => None,
        }
    }
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
            InputSource::Outcomes(outcomes) => outcomes.conditions.as_slice(),
            _ => &[],
        };
        let elements = elements.iter().filter_map(ListElement::link);
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

impl<'a> ResolvedPrimitive<'a> {
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

    /// Returns the named conditions at the inputs, each with the index of its input in the spec.
    pub fn conditions(&self) -> impl Iterator<Item = (usize, &str, &ListElement<'a>)> {
        let inputs = self.inputs.iter().enumerate();
        inputs.flat_map(|(port, input_source)| {
            let outcomes = match input_source {
                InputSource::Outcomes(outcomes) => Some(outcomes),
                _ => None,
            };
            let rows = outcomes.into_iter().flat_map(|outcomes| {
                let names = outcomes.names.iter().copied();
                names.zip(&outcomes.conditions)
            });
            rows.map(move |(name, condition)| (port, name, condition))
        })
    }

    /// Returns a parameter that is given and not null.
    pub(crate) fn given(&self, name: &str) -> Option<&'a Literal> {
        let mut rows = self.spec().parameters.iter().zip(&self.parameters);
        let (_, literal) = rows.find(|(parameter, _)| parameter.name == name)?;
        literal.filter(|literal| literal.shape != LiteralShape::Null)
    }
}

impl<'a> NetGraph<'a> {
    /// Returns the items of the types for which `is_one` is true, with their numbers, in order. A net has few types:
    /// without such a type no item is visited.
    pub fn items_of(
        &self,
        is_one: impl Fn(&'static Spec) -> bool,
    ) -> impl Iterator<Item = (usize, &ResolvedPrimitive<'a>)> {
        let types = self.types.iter().copied();
        let types = types.filter(|row| CATALOGUE.get(*row).is_some_and(|it| is_one(&it.spec)));
        let mut is_of = vec![false; CATALOGUE.len()];
        let mut items = &[][..];
        for row in types {
            is_of[row] = true;
            items = &self.items;
        }
        let items = items.iter().enumerate();
        items.filter(move |(_, item)| is_of.get(item.row) == Some(&true))
    }

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
    pub fn output_name(&self, output: OutputId) -> ShortText {
        let item = self.items.get(output.item);
        let port = item.and_then(|item| item.spec().outputs.get(output.port));
        let id = item.map(|item| item.primitive.id.name.clone());
        let mut name = id.unwrap_or_default();
        name.push('.');
        name.push_str(port.map_or("", |port| port.name));
        name
    }
}
