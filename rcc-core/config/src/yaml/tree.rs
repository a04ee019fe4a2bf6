//! Builds the tree of a text from the events of a parser, and refuses what the tree cannot hold. Never used on the
//! real-time thread.

use std::borrow::Cow;

use foldhash::{HashSet, HashSetExt};
use granit_parser::{Event, ScalarStyle, Span as ParserSpan};

use super::{
    DEPTH_MAX, DUPLICATE_KEY, Entry, Key, NOT_SUPPORTED, Node, ShortText, TOO_LARGE, Value, plain,
    unprintable,
};
use crate::diagnostic::{Diagnostic, Span};

/// A list or mapping that is being parsed. Its elements are the last ones of all that are open, so that each list gets
/// its memory when its length is known.
enum OpenNode {
    List {
        /// Number of elements of the lists around it.
        first: usize,
    },
    Map {
        /// Number of entries of the mappings around it.
        first: usize,
        /// Names of all entries, once there are many.
        keys: Option<Box<HashSet<ShortText>>>,
        /// The key whose value comes next, and whether it is the first one with its name.
        key: Option<(Key, bool)>,
    },
}

/// Up to this number of entries a name is looked for in the entries themselves.
const FEW_ENTRIES: usize = 16;

/// Returns true if no entry of the mapping has this key yet.
pub(super) fn is_new(
    name: &str,
    entries: &[Entry],
    keys: &mut Option<Box<HashSet<ShortText>>>,
) -> bool {
    if entries.len() < FEW_ENTRIES {
        return entries.iter().all(|entry| entry.key.name != name);
    }
    let keys = keys.get_or_insert_with(|| {
        let mut keys = Box::new(HashSet::with_capacity(2 * FEW_ENTRIES));
        keys.extend(entries.iter().map(|entry| entry.key.name.clone()));
        keys
    });
    keys.insert(name.into())
}

/// The tree as far as it is built.
pub(super) struct TreeBuilder<'a> {
    text: &'a str,
    stack: Vec<(OpenNode, Span)>,
    /// Elements of all open lists.
    nodes: Vec<Node>,
    /// Entries of all open mappings.
    entries: Vec<Entry>,
    documents: usize,
    root: Option<Node>,
    /// Errors found so far.
    pub(super) faults: Vec<Diagnostic>,
}

