//! The texts of a net and of its libraries behind each other, as one row of bytes, and behind them a copy of a fragment
//! for each instance of it: so a place alone says in which file something stands and in which instance. (Compilers do the
//! same with files and expanded macros.) The loader's threads.

use std::collections::HashMap;

use rcc_config::diagnostic::{Diagnostic, Faults, Source, Span, UsedAt};
use rcc_config::yaml::{Key, Node, Value};

use crate::fault;
use crate::syntax::fragment::Fragment;
use crate::syntax::literal::{Literal, Shape, Written};
use crate::syntax::reference::Reference;

/// All texts of a net.
#[derive(Clone, Debug)]
pub struct Sources {
    /// Where each begins; the net's own is the first one and begins at 0.
    files: Vec<(usize, Source)>,
    /// In the order of their places, all behind the files.
    copies: Vec<Copy>,
    /// Behind everything.
    end: usize,
}

/// The text of a fragment in an instance of it.
#[derive(Clone, Debug)]
struct Copy {
    base: usize,
    /// Where the fragment itself begins.
    origin: usize,
    /// Id of the instance: `a/b`.
    path: String,
    /// Where the instance stands, perhaps in another copy.
    site: Span,
}

/// How far places are moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shift {
    from: usize,
    to: usize,
}

impl Sources {
    /// Of a net alone.
    #[must_use]
    pub fn new(name: &str, text: &str) -> Sources {
        let source = Source {
            name: name.to_owned(),
            text: text.to_owned(),
        };
        Sources {
            end: text.len() + 1,
            files: vec![(0, source)],
            copies: Vec::new(),
        }
    }

    /// Adds a library, before any copy is; what is read from it is moved by the result.
    pub fn add(&mut self, name: &str, text: String) -> Shift {
        debug_assert!(self.copies.is_empty());
        let base = self.end;
        self.end += text.len() + 1;
        let name = name.to_owned();
        self.files.push((base, Source { name, text }));
        Shift { from: 0, to: base }
    }

    /// Number of the file that a place is in, for faults of the whole file.
    #[must_use]
    pub fn file_of(&self, span: Span) -> u32 {
        self.file(span).0
    }

    /// A new copy of a fragment for the instance `path` that stands at `site`.
    pub fn copy(&mut self, fragment: &Fragment, path: &str, site: Span) -> Shift {
        let base = self.end;
        let Span { start, end } = fragment.span;
        self.end += end.saturating_sub(start) + 1;
        self.copies.push(Copy {
            base,
            origin: start,
            path: path.to_owned(),
            site,
        });
        Shift {
            from: start,
            to: base,
        }
    }

    fn copy_of(&self, span: Span) -> Option<&Copy> {
        let after = self.copies.partition_point(|copy| copy.base <= span.start);
        self.copies.get(after.checked_sub(1)?)
    }

    /// The file and the place in it of a place that is in no copy.
    fn file(&self, span: Span) -> (u32, Span) {
        let after = self.files.partition_point(|(base, _)| *base <= span.start);
        let number = after.saturating_sub(1);
        let base = self.files.get(number).map_or(0, |(base, _)| *base);
        let place = Span::new(span.start - base, span.end.saturating_sub(base));
        // Nobody has 2^32 files.
        (number as u32, place)
    }

    /// The file and the place in it where something is written, whatever instance it belongs to.
    #[must_use]
    pub fn written(&self, span: Span) -> (u32, Span) {
        self.file(self.copy_of(span).map_or(span, |copy| out_of(copy, span)))
    }

    /// The outermost instance around a copy: where it stands in the net's own file.
    fn outermost(&self, copy: &Copy) -> Span {
        let mut site = copy.site;
        // A copy is made after the one that its instance stands in, so this comes to an end.
        while let Some(around) = self.copy_of(site) {
            site = around.site;
        }
        site
    }

