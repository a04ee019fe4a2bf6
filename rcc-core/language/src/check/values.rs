//! Rules of types, units and ranges.
//! The loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitive::{Parameter, ParameterKind, PortType, UnitRule};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use super::Typed;
use crate::fault;
use crate::resolve::{Feed, Wire};
use crate::syntax::literal::{Literal, Shape};

/// `port[i]` names an element that there is.
pub fn elements_exist(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    let wires = net.graph.items.iter().flat_map(|item| item.wires());
    for (_, wire) in wires {
        let ty = net.inferred.output_type(net.graph, wire.from);
        let (Some(index), Some(ty)) = (wire.index, ty) else {
            continue;
        };
        let name = net.graph.output_name(wire.from);
        let (message, help) = match ty.element() {
            None => (
                format!("`{name}` is a {ty} and has no elements to pick"),
                "only arrays such as Real[7] have elements".to_string(),
            ),
            Some(_) if index >= ty.width() => (
                format!(
                    "`{name}` has {} elements, there is no [{index}]",
                    ty.width()
                ),
                format!("elements are counted from 0 to {}", ty.width() - 1),
            ),
            Some(_) => continue,
        };
        faults.push(Diagnostic::error(fault::BAD_ELEMENT, wire.port_span, message).help(help));
    }
}

/// A link and its input are of one type and unit, and so is its first value.
pub fn links_fit(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        for (port, wire) in item.wires() {
            let Some(port) = item.spec().inputs.get(port) else {
                continue;
            };
            let have = net.inferred.wire_type(net.graph, wire);
            let want = net.inferred.port_type(net.graph, number, port.ty);
            let (Some(have), Some(want)) = (have, want) else {
                continue;
            };
            let input = format!("{}.{}", item.id(), port.name);
            if have != want {
                faults.push(other_type(net, wire, &input, have, want));
                continue;
            }
            let source = net.inferred.wire_unit(net.graph, wire);
            let sink = net.inferred.port_unit(net.graph, number, port.unit);
            if let (Some(have), Some(want)) = (source, sink)
                && have != want
            {
                let output = net.graph.output_name(wire.from);
                let message =
                    format!("unit mismatch: `{output}` is in {have}, `{input}` is in {want}");
                let fault = Diagnostic::error(fault::UNIT_MISMATCH, wire.span, message);
                faults.push(fault.label(format!("in {have}")));
            }
            if let Some(initial) = wire.initial {
                literal_fits(initial, have, sink, &input, faults);
            }
        }
    }
}

fn other_type(net: Typed<'_>, wire: &Wire<'_>, input: &str, have: Type, want: Type) -> Diagnostic {
    let output = net.graph.output_name(wire.from);
    let message = format!("type mismatch: `{output}` is a {have}, `{input}` is a {want}");
    let fault =
        Diagnostic::error(fault::TYPE_MISMATCH, wire.span, message).label(format!("a {have}"));
    let is_element = wire.index.is_none() && have.element() == Some(want);
    fault.help_if(match (have, want) {
        _ if is_element => Some(format!("pick an element: `{output}[0]`")),
        (Type::Int, Type::Real) | (Type::Real, Type::Int) => Some(WHOLE_AND_REAL.to_string()),
        _ => None,
    })
}

const WHOLE_AND_REAL: &str = "whole and real numbers do not mix: lead the whole one through `{type: ToReal, inputs: {in: …}}`";

/// Constants at inputs and parameters are of the type and unit of their places.
pub fn literals_fit(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        let mut place = |literal: &Literal, name: &str, ty: PortType, unit: UnitRule| {
            let ty = net.inferred.port_type(net.graph, number, ty);
            let unit = net.inferred.port_unit(net.graph, number, unit);
            if let Some(ty) = ty {
                literal_fits(literal, ty, unit, &format!("{}.{name}", item.id()), faults);
            }
        };
        for (feed, port) in item.inputs.iter().zip(item.spec().inputs) {
            if let Feed::Literal(literal) = feed {
                place(literal, port.name, port.ty, port.unit);
            }
        }
        for (literal, parameter) in item.parameters.iter().zip(item.spec().parameters) {
            if let (Some(literal), Some((ty, unit))) = (literal, parameter.kind.value()) {
                place(literal, parameter.name, ty, unit);
            }
        }
    }
}

/// One constant at a place of a type and unit.
pub(crate) fn literal_fits(
    literal: &Literal,
    ty: Type,
    unit: Option<Unit>,
    place: &str,
    faults: &mut Vec<Diagnostic>,
) {
    if literal.stored(ty).is_none() {
        let message = format!("type mismatch: `{place}` is a {ty}, this is {literal}");
        let fault = Diagnostic::error(fault::TYPE_MISMATCH, literal.span, message);
        faults.push(fault.help_if(example_of(literal, ty)));
        return;
    }
    // A composite whose type says its units takes bare numbers only.
    let want = unit.unwrap_or(Unit::ONE);
    for (have, span) in literal.units() {
        if have != want {
            let message = format!("unit mismatch: `{place}` is in {want}, this is in {have}");
            let fault = Diagnostic::error(fault::UNIT_MISMATCH, span, message);
            faults.push(fault.label(format!("in {have}")));
        }
    }
}

