//! Sources of inputs: links, constants, formulas, lists of them, and named outcomes. Runs on the loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_config::quantity::looks_like;
use rcc_config::yaml::{Entry, Node, Value};
use rcc_core::types::ELEMENTS_MAX;

use super::literal::POSE_KEYS;
use super::shape::{report_bad_id, report_unknown_keys, shape};
use super::{literal, reference};
use crate::codes;
use crate::syntax::literal::is_parameter;
use crate::syntax::{Formula, Link, List, Outcomes, Source, is_formula};

const LINK_KEYS: &[&str] = &["from", "delayed", "initial"];

pub fn read_source(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Source {
    if let Some(nodes) = node.list().filter(|_| has_link(node)) {
        return read_list(node, nodes, 0, diagnostics);
    }
    if let Some(text) = node.text().filter(|text| is_formula(text)) {
        return Source::Formula(Formula {
            text: text.to_owned(),
            span: node.span,
        });
    }
    if let Some(text) = node.text()
        && !looks_like(text)
        && !is_parameter(text)
    {
        let from = reference::read(node, text, diagnostics);
        return from.map_or(Source::Refused, |from| {
            Source::Link(Link {
                from,
                delayed: false,
                initial: None,
                span: node.span,
            })
        });
    }
    let is_link = LINK_KEYS.iter().any(|key| node.get(key).is_some());
    if is_link {
        return read_link(node, diagnostics);
    }
    let is_pose = POSE_KEYS.iter().any(|key| node.get(key).is_some());
    if let Some(entries) = node.map().filter(|entries| !is_pose && !entries.is_empty()) {
        return read_outcomes(node, entries, diagnostics);
    }
    let literal = literal::read(node, diagnostics);
    if literal.is_refused() {
        Source::Refused
    } else {
        Source::Literal(literal)
    }
}

/// Returns true for a list that contains a link or a formula.
fn has_link(node: &Node) -> bool {
    node.list().is_some_and(|nodes| {
        nodes.iter().any(|node| {
            let text = node.text();
            let names = |text| !looks_like(text) && !is_parameter(text);
            text.is_some_and(names)
                || LINK_KEYS.iter().any(|key| node.get(key).is_some())
                || has_link(node)
        })
    })
}

/// Reads a list with links; `depth` is the number of enclosing lists.
fn read_list(node: &Node, nodes: &[Node], depth: u32, diagnostics: &mut Vec<Diagnostic>) -> Source {
    if nodes.len() > usize::from(ELEMENTS_MAX) || depth > 1 {
        let message = match depth {
            0 | 1 => format!(
                "a list has 1 to {ELEMENTS_MAX} elements, this one has {}",
                nodes.len()
            ),
            _ => "lists are nested at most twice: a matrix is a list of rows".to_string(),
        };
        diagnostics.push(Diagnostic::error(codes::WRONG_SHAPE, node.span, message));
        return Source::Refused;
    }
    let read = |node: &Node| match node.list() {
        Some(nodes) if has_link(node) => read_list(node, nodes, depth + 1, diagnostics),
        _ => read_source(node, diagnostics),
    };
    Source::List(List {
        elements: nodes.iter().map(read).collect(),
        span: node.span,
    })
}

/// Reads conditions by their names. Whether the input takes them is decided when it is resolved.
fn read_outcomes(node: &Node, entries: &[Entry], diagnostics: &mut Vec<Diagnostic>) -> Source {
    let rows = entries.iter().map(|entry| {
        report_bad_id(&entry.key, "the name of an outcome", diagnostics);
        let source = read_source(&entry.value, diagnostics);
        if matches!(source, Source::List(_) | Source::Outcomes(_)) {
            let what = format!("the outcome `{}`", entry.key.name);
            let wanted = "a condition such as `move.done`";
            diagnostics.push(shape(&entry.value, &what, wanted));
        }
        (entry.key.clone(), source)
    });
    Source::Outcomes(Outcomes {
        rows: rows.collect(),
        span: node.span,
    })
}

fn read_link(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Source {
    report_unknown_keys(node, LINK_KEYS, "a link", diagnostics);
    let delayed = match node.get("delayed").map(|node| (node, &node.value)) {
        None => false,
        Some((_, Value::Bool(delayed))) => *delayed,
        Some((node, _)) => {
            diagnostics.push(shape(node, "`delayed`", "true or false"));
            true
        }
    };
    let initial = node
        .get("initial")
        .map(|node| Box::new(literal::read(node, diagnostics)));
    if let (Some(initial), false) = (&initial, delayed) {
        let message = "only a delayed link has an initial value";
        let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, initial.span, message);
        diagnostics.push(diagnostic.help("add `delayed: true`, or remove `initial`"));
    }
    let Some(from) = node.get("from") else {
        let diagnostic = Diagnostic::error(codes::MISSING_KEY, node.span, "a link has no source");
        diagnostics.push(diagnostic.help("add `from: PRIMITIVE.PORT`"));
        return Source::Refused;
    };
    let Some(text) = from.text() else {
        diagnostics.push(shape(from, "`from`", "an output such as `move.pose`"));
        return Source::Refused;
    };
    reference::read(from, text, diagnostics).map_or(Source::Refused, |reference| {
        Source::Link(Link {
            from: reference,
            delayed,
            initial,
            span: from.span,
        })
    })
}
