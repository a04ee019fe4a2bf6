//! The syntax pass: the tree of the text becomes primitives, inputs and literals, each with its span. It checks the
//! syntax of the language and of names, reports all errors at once, and does not know the catalogue. Runs on the
//! loader's threads.

pub mod fragment;
mod legs;
pub mod literal;
pub mod part;
pub mod reference;

use rcc_config::diagnostic::{Diagnostic, Span, closest};
use rcc_config::yaml::{Entry, Key, Node, Value};

use rcc_core::types::ELEMENTS_MAX;

use crate::codes;
use crate::syntax::fragment::Fragment;
use crate::syntax::literal::Literal;
use crate::syntax::reference::Reference;

/// Longest name, bytes.
pub const NAME_MAX: usize = 64;

/// A net file.
#[derive(Clone, Debug)]
pub struct Net {
    /// Name and its span.
    pub name: Key,
    /// Description for users; may be empty.
    pub description: String,
    /// `on_device_loss: null`: the net continues with null when a device that it commands is lost.
    pub survives_device_loss: bool,
    /// Period and phase.
    pub timing: Timing,
    /// `use: [library/filters.yaml]`: paths of the libraries, relative to the net's own file.
    pub uses: Vec<Key>,
    /// Fragments of the net itself, in the order of the file.
    pub fragments: Vec<Fragment>,
    /// Primitives and instances of fragments in the order of the file.
    pub primitives: Vec<Primitive>,
    /// Outputs that nothing reads.
    pub discard: Vec<Reference>,
}

/// Period and phase as written. If nothing is given, the net is evaluated in every cycle.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    /// `period: 5 ms`.
    pub period: Option<Literal>,
    /// `rate: 200 Hz`, an alternative to `period`.
    pub rate: Option<Literal>,
    /// `phase: 2 ms`, the delay after the start of the period.
    pub phase: Option<Literal>,
}

/// A primitive, or an instance of a fragment.
#[derive(Clone, Debug)]
pub struct Primitive {
    /// Id.
    pub id: Key,
    /// Whether `type_name` names a type or a fragment.
    pub kind: PrimitiveKind,
    /// Type or fragment as written; empty if it is missing.
    pub type_name: Key,
    /// Parameters in the order of the file.
    pub parameters: Vec<(Key, Literal)>,
    /// Inputs in the order of the file. In a fragment, a link without a port (`x`) reads an input of the fragment.
    pub inputs: Vec<(Key, Source)>,
    /// `active: touch.out`: while this is false or null, the primitive is not evaluated and its outputs are null.
    pub active: Option<Source>,
}

/// What an entry of `primitives` is an instance of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PrimitiveKind {
    /// `type: Add`: a type of the catalogue.
    #[default]
    Type,
    /// `fragment: smooth`: a fragment of the net or of a library.
    Fragment,
}

/// The source of an input.
#[derive(Clone, Debug)]
pub enum Source {
    /// A link from an output.
    Link(Link),
    /// A constant.
    Literal(Literal),
    /// A list with at least one link in it.
    List(List),
    /// Refused; the error is reported.
    Refused,
}

impl Source {
    /// Returns the links of the source.
    #[must_use]
    pub fn links(&self) -> Vec<&Link> {
        match self {
            Source::Link(link) => vec![link],
            Source::List(list) => list.elements.iter().flat_map(Source::links).collect(),
            Source::Literal(_) | Source::Refused => Vec::new(),
        }
    }

    /// Returns the constants of the source, including the initial values of delayed links.
    #[must_use]
    pub fn constants(&self) -> Vec<&Literal> {
        match self {
            Source::Link(link) => link.initial.iter().collect(),
            Source::Literal(literal) => vec![literal],
            Source::List(list) => list.elements.iter().flat_map(Source::constants).collect(),
            Source::Refused => Vec::new(),
        }
    }
}

/// A list of links and constants that becomes one value: an array or a vector, or a matrix if its elements are lists.
#[derive(Clone, Debug)]
pub struct List {
    /// Its elements, at most [`ELEMENTS_MAX`]. Lists are nested at most twice.
    pub elements: Vec<Source>,
    /// Span of the list.
    pub span: Span,
}

/// A link from an output.
#[derive(Clone, Debug)]
pub struct Link {
    /// The output.
    pub from: Reference,
    /// True if it carries the value of the previous cycle.
    pub delayed: bool,
    /// Value of a delayed link in the first cycle.
    pub initial: Option<Literal>,
    /// Span of the link.
    pub span: Span,
}

const NET_KEYS: &[&str] = &[
    "net",
    "description",
    "on_device_loss",
    "period",
    "rate",
    "phase",
    "use",
    "fragments",
    "primitives",
    "discard",
];
const PRIMITIVE_KEYS: &[&str] = &["type", "fragment", "parameters", "inputs", "active"];
const LINK_KEYS: &[&str] = &["from", "delayed", "initial"];

