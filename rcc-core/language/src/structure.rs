//! The structure of a compiled net, for users: its primitives with types, units, constants and links, their slots in
//! the plan, the order of evaluation, and which values can be null and why. Owns its data; shown by `explain` and
//! `graph`. Runs in the command line.

mod literal_label;

use std::borrow::Cow;

use rcc_core::primitive::{ParameterKind, Port, Role};
use rcc_core::types::Store;
use serde::Serialize;

use crate::infer::Typed;
use crate::lower::{Lowered, SlotRange, literal};
use crate::null_analysis::{NullAnalysis, analyse_nulls};
use crate::resolve::{InputSource, ListElement, ResolvedLink, ResolvedPrimitive};

pub use literal_label::literal_label;

/// The structure of a net.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NetStructure {
    /// Name of the net.
    pub net: String,
    /// Description for users; may be empty.
    pub description: String,
    /// Primitives in the order of the file.
    pub primitives: Vec<PrimitiveInfo>,
    /// Primitives with a kernel, in the order of evaluation: indices into `primitives`.
    pub order: Vec<usize>,
}

/// The role of a primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PrimitiveRole {
    /// Computes.
    Plain,
    /// Measures: it has a device and no inputs.
    Measures,
    /// Commands a device.
    Commands,
    /// Moves along a path.
    Moves,
    /// Ends the net, or receives a cancel request.
    Ends,
    /// Publishes or monitors a value.
    Shows,
    /// A constant.
    Constant,
    /// A value that is set from outside.
    Input,
}

/// A primitive.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PrimitiveInfo {
    /// Id.
    pub id: String,
    /// Type.
    #[serde(rename = "type")]
    pub type_name: &'static str,
    /// Role.
    pub role: PrimitiveRole,
    /// Name of its device.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Given parameters, except for the device: name and abbreviated value.
    pub parameters: Vec<(&'static str, String)>,
    /// Inputs.
    pub inputs: Vec<PortInfo>,
    /// Outputs.
    pub outputs: Vec<PortInfo>,
    /// The regions that contain it, outermost first. It is evaluated only while all their conditions are true.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub active: Vec<ActiveCondition>,
    /// Why its outputs can be null; `None` if they never are, or if there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub null: Option<String>,
    /// The effect of null inputs, in words.
    #[serde(skip)]
    pub null_words: &'static str,
}

/// A condition under which primitives are evaluated.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ActiveCondition {
    /// Id of the instance or primitive that has the condition.
    pub id: String,
    /// The condition: `button.out`, or a constant.
    pub condition: String,
}

/// A port.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PortInfo {
    /// Name; that of an outcome for a named condition of a `Termination`.
    pub name: Cow<'static, str>,
    /// Type, such as `Real[7]`.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Unit; `None` if the type implies it, or if it is 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Arena.
    pub store: Store,
    /// Index of the first slot.
    pub slot: u32,
    /// Number of slots.
    pub width: u32,
    /// The sources of an input, several for a list of links; empty for an output.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sources: Vec<SourceInfo>,
    /// Why an input can be null; `None` if it never is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub null: Option<String>,
}

/// The source of an input.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SourceInfo {
    /// A constant of the text, abbreviated.
    Constant(String),
    /// The default of the spec, abbreviated.
    Default(String),
    /// A link from an output.
    Link(LinkInfo),
}

/// A link.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LinkInfo {
    /// Index of the source in `primitives`.
    pub primitive: usize,
    /// Index of its output.
    pub output: usize,
    /// Selected part of the value: `[2]`, `.x`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// True if it carries the value of the previous cycle.
    pub delayed: bool,
    /// The initial value of a delayed link, abbreviated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial: Option<String>,
}

impl NetStructure {
    /// Returns the condition that an instance or primitive itself has.
    #[must_use]
    pub fn condition(&self, id: &str) -> Option<&str> {
        let mut all = self.primitives.iter().flat_map(|part| &part.active);
        let found = all.find(|activity| activity.id == id);
        found.map(|activity| activity.condition.as_str())
    }
}

impl PrimitiveInfo {
    /// Returns the fragment instances that contain it, outermost first: for `a/b/filter`, `a` and `a/b`.
    pub fn frames(&self) -> impl Iterator<Item = &str> {
        self.id.match_indices('/').map(|(end, _)| &self.id[..end])
    }
}

/// Returns the structure of a net.
#[must_use]
pub fn structure(net: Typed<'_>, lowered: &Lowered) -> NetStructure {
    let nulls = analyse_nulls(net.graph);
    let items = net.graph.items.iter().enumerate();
    let primitives = items.map(|(number, item)| part(net, lowered, &nulls, number, item));
    NetStructure {
        net: net.graph.net.name.name.to_string(),
        description: net.graph.net.description.clone(),
        primitives: primitives.collect(),
        order: lowered.order.clone(),
    }
}

fn part(
    net: Typed<'_>,
    lowered: &Lowered,
    nulls: &NullAnalysis,
    number: usize,
    item: &ResolvedPrimitive<'_>,
) -> PrimitiveInfo {
    let spec = item.spec();
    let slots = lowered.slots.outputs(number);
    let outputs = spec.outputs.iter().enumerate();
    let outputs = outputs.map(|(place, port)| pin(net, number, port, slots.get(place)));
    let device = item
        .device
        .and_then(|device| net.graph.cell.devices.get(device));
    PrimitiveInfo {
        id: item.id().to_owned(),
        type_name: spec.name,
        role: role(item),
        device: device.map(|device| device.name.clone()),
        parameters: parameters(item),
        inputs: inputs(net, lowered.slots.inputs(number), nulls, number, item),
        outputs: outputs.collect(),
        active: activity(net, item),
        null: nulls
            .why(net.graph, number)
            .filter(|_| !spec.outputs.is_empty()),
        null_words: spec.null,
    }
}

