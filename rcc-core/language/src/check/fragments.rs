//! Rules about fragments that are checked on the expanded net: the declared types and units of their inputs hold in
//! each instance, and everything read outside of a region becomes null while the region is inactive. Runs on the
//! loader's threads.

use rcc_config::article::with_article;
use rcc_config::diagnostic::Diagnostic;
use rcc_core::types::Type;

use crate::codes;
use crate::infer::Typed;
use crate::resolve::{InputSource, ResolvedLink};
use crate::syntax::literal::LiteralShape;

/// Requires that the declared type and unit of a fragment's input match the inputs that it feeds.
pub fn inputs_match_fragment_declarations(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for declared in &net.graph.declarations {
        let Some(item) = net.graph.items.get(declared.item) else {
            continue;
        };
        let Some(port) = item.spec().inputs.get(declared.input) else {
            continue;
        };
        let (id, name, input) = (item.id(), port.name, &declared.declaration.name);
        let ty = net.inferred.port_type(net.graph, declared.item, port.ty);
        if let (Some(have), Some((want, span))) = (ty, declared.declaration.ty)
            && have != want
        {
            let message = format!(
                "type mismatch: `{input}` is declared as {want}, but feeds `{id}.{name}`, which is {}",
                with_article(have)
            );
            diagnostics.push(Diagnostic::error(codes::TYPE_MISMATCH, span, message));
            continue;
        }
        let unit = net.inferred.port_unit(net.graph, declared.item, port.unit);
        if let (Some(have), Some((want, span))) = (unit, declared.declaration.unit)
            && have != want
        {
            let message = format!(
                "unit mismatch: `{input}` is declared in {want}, but feeds `{id}.{name}`, which is in {have}"
            );
            diagnostics.push(Diagnostic::error(codes::UNIT_MISMATCH, span, message));
        }
    }
}

/// Requires that the condition of a region is a Bool.
pub fn conditions_are_truth_values(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for region in &net.graph.regions {
        let (span, have) = match &region.condition {
            InputSource::Link(link) => {
                let ty = net.inferred.link_type(net.graph, link);
                let output = net.inferred.output_type(net.graph, link.from);
                let name = net.graph.output_name(link.from);
                match (ty, output) {
                    (Some(Type::Bool), _) | (None, None) => continue,
                    (Some(ty), _) => (link.span, format!("but `{name}` is {}", with_article(ty))),
                    (None, Some(ty)) => (
                        link.span,
                        format!("but `{name}` is {} without this element", with_article(ty)),
                    ),
                }
            }
            InputSource::Literal(literal) => match literal.shape {
                LiteralShape::Bool(_) | LiteralShape::Null | LiteralShape::Refused => continue,
                _ => (literal.span, format!("found {literal}")),
            },
            InputSource::List(_) => (region.id.span, "found a list".to_owned()),
            _ => continue,
        };
        let message = format!(
            "type mismatch: `active` of `{}` expects Bool, {have}",
            region.id.name
        );
        let diagnostic = Diagnostic::error(codes::TYPE_MISMATCH, span, message);
        diagnostics.push(diagnostic.help("compare it: `{type: Greater, inputs: {a: …, b: …}}`"));
    }
}

/// Requires that an output that is read outside of its region belongs to a primitive with a kernel. A `Constant` or an
/// `Input` has none: its value would not become null while the region is inactive.
pub fn outputs_read_outside_a_region_can_become_null(
    net: Typed<'_>,
    diagnostics: &mut Vec<Diagnostic>,
) {
    let graph = net.graph;
    let mut check_link = |reader: Option<usize>, link: &ResolvedLink<'_>| {
        let Some(source) = graph.items.get(link.from.item) else {
            return;
        };
        let Some(region) = source.region.filter(|_| source.entry.kernels.is_empty()) else {
            return;
        };
        if graph.is_within(reader, region) {
            return;
        }
        let name = graph.output_name(link.from);
        let around = graph
            .regions
            .get(region)
            .map_or("", |region| &region.id.name);
        let message = format!(
            "`{name}` is read outside of `{around}`, and would not become null while `{around}` is not active"
        );
        let diagnostic = Diagnostic::error(codes::NEVER_NULL, link.span, message);
        diagnostics.push(diagnostic.help("read it only inside that instance, or move it out"));
    };
    for item in &graph.items {
        for (_, link) in item.links() {
            check_link(item.region, link);
        }
    }
    for region in &graph.regions {
        if let InputSource::Link(link) = &region.condition {
            check_link(region.parent, link);
        }
    }
}
