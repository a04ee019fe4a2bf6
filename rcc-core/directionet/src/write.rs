//! Writes a net as DirectIONet, as far as each of its primitives has an exact counterpart there. Everything without one
//! is reported with its span. Runs in `rcc-cli convert`.

mod constants;
mod outside;
mod reverse;

use std::collections::HashMap;

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_core::primitive::ChannelKind;
use rcc_language::codes;
use rcc_language::devices::DeviceTable;
use rcc_language::names::{Names, PrimitiveNames};
use rcc_language::syntax::literal::{Literal, LiteralShape};
use rcc_language::syntax::part::ValuePart;
use rcc_language::syntax::reference::Reference;
use rcc_language::syntax::{Link, Net, Primitive, Source};

use super::table::{FAMILIES, PrimitiveClass};
use super::values::ForeignType;
use reverse::{ReverseRow, reverse_rows};

struct TextWriter<'n, 'f> {
    net: &'n Net,
    names: HashMap<&'n str, &'n PrimitiveNames>,
    cell: &'n DeviceTable,
    rows: HashMap<&'static str, Vec<ReverseRow>>,
    diagnostics: &'f mut Vec<Diagnostic>,
}

/// Writes a net that compiles; `names` are those of its plan. Returns `None` if something has no counterpart.
#[must_use]
pub fn text(
    net: &Net,
    names: &Names,
    cell: &DeviceTable,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<String> {
    let before = diagnostics.len();
    let names = names.primitives.iter().map(|row| (row.id.as_str(), row));
    let mut writer = TextWriter {
        net,
        names: names.collect(),
        cell,
        rows: reverse_rows(),
        diagnostics,
    };
    if let Some(key) = net.uses.first() {
        writer.refuse(key.span, "libraries of fragments".to_string());
    }
    if let Some(fragment) = net.fragments.first() {
        writer.refuse(fragment.name.span, "fragments".to_string());
    }
    for literal in [&net.timing.period, &net.timing.rate, &net.timing.phase]
        .into_iter()
        .flatten()
    {
        writer.refuse(
            literal.span,
            "a period, which is given there when a net is loaded".to_string(),
        );
    }
    let items: Vec<String> = net
        .primitives
        .iter()
        .flat_map(|it| writer.primitive(it))
        .collect();
    (writer.diagnostics.len() == before).then(|| format!("{{{}}}", items.join(",")))
}

/// Returns the predecessor's type for an RCC type by its name in [`Names`].
fn foreign_type(name: &str) -> Option<ForeignType> {
    Some(match name {
        "Bool" => ForeignType::Bool,
        "Int" => ForeignType::Int,
        "Real" => ForeignType::Double,
        "Vector3" => ForeignType::Vector,
        "Rotation" => ForeignType::Rotation,
        "Pose" => ForeignType::Frame,
        "Twist" => ForeignType::Twist,
        "Wrench" => ForeignType::Wrench,
        _ => return None,
    })
}

fn family(ty: ForeignType) -> Option<&'static str> {
    let row = FAMILIES.iter().find(|row| row.1 == ty);
    row.map(|row| row.0)
}

/// Returns true for values from outside; only their output `value` has a counterpart.
fn comes_from_outside(ty: &str) -> bool {
    matches!(ty, "Input" | "Subscribe")
}

impl TextWriter<'_, '_> {
    fn refuse(&mut self, span: Span, what: String) {
        let message = format!("DirectIONet has no counterpart for {what}");
        let diagnostic = Diagnostic::error(codes::NO_COUNTERPART, span, message);
        self.diagnostics.push(
            diagnostic.help("docs/from-the-predecessor.md lists the types that have a counterpart"),
        );
    }

    /// Returns the items for a primitive.
    fn primitive(&mut self, primitive: &Primitive) -> Vec<String> {
        let id = &primitive.id.name;
        match primitive.type_name.name.as_str() {
            "Termination" => {
                let done = self.input(primitive, "done", ForeignType::Bool);
                vec![format!("outTerminate={}", done.unwrap_or_default())]
            }
            "Monitor" => self.keyed(primitive, "NetcommOut"),
            "Input" => self.keyed(primitive, "NetcommIn"),
            "Publish" => self.published(primitive),
            "Subscribe" => self.subscribed(primitive),
            "JointPositionCommand" => self.axes(primitive),
            // Read axis by axis, where it is used.
            "JointState" => Vec::new(),
            _ => {
                let Some(arguments) = self.arguments(primitive) else {
                    return Vec::new();
                };
                let (name, arguments) = arguments;
                vec![format!("{id}={name}({})", arguments.join(","))]
            }
        }
    }

    fn type_of(&self, primitive: &str, port: &str) -> Option<ForeignType> {
        let row = self.names.get(primitive)?;
        let mut ports = row.outputs.iter().chain(&row.inputs);
        foreign_type(&ports.find(|known| known.name == port)?.type_name)
    }

