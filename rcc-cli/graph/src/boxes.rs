//! A primitive as a box: lines of text, ports and their positions. Pure.

use rcc_language::structure::{NetStructure, PortInfo, PrimitiveInfo, PrimitiveRole, SourceInfo};

use super::layout::{LayerConstraint, NodeShape};
use super::text::{fit, lines, width};
use super::{PortValues, constant, constants, drawn_role, is_label, links, shown};

/// Font size of ids.
pub const ID_SIZE: f64 = 13.0;
/// Font size of types, parameters and ports.
pub const PORT_SIZE: f64 = 11.0;
/// Font size of the ports' types and units.
pub const SMALL_SIZE: f64 = 9.5;

const HEAD: f64 = 40.0;
const LINE: f64 = 15.0;
const PORT: f64 = 29.0;
const SIDE: f64 = 12.0;
const MIDDLE: f64 = 22.0;
const PARAMETERS_MAX: usize = 6;
const LEAST: f64 = 108.0;
const MOST: f64 = 340.0;

/// Label of one port.
#[derive(Clone, Debug, PartialEq)]
pub struct PortLabel {
    /// Index of the port in the primitive's type.
    pub port: usize,
    /// Name, with the value if a constant feeds the port.
    pub name: String,
    /// Type and unit, or the current value.
    pub small: String,
    /// True if the port can be null.
    pub null: bool,
    /// True if a link starts or ends here.
    pub linked: bool,
    /// Distance of its dot from the top of the box.
    pub y: f64,
}

/// A primitive as a box.
#[derive(Clone, Debug, PartialEq)]
pub struct PrimitiveBox {
    /// Index of the primitive in the net.
    pub part: usize,
    /// Text of the heading.
    pub id: String,
    /// Type and device.
    pub kind: String,
    /// Role, which gives the colour.
    pub role: PrimitiveRole,
    /// Lines below the heading.
    pub parameters: Vec<String>,
    /// Inputs, on the left.
    pub inputs: Vec<PortLabel>,
    /// Outputs, on the right.
    pub outputs: Vec<PortLabel>,
    /// Monitors of this primitive, and unread outputs.
    pub notes: Vec<String>,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

impl PrimitiveBox {
    /// Returns the y position of the first line below the heading.
    #[must_use]
    pub const fn first_line() -> f64 {
        HEAD + 14.0
    }

    /// Returns the y position of the first note.
    #[must_use]
    pub fn first_note(&self) -> f64 {
        self.height - 6.0 - LINE * (self.notes.len() as f64 - 1.0)
    }

    /// Line spacing.
    pub const LINE: f64 = LINE;

    /// Returns size and ports for the layout.
    #[must_use]
    pub fn shape(&self) -> NodeShape {
        NodeShape {
            width: self.width,
            height: self.height,
            inputs: self.inputs.iter().map(|port| port.y).collect(),
            outputs: self.outputs.iter().map(|port| port.y).collect(),
            constraint: LayerConstraint::Free,
        }
    }

