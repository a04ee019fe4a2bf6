//! Rules about types, units and ranges. Runs on the loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitive::{Parameter, ParameterKind, PortType, Role, UnitRule};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use super::Typed;
use crate::codes;
use crate::resolve::{InputSource, ListElement, ResolvedLink, ResolvedList};
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::part::{ListPosition, ValuePart, parts_of};

/// Requires that the part selected by `port[i]`, `port.x` and the like exists.
pub fn elements_exist(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let links = net.graph.items.iter().flat_map(|item| item.links());
    for (_, link) in links {
        let ty = net.inferred.output_type(net.graph, link.from);
        let (Some(part), Some(ty)) = (link.part, ty) else {
            continue;
        };
        if part.of(ty).is_some() {
            continue;
        }
        let name = net.graph.output_name(link.from);
        let (message, help) = match (parts_of(ty), part) {
            (None, _) => (
                format!("`{name}` is a {ty}, which has no elements or members"),
                "only arrays such as Real[7], matrices and composites have elements or members"
                    .to_string(),
            ),
            (Some(help), ValuePart::Element(_)) if ty.element().is_some() => (
                format!(
                    "`{name}` has {} elements, so {part} is out of range",
                    ty.width()
                ),
                help,
            ),
            (Some(help), _) => (format!("`{name}` is a {ty} and has no `{part}`"), help),
        };
        diagnostics.push(Diagnostic::error(codes::BAD_ELEMENT, link.port_span, message).help(help));
    }
}

/// Requires that a link, its initial value and its input agree in type and unit.
pub fn links_fit(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        for (port, link) in item.links() {
            let Some(port) = item.spec().inputs.get(port) else {
                continue;
            };
            let have = net.inferred.link_type(net.graph, link);
            // A list of the wrong length is reported by `lists_fit`.
            let want = net
                .inferred
                .position_type(net.graph, number, port, link.position);
            let (Some(have), Some(want)) = (have, want) else {
                continue;
            };
            let input = format!(
                "{}.{}{}",
                item.id(),
                port.name,
                position_name(link.position)
            );
            if have != want {
                diagnostics.push(other_type(net, link, &input, have, want));
                continue;
            }
            let source = net.inferred.link_unit(net.graph, link);
            let sink = net
                .inferred
                .position_unit(net.graph, number, port, link.position);
            if let (Some(have), Some(want)) = (source, sink)
                && have != want
            {
                let output = net.graph.output_name(link.from);
                let message =
                    format!("unit mismatch: `{input}` expects {want}, but `{output}` is in {have}");
                let diagnostic = Diagnostic::error(codes::UNIT_MISMATCH, link.span, message);
                diagnostics.push(diagnostic.label(format!("in {have}")));
            }
            if let Some(initial) = link.initial {
                literal_fits(initial, have, sink, &input, diagnostics);
            }
        }
    }
}

/// Returns a position in a list as text: `[2]`, `[1,2]`.
fn position_name(position: ListPosition) -> String {
    match position.steps {
        [Some((row, _)), Some((column, _))] => format!("[{row},{column}]"),
        [Some((index, _)), _] => format!("[{index}]"),
        _ => String::new(),
    }
}

/// Requires that a list of links has as many elements as its input, and that the input can be given as a list.
pub fn lists_fit(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        for (input_source, port) in item.inputs.iter().zip(item.spec().inputs) {
            let Some(ty) = net.inferred.port_type(net.graph, number, port.ty) else {
                continue;
            };
            let input = format!("{}.{}", item.id(), port.name);
            let (span, message, help) = match (input_source, port.ty) {
                (InputSource::Link(link), PortType::Many(_)) => (
                    link.span,
                    format!("type mismatch: `{input}` expects a list of values, found one link"),
                    format!("write `{}: [a.out, b.out]`", port.name),
                ),
                (InputSource::Literal(literal), PortType::Many(_)) => (
                    literal.span,
                    format!(
                        "type mismatch: `{input}` expects a list of values with at least one link"
                    ),
                    format!("write `{}: [a.out, b.out]`", port.name),
                ),
                (InputSource::List(list), _) => match list_mismatch(list, port.ty, ty) {
                    Some(what) => (
                        list.span,
                        format!("type mismatch: `{input}` expects {ty}, found {what}"),
                        list_example(ty),
                    ),
                    None => continue,
                },
                _ => continue,
            };
            diagnostics.push(Diagnostic::error(codes::TYPE_MISMATCH, span, message).help(help));
        }
    }
}

