//! Rules about the types and units of links and of lists of links. Runs on the loader's threads.

use std::fmt::Display;

use rcc_config::article::with_article;
use rcc_config::diagnostic::Diagnostic;
use rcc_core::counted::Counted;
use rcc_core::primitive::PortType;
use rcc_core::types::Type;

use super::constants::{WHOLE_AND_REAL, literal_fits};
use crate::codes;
use crate::infer::Typed;
use crate::resolve::{InputSource, ListElement, ResolvedLink, ResolvedList};
use crate::syntax::part::{ListPosition, ValuePart, parts_of};

/// Requires that the part selected by `port[i]`, `port.x` and the like exists.
pub fn elements_exist(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let links = net.graph.items.iter().flat_map(|item| item.links());
    for (_, link) in links {
        let Some(part) = link.part else { continue };
        let Some(ty) = net.inferred.output_type(net.graph, link.from) else {
            continue;
        };
        if part.of(ty).is_some() {
            continue;
        }
        let name = net.graph.output_name(link.from);
        let (message, help) = match (parts_of(ty), part) {
            (None, _) => (
                format!(
                    "`{name}` is {}, which has no elements or members",
                    with_article(ty)
                ),
                "only arrays such as Real[7], matrices and composites have elements or members"
                    .to_string(),
            ),
            (Some(help), ValuePart::Element(_)) if ty.element().is_some() => (
                format!(
                    "`{name}` has {}, so {part} is out of range",
                    Counted(u64::from(ty.width()), "element")
                ),
                help,
            ),
            (Some(help), _) => (
                format!("`{name}` is {} and has no `{part}`", with_article(ty)),
                help,
            ),
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
            let source = net.inferred.link_unit(net.graph, link);
            let sink = net
                .inferred
                .position_unit(net.graph, number, port, link.position);
            let other_unit = source.zip(sink).filter(|(have, want)| have != want);
            if have == want && other_unit.is_none() && link.initial.is_none() {
                continue;
            }
            let is_it = |condition: &ListElement<'_>| {
                condition.link().is_some_and(|it| std::ptr::eq(it, link))
            };
            let outcome = item.conditions().find(|(_, _, condition)| is_it(condition));
            let name = outcome.map_or(port.name, |(_, name, _)| name);
            let input = format_args!("{}.{name}{}", item.id(), link.position);
            if have != want {
                diagnostics.push(other_type(net, link, input, have, want));
                continue;
            }
            if let Some((have, want)) = other_unit {
                let output = net.graph.output_name(link.from);
                let message =
                    format!("unit mismatch: `{input}` expects {want}, but `{output}` is in {have}");
                let diagnostic = Diagnostic::error(codes::UNIT_MISMATCH, link.span, message);
                diagnostics.push(diagnostic.label(format!("in {have}")));
            }
            if let Some(initial) = link.initial {
                literal_fits(initial, have, sink, input, diagnostics);
            }
        }
    }
}

/// Requires that a list of links has as many elements as its input, and that the input can be given as a list.
pub fn lists_fit(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items.iter().enumerate() {
        for (input_source, port) in item.inputs.iter().zip(item.spec().inputs) {
            let is_many = matches!(port.ty, PortType::Many(_));
            if !is_many && !matches!(input_source, InputSource::List(_)) {
                continue;
            }
            let Some(ty) = net.inferred.port_type(net.graph, number, port.ty) else {
                continue;
            };
            let input = format_args!("{}.{}", item.id(), port.name);
            let (span, message, help) = match (input_source, port.ty) {
                (InputSource::Link(link), PortType::Many(_)) => (
                    link.span,
                    format!("type mismatch: `{input}` expects a list of values, found one link"),
                    format!("write `{}: [a.out, b.out]`", port.name),
                ),
                (InputSource::Literal(literal), PortType::Many(_)) => (
                    literal.span,
                    format!("type mismatch: `{input}` expects a list of values, found {literal}"),
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
        (_, Some((count, item))) => format!("write a list of {count}, each {}", with_article(item)),
        (Type::Pose | Type::Rotation, None) => {
            "a pose is made of a position and a rotation by a primitive".to_string()
        }
        _ => "connect one link, without brackets".to_string(),
    }
}

fn other_type(
    net: Typed<'_>,
    link: &ResolvedLink<'_>,
    input: impl Display,
    have: Type,
    want: Type,
) -> Diagnostic {
    let output = net.graph.output_name(link.from);
    let found = with_article(have);
    let message = format!("type mismatch: `{input}` expects {want}, but `{output}` is {found}");
    let diagnostic = Diagnostic::error(codes::TYPE_MISMATCH, link.span, message).label(found);
    let is_element = link.part.is_none() && have.element() == Some(want);
    diagnostic.help_if(match (have, want) {
        _ if is_element => Some(format!("pick an element: `{output}[0]`")),
        (Type::Int, Type::Real) | (Type::Real, Type::Int) => Some(WHOLE_AND_REAL.to_string()),
        (Type::Pose, Type::Vector3) => Some(format!("its position: `{output}.position`")),
        (Type::Pose, Type::Rotation) => Some(format!("its rotation: `{output}.rotation`")),
        _ => None,
    })
}
