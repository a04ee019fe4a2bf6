//! Rules about values that are set from outside. Runs on the loader's threads.

use rcc_config::article::with_article;
use rcc_config::diagnostic::Diagnostic;
use rcc_core::plan::INPUT_ELEMENTS_MAX;
use rcc_core::primitive::Role;
use rcc_core::types::Type;

use crate::codes;
use crate::infer::{Typed, has_unit};
use crate::resolve::ResolvedPrimitive;
use crate::syntax::literal::Literal;

/// Returns each `Input` and `Subscribe` with the type of its value, if that is known.
fn inputs<'a>(net: Typed<'a>) -> impl Iterator<Item = (&'a ResolvedPrimitive<'a>, Type)> {
    let items = net.graph.items_of(|spec| spec.role == Role::Input);
    items.filter_map(move |(number, item)| {
        let port = item.spec().outputs.first()?;
        let ty = net.inferred.port_type(net.graph, number, port.ty)?;
        Some((item, ty))
    })
}

/// Requires that bounds are given for ordered types only, and that all inputs together have at most
/// [`INPUT_ELEMENTS_MAX`] elements.
pub fn bounds_are_numeric(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let mut elements = 0u32;
    for (item, ty) in inputs(net) {
        let ordered = matches!(ty, Type::Real | Type::Int | Type::Reals(_) | Type::Ints(_));
        let bounds = ["at_least", "at_most"];
        for (name, literal) in bounds.map(|name| (name, item.given(name))) {
            // A bound that is no value of the type is reported as such.
            let is_refused = |literal: &&Literal| !ordered && literal.stored(ty).is_some();
            if let Some(literal) = literal.filter(is_refused) {
                let message = format!(
                    "`{}.{name}` is a bound of {}, which has no order",
                    item.id(),
                    with_article(ty)
                );
                let diagnostic = Diagnostic::error(codes::TYPE_MISMATCH, literal.span, message);
                diagnostics.push(
                    diagnostic.help("bounds apply to Real, Int and arrays of them only: remove it"),
                );
            }
        }
        let before = elements;
        elements = elements.saturating_add(ty.width());
        if before <= INPUT_ELEMENTS_MAX && elements > INPUT_ELEMENTS_MAX {
            let message =
                format!("the inputs of a net have at most {INPUT_ELEMENTS_MAX} elements together");
            let diagnostic =
                Diagnostic::error(codes::NET_TOO_LARGE, item.primitive.id.span, message);
            diagnostics.push(diagnostic.help("split it into several nets"));
        }
    }
}

/// Requires that the initial value of an input is within its bounds.
pub fn initial_values_are_within_bounds(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (item, _) in inputs(net) {
        let Some(initial) = item.given("initial") else {
            continue;
        };
        for (name, least) in [("at_least", true), ("at_most", false)] {
            let Some(bound) = item.given(name) else {
                continue;
            };
            let pairs = initial.elements_or_null().zip(bound.elements_or_null());
            let pairs = pairs.filter_map(|(value, bound)| Some((value?, bound?)));
            let mut outside = pairs.filter(|(value, bound)| match least {
                true => value < bound,
                false => value > bound,
            });
            if let Some((value, bound)) = outside.next() {
                let message = format!(
                    "`{}.initial` must be {} {bound}, found {value}",
                    item.id(),
                    if least { "at least" } else { "at most" }
                );
                diagnostics.push(Diagnostic::error(
                    codes::OUT_OF_RANGE,
                    initial.span,
                    message,
                ));
            }
        }
    }
}

/// Requires that a declared unit belongs to a type that has one: other types imply their units, or have none.
pub fn units_are_given_for_numbers_only(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (item, ty) in inputs(net) {
        let Some((_, unit)) = item.declared_unit().filter(|_| !has_unit(ty)) else {
            continue;
        };
        let message = format!(
            "`{}` is {}, to which `unit: {unit}` does not apply",
            item.id(),
            with_article(ty)
        );
        let diagnostic = Diagnostic::error(codes::UNIT_MISMATCH, item.primitive.id.span, message);
        diagnostics.push(diagnostic.help("remove `unit`: the type implies its unit, or has none"));
    }
}
