//! A net as it is written: the tree of the text turned into primitives, inputs and literals, each with its place.
//! Knows the shape of the language, not the catalogue; all faults of shape and of names at once. The loader's threads.

pub mod literal;
pub mod reference;

use rcc_config::diagnostic::{Diagnostic, Span, closest};
use rcc_config::yaml::{Entry, Key, Node, Value};

use crate::fault;
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
    /// Primitives in the order of the file.
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

/// One primitive.
#[derive(Clone, Debug)]
pub struct Primitive {
    /// Its id.
    pub id: Key,
    /// Its type as written; empty if that is missing.
    pub type_name: Key,
    /// Parameters in the order of the file.
    pub parameters: Vec<(Key, Literal)>,
    /// Inputs in the order of the file.
    pub inputs: Vec<(Key, Source)>,
}

/// What feeds an input.
#[derive(Clone, Debug)]
pub enum Source {
    /// An output.
    Link(Link),
    /// A constant.
    Literal(Literal),
    /// Something that was refused; its fault is reported.
    Refused,
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
    "primitives",
    "discard",
];
const PRIMITIVE_KEYS: &[&str] = &["type", "parameters", "inputs"];
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
    let description = match root.get("description").map(|node| (node, node.text())) {
        None => String::new(),
        Some((_, Some(text))) => text.to_string(),
        Some((node, None)) => {
            faults.push(shape(node, "`description`", "text"));
            String::new()
        }
    };
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
        primitives: read_primitives(root, faults),
        discard: read_discard(root, faults),
    })
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
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if name.is_empty()
        || name.len() > NAME_MAX
        || !name.chars().all(allowed)
        || name.starts_with('-')
    {
        let message = format!("`{name}` cannot be the name of a net");
        let fault = Diagnostic::error(fault::BAD_NAME, node.span, message);
        faults.push(fault.help(format!(
            "use small letters, digits and `-`, at most {NAME_MAX}, beginning with a letter or digit"
        )));
    }
    Key {
        name: name.to_string(),
        span: node.span,
    }
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

fn read_primitive(entry: &Entry, faults: &mut Vec<Diagnostic>) -> Primitive {
    let (id, node) = (&entry.key, &entry.value);
    if !is_id(&id.name) {
        let message = format!("`{}` cannot be the id of a primitive", id.name);
        let fault = Diagnostic::error(fault::BAD_NAME, id.span, message);
        faults.push(fault.help(format!(
            "use small letters, digits and `_`, at most {NAME_MAX}, beginning with a letter"
        )));
    }
    let mut primitive = Primitive {
        id: id.clone(),
        type_name: Key {
            name: String::new(),
            span: id.span,
        },
        parameters: Vec::new(),
        inputs: Vec::new(),
    };
    if node.map().is_none() {
        let wanted = "a mapping such as `{type: Time}`";
        faults.push(shape(node, &format!("primitive `{}`", id.name), wanted));
        return primitive;
    }
    report_unknown_keys(node, PRIMITIVE_KEYS, "a primitive", faults);
    match node.get("type").map(|node| (node, node.text())) {
        Some((node, Some(text))) => {
            primitive.type_name = Key {
                name: text.to_string(),
                span: node.span,
            };
        }
        Some((node, None)) => faults.push(shape(node, "`type`", "the name of a primitive type")),
        None => {
            let message = format!("primitive `{}` has no type", id.name);
            let fault = Diagnostic::error(fault::MISSING_KEY, id.span, message);
            faults.push(fault.help("add `type: …`"));
        }
    }
    for entry in entries_of(node, "parameters", faults) {
        let value = literal::read(&entry.value, faults);
        primitive.parameters.push((entry.key.clone(), value));
    }
    for entry in entries_of(node, "inputs", faults) {
        let source = read_source(&entry.value, faults);
        primitive.inputs.push((entry.key.clone(), source));
    }
    primitive
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

fn read_source(node: &Node, faults: &mut Vec<Diagnostic>) -> Source {
    if let Some(text) = node.text()
        && !rcc_config::quantity::looks_like(text)
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