/// Describes a list that does not fit the type; `None` if it fits.
fn list_mismatch(list: &ResolvedList<'_>, port: PortType, ty: Type) -> Option<String> {
    let mut places = list.elements.iter().map(|element| match element {
        ListElement::Link(link) => link.position,
        ListElement::Literal(_, position) => *position,
    });
    let fits = |position: ListPosition| match port {
        PortType::Many(_) => position.steps[1].is_none(),
        _ => position.of(ty).is_some(),
    };
    let mismatch = places.find(|position| !fits(*position))?;
    Some(match mismatch.steps {
        [_, Some((_, columns))] => format!("a list of {} with a row of {columns}", list.count),
        _ => format!("a list of {}", list.count),
    })
}

fn list_example(ty: Type) -> String {
    match (ty, ty.items()) {
        (Type::Matrix(rows, columns), _) => {
            format!("write {rows} rows of {columns} numbers, or {rows} links to Real[{columns}]")
        }
        (_, Some((count, item))) => format!("write a list of {count}, each a {item}"),
        (Type::Pose | Type::Rotation, None) => {
            "a pose is made of a position and a rotation by a primitive".to_string()
        }
        _ => "connect one link, without brackets".to_string(),
    }
}

fn other_type(
    net: Typed<'_>,
    link: &ResolvedLink<'_>,
    input: &str,
    have: Type,
    want: Type,
) -> Diagnostic {
    let output = net.graph.output_name(link.from);
    let message = format!("type mismatch: `{input}` expects {want}, but `{output}` is a {have}");
    let diagnostic =
        Diagnostic::error(codes::TYPE_MISMATCH, link.span, message).label(format!("a {have}"));
    let is_element = link.part.is_none() && have.element() == Some(want);
    diagnostic.help_if(match (have, want) {
        _ if is_element => Some(format!("pick an element: `{output}[0]`")),
        (Type::Int, Type::Real) | (Type::Real, Type::Int) => Some(WHOLE_AND_REAL.to_string()),
        (Type::Pose, Type::Vector3) => Some(format!("its position: `{output}.position`")),
        (Type::Pose, Type::Rotation) => Some(format!("its rotation: `{output}.rotation`")),
        _ => None,
    })
}

const WHOLE_AND_REAL: &str = "Int and Real are not converted implicitly: convert the Int with `{type: ToReal, inputs: {in: …}}`";

/// Requires that constants at inputs and parameters have the types and units of their ports.
pub fn literals_fit(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        let mut check_literal = |literal: &Literal, name: &str, ty: PortType, unit: UnitRule| {
            let ty = net.inferred.port_type(net.graph, number, ty);
            let unit = net.inferred.port_unit(net.graph, number, unit);
            if let Some(ty) = ty {
                literal_fits(
                    literal,
                    ty,
                    unit,
                    &format!("{}.{name}", item.id()),
                    diagnostics,
                );
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
                    let name = format!("{}.{}{}", item.id(), port.name, position_name(*position));
                    literal_fits(literal, ty, unit, &name, diagnostics);
                }
            }
        }
    }
}