    /// Returns the row that matches the port types of a primitive.
    fn row(&self, primitive: &Primitive) -> Option<&ReverseRow> {
        let rows = self.rows.get(primitive.type_name.name.as_str())?;
        let id = primitive.id.name.as_str();
        let names = self.names.get(id)?;
        rows.iter().find(|row| {
            let fits = |rcc_name: &str, ty: ForeignType| {
                let known = names
                    .inputs
                    .iter()
                    .chain(&names.outputs)
                    .find(|port| port.name == rcc_name);
                known.is_none_or(|_| self.type_of(id, rcc_name) == Some(ty))
            };
            let inputs = row.arguments.iter().all(|(rcc_name, foreign)| {
                row.entry
                    .input(foreign)
                    .is_none_or(|port| port.array || fits(rcc_name, port.ty))
            });
            let outputs = row.outputs.iter().all(|(rcc_name, foreign)| {
                row.entry
                    .output(foreign)
                    .is_none_or(|port| port.array || fits(rcc_name, port.ty))
            });
            inputs && outputs
        })
    }

    /// Returns type and arguments of a primitive that a reversed row describes.
    fn arguments(&mut self, primitive: &Primitive) -> Option<(String, Vec<String>)> {
        let Some(row) = self.row(primitive) else {
            let what = format!("`{}`", primitive.type_name.name);
            self.refuse(primitive.type_name.span, what);
            return None;
        };
        let (entry, known) = (row.entry, row.arguments.clone());
        let mut arguments = Vec::new();
        for (name, source) in &primitive.inputs {
            let Some((_, foreign)) = known.iter().find(|(rcc_name, _)| *rcc_name == name.name)
            else {
                self.refuse(name.span, format!("the input `{}`", name.name));
                continue;
            };
            let port = entry.input(foreign);
            let stem = foreign
                .strip_prefix("in")
                .and_then(|stem| entry.parameter(stem));
            let ty = port.map_or(ForeignType::Any, |port| port.ty);
            match (source, port, stem) {
                (Source::Literal(literal), _, Some(parameter)) => {
                    let text = self.constant(literal, parameter.ty);
                    arguments.push(format!("{}='{text}'", parameter.name));
                }
                (source, Some(port), _) => {
                    let text = self.source(source, ty, port.array);
                    arguments.push(format!("{}={text}", port.name));
                }
                _ => self.refuse(name.span, format!("a link at `{}`", name.name)),
            }
        }
        for (name, literal) in &primitive.parameters {
            let foreign = known.iter().find(|(rcc_name, _)| *rcc_name == name.name);
            let port = foreign.and_then(|(_, foreign)| entry.parameter(foreign));
            match port {
                Some(port) if port.name == "Port" => {
                    let number = self.channel(primitive, literal);
                    arguments.push(format!("Port='{number}'"));
                }
                Some(port) => arguments.push(format!(
                    "{}='{}'",
                    port.name,
                    self.constant(literal, port.ty)
                )),
                None => self.refuse(name.span, format!("the parameter `{}`", name.name)),
            }
        }
        if let Some(active) = &primitive.active {
            if entry.row.kind == PrimitiveClass::M {
                self.refuse(primitive.id.span, format!("a condition of {}", entry.name));
            }
            arguments.push(format!(
                "inActive={}",
                self.source(active, ForeignType::Bool, false)
            ));
        }
        Some((entry.name.clone(), arguments))
    }

    fn channel(&mut self, primitive: &Primitive, channel: &Literal) -> usize {
        let kind = match primitive.type_name.name.as_str() {
            "DigitalInput" => ChannelKind::DigitalInput,
            "AnalogInput" => ChannelKind::AnalogInput,
            "DigitalOutput" | "DigitalOutputState" => ChannelKind::DigitalOutput,
            _ => ChannelKind::AnalogOutput,
        };
        let mut parameters = primitive.parameters.iter();
        let device = parameters.find(|(name, _)| name.name == "device");
        let number = device.and_then(|(_, device)| match (&device.shape, &channel.shape) {
            (LiteralShape::Text(device), LiteralShape::Text(channel)) => {
                let (_, device) = self.cell.find(device)?;
                device
                    .channels_of(kind)
                    .iter()
                    .position(|known| known.name == *channel)
            }
            _ => None,
        });
        number.unwrap_or_default()
    }

    fn robot(&mut self, primitive: &Primitive) -> Option<(String, u32)> {
        let mut parameters = primitive.parameters.iter();
        let (_, device) = parameters.find(|(name, _)| name.name == "device")?;
        let LiteralShape::Text(name) = &device.shape else {
            return None;
        };
        Some((name.clone(), self.cell.find(name)?.1.model.joints))
    }

