//! `fmt`: the text of a net or library in its one layout, with all its comments and without a change of what it says.
//! Used by the command line, never on the real-time thread.

use rcc_config::diagnostic::{Diagnostic, Faults, Severity, Span};
use rcc_config::yaml::annotated::{self, same};
use rcc_config::yaml::layout::{Block, Tree, render};
use rcc_config::yaml::{self, Node};
use thiserror::Error;

use crate::fault;
use crate::syntax::{self, fragment};

/// Why a text is left as it is.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FormatError {
    /// It is no net and no library.
    #[error("the text has faults; it is laid out when it has none")]
    Faulty(Faults),
    /// It is JSON, which is for machines.
    #[error("this is JSON, which is laid out by what writes it")]
    Json,
    /// Something would be lost; one fault at its place.
    #[error("the text has something that would be lost")]
    WouldLose(Faults),
}

/// Lays out a text; `file` is the name that faults mention.
///
/// The result says the same, has the same comments, and laying it out again changes nothing: that is checked here.
///
/// # Errors
/// Why the text is left as it is.
pub fn format(text: &str, file: &str) -> Result<String, FormatError> {
    if text
        .trim_start_matches('\u{feff}')
        .trim_start()
        .starts_with('{')
    {
        return Err(FormatError::Json);
    }
    let faulty =
        |faults| FormatError::Faulty(crate::sources::Sources::new(file, text).finished(faults));
    let root = yaml::parse(text).map_err(faulty)?;
    let faults = faults_of(&root);
    if !faults.is_empty() {
        return Err(faulty(faults));
    }
    let lost = |place: Option<Span>| {
        let message = "this cannot be kept when the text is laid out";
        let fault = Diagnostic::error(fault::NOT_SUPPORTED, place.unwrap_or_default(), message);
        let fault =
            fault.help("write the comment on a line of its own, before the entry that it is about");
        let fault = if place.is_none() {
            fault.anywhere()
        } else {
            fault
        };
        FormatError::WouldLose(Faults::new(file, text, vec![fault]))
    };
    let written = laid_out(text, &root).map_err(|place| lost(Some(place)))?;
    let kept = is_the_same(text, &root, &written);
    if kept { Ok(written) } else { Err(lost(None)) }
}

/// The errors in the shape of a net or library; what names refer to does not matter.
fn faults_of(root: &Node) -> Vec<Diagnostic> {
    let mut faults = Vec::new();
    if root.get("library").is_some() {
        fragment::read_library(root, &mut faults);
    } else {
        syntax::read(root, &mut faults);
    }
    faults.retain(|fault| fault.severity == Severity::Error);
    faults
}

/// The layout, without a look at whether it is right.
fn laid_out(text: &str, root: &Node) -> Result<String, Span> {
    let mut tree = annotated::read(text, root)?;
    open(&mut tree, |key, tree| match key {
        "primitives" => align(tree),
        "fragments" => open(tree, |_, fragment| {
            open(fragment, |key, tree| {
                if key == "primitives" {
                    align(tree);
                }
            });
        }),
        _ => {}
    });
    Ok(render(&tree))
}

/// An entry a line; `inside` sees each.
fn open(tree: &mut Tree, mut inside: impl FnMut(&str, &mut Tree)) {
    if let Tree::Map(Block { entries, open, .. }) = tree {
        *open = true;
        for entry in entries {
            inside(&entry.key, &mut entry.value);
        }
    }
}

/// An entry a line, in columns.
fn align(tree: &mut Tree) {
    open(tree, |_, _| {});
    if let Some(block) = tree.block_mut() {
        block.aligned = true;
    }
}

/// True if the new text says the same with the same comments, and is not changed by another look.
fn is_the_same(text: &str, root: &Node, written: &str) -> bool {
    let Ok(again) = yaml::parse(written) else {
        return false;
    };
    let comments = |text: &str, root: &Node| {
        let comments = annotated::comments(text, root)
            .unwrap_or_default()
            .into_iter();
        let mut texts: Vec<String> = comments.map(|comment| comment.text).collect();
        texts.sort_unstable();
        texts
    };
    same(root, &again)
        && comments(text, root) == comments(written, &again)
        && laid_out(written, &again).is_ok_and(|third| third == written)
}

#[cfg(test)]
mod tests;