/// Reads a net from the tree of its text.
pub fn read(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<Net> {
    if root.map().is_none() {
        let message = format!(
            "expected a net, a mapping with the keys `net` and `primitives`, found {}",
            root.kind()
        );
        diagnostics.push(Diagnostic::error(codes::WRONG_SHAPE, root.span, message));
        return None;
    }
    report_unknown_keys(root, NET_KEYS, "a net", diagnostics);
    let name = read_name(root, diagnostics);
    let description = read_description(root, diagnostics);
    let survives_device_loss = match root.get("on_device_loss") {
        None => false,
        Some(node) if node.value == Value::Null => true,
        Some(node) if node.text() == Some("fault") => false,
        Some(node) => {
            diagnostics.push(shape(
                node,
                "`on_device_loss`",
                "`fault` (the default) or `null`",
            ));
            false
        }
    };
    Some(Net {
        name,
        description,
        survives_device_loss,
        timing: read_timing(root, diagnostics),
        uses: fragment::read_uses(root, diagnostics),
        fragments: fragment::read_all(root, diagnostics),
        primitives: read_primitives(root, diagnostics),
        discard: read_discard(root, diagnostics),
    })
}

fn read_description(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> String {
    match node.get("description").map(|node| (node, node.text())) {
        None => String::new(),
        Some((_, Some(text))) => text.to_string(),
        Some((node, None)) => {
            diagnostics.push(shape(node, "`description`", "text"));
            String::new()
        }
    }
}

fn read_timing(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Timing {
    let mut read = |key| root.get(key).map(|node| literal::read(node, diagnostics));
    Timing {
        period: read("period"),
        rate: read("rate"),
        phase: read("phase"),
    }
}

/// Returns the diagnostic that `what` must be `wanted`.
fn shape(node: &Node, what: &str, wanted: &str) -> Diagnostic {
    let message = format!("{what} must be {wanted}, not {}", node.kind());
    Diagnostic::error(codes::WRONG_SHAPE, node.span, message)
}

fn report_unknown_keys(node: &Node, known: &[&str], what: &str, diagnostics: &mut Vec<Diagnostic>) {
    for key in node.unknown_keys(known) {
        let message = format!("{what} has no key `{}`", key.name);
        let help = match closest(&key.name, known.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("keys: {}", known.join(", ")),
        };
        diagnostics.push(Diagnostic::error(codes::UNKNOWN_KEY, key.span, message).help(help));
    }
}

fn read_name(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Key {
    let unnamed = Key {
        name: String::new(),
        span: Span::default(),
    };
    let Some(node) = root.get("net") else {
        let diagnostic =
            Diagnostic::error(codes::MISSING_KEY, Span::default(), "the net has no name");
        diagnostics.push(diagnostic.anywhere().help("begin with `net: NAME`"));
        return unnamed;
    };
    let Some(name) = node.text() else {
        diagnostics.push(shape(node, "the name of a net", "text"));
        return unnamed;
    };
    let name = Key {
        name: name.to_string(),
        span: node.span,
    };
    diagnostics.extend(bad_net_name(&name));
    name
}

/// Returns true for a valid name of a net, `[a-z][a-z0-9-]{0,63}`, in any notation. A loaded net is also addressed by
/// its number and as `name#number`, so a name does not begin with a digit and has no `#`.
#[must_use]
pub fn is_net_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    name.len() <= NAME_MAX
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(allowed)
}

/// Returns the diagnostic of an invalid name of a net.
pub(crate) fn bad_net_name(name: &Key) -> Option<Diagnostic> {
    if is_net_name(&name.name) {
        return None;
    }
    let message = format!("`{}` cannot be the name of a net", name.name);
    let mut help = format!(
        "use lowercase letters, digits and `-`, at most {NAME_MAX} characters, beginning with a letter"
    );
    let lettered = format!("net-{}", name.name);
    if is_net_name(&lettered) {
        help = format!("{help}, as in `{lettered}`; a number is the id of a loaded net");
    }
    Some(Diagnostic::error(codes::BAD_NAME, name.span, message).help(help))
}

fn read_primitives(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Vec<Primitive> {
    let Some(node) = root.get("primitives") else {
        let diagnostic = Diagnostic::error(
            codes::MISSING_KEY,
            Span::default(),
            "the net has no primitives",
        );
        diagnostics.push(
            diagnostic
                .anywhere()
                .help("add `primitives:` with at least a Termination"),
        );
        return Vec::new();
    };
    let Some(entries) = node.map() else {
        diagnostics.push(shape(
            node,
            "`primitives`",
            "a mapping from ids to primitives",
        ));
        return Vec::new();
    };
    entries
        .iter()
        .map(|entry| read_primitive(entry, diagnostics))
        .collect()
}

fn is_id(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    name.len() <= NAME_MAX
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(allowed)
}

fn report_bad_id(id: &Key, what: &str, diagnostics: &mut Vec<Diagnostic>) {
    if !is_id(&id.name) {
        let message = format!("`{}` cannot be {what}", id.name);
        let diagnostic = Diagnostic::error(codes::BAD_NAME, id.span, message);
        diagnostics.push(diagnostic.help(format!(
            "use lowercase letters, digits and `_`, at most {NAME_MAX} characters, beginning with a letter"
        )));
    }
}

fn read_primitive(entry: &Entry, diagnostics: &mut Vec<Diagnostic>) -> Primitive {
    let (id, node) = (&entry.key, &entry.value);
    report_bad_id(id, "the id of a primitive", diagnostics);
    let mut primitive = Primitive {
        id: id.clone(),
        kind: PrimitiveKind::Type,
        type_name: Key {
            name: String::new(),
            span: id.span,
        },
        parameters: Vec::new(),
        inputs: Vec::new(),
        active: None,
    };
    if node.map().is_none() {
        let wanted = "a mapping such as `{type: Time}`";
        diagnostics.push(shape(node, &format!("primitive `{}`", id.name), wanted));
        return primitive;
    }
    report_unknown_keys(node, PRIMITIVE_KEYS, "a primitive", diagnostics);
    read_kind(&mut primitive, node, diagnostics);
    for entry in entries_of(node, "parameters", diagnostics) {
        let value = literal::read(&entry.value, diagnostics);
        primitive.parameters.push((entry.key.clone(), value));
    }
    for entry in entries_of(node, "inputs", diagnostics) {
        let source = read_source(&entry.value, diagnostics);
        primitive.inputs.push((entry.key.clone(), source));
    }
    primitive.active = node
        .get("active")
        .map(|node| read_source(node, diagnostics));
    primitive
}

/// Reads `type: Add` or `fragment: smooth`.
fn read_kind(primitive: &mut Primitive, node: &Node, diagnostics: &mut Vec<Diagnostic>) {
    let (kind, what, given) = match (node.get("type"), node.get("fragment")) {
        (Some(given), None) => (PrimitiveKind::Type, "a primitive type", given),
        (None, Some(given)) => (PrimitiveKind::Fragment, "a fragment", given),
        (None, None) => {
            let message = format!("primitive `{}` has no type", primitive.id.name);
            let diagnostic = Diagnostic::error(codes::MISSING_KEY, primitive.id.span, message);
            return diagnostics.push(diagnostic.help("add `type: …`"));
        }
        (Some(_), Some(given)) => {
            let message = format!("`{}` has both `type` and `fragment`", primitive.id.name);
            let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, given.span, message);
            return diagnostics.push(diagnostic.help("remove `type` or `fragment`"));
        }
    };
    let Some(name) = given.text() else {
        let key = if kind == PrimitiveKind::Type {
            "`type`"
        } else {
            "`fragment`"
        };
        return diagnostics.push(shape(given, key, &format!("the name of {what}")));
    };
    primitive.kind = kind;
    primitive.type_name = Key {
        name: name.to_string(),
        span: given.span,
    };
}

/// Returns the entries of the mapping under `key`; an absent or null value counts as an empty mapping.
fn entries_of<'a>(node: &'a Node, key: &str, diagnostics: &mut Vec<Diagnostic>) -> &'a [Entry] {
    match node.get(key) {
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

/// Returns true for a list that contains a link.
fn has_link(node: &Node) -> bool {
    node.list().is_some_and(|nodes| {
        nodes.iter().any(|node| {
            let text = node.text();
            let names =
                |text| !rcc_config::quantity::looks_like(text) && !literal::is_parameter(text);
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

fn read_source(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Source {
    if let Some(nodes) = node.list().filter(|_| has_link(node)) {
        return read_list(node, nodes, 0, diagnostics);
    }
    if let Some(text) = node.text()
        && !rcc_config::quantity::looks_like(text)
        && !literal::is_parameter(text)
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
    let literal = literal::read(node, diagnostics);
    if literal.is_refused() {
        Source::Refused
    } else {
        Source::Literal(literal)
    }
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
        .map(|node| literal::read(node, diagnostics));
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

fn read_discard(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Vec<Reference> {
    let Some(node) = root.get("discard") else {
        return Vec::new();
    };
    let Some(nodes) = node.list() else {
        diagnostics.push(shape(
            node,
            "`discard`",
            "a list of outputs such as `[ft.fx, ft.fy]`",
        ));
        return Vec::new();
    };
    let mut outputs = Vec::new();
    for node in nodes {
        match node.text() {
            Some(text) => outputs.extend(reference::read(node, text, diagnostics)),
            None => diagnostics.push(shape(
                node,
                "an element of `discard`",
                "an output such as `ft.fx`",
            )),
        }
    }
    outputs
}