/// Returns the inputs of a primitive; each named outcome is an input of its own.
fn inputs(
    net: Typed<'_>,
    slots: &[SlotRange],
    nulls: &NullAnalysis,
    number: usize,
    item: &ResolvedPrimitive<'_>,
) -> Vec<PortInfo> {
    let ports = item.spec().inputs;
    let outcomes = item.conditions().enumerate();
    let outcomes = outcomes.filter_map(|(place, (port, name, condition))| {
        Some(PortInfo {
            name: Cow::Owned(name.to_owned()),
            sources: vec![element(condition)],
            null: nulls.why_element(net.graph, condition),
            ..pin(net, number, ports.get(port)?, slots.get(place))
        })
    });
    let outcomes: Vec<PortInfo> = outcomes.collect();
    if !outcomes.is_empty() {
        return outcomes;
    }
    let inputs = ports.iter().zip(&item.inputs).enumerate();
    inputs
        .map(|(place, (port, input_source))| PortInfo {
            sources: sources(input_source),
            null: nulls.why_input(net.graph, number, place),
            ..pin(net, number, port, slots.get(place))
        })
        .collect()
}

/// Returns the regions of a primitive, outermost first.
fn activity(net: Typed<'_>, item: &ResolvedPrimitive<'_>) -> Vec<ActiveCondition> {
    let regions = &net.graph.regions;
    let parent = |region: &usize| regions.get(*region)?.parent;
    let numbers = std::iter::successors(item.region, parent);
    let mut chain: Vec<ActiveCondition> = numbers
        .filter_map(|number| {
            let region = regions.get(number)?;
            Some(ActiveCondition {
                id: region.id.name.to_string(),
                condition: condition(net, &region.condition),
            })
        })
        .collect();
    chain.reverse();
    chain
}

fn condition(net: Typed<'_>, input_source: &InputSource<'_>) -> String {
    match sources(input_source).first() {
        Some(SourceInfo::Link(link)) => {
            let item = net.graph.items.get(link.primitive);
            let output = item.and_then(|item| item.spec().outputs.get(link.output));
            format!(
                "{}.{}{}",
                item.map_or("", |item| item.id()),
                output.map_or("", |port| port.name),
                link.part.as_deref().unwrap_or_default()
            )
        }
        Some(SourceInfo::Constant(value) | SourceInfo::Default(value)) => value.clone(),
        None => String::new(),
    }
}

fn role(item: &ResolvedPrimitive<'_>) -> PrimitiveRole {
    match item.spec().role {
        Role::Plain if item.device.is_some() && item.spec().inputs.is_empty() => {
            PrimitiveRole::Measures
        }
        Role::Plain => PrimitiveRole::Plain,
        Role::Monitor | Role::Publish => PrimitiveRole::Shows,
        Role::Constant => PrimitiveRole::Constant,
        Role::Input => PrimitiveRole::Input,
        Role::Termination | Role::Cancel => PrimitiveRole::Ends,
        Role::Motion => PrimitiveRole::Moves,
        Role::CommandsArm | Role::CommandsChannel => PrimitiveRole::Commands,
    }
}

/// Returns the given parameters except for the device, which has its own field.
fn parameters(item: &ResolvedPrimitive<'_>) -> Vec<(&'static str, String)> {
    let given = item.spec().parameters.iter().zip(&item.parameters);
    let given = given.filter(|(parameter, _)| {
        !matches!(parameter.kind, ParameterKind::Arm | ParameterKind::Device)
    });
    given
        .filter_map(|(parameter, literal)| Some((parameter.name, literal_label((*literal)?))))
        .collect()
}

fn pin(net: Typed<'_>, number: usize, port: &Port, slot: Option<&SlotRange>) -> PortInfo {
    let names = crate::names::port_names(
        net,
        number,
        port,
        slot.copied().unwrap_or(SlotRange {
            store: Store::Real,
            slot: 0,
            width: 0,
        }),
    );
    PortInfo {
        name: Cow::Borrowed(port.name),
        type_name: names.type_name.into_owned(),
        unit: names.unit.filter(|unit| unit != "1").map(Cow::into_owned),
        store: names.store,
        slot: names.slot,
        width: names.width,
        sources: Vec::new(),
        null: None,
    }
}

fn link_info(link: &ResolvedLink<'_>) -> SourceInfo {
    SourceInfo::Link(LinkInfo {
        primitive: link.from.item,
        output: link.from.port,
        part: link.part.map(|part| part.to_string()),
        delayed: link.delayed,
        initial: link.initial.map(literal_label),
    })
}

fn element(element: &ListElement<'_>) -> SourceInfo {
    match element {
        ListElement::Link(link) => link_info(link),
        ListElement::Literal(literal, _) => SourceInfo::Constant(literal_label(literal)),
    }
}

fn sources(input_source: &InputSource<'_>) -> Vec<SourceInfo> {
    match input_source {
        InputSource::Link(link) => vec![link_info(link)],
        InputSource::List(list) => list.elements.iter().map(element).collect(),
        InputSource::Outcomes(outcomes) => outcomes.conditions.iter().map(element).collect(),
        InputSource::Literal(literal) => vec![SourceInfo::Constant(literal_label(literal))],
        InputSource::Default(value) => {
            vec![SourceInfo::Default(literal_label(&literal(*value)))]
        }
        // A compiled net has neither.
        InputSource::Missing | InputSource::Refused => Vec::new(),
    }
}
