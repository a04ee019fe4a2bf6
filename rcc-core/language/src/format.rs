//! The formatter: rewrites a net or library in its canonical layout, and keeps all comments and the meaning. Used by
//! the command line; never on the real-time thread.

use rcc_config::diagnostic::{Diagnostic, Faults, Severity, Span};
use rcc_config::yaml::annotated::{self, same};
use rcc_config::yaml::layout::{Tree, TreeBlock, render};
use rcc_config::yaml::{self, Node};
use thiserror::Error;

use crate::codes;
use crate::parse::{read_library, read_net};
use crate::source_map::SourceMap;

/// Reason why a text is not formatted.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FormatError {
    /// The text is not a valid net or library.
    #[error("the text has errors, so it is not formatted")]
    Faulty(Faults),
    /// The text is JSON, which programs write.
    #[error("the text is JSON, which is not formatted")]
    Json,
    /// Formatting would lose something; holds one diagnostic at its span.
    #[error("formatting would lose a part of the text")]
    WouldLose(Faults),
}

/// Formats a text; `file` is the name that diagnostics show.
///
/// The result has the same meaning and the same comments, and formatting it again changes nothing. All this is verified
/// here.
///
/// # Errors
/// Returns the reason if the text cannot be formatted.
pub fn format(text: &str, file: &str) -> Result<String, FormatError> {
    if text
        .trim_start_matches('\u{feff}')
        .trim_start()
        .starts_with('{')
    {
        return Err(FormatError::Json);
    }
    let faulty = |diagnostics| FormatError::Faulty(SourceMap::new(file, text).finish(diagnostics));
    let root = yaml::parse(text).map_err(faulty)?;
    let diagnostics = faults_of(&root);
    if !diagnostics.is_empty() {
        return Err(faulty(diagnostics));
    }
    let lost = |place: Option<Span>| {
        let message = "formatting would lose this";
        let diagnostic =
            Diagnostic::error(codes::NOT_SUPPORTED, place.unwrap_or_default(), message);
        let diagnostic = diagnostic
            .help("write the comment on a line of its own, before the entry that it is about");
        let diagnostic = if place.is_none() {
            diagnostic.anywhere()
        } else {
            diagnostic
        };
        FormatError::WouldLose(Faults::new(file, text, vec![diagnostic]))
    };
    let written = laid_out(text, &root).map_err(|place| lost(Some(place)))?;
    let kept = is_the_same(text, &root, &written);
    if kept { Ok(written) } else { Err(lost(None)) }
}

/// Returns the syntax errors of a net or library; names are not resolved.
fn faults_of(root: &Node) -> Vec<Diagnostic> {
    let mut diagnostics = Vec::new();
    if root.get("library").is_some() {
        read_library(root, &mut diagnostics);
    } else {
        read_net(root, &mut diagnostics);
    }
    diagnostics.retain(|diagnostic| diagnostic.severity == Severity::Error);
    diagnostics
}

/// Formats without verifying the result.
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

/// Puts each entry on a line of its own and calls `inside` with it.
fn open(tree: &mut Tree, mut inside: impl FnMut(&str, &mut Tree)) {
    if let Tree::Map(TreeBlock { entries, open, .. }) = tree {
        *open = true;
        for entry in entries {
            inside(&entry.key, &mut entry.value);
        }
    }
}

/// Puts each entry on a line of its own, aligned in columns.
fn align(tree: &mut Tree) {
    open(tree, |_, _| {});
    if let Some(block) = tree.block_mut() {
        block.aligned = true;
    }
}

/// Returns true if the new text has the same meaning and comments, and formatting it again changes nothing.
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
