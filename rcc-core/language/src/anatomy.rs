//! The anatomy of a net that compiled: its primitives with types, units, constants and links, where everything lies in the
//! plan, in which order it runs, and what can be null and why. Owned and complete, for people: `explain` and `graph` show
//! it. Pure; run by the command line.

mod short;

use rcc_core::primitive::{ParameterKind, Port, Role};
use rcc_core::types::Store;
use serde::Serialize;

use crate::check::Typed;
use crate::lower::{ItemSlots, Lowered, Slot, literal};
use crate::nulls::{Nulls, nulls};
use crate::resolve::{Feed, Item, Leaf, Wire};

pub use short::short;

/// A net, taken apart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Anatomy {
    /// Name of the net.
    pub net: String,
    /// What people should know about it; may be empty.
    pub description: String,
    /// Primitives in the order of the file.
    pub primitives: Vec<Part>,
    /// Primitives with a kernel, in the order of evaluation: places in `primitives`.
    pub order: Vec<usize>,
}

/// What a primitive is to the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PartRole {
    /// It computes.
    Plain,
    /// It measures: it has a device and commands nothing.
    Measures,
    /// It commands a device.
    Commands,
    /// It moves along a path.
    Moves,
    /// It ends the net, or is how the net hears of a cancel.
    Ends,
    /// It shows a value.
    Shows,
    /// It is a constant.
    Constant,
    /// It is set from outside.
    Input,
}

/// One primitive.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// Its id.
    pub id: String,
    /// Its type.
    #[serde(rename = "type")]
    pub type_name: &'static str,
    /// What it is to the core.
    pub role: PartRole,
    /// The device that it belongs to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Parameters that are given, short: name and value.
    pub parameters: Vec<(&'static str, String)>,
    /// Inputs.
    pub inputs: Vec<Pin>,
    /// Outputs.
    pub outputs: Vec<Pin>,
    /// The regions that it is in, outermost first: it is evaluated only while all their conditions are true.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub active: Vec<Activity>,
    /// Why its outputs can be null; `None`: they never are, or there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub null: Option<String>,
    /// What null at its inputs does, in words.
    #[serde(skip)]
    pub null_words: &'static str,
}

/// What is evaluated only while a condition is true.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Activity {
    /// The instance or primitive that has the condition.
    pub id: String,
    /// The condition: `button.out`, or a constant.
    pub condition: String,
}

/// One port.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pin {
    /// Its name.
    pub name: &'static str,
    /// Its type, `Real[7]`.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Its unit; `None`: the type says it, or there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Which arena.
    pub store: Store,
    /// First element.
    pub slot: u32,
    /// Elements.
    pub width: u32,
    /// Of an input: what feeds it; several if it is a list of links.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sources: Vec<Source>,
    /// Of an input: why it can be null; `None`: it never is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub null: Option<String>,
}

/// What feeds an input.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// A constant of the text, short.
    Constant(String),
    /// Not connected: the value of the spec.
    Default(String),
    /// An output.
    Link(Link),
}

/// A link.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Link {
    /// Place of the primitive that it reads, in the order of the file.
    pub primitive: usize,
    /// Which of its outputs.
    pub output: usize,
    /// Which part of its value: `[2]`, `.x`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// It carries the value of the cycle before.
    pub delayed: bool,
    /// Its first value, short.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial: Option<String>,
}

impl Anatomy {
    /// The condition of an instance or primitive, if it has one of its own.
    #[must_use]
    pub fn condition(&self, id: &str) -> Option<&str> {
        let mut all = self.primitives.iter().flat_map(|part| &part.active);
        let found = all.find(|activity| activity.id == id);
        found.map(|activity| activity.condition.as_str())
    }
}

impl Part {
    /// The fragment instances that it is in, outermost first: `a/b/filter` is in `a` and `a/b`.
    pub fn frames(&self) -> impl Iterator<Item = &str> {
        self.id.match_indices('/').map(|(end, _)| &self.id[..end])
    }
}

/// Takes a net apart.
#[must_use]
pub fn anatomy(net: Typed<'_>, lowered: &Lowered) -> Anatomy {
    let nulls = nulls(net.graph);
    let items = net.graph.items.iter().enumerate();
    let primitives = items.map(|(number, item)| part(net, lowered, &nulls, number, item));
    Anatomy {
        net: net.graph.net.name.name.clone(),
        description: net.graph.net.description.clone(),
        primitives: primitives.collect(),
        order: lowered.order.clone(),
    }
}

