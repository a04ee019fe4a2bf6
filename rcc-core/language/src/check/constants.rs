//! Rules about the types, units and ranges of constants. Runs on the loader's threads.

use std::fmt::Display;

use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitive::{
    ChannelKind, DefaultValue, Parameter, ParameterKind, Port, PortType, Role, UnitRule,
};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use crate::codes;
use crate::infer::Typed;
use crate::resolve::{InputSource, ListElement};
use crate::syntax::literal::{Literal, LiteralShape};

/// Remedy for a whole number where a real one is expected, and the reverse.
pub const WHOLE_AND_REAL: &str = "Int and Real are not converted implicitly: convert the Int with `{type: ToReal, inputs: {in: …}}`";

/// Requires that constants at inputs and parameters have the types and units of their ports.
pub fn literals_fit(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        let mut check_literal = |literal: &Literal, name: &str, ty: PortType, unit: UnitRule| {
            let ty = net.inferred.port_type(net.graph, number, ty);
            let unit = net.inferred.port_unit(net.graph, number, unit);
            if let Some(ty) = ty {
                let place = format_args!("{}.{name}", item.id());
                literal_fits(literal, ty, unit, place, diagnostics);
            }
        };
        for (input_source, port) in item.inputs.iter().zip(item.spec().inputs) {
            if let (InputSource::Literal(literal), false) =
                (input_source, matches!(port.ty, PortType::Many(_)))
            {
                check_literal(literal, port.name, port.ty, port.unit);
            }
        }
        for (literal, parameter) in item.parameters.iter().zip(item.spec().parameters) {
            if let (Some(literal), Some((ty, unit))) = (literal, parameter.kind.value()) {
                check_literal(literal, parameter.name, ty, unit);
            }
        }
        for (port, name, condition) in item.conditions() {
            if let (ListElement::Literal(literal, _), Some(port)) =
                (condition, item.spec().inputs.get(port))
            {
                check_literal(literal, name, port.ty, port.unit);
            }
        }
        for (port, list) in item.lists() {
            for element in &list.elements {
                if let (ListElement::Literal(literal, position), Some(port)) =
                    (element, item.spec().inputs.get(port))
                    && let Some(ty) = net
                        .inferred
                        .position_type(net.graph, number, port, *position)
                {
                    let unit = net
                        .inferred
                        .position_unit(net.graph, number, port, *position);
                    let place = format_args!("{}.{}{}", item.id(), port.name, position);
                    literal_fits(literal, ty, unit, place, diagnostics);
                }
            }
        }
    }
}

/// Checks one constant against the type and unit of a port.
pub fn literal_fits(
    literal: &Literal,
    ty: Type,
    unit: Option<Unit>,
    place: impl Display,
    diagnostics: &mut Vec<Diagnostic>,
) {
    if !literal.fits(ty) {
        let message = format!("type mismatch: `{place}` expects {ty}, found {literal}");
        let diagnostic = Diagnostic::error(codes::TYPE_MISMATCH, literal.span, message);
        diagnostics.push(diagnostic.help_if(example_of(literal, ty)));
        return;
    }
    // The units of a composite are implied by its type, so its constants are bare numbers.
    let want = unit.unwrap_or(Unit::ONE);
    for (have, span) in literal.units() {
        if have != want {
            let message = format!("unit mismatch: `{place}` expects {want}, found {have}");
            let diagnostic = Diagnostic::error(codes::UNIT_MISMATCH, span, message);
            diagnostics.push(diagnostic.label(format!("in {have}")));
        }
    }
}

/// Returns an example of a constant of the type, where the notation is not obvious.
fn example_of(literal: &Literal, ty: Type) -> Option<String> {
    match (ty, &literal.shape) {
        (Type::Real | Type::Int, LiteralShape::Text(text)) if text.parse::<f64>().is_ok() => {
            Some("a number in quotes is text: remove the quotes".to_string())
        }
        (_, LiteralShape::Text(text)) if text.contains('.') => Some(format!(
            "a parameter must be a constant: `{text}` can only be connected to an input"
        )),
        (Type::Pose, _) => {
            Some("write `{xyz: [0.4, 0.1, 0.5], rpy: [deg(180), 0, 0]}`".to_string())
        }
        (Type::Rotation, _) => Some("write `{rpy: [deg(180), 0, 0]}`".to_string()),
        (Type::Bool, _) => Some("write true or false".to_string()),
        (Type::Int, LiteralShape::Real(..)) => Some(WHOLE_AND_REAL.to_string()),
        (Type::Matrix(rows, columns), LiteralShape::List(_)) => {
            let row = format!("[{}]", vec!["…"; usize::from(columns)].join(", "));
            Some(format!(
                "write {rows} rows of {columns} numbers: `[{row}, …]`"
            ))
        }
        (ty, LiteralShape::List(_)) if ty.width() > 1 => {
            Some(format!("write a list of {}", ty.width()))
        }
        _ => None,
    }
}

