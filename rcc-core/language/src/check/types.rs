//! Rules about the types, lengths and units of the ports of one primitive. Runs on the loader's threads.

use rcc_config::article::with_article;
use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitive::{ParameterKind, PortType, Spec, UnitRule};
use rcc_core::unit::Unit;

use crate::codes;
use crate::infer::Typed;
use crate::resolve::InputSource;

/// Requires that the array lengths that a spec leaves open can be inferred.
pub fn lengths_are_known(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let has_length = |ty| matches!(ty, PortType::Array(..) | PortType::Matrix(..));
    let items = net.graph.items_of(|spec| spec.types().any(has_length));
    for (number, item) in items {
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

/// Requires that a primitive has a kernel for the type that it is connected to.
pub fn types_suit_their_primitives(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let items = net
        .graph
        .items_of(|spec| spec.types().any(PortType::is_open));
    for (number, item) in items {
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
            let found = with_article(ty);
            let message = format!("type mismatch: {} takes {wanted}, not {found}", spec.name);
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

/// Returns true if the unit of a port or parameter follows from other units.
fn has_derived_unit(spec: &'static Spec) -> bool {
    let ports = spec.inputs.iter().chain(spec.outputs).map(|port| port.unit);
    let parameters = spec.parameters.iter();
    let parameters = parameters.filter_map(|parameter| Some(parameter.kind.value()?.1));
    ports.chain(parameters).any(|rule| {
        !matches!(
            rule,
            UnitRule::Is(_)
                | UnitRule::Typed
                | UnitRule::Channel
                | UnitRule::Joint(_)
                | UnitRule::Var(_)
        )
    })
}

/// Requires that the units at the ports of a primitive are consistent, for example that a product has the unit of the
/// product.
pub fn units_of_a_primitive_agree(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items_of(has_derived_unit) {
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
