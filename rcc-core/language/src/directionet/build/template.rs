//! The net of a row put in place of a primitive. The loader's threads.

use std::collections::HashMap;

use rcc_config::diagnostic::Span;
use rcc_config::yaml::Key;
use rcc_core::primitive::{ChannelKind, ParameterKind, Spec};
use rcc_core::primitives;

use super::{Build, Ours, Value, Wire};
use crate::directionet::table::Entry;
use crate::directionet::text::{self, Argument, Fragment, Primitive};
use crate::fault;
use crate::syntax::literal::{Literal, Shape};

/// The place where the net of a row is put.
struct Place<'r> {
    number: usize,
    entry: &'static Entry,
    names: HashMap<&'r str, usize>,
    made: Vec<usize>,
}

impl Build<'_, '_> {
    /// Puts `net` in place of primitive `number`.
    pub(super) fn expand(&mut self, number: usize, entry: &'static Entry, net: &'static Fragment) {
        let mut place = Place {
            number,
            entry,
            names: HashMap::new(),
            made: Vec::new(),
        };
        for item in &net.items {
            let Some(port) = &item.port else {
                if let Primitive::Typed(ty, arguments) = &item.primitive {
                    let made = self.make(&mut place, ty, arguments, &item.name.name);
                    place
                        .names
                        .extend(made.map(|made| (item.name.name.as_str(), made)));
                }
                continue;
            };
            let (value, _) = self.evaluate(&mut place, &item.primitive, port);
            let output = entry.output(&item.name.name);
            if let (Some(output), Some(values)) = (output, self.values.get_mut(number)) {
                values.insert(output.name, value);
            }
        }
        // What the text calls `x` is called so here, if it is one thing; else its last part is.
        if let [.., last] = place.made.as_slice() {
            let id = self.id_of(number);
            if let Some(ours) = self.ours.get_mut(*last) {
                ours.id = id;
            }
        }
    }

    fn evaluate(
        &mut self,
        place: &mut Place<'_>,
        primitive: &'static Primitive,
        port: &Key,
    ) -> (Value, Span) {
        let span = self.span(place.number);
        match primitive {
            Primitive::Named(name) if name.name == "parent" => {
                self.argument(place.number, place.entry, &port.name)
            }
            Primitive::Named(name) => {
                let made = place.names.get(name.name.as_str()).copied();
                (self.output(made, &port.name), span)
            }
            Primitive::Typed(ty, arguments) if ty.name == "List" => {
                let elements = arguments
                    .iter()
                    .map(|argument| self.source(place, argument).0);
                (Value::List(elements.collect()), span)
            }
            Primitive::Typed(ty, arguments) if ty.name == "Else" => {
                let [link, otherwise] = arguments.as_slice() else {
                    return (Value::Refused, span);
                };
                let is_given = match &link.value {
                    text::Value::Link(_, input) => self.given(place.number, &input.name).is_some(),
                    text::Value::Text(..) => false,
                };
                self.source(place, if is_given { link } else { otherwise })
            }
            Primitive::Typed(ty, arguments) if ty.name == "At" => {
                let [of, index] = arguments.as_slice() else {
                    return (Value::Refused, span);
                };
                let (of, _) = self.source(place, of);
                let (index, at) = self.source(place, index);
                (self.element(of, &index, at), span)
            }
            Primitive::Typed(ty, arguments) => {
                let name = format!("{}", place.made.len() + 1);
                let made = self.make(place, ty, arguments, &name);
                (self.output(made, &port.name), span)
            }
            Primitive::Fragment(..) => (Value::Refused, span),
        }
    }

    fn output(&self, made: Option<usize>, port: &str) -> Value {
        let found = made.and_then(|made| Some((made, self.spec(made)?.output(port)?.1.name)));
        found.map_or(Value::Refused, |(made, port)| self.wire(made, port))
    }