    /// Returns the index of a port among the labels of its side.
    #[must_use]
    pub fn label(ports: &[PortLabel], port: usize) -> Option<usize> {
        ports.iter().position(|label| label.port == port)
    }
}

/// Returns the boxes of a net: all primitives except those drawn as labels of others.
#[must_use]
pub fn boxes(net: &NetStructure, values: Option<&PortValues>) -> Vec<PrimitiveBox> {
    let mut read: Vec<Vec<bool>> = net
        .primitives
        .iter()
        .map(|part| vec![false; part.outputs.len()])
        .collect();
    for (reader, _, _, link) in links(net) {
        if !is_label(net, &net.primitives[reader]) {
            read[link.primitive][link.output] = true;
        }
    }
    let mut watched: Vec<Vec<(usize, String)>> = vec![Vec::new(); net.primitives.len()];
    for part in &net.primitives {
        if let Some(link) = shown(net, part) {
            watched[link.primitive].push((link.output, watch(net, part)));
        }
    }
    let parts = net.primitives.iter().enumerate();
    let parts = parts.filter(|(_, part)| !is_label(net, part));
    parts
        .map(|(number, part)| {
            primitive_box(net, number, part, &read[number], &watched[number], values)
        })
        .collect()
}

/// Formats a monitor: "watch_pose: pose, 100 Hz".
fn watch(net: &NetStructure, part: &PrimitiveInfo) -> String {
    let link = shown(net, part);
    let output = link.and_then(|link| {
        let port = net
            .primitives
            .get(link.primitive)?
            .outputs
            .get(link.output)?;
        Some(match &link.part {
            Some(part) => format!("{}{part}", port.name),
            None => port.name.to_string(),
        })
    });
    let rate = part
        .parameters
        .first()
        .map_or("", |(_, rate)| rate.as_str());
    let parts = [output.unwrap_or_default(), rate.to_owned()];
    let parts: Vec<&str> = parts
        .iter()
        .map(String::as_str)
        .filter(|it| !it.is_empty())
        .collect();
    format!("◉ {}: {}", short_id(&part.id), parts.join(", "))
}

/// Returns the id without its fragments, which are shown by the frames.
fn short_id(id: &str) -> &str {
    id.rsplit('/').next().unwrap_or(id)
}

fn primitive_box(
    net: &NetStructure,
    number: usize,
    part: &PrimitiveInfo,
    read: &[bool],
    watched: &[(usize, String)],
    values: Option<&PortValues>,
) -> PrimitiveBox {
    let value = |port: &str| values?.get(&format!("{}.{port}", part.id)).cloned();
    let inputs = part.inputs.iter().enumerate();
    let inputs = inputs.map(|(port, pin)| input(net, port, pin, value(&pin.name)));
    let outputs = part
        .outputs
        .iter()
        .enumerate()
        .filter(|(port, _)| read[*port]);
    let outputs = outputs.map(|(port, pin)| PortLabel {
        port,
        name: pin.name.to_string(),
        small: value(&pin.name).unwrap_or_else(|| kind(pin)),
        null: part.null.is_some(),
        linked: true,
        y: 0.0,
    });
    let is_watched = |port: usize| watched.iter().any(|(output, _)| *output == port);
    let unread = part.outputs.iter().enumerate();
    let unread = unread.filter(|(port, _)| !read[*port] && !is_watched(*port));
    let unread: Vec<String> = unread
        .map(|(_, pin)| match value(&pin.name) {
            Some(value) => format!("{} {value}", pin.name),
            None => pin.name.to_string(),
        })
        .collect();
    let mut it = PrimitiveBox {
        part: number,
        id: short_id(&part.id).to_owned(),
        kind: match &part.device {
            Some(device) => format!("{} · {device}", part.type_name),
            None => part.type_name.to_owned(),
        },
        role: drawn_role(part),
        parameters: parameters(net, part),
        inputs: inputs.collect(),
        outputs: outputs.collect(),
        notes: watched.iter().map(|(_, text)| text.clone()).collect(),
        width: 0.0,
        height: 0.0,
    };
    measure(&mut it);
    if !unread.is_empty() {
        let unread = format!("not read: {}", unread.join(", "));
        it.notes
            .extend(lines(&unread, SMALL_SIZE, it.width - 2.0 * SIDE, 3));
        measure(&mut it);
    }
    it
}

fn input(net: &NetStructure, port: usize, pin: &PortInfo, value: Option<String>) -> PortLabel {
    let is_constant = |source: &SourceInfo| match source {
        SourceInfo::Constant(_) | SourceInfo::Default(_) => true,
        SourceInfo::Link(link) => constant(net, link).is_some(),
    };
    let linked = !pin.sources.iter().all(is_constant);
    let first = pin.sources.iter().find_map(|source| match source {
        SourceInfo::Link(link) if link.delayed => Some(link.initial.as_deref().unwrap_or("null")),
        _ => None,
    });
    let kind = kind(pin);
    PortLabel {
        port,
        name: match constants(net, pin) {
            Some(constants) => format!("{} = {constants}", pin.name),
            None => pin.name.to_string(),
        },
        small: match (value, first) {
            (Some(value), _) if linked => value,
            (_, Some(first)) => format!("{kind}, first {first}"),
            _ => kind,
        },
        null: pin.null.is_some(),
        linked,
        y: 0.0,
    }
}

fn kind(pin: &PortInfo) -> String {
    match &pin.unit {
        Some(unit) => format!("{} {}", pin.type_name, with_superscripts(unit)),
        None => pin.type_name.clone(),
    }
}

/// Replaces powers in units by superscripts.
fn with_superscripts(text: &str) -> String {
    text.replace("^2", "²").replace("^3", "³")
}

fn parameters(net: &NetStructure, part: &PrimitiveInfo) -> Vec<String> {
    let all = part.parameters.iter();
    let mut shown: Vec<String> = all
        .take(PARAMETERS_MAX)
        .map(|(name, value)| format!("{name} {}", with_superscripts(value)))
        .collect();
    if let Some(more @ 1..) = part.parameters.len().checked_sub(PARAMETERS_MAX) {
        shown.push(format!("… {more} more"));
    }
    if let Some(condition) = net.condition(&part.id) {
        shown.push(format!("while {condition}"));
    }
    shown
}

/// Computes the size and the positions of the ports; truncates texts that are too long for any box.
fn measure(it: &mut PrimitiveBox) {
    let cut = |text: &mut String, size: f64, most: f64| *text = fit(text, size, most);
    cut(&mut it.id, ID_SIZE, MOST - 2.0 * SIDE);
    cut(&mut it.kind, PORT_SIZE, MOST - 2.0 * SIDE);
    for line in it.parameters.iter_mut() {
        cut(line, SMALL_SIZE, MOST - 2.0 * SIDE);
    }
    for line in it.notes.iter_mut() {
        cut(line, SMALL_SIZE, MOST - 2.0 * SIDE);
    }
    let half = (MOST - 2.0 * SIDE - MIDDLE) / 2.0;
    for port in it.inputs.iter_mut().chain(&mut it.outputs) {
        cut(&mut port.name, PORT_SIZE, half);
        cut(&mut port.small, SMALL_SIZE, half);
    }
    let side = |ports: &[PortLabel]| {
        let widths = ports.iter();
        let widths = widths.map(|it| width(&it.name, PORT_SIZE).max(width(&it.small, SMALL_SIZE)));
        widths.fold(0.0, f64::max)
    };
    let (left, right) = (side(&it.inputs), side(&it.outputs));
    let middle = if left > 0.0 && right > 0.0 {
        MIDDLE
    } else {
        0.0
    };
    let texts = it.parameters.iter().chain(&it.notes);
    let widest = texts
        .map(|text| width(text, SMALL_SIZE))
        .fold(0.0, f64::max);
    let head = width(&it.id, ID_SIZE).max(width(&it.kind, PORT_SIZE));
    it.width = (left + middle + right)
        .max(widest)
        .max(head)
        .max(LEAST - 2.0 * SIDE)
        + 2.0 * SIDE;
    it.width = it.width.ceil();
    let first =
        HEAD + LINE * it.parameters.len() as f64 + if it.parameters.is_empty() { 0.0 } else { 5.0 };
    for ports in [&mut it.inputs, &mut it.outputs] {
        for (row, port) in ports.iter_mut().enumerate() {
            port.y = first + PORT * row as f64 + 16.0;
        }
    }
    let rows = it.inputs.len().max(it.outputs.len()) as f64;
    let notes = LINE * it.notes.len() as f64 + if it.notes.is_empty() { 0.0 } else { 5.0 };
    it.height = first + PORT * rows + notes + 4.0;
}
