//! Checks of keys, ids and shapes that nets, fragments and constants have in common. Runs on the loader's threads.

use rcc_config::FileKind;
use rcc_config::diagnostic::{Diagnostic, closest};
use rcc_config::yaml::{Entry, Key, Node, Value};

use crate::codes;
use crate::syntax::NAME_MAX;

/// Returns the diagnostic that `what` must be `wanted`.
pub fn shape(node: &Node, what: &str, wanted: &str) -> Diagnostic {
    let message = format!("{what} must be {wanted}, not {}", node.kind());
    Diagnostic::error(codes::WRONG_SHAPE, node.span, message)
}

/// Refuses a file of another kind with one diagnostic, instead of one for each key that it lacks.
pub fn expect_kind(root: &Node, wanted: FileKind, diagnostics: &mut Vec<Diagnostic>) -> Option<()> {
    let Some((kind, span)) = FileKind::of_tree(root).filter(|(kind, _)| *kind != wanted) else {
        return Some(());
    };
    let message = format!(
        "expected {}, found {}",
        wanted.described(),
        kind.described()
    );
    let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, span, message);
    diagnostics.push(diagnostic.help(kind.usage()));
    None
}

pub fn report_unknown_keys(
    node: &Node,
    known: &[&str],
    what: &str,
    diagnostics: &mut Vec<Diagnostic>,
) {
    for key in node.unknown_keys(known) {
        let message = format!("{what} has no key `{}`", key.name);
        let help = match closest(&key.name, known.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("keys: {}", known.join(", ")),
        };
        diagnostics.push(Diagnostic::error(codes::UNKNOWN_KEY, key.span, message).help(help));
    }
}

/// Returns the entries of the mapping under `key`; an absent or null value counts as an empty mapping.
pub fn entries_of<'a>(node: &'a Node, key: &str, diagnostics: &mut Vec<Diagnostic>) -> &'a [Entry] {
    mapping(node.get(key), key, diagnostics)
}

/// Returns the entries of a mapping; an absent or null value counts as an empty one.
pub fn mapping<'a>(
    value: Option<&'a Node>,
    key: &str,
    diagnostics: &mut Vec<Diagnostic>,
) -> &'a [Entry] {
    match value {
        None => &[],
        Some(node) => match (&node.value, node.map()) {
            (_, Some(entries)) => entries,
            (Value::Null, None) => &[],
            (_, None) => {
                diagnostics.push(shape(
                    node,
                    &format!("`{key}`"),
                    "a mapping from names to values",
                ));
                &[]
            }
        },
    }
}

pub fn read_description(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> String {
    match node.get("description").map(|node| (node, node.text())) {
        None => String::new(),
        Some((_, Some(text))) => text.to_string(),
        Some((node, None)) => {
            diagnostics.push(shape(node, "`description`", "text"));
            String::new()
        }
    }
}

fn is_id(name: &str) -> bool {
    let allowed = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'_';
    name.len() <= NAME_MAX
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.bytes().all(allowed)
}

pub fn report_bad_id(id: &Key, what: &str, diagnostics: &mut Vec<Diagnostic>) {
    if !is_id(&id.name) {
        let message = format!("`{}` cannot be {what}", id.name);
        let diagnostic = Diagnostic::error(codes::BAD_NAME, id.span, message);
        diagnostics.push(diagnostic.help(format!(
            "use lowercase letters, digits and `_`, at most {NAME_MAX} characters, beginning with a letter"
        )));
    }
}