    /// Element `index` of an array or vector.
    pub(super) fn element(&mut self, of: Value, index: &Value, span: Span) -> Value {
        let index = match index {
            Value::Constant(literal) => match literal.shape {
                Shape::Int(index) => u32::try_from(index).ok(),
                _ => None,
            },
            _ => None,
        };
        let Some(index) = index else {
            return Value::Refused;
        };
        let known = match &of {
            Value::List(elements) => elements.get(index as usize).cloned(),
            Value::Constant(Literal {
                shape: Shape::List(elements),
                ..
            }) => elements.get(index as usize).cloned().map(Value::Constant),
            Value::Wire(wire)
                if wire.index.is_none() && wire.length.is_none_or(|it| index < it) =>
            {
                Some(Value::Wire(Wire {
                    index: Some(index),
                    length: None,
                    is_vector: false,
                    ..*wire
                }))
            }
            Value::Delayed(_) => match self.pass(of.clone()) {
                Value::Wire(wire) => Some(Value::Wire(Wire {
                    index: Some(index),
                    ..wire
                })),
                _ => None,
            },
            _ => None,
        };
        if known.is_none() && !matches!(of, Value::Refused) {
            let message = format!("there is no element {index}");
            self.error(fault::BAD_ELEMENT, span, message, None);
        }
        known.unwrap_or(Value::Refused)
    }

    fn source(&mut self, place: &mut Place<'_>, argument: &'static Argument) -> (Value, Span) {
        match &argument.value {
            text::Value::Link(primitive, port) => self.evaluate(place, primitive, port),
            text::Value::Text(text, _) => {
                let span = self.span(place.number);
                (Value::Constant(Literal::new(constant(text), span)), span)
            }
        }
    }

    /// Makes a primitive of ours from one of a row's net.
    fn make(
        &mut self,
        place: &mut Place<'_>,
        ty: &'static Key,
        arguments: &'static [Argument],
        name: &str,
    ) -> Option<usize> {
        let span = self.span(place.number);
        let Some((_, catalogue)) = primitives::find(&ty.name) else {
            let message = format!(
                "`{}` needs `{}`, which is not there",
                place.entry.name, ty.name
            );
            let help = Some("this version of the catalogue does not have it".to_string());
            self.error(fault::NO_COUNTERPART, span, message, help);
            return None;
        };
        let spec = &catalogue.spec;
        let mut parameters = Vec::new();
        let mut inputs = Vec::new();
        for argument in arguments {
            let (value, span) = self.source(place, argument);
            let parameter = spec
                .parameters
                .iter()
                .find(|it| it.name == argument.name.name);
            if let Some((_, port)) = spec.input(&argument.name.name) {
                inputs.push((port, value, span));
            } else if let Some(parameter) = parameter {
                let literal = match value {
                    Value::Constant(literal) => Some(literal),
                    Value::Refused => None,
                    _ => {
                        self.must_be_constant(place.entry, parameter.name, span);
                        None
                    }
                };
                let literal = literal.and_then(|it| {
                    self.device_literal(it, parameter.kind, spec, &parameters, place.entry)
                });
                parameters.extend(literal.map(|literal| (parameter.name, literal)));
            }
        }
        let made = self.ours.len();
        self.ours.push(Ours {
            id: format!("{}_{name}", self.id_of(place.number)),
            span,
            ty: spec.name,
            parameters,
            inputs: Vec::new(),
            active: None,
            made_for: place.number,
        });
        place.made.push(made);
        let inputs: Vec<_> = inputs
            .into_iter()
            .map(|(port, value, span)| (port.name, self.fit(value, made, port), span))
            .collect();
        if let Some(ours) = self.ours.get_mut(made) {
            ours.inputs = inputs;
        }
        Some(made)
    }

    fn must_be_constant(&mut self, entry: &Entry, parameter: &str, span: Span) {
        let message = format!(
            "this is connected, and what becomes of {} takes it as the constant `{parameter}`",
            entry.name
        );
        let help = Some("give it as the parameter instead of the link".to_string());
        self.error(fault::NO_COUNTERPART, span, message, help);
    }

