//! The source map: the texts of a net and of its libraries in one address space of bytes, followed by a copy of a
//! fragment for each instance of it. A span therefore identifies the file and the instance. Compilers treat files and
//! expanded macros the same way. Runs on the loader's threads.

use std::collections::HashMap;

use rcc_config::diagnostic::{Diagnostic, Faults, SourceText, Span, UseSite};
use rcc_config::yaml::{Key, Node, Value};

use crate::codes;
use crate::syntax::fragment::Fragment;
use crate::syntax::literal::{Literal, LiteralShape, Notation};
use crate::syntax::reference::Reference;

/// All texts of a net.
#[derive(Clone, Debug)]
pub struct SourceMap {
    /// Start and text of each file; the net's own file is the first one and starts at 0.
    files: Vec<(usize, SourceText)>,
    /// In the order of their positions, all after the files.
    copies: Vec<FragmentCopy>,
    /// Position after the last copy.
    end: usize,
}

/// The text of a fragment in one of its instances.
#[derive(Clone, Debug)]
struct FragmentCopy {
    base: usize,
    /// Start of the fragment itself.
    origin: usize,
    /// Id of the instance, such as `a/b`.
    path: String,
    /// Span of the instance, which may be in another copy.
    site: Span,
}

/// Offset between two positions of the same text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpanShift {
    from: usize,
    to: usize,
}

impl SourceMap {
    /// Creates the source map of a net without libraries.
    #[must_use]
    pub fn new(name: &str, text: &str) -> SourceMap {
        let source = SourceText {
            name: name.to_owned(),
            text: text.to_owned(),
        };
        SourceMap {
            end: text.len() + 1,
            files: vec![(0, source)],
            copies: Vec::new(),
        }
    }

    /// Adds a library and returns the shift of its spans. All libraries are added before the first copy.
    pub fn add(&mut self, name: &str, text: String) -> SpanShift {
        debug_assert!(self.copies.is_empty());
        let base = self.end;
        self.end += text.len() + 1;
        let name = name.to_owned();
        self.files.push((base, SourceText { name, text }));
        SpanShift { from: 0, to: base }
    }

    /// Returns the number of the file that contains a span, for diagnostics about the file as a whole.
    #[must_use]
    pub fn file_of(&self, span: Span) -> u32 {
        self.file(span).0
    }

    /// Returns the text at a span that is not in a copy.
    #[must_use]
    pub fn text(&self, span: Span) -> Option<&str> {
        let (number, place) = self.file(span);
        let (_, source) = self.files.get(number as usize)?;
        source.text.get(place.start..place.end)
    }

    /// Adds a copy of a fragment for the instance `path` at `site`.
    pub fn copy(&mut self, fragment: &Fragment, path: &str, site: Span) -> SpanShift {
        let base = self.end;
        let Span { start, end } = fragment.span;
        self.end += end.saturating_sub(start) + 1;
        self.copies.push(FragmentCopy {
            base,
            origin: start,
            path: path.to_owned(),
            site,
        });
        SpanShift {
            from: start,
            to: base,
        }
    }

    fn copy_of(&self, span: Span) -> Option<&FragmentCopy> {
        let after = self.copies.partition_point(|copy| copy.base <= span.start);
        self.copies.get(after.checked_sub(1)?)
    }

    /// Returns the number of the file and the span in it, for a span that is not in a copy.
    fn file(&self, span: Span) -> (u32, Span) {
        let after = self.files.partition_point(|(base, _)| *base <= span.start);
        let number = after.saturating_sub(1);
        let base = self.files.get(number).map_or(0, |(base, _)| *base);
        let place = Span::new(span.start - base, span.end.saturating_sub(base));
        // There are fewer than 2^32 files.
        (number as u32, place)
    }

    /// Returns the number of the file and the span in it where something is written, whichever instance the span
    /// belongs to.
    #[must_use]
    pub fn location(&self, span: Span) -> (u32, Span) {
        self.file(
            self.copy_of(span)
                .map_or(span, |copy| to_original(copy, span)),
        )
    }

    /// Returns the span of the outermost instance around a copy, in the net's own file.
    fn outermost(&self, copy: &FragmentCopy) -> Span {
        let mut site = copy.site;
        // A copy is added after the one that contains its instance, so the loop ends.
        while let Some(around) = self.copy_of(site) {
            site = around.site;
        }
        site
    }

    /// Maps every diagnostic to its file and adds the general help text. An error in a fragment is reported once for
    /// all its instances.
    #[must_use]
    pub fn finish(&self, diagnostics: Vec<Diagnostic>) -> Faults {
        let mut kept: Vec<(Diagnostic, Option<&FragmentCopy>, usize)> =
            Vec::with_capacity(diagnostics.len());
        let mut known = HashMap::new();
        for mut diagnostic in diagnostics {
            let copy = diagnostic.place.and_then(|span| self.copy_of(span));
            if let Some(span) = diagnostic.place {
                let (file, place) = self.location(span);
                (diagnostic.file, diagnostic.place) = (file, Some(place));
            }
            if copy.is_some() {
                let key = (diagnostic.code, diagnostic.file, diagnostic.place);
                let first = *known.entry(key).or_insert(kept.len());
                if let Some((_, _, count)) = kept.get_mut(first) {
                    *count += 1;
                    continue;
                }
            }
            kept.push((diagnostic, copy, 0));
        }
        let finished = kept
            .into_iter()
            .map(|(diagnostic, copy, others)| match copy {
                Some(copy) => self.in_instance(diagnostic, copy, others),
                None => diagnostic,
            });
        let finished = finished.map(|diagnostic| {
            let remedy = || codes::remedy(diagnostic.code).map(str::to_owned);
            let help = diagnostic.help.clone().or_else(remedy);
            diagnostic.help_if(help)
        });
        let (_, main) = &self.files[0];
        let sorted = Faults::new(main.name.as_str(), "", finished.collect());
        Faults {
            sources: self.files.iter().map(|(_, file)| file.clone()).collect(),
            diagnostics: sorted.diagnostics,
        }
    }

