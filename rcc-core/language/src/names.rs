//! The names of a plan: slots of ports, and sources of monitors. Stored beside the plan, so that monitors and a
//! restarted loader can name everything; the executor never reads them. Runs on the loader's threads.

use std::borrow::Cow;

use rcc_config::yaml::ShortText;
use rcc_core::plan::InputPoint;
use rcc_core::primitive::{Port, Role};
use rcc_core::types::{NULL_INT, NULL_REAL, Store};
use rcc_protocol::control::PlanData;
use serde::{Deserialize, Serialize};

use crate::infer::Typed;
use crate::lower::{Lowered, SlotRange};
use crate::null_analysis::analyse_nulls;
use crate::resolve::{InputSource, ListElement, ResolvedLink, ResolvedPrimitive, every};

/// Names of one command.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Names {
    /// Name of the net.
    pub net: String,
    /// Primitives in the order of the file.
    pub primitives: Vec<PrimitiveNames>,
    /// Monitors in the order of the plan; the index is that of the records.
    pub monitors: Vec<MonitorNames>,
    /// Values that are set from outside, in the order of the plan.
    #[serde(default)]
    pub inputs: Vec<InputNames>,
    /// Topics that the net publishes, in the order of the file.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub publishes: Vec<TopicNames>,
    /// Ids of the motions, in the order of the plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motions: Vec<String>,
    /// Names of the outcomes of its `Termination`, in the order of the text; empty if they have no names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outcomes: Vec<String>,
}

impl Names {
    /// Returns the inputs that users and programs can set, with their indices in the plan. Subscribed topics are
    /// excluded.
    pub fn settable(&self) -> impl Iterator<Item = (u32, &InputNames)> + Clone {
        let inputs = (0..).zip(&self.inputs);
        inputs.filter(|(_, input)| input.topic.is_none())
    }

    /// Returns the name of an outcome, counted from 1; `None` if it has none.
    #[must_use]
    pub fn outcome(&self, number: u32) -> Option<&str> {
        let index = number.checked_sub(1)?;
        self.outcomes.get(index as usize).map(String::as_str)
    }
}

/// Names of one primitive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PrimitiveNames {
    /// Id.
    pub id: ShortText,
    /// Type.
    #[serde(rename = "type")]
    pub type_name: Cow<'static, str>,
    /// Inputs.
    pub inputs: Vec<PortNames>,
    /// Outputs.
    pub outputs: Vec<PortNames>,
    /// No output is ever null, by the null analysis of the net.
    #[serde(default)]
    pub never_null: bool,
}

/// Name, slots, type and unit of a port.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PortNames {
    /// Name.
    pub name: Cow<'static, str>,
    /// Arena.
    pub store: Store,
    /// Index of the first slot.
    pub slot: u32,
    /// Number of slots.
    pub width: u32,
    /// Type, such as `Real[7]`.
    #[serde(rename = "type")]
    pub type_name: Cow<'static, str>,
    /// Unit, such as `m/s`; `None` if the type implies it or has none.
    pub unit: Option<Cow<'static, str>>,
    /// The `primitive.port` connected to an input; `None` for a constant and for an output.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<ShortText>,
}

/// A monitor and its source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MonitorNames {
    /// Id of the Monitor primitive.
    pub primitive: String,
    /// The monitored output: `primitive.port` or `primitive.port[index]`. For a constant, the monitor's own input.
    pub source: String,
    /// Arena.
    pub store: Store,
    /// Index of the first slot.
    pub slot: u32,
    /// Number of slots.
    pub width: u32,
    /// Type.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Unit; `None` if the type implies it or has none.
    pub unit: Option<String>,
    /// Rate, Hz.
    pub rate_hz: f64,
    /// Number of evaluations of the net between two samples.
    pub every: u32,
    /// The value is never null, by the null analysis of the net.
    #[serde(default)]
    pub never_null: bool,
}