    /// A parameter that names a device or counts its channels, in the words of the cell.
    fn device_literal(
        &mut self,
        literal: Literal,
        kind: ParameterKind,
        spec: &Spec,
        parameters: &[(&'static str, Literal)],
        entry: &Entry,
    ) -> Option<Literal> {
        match (kind, &literal.shape) {
            (ParameterKind::Arm | ParameterKind::Device, Shape::Text(name)) => {
                let name = self.device(name, kind == ParameterKind::Arm, literal.span)?;
                Some(Literal {
                    shape: Shape::Text(name),
                    ..literal
                })
            }
            (ParameterKind::Channel(kind), Shape::Int(number)) => {
                let device = parameters
                    .iter()
                    .find_map(|(_, literal)| match &literal.shape {
                        Shape::Text(device) => Some(device.clone()),
                        _ => None,
                    })?;
                self.channel(&device, kind, *number, entry, spec, literal.span)
            }
            _ => Some(literal),
        }
    }

    /// The cell's name for a device of the text; reports it once if there is none.
    pub(super) fn device(&mut self, name: &str, is_arm: bool, span: Span) -> Option<String> {
        let mapped = self.options.device(name).to_string();
        let found = self.cell.find(&mapped);
        let fits = found.is_some_and(|(_, device)| !is_arm || device.model.joints > 0);
        if fits {
            return Some(mapped);
        }
        if !self.absent.iter().any(|it| it == name) {
            self.absent.push(name.to_string());
            let wanted = if is_arm { "arm" } else { "device" };
            let devices = self.cell.devices.iter();
            let names: Vec<&str> = devices
                .filter(|device| !is_arm || device.model.joints > 0)
                .map(|device| device.name.as_str())
                .collect();
            let message = match found {
                Some(_) => format!("the cell's device `{mapped}` is no arm"),
                None => format!("the cell has no {wanted} `{mapped}`"),
            };
            let help = format!(
                "say which {wanted} of the cell `{name}` is: `# devices: {name}=NAME` before the net; the cell has: {}",
                names.join(", ")
            );
            let code = if found.is_some() {
                fault::NO_ARM
            } else {
                fault::UNKNOWN_DEVICE
            };
            self.error(code, span, message, Some(help));
        }
        None
    }

    fn channel(
        &mut self,
        device: &str,
        kind: ChannelKind,
        number: i64,
        entry: &Entry,
        spec: &Spec,
        span: Span,
    ) -> Option<Literal> {
        let (_, row) = self.cell.find(device)?;
        let theirs = format!("{}.{number}", entry.name.trim_start_matches("IO::"));
        let named = self.options.channel(device, &theirs);
        let channels = row.channels_of(kind);
        let by_name = named.and_then(|name| channels.iter().find(|channel| channel.name == name));
        let by_number = usize::try_from(number)
            .ok()
            .and_then(|number| channels.get(number));
        let channel = if named.is_some() { by_name } else { by_number };
        if let Some(channel) = channel {
            return Some(Literal::new(Shape::Text(channel.name.clone()), span));
        }
        let listed: Vec<String> = channels
            .iter()
            .enumerate()
            .map(|(number, channel)| format!("{number} {}", channel.name))
            .collect();
        let message = format!("`{device}` has no channel {number} for {}", spec.name);
        let help = format!(
            "it has: {}; or say which one it is: `# channels: {device}.{theirs}=NAME` before the net",
            listed.join(", ")
        );
        self.error(fault::UNKNOWN_CHANNEL, span, message, Some(help));
        None
    }
}

/// A constant in the net of a row.
fn constant(text: &str) -> Shape {
    match text {
        "true" => Shape::Bool(true),
        "false" => Shape::Bool(false),
        "null" => Shape::Null,
        text => match (text.parse::<i64>(), text.parse::<f64>()) {
            (Ok(value), _) => Shape::Int(value),
            (_, Ok(value)) => Shape::Real(value, None),
            _ => Shape::Text(text.to_string()),
        },
    }
}
