//! A net as it is written: the tree of the text turned into primitives, inputs and literals, each with its place.
//! Knows the shape of the language, not the catalogue; all faults of shape and of names at once. The loader's threads.

pub mod fragment;
mod legs;
pub mod literal;
pub mod part;
pub mod reference;

use rcc_config::diagnostic::{Diagnostic, Span, closest};
use rcc_config::yaml::{Entry, Key, Node, Value};

use rcc_core::types::ELEMENTS_MAX;

use crate::fault;
use crate::syntax::fragment::Fragment;
use crate::syntax::literal::Literal;
use crate::syntax::reference::Reference;

/// Longest name in bytes.
pub const NAME_MAX: usize = 64;

/// Everything that a net file says.
#[derive(Clone, Debug)]
pub struct Net {
    /// Its name and where that stands.
    pub name: Key,
    /// What people should know about it; empty if nothing is said.
    pub description: String,
    /// `on_device_loss: null`: the net goes on with null when a device that it commands is lost.
    pub survives_device_loss: bool,
    /// When it is evaluated.
    pub timing: Timing,
    /// `use: [library/filters.yaml]`: files whose fragments the net uses, relative to its own file.
    pub uses: Vec<Key>,
    /// Its own fragments in the order of the file.
    pub fragments: Vec<Fragment>,
    /// Primitives and instances of fragments in the order of the file.
    pub primitives: Vec<Primitive>,
    /// Outputs that nobody reads.
    pub discard: Vec<Reference>,
}

/// When a net is evaluated, as written; without any of it in every cycle.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    /// `period: 5 ms`.
    pub period: Option<Literal>,
    /// `rate: 200 Hz`: the same in other words.
    pub rate: Option<Literal>,
    /// `phase: 2 ms`: how long after the beginning of the period.
    pub phase: Option<Literal>,
}

/// One primitive, or one instance of a fragment.
#[derive(Clone, Debug)]
pub struct Primitive {
    /// Its id.
    pub id: Key,
    /// What `type_name` names.
    pub kind: Kind,
    /// Its type, or the fragment, as written; empty if that is missing.
    pub type_name: Key,
    /// Parameters in the order of the file.
    pub parameters: Vec<(Key, Literal)>,
    /// Inputs in the order of the file. In a fragment a link from a name without a port (`x`) is one from its input.
    pub inputs: Vec<(Key, Source)>,
    /// `active: touch.out`: while this is false or null it is not evaluated, and its outputs are null.
    pub active: Option<Source>,
}

/// What an entry of `primitives` is made from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// `type: Add`: a type of the catalogue.
    #[default]
    Type,
    /// `fragment: smooth`: a fragment of the net or of a library.
    Fragment,
}

/// What feeds an input.
#[derive(Clone, Debug)]
pub enum Source {
    /// An output.
    Link(Link),
    /// A constant.
    Literal(Literal),
    /// A list with at least one link in it.
    List(List),
    /// Something that was refused; its fault is reported.
    Refused,
}

impl Source {
    /// The links in it.
    #[must_use]
    pub fn links(&self) -> Vec<&Link> {
        match self {
            Source::Link(link) => vec![link],
            Source::List(list) => list.elements.iter().flat_map(Source::links).collect(),
            Source::Literal(_) | Source::Refused => Vec::new(),
        }
    }