/// A topic that a net publishes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TopicNames {
    /// Id of the Publish primitive.
    pub primitive: String,
    /// Name of the topic.
    pub topic: String,
    /// Type.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Unit; `None` if the type implies it or has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// A value that is set from outside.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputNames {
    /// Id of the Input primitive, which is the name used to set it.
    pub primitive: String,
    /// Type.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Unit of the value or of each element; `None` if the type implies it or has none.
    pub unit: Option<String>,
    /// Lower bound of each element, SI units; NaN for an element without one, which is null in JSON. Empty if no element
    /// has one.
    #[serde(
        default,
        skip_serializing_if = "Vec::is_empty",
        with = "nullable_numbers"
    )]
    pub at_least: Vec<f64>,
    /// Upper bound of each element, SI units; NaN for an element without one, which is null in JSON. Empty if no element
    /// has one.
    #[serde(
        default,
        skip_serializing_if = "Vec::is_empty",
        with = "nullable_numbers"
    )]
    pub at_most: Vec<f64>,
    /// Time after which the value becomes null unless it is set again, s; `None` if it never expires.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires_s: Option<f64>,
    /// Topic that the value is subscribed to; `None` if the value is set by clients.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub topic: Option<String>,
}

/// Numbers of which some may be missing: NaN in memory, null in JSON, which has no NaN.
mod nullable_numbers {
    use rcc_core::types::NULL_REAL;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(numbers: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
        let numbers = numbers.iter();
        serializer.collect_seq(numbers.map(|number| (!number.is_nan()).then_some(*number)))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
        let numbers = Vec::<Option<f64>>::deserialize(deserializer)?;
        let numbers = numbers.into_iter();
        Ok(numbers.map(|number| number.unwrap_or(NULL_REAL)).collect())
    }
}

/// Returns the names of a lowered net.
#[must_use]
pub fn names(net: Typed<'_>, lowered: &Lowered) -> Names {
    let nulls = analyse_nulls(net.graph);
    let items = net.graph.items.iter().enumerate();
    let primitives = items.map(|(number, item)| {
        let outputs = item.spec().outputs.iter();
        let outputs = outputs.zip(lowered.slots.outputs(number));
        PrimitiveNames {
            id: item.primitive.id.name.clone(),
            type_name: Cow::Borrowed(item.spec().name),
            inputs: input_names(net, number, item, lowered.slots.inputs(number)),
            outputs: outputs
                .map(|(port, slot)| port_names(net, number, port, *slot))
                .collect(),
            never_null: nulls.item(number).is_none(),
        }
    });
    let monitors = net.graph.items_of(|spec| spec.role == Role::Monitor);
    let monitors = monitors.filter_map(|(number, item)| {
        let port = item.spec().inputs.first()?;
        let slot = lowered.slots.inputs(number).first()?;
        Some(MonitorNames {
            never_null: nulls.input(item, 0).is_none(),
            ..monitor_names(net, number, item, port, *slot)
        })
    });
    Names {
        net: net.graph.net.name.name.to_string(),
        primitives: primitives.collect(),
        monitors: monitors.collect(),
        inputs: inputs(net, lowered),
        publishes: publishes(net, lowered),
        motions: motions(net, lowered),
        outcomes: net
            .graph
            .items_of(|spec| spec.role == Role::Termination)
            .flat_map(|(_, item)| item.conditions())
            .map(|(_, name, _)| name.to_string())
            .collect(),
    }
}

/// Returns the names of the inputs of an item; each named outcome is an input of its own.
fn input_names(
    net: Typed<'_>,
    number: usize,
    item: &ResolvedPrimitive<'_>,
    slots: &[SlotRange],
) -> Vec<PortNames> {
    let ports = item.spec().inputs;
    let outcomes = item.conditions().zip(slots);
    let outcomes = outcomes.filter_map(|((port, name, condition), slot)| {
        Some(PortNames {
            name: Cow::Owned(name.to_owned()),
            source: condition.link().map(|link| link_name(net, link)),
            ..port_names(net, number, ports.get(port)?, *slot)
        })
    });
    let outcomes: Vec<PortNames> = outcomes.collect();
    if !outcomes.is_empty() {
        return outcomes;
    }
    let inputs = item.inputs.iter().zip(ports).zip(slots);
    inputs
        .map(|((input_source, port), slot)| PortNames {
            source: source(net, input_source),
            ..port_names(net, number, port, *slot)
        })
        .collect()
}

/// Returns the ids of the motions. Motions are numbered in the order in which primitives are lowered.
fn motions(net: Typed<'_>, lowered: &Lowered) -> Vec<String> {
    let items = lowered
        .order
        .iter()
        .filter_map(|item| net.graph.items.get(*item));
    let motions = items.filter(|item| item.spec().role == Role::Motion);
    motions.map(|item| item.id().to_string()).collect()
}

