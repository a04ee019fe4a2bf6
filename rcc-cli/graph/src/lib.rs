//! Diagrams of nets: SVG with its own layout, DOT for Graphviz, Mermaid for Markdown. Needs no external program; the
//! same net gives the same bytes. Pure; run by the command line. A separate package, because it depends only on the
//! language and is tested without the rest of the system.

pub mod boxes;
pub mod dot;
pub mod layout;
pub mod mermaid;
pub mod scene;
pub mod svg;
pub mod text;

use std::collections::BTreeMap;

use rcc_language::structure::{
    LinkInfo, NetStructure, PortInfo, PrimitiveInfo, PrimitiveRole, SourceInfo,
};

/// Values of a running net, as text, by `primitive.port`.
pub type PortValues = BTreeMap<String, String>;

/// Returns the links of a net: the reading primitive, its input, the element within a list of links, and the link.
pub fn links(net: &NetStructure) -> impl Iterator<Item = (usize, usize, Option<usize>, &LinkInfo)> {
    let parts = net.primitives.iter().enumerate();
    parts.flat_map(|(number, part)| {
        part.inputs
            .iter()
            .enumerate()
            .flat_map(move |(input, pin)| {
                let is_list = pin.sources.len() > 1;
                pin.sources
                    .iter()
                    .enumerate()
                    .filter_map(move |(element, source)| match source {
                        SourceInfo::Link(link) => {
                            Some((number, input, is_list.then_some(element), link))
                        }
                        _ => None,
                    })
            })
    })
}

/// Returns true for primitives that are drawn as labels of others: constants at their readers, monitors at the output
/// that they show.
#[must_use]
pub fn is_label(net: &NetStructure, part: &PrimitiveInfo) -> bool {
    match part.role {
        PrimitiveRole::Constant => true,
        PrimitiveRole::Shows => shown(net, part).is_some(),
        _ => false,
    }
}

/// Returns the output that a monitor shows, if it is the output of a box.
#[must_use]
pub fn shown<'n>(net: &'n NetStructure, part: &'n PrimitiveInfo) -> Option<&'n LinkInfo> {
    if part.role != PrimitiveRole::Shows {
        return None;
    }
    match part.inputs.first()?.sources.as_slice() {
        [SourceInfo::Link(link)] => {
            let source = net.primitives.get(link.primitive)?;
            (source.role != PrimitiveRole::Constant).then_some(link)
        }
        _ => None,
    }
}

/// Returns the role that gives a box its colour: goals, which may change in any cycle, move like motions along a path.
#[must_use]
pub fn drawn_role(part: &PrimitiveInfo) -> PrimitiveRole {
    match part.role {
        PrimitiveRole::Plain if part.type_name.ends_with("Goal") => PrimitiveRole::Moves,
        role => role,
    }
}

/// Returns the title of an instance's frame: its name, and its condition if it is not always active.
#[must_use]
pub fn frame_title(net: &NetStructure, path: &str) -> String {
    let name = path.rsplit('/').next().unwrap_or_default();
    match net.condition(path) {
        Some(condition) => format!("{name}, while {condition}"),
        None => name.to_owned(),
    }
}

/// Returns value and name of the constant that a link reads; `None` if it reads something else.
#[must_use]
pub fn constant(net: &NetStructure, link: &LinkInfo) -> Option<String> {
    let part = net.primitives.get(link.primitive)?;
    let (_, value) = part
        .parameters
        .first()
        .filter(|_| part.role == PrimitiveRole::Constant)?;
    Some(format!("{value} ({})", part.id))
}

/// Returns the constants of an input as text: `2 s`, or `[0.1, ·, 0.3]` for a list in which `·` is a link. `None` if it
/// reads links only.
#[must_use]
pub fn constants(net: &NetStructure, pin: &PortInfo) -> Option<String> {
    let values: Vec<Option<String>> = pin
        .sources
        .iter()
        .map(|source| match source {
            SourceInfo::Constant(value) | SourceInfo::Default(value) => Some(value.clone()),
            SourceInfo::Link(link) => constant(net, link),
        })
        .collect();
    match values.as_slice() {
        [single] => single.clone(),
        list if list.iter().any(Option::is_some) => {
            let shown = list.iter().map(|value| value.as_deref().unwrap_or("·"));
            Some(format!("[{}]", shown.collect::<Vec<_>>().join(", ")))
        }
        _ => None,
    }
}