impl<'a> TreeBuilder<'a> {
    pub(super) fn new(text: &'a str) -> TreeBuilder<'a> {
        TreeBuilder {
            text,
            stack: Vec::new(),
            nodes: Vec::new(),
            entries: Vec::new(),
            documents: 0,
            root: None,
            faults: Vec::new(),
        }
    }

    pub(super) fn finish(self) -> (Option<Node>, Vec<Diagnostic>) {
        let null = Node {
            value: Value::Null,
            span: Span::new(0, 0),
        };
        (Some(self.root.unwrap_or(null)), self.faults)
    }

    pub(super) fn take(
        &mut self,
        event: Event<'a>,
        span: ParserSpan,
    ) -> Result<(), Box<Diagnostic>> {
        let place = self.place(span);
        let refuse = |what: &str, help: &str| {
            let message = format!("{what} are not supported");
            let fault = Diagnostic::error(NOT_SUPPORTED, place, message);
            Err(Box::new(fault.help(help)))
        };
        match event {
            Event::DocumentStart(..) => {
                self.documents += 1;
                if self.documents > 1 {
                    return refuse("several documents in one file", "use one file each");
                }
                Ok(())
            }
            Event::Alias(_) | Event::UnresolvedAlias(_) | Event::Anchor(..) => {
                refuse("anchors and aliases", "write the value where it is used")
            }
            Event::Scalar(_, _, anchor, _)
            | Event::SequenceStart(_, anchor, _)
            | Event::MappingStart(_, anchor, _)
                if anchor != 0 =>
            {
                refuse("anchors and aliases", "write the value where it is used")
            }
            Event::Scalar(_, _, _, Some(_))
            | Event::SequenceStart(_, _, Some(_))
            | Event::MappingStart(_, _, Some(_)) => refuse(
                "tags (`!…`)",
                "remove the tag; quote a value to keep it text",
            ),
            Event::Scalar(text, style, ..) => self.scalar(text, style, place),
            Event::SequenceStart(..) => self.open_list(place),
            Event::MappingStart(..) => self.open_map(place),
            Event::SequenceEnd | Event::MappingEnd => self.close(place),
            _ => Ok(()),
        }
    }

    fn place(&self, span: ParserSpan) -> Span {
        let range = span.byte_range().unwrap_or_default();
        let end = range.end.min(self.text.len());
        Span::new(range.start.min(end), end)
    }

    fn scalar(
        &mut self,
        text: Cow<'a, str>,
        style: ScalarStyle,
        span: Span,
    ) -> Result<(), Box<Diagnostic>> {
        self.faults.extend(unprintable(&text, span));
        if let Some((OpenNode::Map { first, keys, key }, _)) = self.stack.last_mut()
            && key.is_none()
        {
            let entries = self.entries.get(*first..).unwrap_or_default();
            let first = is_new(&text, entries, keys);
            let name = ShortText::from(text);
            if !first {
                let message = format!("`{name}` is given twice in one mapping");
                let fault = Diagnostic::error(DUPLICATE_KEY, span, message).label("given before");
                self.faults.push(fault.help("keep one of them"));
            }
            *key = Some((Key { name, span }, first));
            return Ok(());
        }
        let value = if style == ScalarStyle::Plain {
            plain(&text)
        } else {
            Value::Text(text.into())
        };
        self.put(Node { value, span })
    }

    fn open_list(&mut self, span: Span) -> Result<(), Box<Diagnostic>> {
        let first = self.nodes.len();
        self.open(OpenNode::List { first }, span)
    }

    fn open_map(&mut self, span: Span) -> Result<(), Box<Diagnostic>> {
        let map = OpenNode::Map {
            first: self.entries.len(),
            keys: None,
            key: None,
        };
        self.open(map, span)
    }

    fn open(&mut self, open: OpenNode, span: Span) -> Result<(), Box<Diagnostic>> {
        if let Some((OpenNode::Map { key: None, .. }, _)) = self.stack.last() {
            let fault =
                Diagnostic::error(NOT_SUPPORTED, span, "a list or mapping is used as a key");
            return Err(Box::new(fault.help("a key is plain text")));
        }
        if self.stack.len() >= DEPTH_MAX {
            let message = format!("lists and mappings are nested more than {DEPTH_MAX} deep");
            let fault = Diagnostic::error(TOO_LARGE, span, message);
            return Err(Box::new(fault.label("here")));
        }
        self.stack.push((open, span));
        Ok(())
    }

    fn close(&mut self, end: Span) -> Result<(), Box<Diagnostic>> {
        let Some((open, start)) = self.stack.pop() else {
            return Ok(());
        };
        // The parser ends a block collection where the next token begins; its text ends earlier.
        let (value, inside) = match open {
            OpenNode::List { first } => {
                let nodes = self.nodes.split_off(first);
                let last = nodes.last().map(|node| node.span.end);
                (Value::List(nodes), last)
            }
            OpenNode::Map { first, .. } => {
                let entries = self.entries.split_off(first);
                let last = entries.last().map(|entry| entry.value.span.end);
                (Value::Map(entries), last)
            }
        };
        let inside = inside.unwrap_or(start.end);
        let span = Span::new(
            start.start,
            if end.end > end.start { end.end } else { inside },
        );
        self.put(Node { value, span })
    }

    fn put(&mut self, node: Node) -> Result<(), Box<Diagnostic>> {
        match self.stack.last_mut() {
            Some((OpenNode::List { .. }, _)) => self.nodes.push(node),
            Some((OpenNode::Map { key, .. }, _)) => match key.take() {
                Some((key, true)) => self.entries.push(Entry { key, value: node }),
                Some((_, false)) => {}
                None => {
                    let message = "a list or mapping is used as a key";
                    let fault = Diagnostic::error(NOT_SUPPORTED, node.span, message);
                    return Err(Box::new(fault));
                }
            },
            None => self.root = Some(node),
        }
        Ok(())
    }
}
