//! Replaces a primitive by the net of its row. Runs on the loader's threads.

use rcc_config::diagnostic::Span;
use rcc_config::yaml::{Key, ShortText};
use rcc_core::primitive::{ChannelKind, ParameterKind, Spec};
use rcc_core::primitives;
use rcc_language::codes;
use rcc_language::syntax::literal::{Literal, LiteralShape};

use super::{BuiltOutput, BuiltPrimitive, BuiltValue, Conversion};
use crate::table::TypeEntry;
use crate::text::{self, AstArgument, AstFragment, AstPrimitive};

/// The expansion of a row's net for one primitive.
struct RowExpansion<'r> {
    number: usize,
    /// Id of the primitive in the text.
    id: ShortText,
    entry: &'static TypeEntry,
    names: Vec<(&'r str, usize)>,
    made: Vec<usize>,
}

impl Conversion<'_, '_> {
    /// Replaces primitive `number` by `net`.
    pub(super) fn expand(
        &mut self,
        number: usize,
        entry: &'static TypeEntry,
        net: &'static AstFragment,
    ) {
        let mut place = RowExpansion {
            number,
            id: self.id_of(number),
            entry,
            names: Vec::new(),
            made: Vec::new(),
        };
        for item in &net.items {
            let Some(port) = &item.port else {
                if let AstPrimitive::Typed(ty, arguments) = &item.primitive {
                    let made = self.make(&mut place, ty, arguments, &item.name.name);
                    place
                        .names
                        .extend(made.map(|made| (item.name.name.as_str(), made)));
                }
                continue;
            };
            let (value, _) = self.evaluate(&mut place, &item.primitive, port);
            if let Some(output) = entry.output(&item.name.name) {
                self.put(number, output.name, value);
            }
        }
        // The last primitive of the expansion takes the id of the primitive in the text.
        if let Some(built) = place.made.last().and_then(|last| self.built.get_mut(*last)) {
            built.id = place.id;
        }
    }

    fn evaluate(
        &mut self,
        place: &mut RowExpansion<'_>,
        primitive: &'static AstPrimitive,
        port: &Key,
    ) -> (BuiltValue, Span) {
        let span = self.span(place.number);
        match primitive {
            AstPrimitive::Named(name) if name.name == "parent" => {
                self.argument(place.number, place.entry, &port.name)
            }
            AstPrimitive::Named(name) => {
                let mut names = place.names.iter();
                let made = names.find(|(known, _)| name.name == *known);
                let made = made.map(|(_, made)| *made);
                (self.output(made, &port.name), span)
            }
            AstPrimitive::Typed(ty, arguments) if ty.name == "List" => {
                let elements = arguments
                    .iter()
                    .map(|argument| self.source(place, argument).0);
                (BuiltValue::List(elements.collect()), span)
            }
            AstPrimitive::Typed(ty, arguments) if ty.name == "Else" => {
                let [link, otherwise] = arguments.as_slice() else {
                    return (BuiltValue::Refused, span);
                };
                let is_given = match &link.value {
                    text::AstValue::Link(_, input) => {
                        self.given(place.number, &input.name).is_some()
                    }
                    text::AstValue::Text(..) => false,
                };
                self.source(place, if is_given { link } else { otherwise })
            }
            AstPrimitive::Typed(ty, arguments) if ty.name == "At" => {
                let [of, index] = arguments.as_slice() else {
                    return (BuiltValue::Refused, span);
                };
                let (of, _) = self.source(place, of);
                let (index, at) = self.source(place, index);
                (self.element(&of, &index, at), span)
            }
            AstPrimitive::Typed(ty, arguments) => {
                let name = format!("{}", place.made.len() + 1);
                let made = self.make(place, ty, arguments, &name);
                (self.output(made, &port.name), span)
            }
            AstPrimitive::Fragment(..) => (BuiltValue::Refused, span),
        }
    }

    fn output(&self, made: Option<usize>, port: &str) -> BuiltValue {
        let found = made.and_then(|made| Some((made, self.spec(made)?.output(port)?.1.name)));
        found.map_or(BuiltValue::Refused, |(made, port)| {
            self.built_output(made, port)
        })
    }

    /// Returns element `index` of an array or vector.
    pub(super) fn element(
        &mut self,
        of: &BuiltValue,
        index: &BuiltValue,
        span: Span,
    ) -> BuiltValue {
        let index = match index {
            BuiltValue::Constant(literal) => match literal.shape {
                LiteralShape::Int(index) => u32::try_from(index).ok(),
                _ => None,
            },
            _ => None,
        };
        let Some(index) = index else {
            return BuiltValue::Refused;
        };
        let known = match of {
            BuiltValue::List(elements) => elements.get(index as usize).cloned(),
            BuiltValue::Constant(Literal {
                shape: LiteralShape::List(elements),
                ..
            }) => elements
                .get(index as usize)
                .cloned()
                .map(BuiltValue::Constant),
            BuiltValue::Output(output)
                if output.index.is_none() && output.length.is_none_or(|it| index < it) =>
            {
                Some(BuiltValue::Output(BuiltOutput {
                    index: Some(index),
                    length: None,
                    is_vector: false,
                    ..*output
                }))
            }
            BuiltValue::Delayed(_) => match self.pass(of.clone()) {
                BuiltValue::Output(output) => Some(BuiltValue::Output(BuiltOutput {
                    index: Some(index),
                    ..output
                })),
                _ => None,
            },
            _ => None,
        };
        if known.is_none() && !matches!(of, BuiltValue::Refused) {
            let message = format!("element {index} is out of range");
            self.error(codes::BAD_ELEMENT, span, message, None);
        }
        known.unwrap_or(BuiltValue::Refused)
    }