    /// The constants in it, first values of delayed links included.
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

/// A list of links and constants that becomes one value: an array, a vector, or, of lists, a matrix.
#[derive(Clone, Debug)]
pub struct List {
    /// What it consists of, at most [`ELEMENTS_MAX`]; lists only in a list that is in none.
    pub elements: Vec<Source>,
    /// Where it stands.
    pub span: Span,
}

/// A link from an output.
#[derive(Clone, Debug)]
pub struct Link {
    /// The output.
    pub from: Reference,
    /// It carries the value of the cycle before.
    pub delayed: bool,
    /// Value of a delayed link in the first cycle.
    pub initial: Option<Literal>,
    /// Where the link stands.
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
pub fn read(root: &Node, faults: &mut Vec<Diagnostic>) -> Option<Net> {
    if root.map().is_none() {
        let message = format!(
            "a net is a mapping with the keys `net` and `primitives`, this is {}",
            root.kind()
        );
        faults.push(Diagnostic::error(fault::WRONG_SHAPE, root.span, message));
        return None;
    }
    report_unknown_keys(root, NET_KEYS, "a net", faults);
    let name = read_name(root, faults);
    let description = read_description(root, faults);
    let survives_device_loss = match root.get("on_device_loss") {
        None => false,
        Some(node) if node.value == Value::Null => true,
        Some(node) if node.text() == Some("fault") => false,
        Some(node) => {
            faults.push(shape(
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
        timing: read_timing(root, faults),
        uses: fragment::read_uses(root, faults),
        fragments: fragment::read_all(root, faults),
        primitives: read_primitives(root, faults),
        discard: read_discard(root, faults),
    })
}

fn read_description(node: &Node, faults: &mut Vec<Diagnostic>) -> String {
    match node.get("description").map(|node| (node, node.text())) {
        None => String::new(),
        Some((_, Some(text))) => text.to_string(),
        Some((node, None)) => {
            faults.push(shape(node, "`description`", "text"));
            String::new()
        }
    }
}

fn read_timing(root: &Node, faults: &mut Vec<Diagnostic>) -> Timing {
    let mut read = |key| root.get(key).map(|node| literal::read(node, faults));
    Timing {
        period: read("period"),
        rate: read("rate"),
        phase: read("phase"),
    }
}

/// A fault of shape: `what` is not `wanted`.
fn shape(node: &Node, what: &str, wanted: &str) -> Diagnostic {
    let message = format!("{what} must be {wanted}, not {}", node.kind());
    Diagnostic::error(fault::WRONG_SHAPE, node.span, message)
}

fn report_unknown_keys(node: &Node, known: &[&str], what: &str, faults: &mut Vec<Diagnostic>) {
    for key in node.unknown_keys(known) {
        let message = format!("{what} has no key `{}`", key.name);
        let help = match closest(&key.name, known.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("keys: {}", known.join(", ")),
        };
        faults.push(Diagnostic::error(fault::UNKNOWN_KEY, key.span, message).help(help));
    }
}

fn read_name(root: &Node, faults: &mut Vec<Diagnostic>) -> Key {
    let nowhere = Key {
        name: String::new(),
        span: Span::default(),
    };
    let Some(node) = root.get("net") else {
        let fault = Diagnostic::error(fault::MISSING_KEY, Span::default(), "the net has no name");
        faults.push(fault.anywhere().help("begin with `net: NAME`"));
        return nowhere;
    };
    let Some(name) = node.text() else {
        faults.push(shape(node, "the name of a net", "text"));
        return nowhere;
    };
    let name = Key {
        name: name.to_string(),
        span: node.span,
    };
    faults.extend(bad_net_name(&name));
    name
}

/// The rule for names of nets, in whatever form they are given: `[a-z][a-z0-9-]{0,63}`. A loaded net is also addressed by
/// its number and as `name#number`, so no name begins with a digit or has a `#`.
#[must_use]
pub fn is_net_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    name.len() <= NAME_MAX
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(allowed)
}

/// The fault of a name that no net may have.
pub(crate) fn bad_net_name(name: &Key) -> Option<Diagnostic> {
    if is_net_name(&name.name) {
        return None;
    }
    let message = format!("`{}` cannot be the name of a net", name.name);
    let mut help =
        format!("use small letters, digits and `-`, at most {NAME_MAX}, beginning with a letter");
    let lettered = format!("net-{}", name.name);
    if is_net_name(&lettered) {
        help = format!("{help}, as in `{lettered}`; a number is the id of a loaded net");
    }
    Some(Diagnostic::error(fault::BAD_NAME, name.span, message).help(help))
}

fn read_primitives(root: &Node, faults: &mut Vec<Diagnostic>) -> Vec<Primitive> {
    let Some(node) = root.get("primitives") else {
        let fault = Diagnostic::error(
            fault::MISSING_KEY,
            Span::default(),
            "the net has no primitives",
        );
        faults.push(
            fault
                .anywhere()
                .help("add `primitives:` with at least a Termination"),
        );
        return Vec::new();
    };
    let Some(entries) = node.map() else {
        faults.push(shape(
            node,
            "`primitives`",
            "a mapping from ids to primitives",
        ));
        return Vec::new();
    };
    entries
        .iter()
        .map(|entry| read_primitive(entry, faults))
        .collect()
}

fn is_id(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    name.len() <= NAME_MAX
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(allowed)
}

fn report_bad_id(id: &Key, what: &str, faults: &mut Vec<Diagnostic>) {
    if !is_id(&id.name) {
        let message = format!("`{}` cannot be {what}", id.name);
        let fault = Diagnostic::error(fault::BAD_NAME, id.span, message);
        faults.push(fault.help(format!(
            "use small letters, digits and `_`, at most {NAME_MAX}, beginning with a letter"
        )));
    }
}

fn read_primitive(entry: &Entry, faults: &mut Vec<Diagnostic>) -> Primitive {
    let (id, node) = (&entry.key, &entry.value);
    report_bad_id(id, "the id of a primitive", faults);
    let mut primitive = Primitive {
        id: id.clone(),
        kind: Kind::Type,
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
        faults.push(shape(node, &format!("primitive `{}`", id.name), wanted));
        return primitive;
    }
    report_unknown_keys(node, PRIMITIVE_KEYS, "a primitive", faults);
    read_kind(&mut primitive, node, faults);
    for entry in entries_of(node, "parameters", faults) {
        let value = literal::read(&entry.value, faults);
        primitive.parameters.push((entry.key.clone(), value));
    }
    for entry in entries_of(node, "inputs", faults) {
        let source = read_source(&entry.value, faults);
        primitive.inputs.push((entry.key.clone(), source));
    }
    primitive.active = node.get("active").map(|node| read_source(node, faults));
    primitive
}

/// `type: Add` or `fragment: smooth`.
fn read_kind(primitive: &mut Primitive, node: &Node, faults: &mut Vec<Diagnostic>) {
    let (kind, what, given) = match (node.get("type"), node.get("fragment")) {
        (Some(given), None) => (Kind::Type, "a primitive type", given),
        (None, Some(given)) => (Kind::Fragment, "a fragment", given),
        (None, None) => {
            let message = format!("primitive `{}` has no type", primitive.id.name);
            let fault = Diagnostic::error(fault::MISSING_KEY, primitive.id.span, message);
            return faults.push(fault.help("add `type: …`"));
        }
        (Some(_), Some(given)) => {
            let message = format!(
                "`{}` has a type and a fragment: it is made from one of them",
                primitive.id.name
            );
            let fault = Diagnostic::error(fault::WRONG_SHAPE, given.span, message);
            return faults.push(fault.help("take `type` or `fragment` out"));
        }
    };
    let Some(name) = given.text() else {
        let key = if kind == Kind::Type {
            "`type`"
        } else {
            "`fragment`"
        };
        return faults.push(shape(given, key, &format!("the name of {what}")));
    };
    primitive.kind = kind;
    primitive.type_name = Key {
        name: name.to_string(),
        span: given.span,
    };
}

/// The entries of the mapping under `key`; nothing counts as an empty one.
fn entries_of<'a>(node: &'a Node, key: &str, faults: &mut Vec<Diagnostic>) -> &'a [Entry] {
    match node.get(key) {
        None => &[],
        Some(node) => match (&node.value, node.map()) {
            (_, Some(entries)) => entries,
            (Value::Null, None) => &[],
            (_, None) => {
                faults.push(shape(
                    node,
                    &format!("`{key}`"),
                    "a mapping from names to values",
                ));
                &[]
            }
        },
    }
}

/// True for a list with a link in it.
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

/// A list with links; `depth`: how many lists it is in.
fn read_list(node: &Node, nodes: &[Node], depth: u32, faults: &mut Vec<Diagnostic>) -> Source {
    if nodes.len() > usize::from(ELEMENTS_MAX) || depth > 1 {
        let message = match depth {
            0 | 1 => format!(
                "a list has 1 to {ELEMENTS_MAX} elements, this one has {}",
                nodes.len()
            ),
            _ => "lists are nested at most twice: a matrix is a list of rows".to_string(),
        };
        faults.push(Diagnostic::error(fault::WRONG_SHAPE, node.span, message));
        return Source::Refused;
    }
    let read = |node: &Node| match node.list() {
        Some(nodes) if has_link(node) => read_list(node, nodes, depth + 1, faults),
        _ => read_source(node, faults),
    };
    Source::List(List {
        elements: nodes.iter().map(read).collect(),
        span: node.span,
    })
}

fn read_source(node: &Node, faults: &mut Vec<Diagnostic>) -> Source {
    if let Some(nodes) = node.list().filter(|_| has_link(node)) {
        return read_list(node, nodes, 0, faults);
    }
    if let Some(text) = node.text()
        && !rcc_config::quantity::looks_like(text)
        && !literal::is_parameter(text)
    {
        let from = reference::read(node, text, faults);
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
        return read_link(node, faults);
    }
    let literal = literal::read(node, faults);
    if literal.is_refused() {
        Source::Refused
    } else {
        Source::Literal(literal)
    }
}

fn read_link(node: &Node, faults: &mut Vec<Diagnostic>) -> Source {
    report_unknown_keys(node, LINK_KEYS, "a link", faults);
    let delayed = match node.get("delayed").map(|node| (node, &node.value)) {
        None => false,
        Some((_, Value::Bool(delayed))) => *delayed,
        Some((node, _)) => {
            faults.push(shape(node, "`delayed`", "true or false"));
            true
        }
    };
    let initial = node.get("initial").map(|node| literal::read(node, faults));
    if let (Some(initial), false) = (&initial, delayed) {
        let message = "only a delayed link has an initial value";
        let fault = Diagnostic::error(fault::WRONG_SHAPE, initial.span, message);
        faults.push(fault.help("add `delayed: true`, or leave `initial` out"));
    }
    let Some(from) = node.get("from") else {
        let fault = Diagnostic::error(
            fault::MISSING_KEY,
            node.span,
            "a link does not say where it comes from",
        );
        faults.push(fault.help("add `from: PRIMITIVE.PORT`"));
        return Source::Refused;
    };
    let Some(text) = from.text() else {
        faults.push(shape(from, "`from`", "an output such as `move.pose`"));
        return Source::Refused;
    };
    reference::read(from, text, faults).map_or(Source::Refused, |reference| {
        Source::Link(Link {
            from: reference,
            delayed,
            initial,
            span: from.span,
        })
    })
}

fn read_discard(root: &Node, faults: &mut Vec<Diagnostic>) -> Vec<Reference> {
    let Some(node) = root.get("discard") else {
        return Vec::new();
    };
    let Some(nodes) = node.list() else {
        faults.push(shape(
            node,
            "`discard`",
            "a list of outputs such as `[ft.fx, ft.fy]`",
        ));
        return Vec::new();
    };
    let mut outputs = Vec::new();
    for node in nodes {
        match node.text() {
            Some(text) => outputs.extend(reference::read(node, text, faults)),
            None => faults.push(shape(
                node,
                "an element of `discard`",
                "an output such as `ft.fx`",
            )),
        }
    }
    outputs
}