/// Requires that parameters are within the ranges of their specs.
pub fn parameters_are_in_range(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items_of(|spec| !spec.parameters.is_empty()) {
        for (literal, parameter) in item.parameters.iter().zip(item.spec().parameters) {
            let Some(literal) = literal else { continue };
            let null = literal.is_null();
            let may_be_null = matches!(parameter.default, Some(DefaultValue::Null))
                || matches!(
                    parameter.kind,
                    ParameterKind::Value(PortType::Any, _)
                        | ParameterKind::Start(..)
                        | ParameterKind::First(_)
                );
            let message = if null && !may_be_null {
                "cannot be null".to_string()
            } else if parameter.rising && !rises(literal) {
                "must rise from element to element".to_string()
            } else if let Some(wanted) =
                wanted_range(parameter, literal.number(), net.graph.evaluations_hz())
            {
                let unit = match parameter.kind {
                    ParameterKind::Rate => Some(Unit::HERTZ),
                    kind => kind
                        .value()
                        .and_then(|(_, rule)| net.inferred.port_unit(net.graph, number, rule)),
                };
                let unit = unit
                    .filter(|unit| *unit != Unit::ONE)
                    .map_or(String::new(), |unit| format!(" {unit}"));
                let value = literal.number().unwrap_or_default();
                format!("must be {wanted}{unit}, found {value}{unit}")
            } else {
                continue;
            };
            let message = format!("`{}.{}` {message}", item.id(), parameter.name);
            let diagnostic = Diagnostic::error(codes::OUT_OF_RANGE, literal.span, message);
            diagnostics.push(diagnostic.help(format!("{}: {}", parameter.name, parameter.doc)));
        }
    }
}

/// Returns the constant value of an input: a literal, or the value of a `Constant`.
pub fn constant<'a>(net: Typed<'a>, input_source: &InputSource<'a>) -> Option<&'a Literal> {
    match input_source {
        InputSource::Literal(literal) => Some(literal),
        InputSource::Link(link) if link.part.is_none() && link.initial.is_none() => {
            let source = net.graph.items.get(link.from.item)?;
            let value = source.parameters.first().copied().flatten();
            value.filter(|_| source.spec().role == Role::Constant)
        }
        _ => None,
    }
}

/// Requires that constants at inputs are within the ranges of their specs. A computed value may be limited there, but a
/// constant out of range is a mistake.
pub fn constants_are_in_range(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let has_range = |port: &Port| port.least.is_some() && port.greatest.is_some();
    let items = net.graph.items_of(|spec| spec.inputs.iter().any(has_range));
    for (_, item) in items {
        for (input_source, port) in item.inputs.iter().zip(item.spec().inputs) {
            let (Some(least), Some(greatest)) = (port.least, port.greatest) else {
                continue;
            };
            let Some(literal) = constant(net, input_source) else {
                continue;
            };
            let Some(value) = literal.number().filter(|it| *it < least || *it > greatest) else {
                continue;
            };
            let (id, name) = (item.id(), port.name);
            let message = format!("`{id}.{name}` must be {least} to {greatest}, found {value}");
            let diagnostic = Diagnostic::error(codes::OUT_OF_RANGE, literal.span, message);
            diagnostics.push(diagnostic.help(format!("{name}: {}", port.doc)));
        }
    }
}

/// Requires that a constant at an analog output is within the range of its channel: the driver would release the output
/// (`on_release`) in every cycle.
pub fn outputs_are_commanded_in_range(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (_, item) in net.graph.items_of(|spec| spec.name == "AnalogOutput") {
        let device = item
            .device
            .and_then(|index| net.graph.cell.devices.get(index));
        let (Some(device), Some((index, unit)), Some(input)) =
            (device, item.channel, item.inputs.first())
        else {
            continue;
        };
        let channels = device.channels_of(ChannelKind::AnalogOutput);
        let channel = channels.get(index as usize);
        let Some((name, [least, greatest])) =
            channel.and_then(|channel| Some((&channel.name, channel.range?)))
        else {
            continue;
        };
        let Some(literal) = constant(net, input) else {
            continue;
        };
        let Some(value) = literal.number().filter(|it| *it < least || *it > greatest) else {
            continue;
        };
        let message = format!(
            "`{}.in` is out of range: `{name}` of `{}` takes {least} {unit} to {greatest} {unit}, found {value} {unit}",
            item.id(),
            device.name
        );
        let diagnostic = Diagnostic::error(codes::OUT_OF_RANGE, literal.span, message);
        diagnostics.push(diagnostic.help(
            "a value outside the channel's range is refused by the driver, which then releases the output (`on_release`)",
        ));
    }
}

/// Returns true if each number is greater than the one before it, and for anything but a list.
fn rises(literal: &Literal) -> bool {
    let LiteralShape::List(elements) = &literal.shape else {
        return true;
    };
    let numbers: Vec<f64> = elements
        .iter()
        .map(|element| element.number().unwrap_or(f64::NAN))
        .collect();
    numbers.windows(2).all(|pair| pair[0] < pair[1])
}

/// Returns the violated range; `None` if the value is in range. `rate_hz` is the rate of evaluation.
fn wanted_range(parameter: &Parameter, value: Option<f64>, rate_hz: f64) -> Option<String> {
    let value = value?;
    if parameter.below_nyquist && value >= rate_hz / 2.0 {
        return Some(format!("less than {}", rate_hz / 2.0));
    }
    match (parameter.above, parameter.at_least) {
        (Some(bound), _) if value <= bound => Some(format!("greater than {bound}")),
        (_, Some(bound)) if value < bound => Some(format!("at least {bound}")),
        _ => parameter
            .at_most
            .filter(|bound| value > *bound)
            .map(|bound| format!("at most {bound}")),
    }
}