    /// Returns one command per axis.
    fn axes(&mut self, primitive: &Primitive) -> Vec<String> {
        let Some((robot, joints)) = self.robot(primitive) else {
            return Vec::new();
        };
        let mut inputs = primitive.inputs.iter();
        let Some((name, source)) = inputs.find(|(name, _)| name.name == "position") else {
            return Vec::new();
        };
        let mut items = Vec::new();
        for axis in 0..joints {
            let value = match source {
                Source::List(list) => list
                    .elements
                    .get(axis as usize)
                    .map(|it| self.source(it, ForeignType::Double, false)),
                Source::Link(link) => {
                    let element = Link {
                        from: Reference {
                            part: Some(ValuePart::Element(axis)),
                            ..link.from.clone()
                        },
                        ..link.clone()
                    };
                    Some(self.link(&element, ForeignType::Double))
                }
                _ => None,
            };
            let Some(value) = value else {
                self.refuse(name.span, "these joint positions".to_string());
                break;
            };
            let id = &primitive.id.name;
            items.push(format!(
                "{id}_{axis}=RobotArm::JointPosition(inPosition={value},Robot='{robot}',Axis='{axis}')"
            ));
        }
        if primitive.active.is_some() {
            self.refuse(
                primitive.id.span,
                "a condition of `JointPositionCommand`".to_string(),
            );
        }
        items
    }

    fn input(&mut self, primitive: &Primitive, name: &str, ty: ForeignType) -> Option<String> {
        let mut inputs = primitive.inputs.iter();
        let (_, source) = inputs.find(|(key, _)| key.name == name)?;
        Some(self.source(source, ty, false))
    }

    fn source(&mut self, source: &Source, ty: ForeignType, array: bool) -> String {
        match source {
            Source::Link(link) => self.link(link, ty),
            Source::Literal(literal) if !array => {
                let value = self.constant(literal, ty);
                format!(
                    "{}Value(Value='{value}').outValue",
                    family(ty).unwrap_or("Core::Double")
                )
            }
            Source::List(list) => {
                let (prefix, size) = (family(ty).unwrap_or("Core::Double"), list.elements.len());
                let mut text = format!("{prefix}Array(Size='{size}').outArray");
                for (index, element) in list.elements.iter().enumerate() {
                    let element = self.source(element, ty, false);
                    text = format!(
                        "{prefix}ArraySet(inArray={text},inValue={element},Size='{size}',Index='{index}').outArray"
                    );
                }
                text
            }
            Source::Outcomes(outcomes) => {
                self.refuse(outcomes.span, "outcomes by name".to_string());
                String::new()
            }
            Source::Literal(literal) => {
                self.refuse(literal.span, "a constant array".to_string());
                String::new()
            }
            // The formula pass has replaced every formula.
            Source::Formula(_) | Source::Refused => String::new(),
        }
    }

    fn link(&mut self, link: &Link, ty: ForeignType) -> String {
        let from = &link.from;
        let primitives = &self.net.primitives;
        let Some(primitive) = primitives.iter().find(|it| it.id.name == from.primitive) else {
            self.refuse(link.span, "inputs of fragments".to_string());
            return String::new();
        };
        let text = self.output(primitive, link);
        let initial = link
            .initial
            .as_ref()
            .filter(|it| it.shape != LiteralShape::Null);
        if let Some(initial) = initial {
            self.refuse(
                initial.span,
                "an initial value of a delayed link, which is null there".to_string(),
            );
        }
        match link.delayed {
            true => format!(
                "{}Pre(inValue={text}).outValue",
                family(ty).unwrap_or("Core::Double")
            ),
            false => text,
        }
    }

    /// Returns the source of a link without its delay.
    fn output(&mut self, primitive: &Primitive, link: &Link) -> String {
        let from = &link.from;
        let id = &from.primitive;
        let ty = primitive.type_name.name.as_str();
        match (ty, from.port.as_str(), from.part) {
            ("JointState", "position" | "hold", Some(ValuePart::Element(axis))) => {
                let robot = self
                    .robot(primitive)
                    .map_or_else(String::new, |(robot, _)| robot);
                let port = if from.port == "hold" {
                    "outCommandedPosition"
                } else {
                    "outMeasuredPosition"
                };
                return format!("RobotArm::JointMonitor(Robot='{robot}',Axis='{axis}').{port}");
            }
            ("Input" | "Subscribe", "value", None) => return format!("{id}.outValue"),
            _ => {}
        }
        let row = self.row(primitive);
        let found = row.and_then(|row| {
            let (_, foreign) = row
                .outputs
                .iter()
                .find(|(rcc_name, _)| *rcc_name == from.port)?;
            row.entry.output(foreign)
        });
        let size = self.names.get(id.as_str()).and_then(|names| {
            let mut outputs = names.outputs.iter();
            Some(outputs.find(|port| port.name == from.port)?.width)
        });
        match (found, from.part) {
            (Some(port), None) => format!("{id}.{}", port.name),
            (Some(port), Some(ValuePart::Element(index))) if port.array => {
                let (prefix, size) = (family(port.ty).unwrap_or("Core::Double"), size.unwrap_or(0));
                format!(
                    "{prefix}ArrayGet(inArray={id}.{},Size='{size}',Index='{index}').outValue",
                    port.name
                )
            }
            // Without any counterpart it is reported at the primitive itself.
            (None, _) if self.row(primitive).is_none() && !comes_from_outside(ty) => String::new(),
            _ => {
                self.refuse(link.span, format!("`{from}`"));
                String::new()
            }
        }
    }
}