fn inputs(net: Typed<'_>, lowered: &Lowered) -> Vec<InputNames> {
    let items = net.graph.items_of(|spec| spec.role == Role::Input);
    let named = items.filter_map(|(number, item)| {
        let port = item.spec().outputs.first()?;
        let slot = lowered.slots.outputs(number).first()?;
        Some((item, port_names(net, number, port, *slot)))
    });
    let plan = &lowered.plan;
    let rows = named.zip(&plan.inputs).map(|((item, port), point)| {
        let bound = |slot: Option<u32>| slot.map_or(Vec::new(), |slot| numbers(plan, point, slot));
        let expires_s = f64::from(point.expires) / net.graph.evaluations_hz();
        InputNames {
            primitive: item.id().to_string(),
            topic: item.topic().map(str::to_owned),
            type_name: port.type_name.into_owned(),
            unit: port.unit.map(Cow::into_owned),
            at_least: bound(point.at_least),
            at_most: bound(point.at_most),
            expires_s: (point.expires > 0).then_some(expires_s),
        }
    });
    rows.collect()
}

fn publishes(net: Typed<'_>, lowered: &Lowered) -> Vec<TopicNames> {
    let items = net.graph.items_of(|spec| spec.role == Role::Publish);
    let rows = items.filter_map(|(number, item)| {
        let port = item.spec().outputs.first()?;
        let slot = lowered.slots.outputs(number).first()?;
        let port = port_names(net, number, port, *slot);
        Some(TopicNames {
            primitive: item.id().to_string(),
            topic: item.topic()?.to_owned(),
            type_name: port.type_name.into_owned(),
            unit: port.unit.map(Cow::into_owned),
        })
    });
    rows.collect()
}

/// Returns the elements of a bound; NaN for null.
fn numbers(plan: &PlanData, point: &InputPoint, slot: u32) -> Vec<f64> {
    let (first, count) = (slot as usize, point.width as usize);
    match point.store {
        Store::Real => plan.reals.iter().skip(first).take(count).copied().collect(),
        Store::Int => {
            let values = plan.ints.iter().skip(first).take(count);
            let numbers = values.map(|value| match *value {
                NULL_INT => NULL_REAL,
                value => value as f64,
            });
            numbers.collect()
        }
        Store::Bool => Vec::new(),
    }
}

fn monitor_names(
    net: Typed<'_>,
    number: usize,
    item: &ResolvedPrimitive<'_>,
    port: &Port,
    slot: SlotRange,
) -> MonitorNames {
    let names = port_names(net, number, port, slot);
    let source = item
        .inputs
        .first()
        .and_then(|input_source| source(net, input_source));
    let every = every(item, net.graph).unwrap_or(1);
    MonitorNames {
        primitive: item.id().to_string(),
        source: match source {
            Some(source) => source.into(),
            None => format!("{}.{}", item.id(), port.name),
        },
        store: names.store,
        slot: names.slot,
        width: names.width,
        type_name: names.type_name.into_owned(),
        unit: names.unit.map(Cow::into_owned),
        rate_hz: net.graph.evaluations_hz() / f64::from(every),
        every,
        never_null: false,
    }
}

fn link_name(net: Typed<'_>, link: &ResolvedLink<'_>) -> ShortText {
    let output = net.graph.output_name(link.from);
    match link.part {
        Some(part) => format!("{output}{part}").into(),
        None => output,
    }
}

fn source(net: Typed<'_>, input_source: &InputSource<'_>) -> Option<ShortText> {
    match input_source {
        InputSource::Link(link) => Some(link_name(net, link)),
        InputSource::List(list) => {
            let elements = list.elements.iter().map(|element| match element {
                ListElement::Link(link) => link_name(net, link),
                ListElement::Literal(literal, _) => literal.to_string().into(),
            });
            let elements: Vec<ShortText> = elements.collect();
            Some(format!("[{}]", elements.join(", ")).into())
        }
        _ => None,
    }
}

/// Returns name, slots, type and unit of a port.
pub(crate) fn port_names(net: Typed<'_>, number: usize, port: &Port, slot: SlotRange) -> PortNames {
    let (type_name, unit) = net.port_texts(number, port);
    PortNames {
        name: Cow::Borrowed(port.name),
        store: slot.store,
        slot: slot.slot,
        width: slot.width,
        type_name,
        unit,
        source: None,
    }
}