/// Requires that the array lengths that a spec leaves open can be inferred.
pub fn lengths_are_known(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        let spec = item.spec();
        let ports = spec.inputs.iter().chain(spec.outputs);
        let unknown = ports.clone().find(|port| match port.ty {
            PortType::Array(_, length) => net.inferred.length(number, length).is_none(),
            PortType::Matrix(rows, columns) => {
                let length = |dim| net.inferred.length(number, dim);
                length(rows).is_none() || length(columns).is_none()
            }
            _ => false,
        });
        let Some(port) = unknown else { continue };
        // Missing inputs and inputs of the wrong type are reported by their own rules.
        let hidden = item.inputs.iter().any(|input_source| {
            let mut links = input_source.links();
            matches!(input_source, InputSource::Missing | InputSource::Refused)
                || links.any(|link| net.inferred.link_type(net.graph, link).is_none())
        });
        let fed = item.inputs.iter().zip(spec.inputs);
        let misfit = fed.clone().any(|(input_source, port)| {
            matches!(port.ty, PortType::Array(..) | PortType::Matrix(..))
                && matches!(input_source, InputSource::Link(_) | InputSource::List(_))
        });
        let parameters = item.parameters.iter().zip(spec.parameters);
        let refused = parameters.clone().any(|(given, parameter)| {
            matches!(parameter.kind, ParameterKind::Length(_))
                || (given.is_none() && parameter.default.is_none())
        });
        let message = if hidden || refused {
            continue;
        } else if misfit {
            format!(
                "type mismatch: {} needs an array or matrix of a length that fits at every input",
                spec.name
            )
        } else {
            format!("cannot infer the length of `{}.{}`", item.id(), port.name)
        };
        let diagnostic = Diagnostic::error(codes::TYPE_MISMATCH, item.primitive.id.span, message);
        diagnostics.push(diagnostic.help(format!("`{}` is {}", port.name, port.doc)));
    }
}

/// Checks one constant against the type and unit of a port.
pub(crate) fn literal_fits(
    literal: &Literal,
    ty: Type,
    unit: Option<Unit>,
    place: &str,
    diagnostics: &mut Vec<Diagnostic>,
) {
    if literal.stored(ty).is_none() {
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

/// Requires that a primitive has a kernel for the type that it is connected to.
pub fn types_suit_their_primitives(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        let spec = item.spec();
        let mut ports = spec.inputs.iter().chain(spec.outputs);
        let Some(port) = ports.find(|port| port.ty.is_open()) else {
            continue;
        };
        let Some(ty) = net.inferred.open_type(number) else {
            continue;
        };
        let fits = spec.types().all(|port| port.admits(ty));
        let kernels = item.entry.kernels;
        let runs = kernels.is_empty() || kernels.iter().any(|kernel| kernel.store == ty.store());
        if !fits || !runs {
            let wanted = match port.ty {
                PortType::Number => "single numbers",
                PortType::Of(family) => family.members(),
                PortType::Linear | PortType::Part => "numbers, vectors, arrays and matrices",
                PortType::Array(..) => "arrays of single values",
                _ => "single numbers or truth values",
            };
            let message = format!("type mismatch: {} takes {wanted}, not a {ty}", spec.name);
            let place = item
                .primitive
                .inputs
                .iter()
                .find_map(|(key, _)| (key.name == port.name).then_some(key.span));
            let span = place.unwrap_or(item.primitive.id.span);
            diagnostics.push(Diagnostic::error(codes::TYPE_MISMATCH, span, message));
        }
    }
}

/// Requires that the units at the ports of a primitive are consistent, for example that a product has the unit of the
/// product.
pub fn units_of_a_primitive_agree(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
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
                UnitRule::PerSecond3(a) => {
                    let cube = Unit::SECOND.times(Unit::SECOND).times(Unit::SECOND);
                    var(a).map(|a| a.per(cube))
                }
                UnitRule::Root(a) => match var(a).map(|square| (square, square.root())) {
                    Some((square, None)) => {
                        let message = format!(
                            "unit mismatch: `{}.{name}` has no unit: it would be the square root of {square}",
                            item.id()
                        );
                        let span = item.primitive.id.span;
                        diagnostics.push(Diagnostic::error(codes::UNIT_MISMATCH, span, message));
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
                diagnostics.push(Diagnostic::error(codes::UNIT_MISMATCH, span, message));
            }
        }
    }
}

/// Requires that parameters are within the ranges of their specs.
pub fn parameters_are_in_range(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        for (literal, parameter) in item.parameters.iter().zip(item.spec().parameters) {
            let Some(literal) = literal else { continue };
            let null = literal.shape == LiteralShape::Null;
            let may_be_null = matches!(
                parameter.default,
                Some(rcc_core::primitive::DefaultValue::Null)
            ) || matches!(
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
pub(super) fn constant<'a>(net: Typed<'a>, input_source: &InputSource<'a>) -> Option<&'a Literal> {
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
    for item in &net.graph.items {
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