    fn source(
        &mut self,
        place: &mut RowExpansion<'_>,
        argument: &'static AstArgument,
    ) -> (BuiltValue, Span) {
        match &argument.value {
            text::AstValue::Link(primitive, port) => self.evaluate(place, primitive, port),
            text::AstValue::Text(text, _) => {
                let span = self.span(place.number);
                (
                    BuiltValue::Constant(Literal::new(constant(text), span)),
                    span,
                )
            }
        }
    }

    /// Creates an RCC primitive from one of a row's net.
    fn make(
        &mut self,
        place: &mut RowExpansion<'_>,
        ty: &'static Key,
        arguments: &'static [AstArgument],
        name: &str,
    ) -> Option<usize> {
        let span = self.span(place.number);
        let Some((_, catalogue)) = primitives::find(&ty.name) else {
            let message = format!(
                "`{}` needs the primitive type `{}`, which the catalogue does not have",
                place.entry.name, ty.name
            );
            let help = Some("this version of the catalogue does not have it".to_string());
            self.error(codes::NO_COUNTERPART, span, message, help);
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
                    BuiltValue::Constant(literal) => Some(literal),
                    BuiltValue::Refused => None,
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
        let made = self.built.len();
        let mut id = place.id.clone();
        id.push('_');
        id.push_str(name);
        self.built.push(BuiltPrimitive {
            id,
            span,
            ty: spec.name,
            spec: Some(spec),
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
        if let Some(built) = self.built.get_mut(made) {
            built.inputs = inputs;
        }
        Some(made)
    }

    fn must_be_constant(&mut self, entry: &TypeEntry, parameter: &str, span: Span) {
        let message = format!(
            "this is connected, but the counterpart of {} takes it as the constant parameter `{parameter}`",
            entry.name
        );
        let help = Some("set the parameter instead of connecting the input".to_string());
        self.error(codes::NO_COUNTERPART, span, message, help);
    }

    /// Converts a parameter that names a device or counts its channels to the names of the cell.
    fn device_literal(
        &mut self,
        literal: Literal,
        kind: ParameterKind,
        spec: &Spec,
        parameters: &[(&'static str, Literal)],
        entry: &TypeEntry,
    ) -> Option<Literal> {
        match (kind, &literal.shape) {
            (ParameterKind::Arm | ParameterKind::Device, LiteralShape::Text(name)) => {
                let name = self.device(name, kind == ParameterKind::Arm, literal.span)?;
                Some(Literal {
                    shape: LiteralShape::Text(name),
                    ..literal
                })
            }
            (ParameterKind::Channel(kind), LiteralShape::Int(number)) => {
                let device = parameters
                    .iter()
                    .find_map(|(_, literal)| match &literal.shape {
                        LiteralShape::Text(device) => Some(device.clone()),
                        _ => None,
                    })?;
                self.channel(&device, kind, *number, entry, spec, literal.span)
            }
            _ => Some(literal),
        }
    }

    /// Returns the cell's name for a device of the text; reports an unknown device once.
    pub(super) fn device(&mut self, name: &str, is_arm: bool, span: Span) -> Option<String> {
        let mapped = self.options.device(name).to_string();
        let found = self.cell.find(&mapped);
        let fits = found.is_some_and(|(_, device)| !is_arm || device.model.joints > 0);
        if fits {
            return Some(mapped);
        }
        if self.absent.insert(name.to_string()) {
            let wanted = if is_arm { "arm" } else { "device" };
            let devices = self.cell.devices.iter();
            let names: Vec<&str> = devices
                .filter(|device| !is_arm || device.model.joints > 0)
                .map(|device| device.name.as_str())
                .collect();
            let message = match found {
                Some(_) => format!("the cell's device `{mapped}` is not an arm"),
                None => format!("the cell has no {wanted} `{mapped}`"),
            };
            let help = format!(
                "name the cell's {wanted} for `{name}` in a line before the net, `# devices: {name}=NAME`; the cell has: {}",
                names.join(", ")
            );
            let code = if found.is_some() {
                codes::NO_ARM
            } else {
                codes::UNKNOWN_DEVICE
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
        entry: &TypeEntry,
        spec: &Spec,
        span: Span,
    ) -> Option<Literal> {
        let (_, row) = self.cell.find(device)?;
        let foreign = format!("{}.{number}", entry.name.trim_start_matches("IO::"));
        let named = self.options.channel(device, &foreign);
        let channels = row.channels_of(kind);
        let by_name = named.and_then(|name| channels.iter().find(|channel| channel.name == name));
        let by_number = usize::try_from(number)
            .ok()
            .and_then(|number| channels.get(number));
        let channel = if named.is_some() { by_name } else { by_number };
        if let Some(channel) = channel {
            return Some(Literal::new(LiteralShape::Text(channel.name.clone()), span));
        }
        let listed: Vec<String> = channels
            .iter()
            .enumerate()
            .map(|(number, channel)| format!("{number} {}", channel.name))
            .collect();
        let message = format!("`{device}` has no channel {number} for {}", spec.name);
        let help = format!(
            "channels: {}; or name it in a line before the net, `# channels: {device}.{foreign}=NAME`",
            listed.join(", ")
        );
        self.error(codes::UNKNOWN_CHANNEL, span, message, Some(help));
        None
    }
}

/// Parses a constant in the net of a row.
fn constant(text: &str) -> LiteralShape {
    match text {
        "true" => LiteralShape::Bool(true),
        "false" => LiteralShape::Bool(false),
        "null" => LiteralShape::Null,
        text => match (text.parse::<i64>(), text.parse::<f64>()) {
            (Ok(value), _) => LiteralShape::Int(value),
            (_, Ok(value)) => LiteralShape::Real(value, None),
            _ => LiteralShape::Text(text.to_string()),
        },
    }
}