/// How a constant of a type is written, where that is not obvious.
fn example_of(literal: &Literal, ty: Type) -> Option<String> {
    match (ty, &literal.shape) {
        (Type::Real | Type::Int, Shape::Text(text)) if text.parse::<f64>().is_ok() => {
            Some("a number in quotes is text: leave the quotes out".to_string())
        }
        (_, Shape::Text(text)) if text.contains('.') => Some(format!(
            "a parameter is a constant: `{text}` can feed an input only"
        )),
        (Type::Pose, _) => {
            Some("write `{xyz: [0.4, 0.1, 0.5], rpy: [deg(180), 0, 0]}`".to_string())
        }
        (Type::Rotation, _) => Some("write `{rpy: [deg(180), 0, 0]}`".to_string()),
        (Type::Bool, _) => Some("write true or false".to_string()),
        (Type::Int, Shape::Real(..)) => Some(WHOLE_AND_REAL.to_string()),
        (Type::Matrix(rows, columns), Shape::List(_)) => {
            let row = format!("[{}]", vec!["…"; usize::from(columns)].join(", "));
            Some(format!(
                "write {rows} rows of {columns} numbers: `[{row}, …]`"
            ))
        }
        (ty, Shape::List(_)) if ty.width() > 1 => Some(format!("write a list of {}", ty.width())),
        _ => None,
    }
}

/// A primitive for scalars is fed with scalars, and every primitive has a kernel for what it is fed with.
pub fn types_suit_their_primitives(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        let spec = item.spec();
        let mut ports = spec.inputs.iter().chain(spec.outputs);
        let Some(port) = ports.find(|port| port.ty.is_open()) else {
            continue;
        };
        let Some(ty) = net.inferred.port_type(net.graph, number, port.ty) else {
            continue;
        };
        let fits = match port.ty {
            PortType::Number => matches!(ty, Type::Int | Type::Real),
            PortType::Scalar => matches!(ty, Type::Bool | Type::Int | Type::Real),
            _ => true,
        };
        let kernels = item.entry.kernels;
        let runs = kernels.is_empty() || kernels.iter().any(|kernel| kernel.store == ty.store());
        if !fits || !runs {
            let wanted = match port.ty {
                PortType::Number => "single numbers",
                _ => "single numbers or truth values",
            };
            let message = format!("type mismatch: {} takes {wanted}, not a {ty}", spec.name);
            let place = item
                .primitive
                .inputs
                .iter()
                .find_map(|(key, _)| (key.name == port.name).then_some(key.span));
            let span = place.unwrap_or(item.primitive.id.span);
            faults.push(Diagnostic::error(fault::TYPE_MISMATCH, span, message));
        }
    }
}

/// Products and quotients come out: the units at the ports of one primitive agree with each other.
pub fn units_of_a_primitive_agree(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        let unit = |rule: UnitRule| net.inferred.port_unit(net.graph, number, rule);
        let var = |index: u8| unit(UnitRule::Var(index));
        let spec = item.spec();
        let ports = spec.inputs.iter().chain(spec.outputs);
        let ports = ports.map(|port| (port.name, port.unit));
        let parameters = spec
            .parameters
            .iter()
            .filter_map(|parameter| Some((parameter.name, parameter.kind.value()?.1)));
        for (name, rule) in ports.chain(parameters) {
            let want = match rule {
                UnitRule::Product(a, b) => var(a).zip(var(b)).map(|(a, b)| a.times(b)),
                UnitRule::Quotient(a, b) => var(a).zip(var(b)).map(|(a, b)| a.per(b)),
                UnitRule::PerSecond(a) => var(a).map(|a| a.per(Unit::SECOND)),
                UnitRule::PerSecond2(a) => var(a).map(|a| a.per(Unit::SECOND).per(Unit::SECOND)),
                UnitRule::Root(a) => match var(a).map(|square| (square, square.root())) {
                    Some((square, None)) => {
                        let message = format!(
                            "unit mismatch: `{}.{name}` has no unit: it would be the square root of {square}",
                            item.id()
                        );
                        let span = item.primitive.id.span;
                        faults.push(Diagnostic::error(fault::UNIT_MISMATCH, span, message));
                        None
                    }
                    root => root.and_then(|(_, root)| root),
                },
                _ => None,
            };
            if let (Some(have), Some(want)) = (unit(rule), want)
                && have != want
            {
                let id = item.id();
                let given = item.primitive.parameters.iter();
                let place = given.filter(|(key, _)| key.name == name);
                let place = place.map(|(_, literal)| literal.span).next();
                let span = place.unwrap_or(item.primitive.id.span);
                let message = format!(
                    "unit mismatch: `{id}.{name}` is in {want} by its inputs and is used in {have}"
                );
                faults.push(Diagnostic::error(fault::UNIT_MISMATCH, span, message));
            }
        }
    }
}

/// Speeds are positive and the like.
pub fn parameters_are_in_range(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        for (literal, parameter) in item.parameters.iter().zip(item.spec().parameters) {
            let Some(literal) = literal else { continue };
            let null = literal.shape == Shape::Null;
            let may_be_null = matches!(parameter.default, Some(rcc_core::primitive::Literal::Null))
                || matches!(
                    parameter.kind,
                    ParameterKind::Value(PortType::Any, _) | ParameterKind::Start(..)
                );
            let message = if null && !may_be_null {
                "cannot be null".to_string()
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
                format!("must be {wanted}{unit}, this is {value}{unit}")
            } else {
                continue;
            };
            let message = format!("`{}.{}` {message}", item.id(), parameter.name);
            let fault = Diagnostic::error(fault::OUT_OF_RANGE, literal.span, message);
            faults.push(fault.help(format!("{}: {}", parameter.name, parameter.doc)));
        }
    }
}

/// The range that a number is not in; `rate_hz`: how often the net is evaluated.
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