    /// Gives every fault its place in a file and its remedy; what a fragment has been told once for all its instances.
    #[must_use]
    pub fn finished(&self, faults: Vec<Diagnostic>) -> Faults {
        let mut told: Vec<(Diagnostic, Option<&Copy>, usize)> = Vec::with_capacity(faults.len());
        let mut known = HashMap::new();
        for mut fault in faults {
            let copy = fault.place.and_then(|span| self.copy_of(span));
            if let Some(span) = fault.place {
                let (file, place) = self.written(span);
                (fault.file, fault.place) = (file, Some(place));
            }
            if copy.is_some() {
                let key = (fault.code, fault.file, fault.place);
                let first = *known.entry(key).or_insert(told.len());
                if let Some((_, _, count)) = told.get_mut(first) {
                    *count += 1;
                    continue;
                }
            }
            told.push((fault, copy, 0));
        }
        let finished = told.into_iter().map(|(fault, copy, others)| match copy {
            Some(copy) => self.in_instance(fault, copy, others),
            None => fault,
        });
        let finished = finished.map(|fault| {
            let remedy = || fault::remedy(fault.code).map(str::to_owned);
            let help = fault.help.clone().or_else(remedy);
            fault.help_if(help)
        });
        let (_, main) = &self.files[0];
        let sorted = Faults::new(main.name.as_str(), "", finished.collect());
        Faults {
            sources: self.files.iter().map(|(_, file)| file.clone()).collect(),
            diagnostics: sorted.diagnostics,
        }
    }

    /// A fault of a fragment as it is told: with names as the fragment knows them, and where an instance stands.
    fn in_instance(&self, mut fault: Diagnostic, copy: &Copy, others: usize) -> Diagnostic {
        if !ACROSS.contains(&fault.code) {
            let prefix = format!("{}/", copy.path);
            fault.message = without(&fault.message, &prefix);
            fault.label = without(&fault.label, &prefix);
            fault.help = fault.help.map(|help| without(&help, &prefix));
        }
        let (file, place) = self.file(self.outermost(copy));
        let label = match others {
            0 => format!("in the instance `{}`", copy.path),
            1 => format!("in the instance `{}`, and in another one", copy.path),
            _ => format!("in the instance `{}`, and in {others} others", copy.path),
        };
        fault.used_at = Some(Box::new(UsedAt { place, file, label }));
        fault
    }
}

/// Faults that name primitives in and outside of a fragment: their names stay whole.
const ACROSS: &[&str] = &[
    fault::LOOP_WITHOUT_DELAY,
    fault::LOOP_WITHOUT_INITIAL,
    fault::NULL_FOR_EVER,
    fault::CLAIMED_TWICE,
    fault::OWN_TOPIC,
    fault::MANY_TERMINATIONS,
];

fn out_of(copy: &Copy, span: Span) -> Span {
    let back = |at: usize| at.saturating_sub(copy.base) + copy.origin;
    Span::new(back(span.start), back(span.end))
}

/// The text without a prefix of names.
fn without(text: &str, prefix: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut done = 0;
    for (at, _) in text.match_indices(prefix) {
        let (before, after) = (&text[..at], at + prefix.len());
        let in_a_name = |c: char| c.is_alphanumeric() || c == '_' || c == '/';
        if !before.ends_with(in_a_name) {
            out.push_str(&text[done..at]);
            done = after;
        }
    }
    out.push_str(&text[done..]);
    out
}

impl Shift {
    /// A place, moved.
    #[must_use]
    pub fn span(self, span: Span) -> Span {
        let moved = |at: usize| at.saturating_sub(self.from) + self.to;
        if self == Shift::default() {
            return span;
        }
        Span::new(moved(span.start), moved(span.end))
    }

    /// A key, moved.
    #[must_use]
    pub fn key(self, key: &Key) -> Key {
        Key {
            name: key.name.clone(),
            span: self.span(key.span),
        }
    }

    /// A reference, moved.
    #[must_use]
    pub fn reference(self, reference: &Reference) -> Reference {
        Reference {
            span: self.span(reference.span),
            primitive_span: self.span(reference.primitive_span),
            port_span: self.span(reference.port_span),
            ..reference.clone()
        }
    }

    /// A constant, moved.
    #[must_use]
    pub fn literal(self, literal: &Literal) -> Literal {
        if self == Shift::default() {
            return literal.clone();
        }
        let shape = match &literal.shape {
            Shape::List(elements) => {
                let elements = elements.iter().map(|element| self.literal(element));
                Shape::List(elements.collect())
            }
            Shape::Open(node) => {
                let mut node = node.clone();
                self.node(&mut node);
                Shape::Open(node)
            }
            shape => shape.clone(),
        };
        Literal {
            written: match &literal.written {
                // With places of their own; a copy is not written out again.
                Written::Parts(_) => Written::Usual,
                written => written.clone(),
            },
            ..Literal::new(shape, self.span(literal.span))
        }
    }

    /// Moves a tree.
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
    fn a_prefix_is_taken_off_whole_names_only() {
        let text = without("`a/b.x`, a/c.y and ba/d.z of a/a/e", "a/");
        assert_eq!(text, "`b.x`, c.y and ba/d.z of a/e");
    }
}