fn part(net: Typed<'_>, lowered: &Lowered, nulls: &Nulls, number: usize, item: &Item<'_>) -> Part {
    let spec = item.spec();
    let no_slots = ItemSlots::default();
    let slots = lowered.slots.get(number).unwrap_or(&no_slots);
    let inputs = spec.inputs.iter().zip(&item.inputs).enumerate();
    let inputs = inputs.map(|(place, (port, feed))| Pin {
        sources: sources(feed),
        null: nulls.why_input(net.graph, number, place),
        ..pin(net, number, port, slots.inputs.get(place))
    });
    let outputs = spec.outputs.iter().enumerate();
    let outputs = outputs.map(|(place, port)| pin(net, number, port, slots.outputs.get(place)));
    let device = item
        .device
        .and_then(|device| net.graph.cell.devices.get(device));
    Part {
        id: item.id().to_owned(),
        type_name: spec.name,
        role: role(item),
        device: device.map(|device| device.name.clone()),
        parameters: parameters(item),
        inputs: inputs.collect(),
        outputs: outputs.collect(),
        active: activity(net, item),
        null: nulls
            .why(net.graph, number)
            .filter(|_| !spec.outputs.is_empty()),
        null_words: spec.null,
    }
}

/// The regions of a primitive, outermost first.
fn activity(net: Typed<'_>, item: &Item<'_>) -> Vec<Activity> {
    let regions = &net.graph.regions;
    let parent = |region: &usize| regions.get(*region)?.parent;
    let numbers = std::iter::successors(item.region, parent);
    let mut chain: Vec<Activity> = numbers
        .filter_map(|number| {
            let region = regions.get(number)?;
            Some(Activity {
                id: region.id.name.clone(),
                condition: condition(net, &region.condition),
            })
        })
        .collect();
    chain.reverse();
    chain
}

fn condition(net: Typed<'_>, feed: &Feed<'_>) -> String {
    match sources(feed).first() {
        Some(Source::Link(link)) => {
            let item = net.graph.items.get(link.primitive);
            let output = item.and_then(|item| item.spec().outputs.get(link.output));
            format!(
                "{}.{}{}",
                item.map_or("", |item| item.id()),
                output.map_or("", |port| port.name),
                link.part.as_deref().unwrap_or_default()
            )
        }
        Some(Source::Constant(value) | Source::Default(value)) => value.clone(),
        None => String::new(),
    }
}

fn role(item: &Item<'_>) -> PartRole {
    match item.spec().role {
        Role::Plain if item.device.is_some() && item.spec().inputs.is_empty() => PartRole::Measures,
        Role::Plain => PartRole::Plain,
        Role::Monitor | Role::Publish => PartRole::Shows,
        Role::Constant => PartRole::Constant,
        Role::Input => PartRole::Input,
        Role::Termination | Role::Cancel => PartRole::Ends,
        Role::Motion => PartRole::Moves,
        Role::CommandsArm | Role::CommandsChannel => PartRole::Commands,
    }
}

/// The parameters that are given, but for the device, which stands elsewhere.
fn parameters(item: &Item<'_>) -> Vec<(&'static str, String)> {
    let given = item.spec().parameters.iter().zip(&item.parameters);
    let given = given.filter(|(parameter, _)| {
        !matches!(parameter.kind, ParameterKind::Arm | ParameterKind::Device)
    });
    given
        .filter_map(|(parameter, literal)| Some((parameter.name, short((*literal)?))))
        .collect()
}

fn pin(net: Typed<'_>, number: usize, port: &Port, slot: Option<&Slot>) -> Pin {
    let names = crate::names::port_names(
        net,
        number,
        port,
        slot.copied().unwrap_or(Slot {
            store: Store::Real,
            slot: 0,
            width: 0,
        }),
    );
    Pin {
        name: port.name,
        type_name: names.type_name,
        unit: names.unit.filter(|unit| unit != "1"),
        store: names.store,
        slot: names.slot,
        width: names.width,
        sources: Vec::new(),
        null: None,
    }
}

fn link(wire: &Wire<'_>) -> Source {
    Source::Link(Link {
        primitive: wire.from.item,
        output: wire.from.port,
        part: wire.part.map(|part| part.to_string()),
        delayed: wire.delayed,
        initial: wire.initial.map(short),
    })
}

fn sources(feed: &Feed<'_>) -> Vec<Source> {
    match feed {
        Feed::Wire(wire) => vec![link(wire)],
        Feed::List(list) => {
            let leaves = list.leaves.iter().map(|leaf| match leaf {
                Leaf::Wire(wire) => link(wire),
                Leaf::Literal(literal, _) => Source::Constant(short(literal)),
            });
            leaves.collect()
        }
        Feed::Literal(literal) => vec![Source::Constant(short(literal))],
        Feed::Default(value) => {
            vec![Source::Default(short(&literal(*value)))]
        }
        // A net that compiled has neither.
        Feed::Missing | Feed::Refused => Vec::new(),
    }
}
