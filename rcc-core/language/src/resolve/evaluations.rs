//! Rates and windows of primitives as numbers of evaluations of the net. Runs on the loader's threads.

use rcc_config::diagnostic::Span;
use rcc_core::primitive::{CYCLES_MAX, DefaultValue as Default, ParameterKind};

use super::{NetGraph, ResolvedPrimitive};

/// Relative tolerance by which a rate may exceed the rate of evaluation and still count as equal to it.
pub const RATE_TOLERANCE: f64 = 1e-9;

/// Returns the rate of a monitor, given or by default, Hz.
fn rate_of(item: &ResolvedPrimitive<'_>) -> Option<f64> {
    let mut rows = item.spec().parameters.iter().zip(&item.parameters);
    let (parameter, given) = rows.find(|(parameter, _)| parameter.kind == ParameterKind::Rate)?;
    match (given, parameter.default) {
        (Some(literal), _) => literal.number(),
        (None, Some(Default::Real(rate))) => Some(rate),
        _ => None,
    }
}

/// Returns the number of evaluations between two samples of a primitive with a rate. The resulting rate is the highest
/// that divides the net's rate and does not exceed the given one. Returns `None` if the rate is not a number or is too
/// low.
pub fn every(item: &ResolvedPrimitive<'_>, graph: &NetGraph<'_>) -> Option<u32> {
    let rate = rate_of(item)?;
    let cycles = (graph.evaluations_hz() / rate * (1.0 - RATE_TOLERANCE)).ceil();
    // NaN fails the comparison, so the cast is in range.
    (cycles <= f64::from(u32::MAX)).then_some((cycles as u32).max(1))
}

/// Returns the number of evaluations that the window of a primitive spans, rounded. Returns `None` if the primitive has
/// no window, or if the window is out of range.
pub fn window(item: &ResolvedPrimitive<'_>, graph: &NetGraph<'_>) -> Option<u32> {
    let seconds = window_s(item)?.0;
    let cycles = (seconds * graph.evaluations_hz()).round();
    // NaN fails the comparison, so the cast is in range.
    (cycles >= 1.0 && cycles <= f64::from(CYCLES_MAX)).then_some(cycles as u32)
}

/// Returns the window of an item, s, and the span of its parameter; the span is `None` for a default.
pub fn window_s(item: &ResolvedPrimitive<'_>) -> Option<(f64, Option<Span>)> {
    let mut rows = item.spec().parameters.iter().zip(&item.parameters);
    let (parameter, given) = rows.find(|(parameter, _)| parameter.kind == ParameterKind::Window)?;
    match (given, parameter.default) {
        (Some(literal), _) => Some((literal.number()?, Some(literal.span))),
        (None, Some(Default::Real(seconds))) => Some((seconds, None)),
        _ => None,
    }
}