    /// Converts an error in a copy: names are relative to the fragment, and a label shows where the instance is.
    fn in_instance(
        &self,
        mut diagnostic: Diagnostic,
        copy: &FragmentCopy,
        others: usize,
    ) -> Diagnostic {
        if !CODES_WITH_FULL_NAMES.contains(&diagnostic.code) {
            let prefix = format!("{}/", copy.path);
            diagnostic.message = strip_name_prefix(&diagnostic.message, &prefix);
            diagnostic.label = strip_name_prefix(&diagnostic.label, &prefix);
            diagnostic.help = diagnostic
                .help
                .map(|help| strip_name_prefix(&help, &prefix));
        }
        let (file, place) = self.file(self.outermost(copy));
        let label = match others {
            0 => format!("in the instance `{}`", copy.path),
            1 => format!("in the instance `{}`, and in another one", copy.path),
            _ => format!("in the instance `{}`, and in {others} others", copy.path),
        };
        diagnostic.used_at = Some(Box::new(UseSite { place, file, label }));
        diagnostic
    }
}

/// Diagnostics that name primitives inside and outside of a fragment, so their names keep the full path.
const CODES_WITH_FULL_NAMES: &[&str] = &[
    codes::LOOP_WITHOUT_DELAY,
    codes::LOOP_WITHOUT_INITIAL,
    codes::LOOP_STAYS_NULL,
    codes::ALWAYS_NULL,
    codes::CLAIMED_TWICE,
    codes::OWN_TOPIC,
    codes::MANY_TERMINATIONS,
];

fn to_original(copy: &FragmentCopy, span: Span) -> Span {
    let back = |at: usize| at.saturating_sub(copy.base) + copy.origin;
    Span::new(back(span.start), back(span.end))
}

/// Removes a prefix from the names in a text.
fn strip_name_prefix(text: &str, prefix: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut done = 0;
    for (at, _) in text.match_indices(prefix) {
        let (before, after) = (&text[..at], at + prefix.len());
        let is_name_character = |c: char| c.is_alphanumeric() || c == '_' || c == '/';
        if !before.ends_with(is_name_character) {
            out.push_str(&text[done..at]);
            done = after;
        }
    }
    out.push_str(&text[done..]);
    out
}

impl SpanShift {
    /// Shifts a span.
    #[must_use]
    pub fn span(self, span: Span) -> Span {
        let moved = |at: usize| at.saturating_sub(self.from) + self.to;
        if self == SpanShift::default() {
            return span;
        }
        Span::new(moved(span.start), moved(span.end))
    }

    /// Shifts the span of a key.
    #[must_use]
    pub fn key(self, key: &Key) -> Key {
        Key {
            name: key.name.clone(),
            span: self.span(key.span),
        }
    }

    /// Shifts the spans of a reference.
    #[must_use]
    pub fn reference(self, reference: &Reference) -> Reference {
        Reference {
            span: self.span(reference.span),
            primitive_span: self.span(reference.primitive_span),
            port_span: self.span(reference.port_span),
            ..reference.clone()
        }
    }

    /// Shifts the spans of a constant.
    #[must_use]
    pub fn literal(self, literal: &Literal) -> Literal {
        if self == SpanShift::default() {
            return literal.clone();
        }
        let shape = match &literal.shape {
            LiteralShape::List(elements) => {
                let elements = elements.iter().map(|element| self.literal(element));
                LiteralShape::List(elements.collect())
            }
            LiteralShape::Parameterised(node) => {
                let mut node = node.clone();
                self.node(&mut node);
                LiteralShape::Parameterised(node)
            }
            shape => shape.clone(),
        };
        Literal {
            notation: match &literal.notation {
                // The parts have spans of their own; the notation is not needed, because a copy is not written out.
                Notation::Mapping(_) => Notation::Canonical,
                notation => notation.clone(),
            },
            ..Literal::new(shape, self.span(literal.span))
        }
    }

    /// Shifts the spans of a tree.
    pub fn node(self, node: &mut Node) {
        node.span = self.span(node.span);
        match &mut node.value {
            Value::List(nodes) => nodes.iter_mut().for_each(|node| self.node(node)),
            Value::Map(entries) => {
                for entry in entries {
                    entry.key.span = self.span(entry.key.span);
                    self.node(&mut entry.value);
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_prefixes_of_whole_names_are_removed() {
        let text = strip_name_prefix("`a/b.x`, a/c.y and ba/d.z of a/a/e", "a/");
        assert_eq!(text, "`b.x`, c.y and ba/d.z of a/e");
    }
}
