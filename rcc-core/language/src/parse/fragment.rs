//! Fragments and libraries. Runs on the loader's threads.

use rcc_config::FileKind;
use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::{Entry, Key, Node, Value};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use super::primitive::{read_discard, read_primitive};
use super::shape::{
    entries_of, expect_kind, read_description, report_bad_id, report_unknown_keys, shape,
};
use super::{literal, reference};
use crate::codes;
use crate::syntax::declaration::{TYPES, UNITS, parse_type, si_unit};
use crate::syntax::fragment::{
    Fragment, FragmentInput, FragmentOutput, FragmentParameter, Library,
};
use crate::syntax::literal::Literal;

const LIBRARY_KEYS: &[&str] = &["library", "description", "use", "fragments"];
const FRAGMENT_KEYS: &[&str] = &[
    "description",
    "parameters",
    "inputs",
    "outputs",
    "primitives",
    "discard",
];
const PORT_KEYS: &[&str] = &["type", "unit", "default", "description"];
const OUTPUT_KEYS: &[&str] = &["from", "description"];

/// Reads a library from the tree of its text.
pub fn read_library(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<Library> {
    expect_kind(root, FileKind::Library, diagnostics)?;
    if root.map().is_none() {
        let message = format!(
            "expected a library, a mapping with the keys `library` and `fragments`, found {}",
            root.kind()
        );
        diagnostics.push(Diagnostic::error(codes::WRONG_SHAPE, root.span, message));
        return None;
    }
    report_unknown_keys(root, LIBRARY_KEYS, "a library", diagnostics);
    let name = match root.get("library").map(|node| (node, node.text())) {
        Some((node, Some(name))) => Key {
            name: name.into(),
            span: node.span,
        },
        Some((node, None)) => {
            diagnostics.push(shape(node, "the name of a library", "text"));
            return None;
        }
        None => {
            let message = "the library has no name";
            let diagnostic = Diagnostic::error(codes::MISSING_KEY, root.span, message);
            diagnostics.push(diagnostic.help("begin with `library: NAME`"));
            return None;
        }
    };
    Some(Library {
        name,
        description: read_description(root, diagnostics),
        uses: read_uses(root, diagnostics),
        fragments: read_all(root, diagnostics),
    })
}

/// Reads the paths of the libraries that a file uses.
pub fn read_uses(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Vec<Key> {
    let Some(node) = root.get("use") else {
        return Vec::new();
    };
    let wanted = "a list of library files such as `[library/filters.yaml]`";
    let Some(nodes) = node.list() else {
        diagnostics.push(shape(node, "`use`", wanted));
        return Vec::new();
    };
    let mut uses = Vec::new();
    for node in nodes {
        match node.text() {
            Some(path) => uses.push(Key {
                name: path.into(),
                span: node.span,
            }),
            None => diagnostics.push(shape(node, "an element of `use`", "the path of a library")),
        }
    }
    uses
}

/// Reads the fragments of a file.
pub fn read_all(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Vec<Fragment> {
    let entries = entries_of(root, "fragments", diagnostics).iter();
    entries
        .filter_map(|entry| read_fragment(entry, diagnostics))
        .collect()
}

fn read_fragment(entry: &Entry, diagnostics: &mut Vec<Diagnostic>) -> Option<Fragment> {
    let (name, node) = (&entry.key, &entry.value);
    report_bad_id(name, "the name of a fragment", diagnostics);
    if node.map().is_none() {
        let what = format!("fragment `{}`", name.name);
        let wanted = "a mapping with `primitives` and its ports";
        diagnostics.push(shape(node, &what, wanted));
        return None;
    }
    report_unknown_keys(node, FRAGMENT_KEYS, "a fragment", diagnostics);
    if node.get("primitives").is_none() {
        let message = format!("the fragment `{}` has no primitives", name.name);
        let diagnostic = Diagnostic::error(codes::MISSING_KEY, name.span, message);
        diagnostics.push(diagnostic.help("add `primitives:`"));
    }
    let primitives = entries_of(node, "primitives", diagnostics).iter();
    let primitives = primitives
        .map(|entry| read_primitive(entry, diagnostics))
        .collect();
    Some(Fragment {
        name: name.clone(),
        description: read_description(node, diagnostics),
        parameters: read_parameters(node, diagnostics),
        inputs: read_inputs(node, diagnostics),
        outputs: read_outputs(node, diagnostics),
        primitives,
        discard: read_discard(node, diagnostics),
        span: Span::new(name.span.start, node.span.end.max(name.span.end)),
    })
}

/// Members that parameters and inputs of a fragment have in common.
struct Port {
    name: Key,
    description: String,
    ty: Option<(Type, Span)>,
    unit: Option<(Unit, Span)>,
    default: Option<Literal>,
}

fn read_parameters(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Vec<FragmentParameter> {
    let ports =
        read_ports(node, "parameters", "a parameter of a fragment", diagnostics).into_iter();
    ports
        .map(|port| FragmentParameter {
            name: port.name,
            description: port.description,
            ty: port.ty,
            unit: port.unit,
            default: port.default,
        })
        .collect()
}

fn read_inputs(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Vec<FragmentInput> {
    let ports = read_ports(node, "inputs", "an input of a fragment", diagnostics).into_iter();
    ports
        .map(|port| FragmentInput {
            name: port.name,
            description: port.description,
            ty: port.ty,
            unit: port.unit,
            default: port.default,
        })
        .collect()
}

fn read_ports(node: &Node, key: &str, what: &str, diagnostics: &mut Vec<Diagnostic>) -> Vec<Port> {
    let mut ports = Vec::new();
    for Entry { key: name, value } in entries_of(node, key, diagnostics) {
        report_bad_id(name, what, diagnostics);
        if value.map().is_none() && value.value != Value::Null {
            let what = format!("`{}`", name.name);
            let wanted = "a mapping such as `{type: Real, unit: m, default: 0}`, or nothing";
            diagnostics.push(shape(value, &what, wanted));
            continue;
        }
        report_unknown_keys(value, PORT_KEYS, what, diagnostics);
        ports.push(Port {
            name: name.clone(),
            description: read_description(value, diagnostics),
            ty: value
                .get("type")
                .and_then(|node| read_type(node, diagnostics)),
            unit: value
                .get("unit")
                .and_then(|node| read_unit(node, diagnostics)),
            default: value
                .get("default")
                .map(|node| literal::read(node, diagnostics))
                .filter(|literal| !literal.is_refused()),
        });
    }
    ports
}

fn read_outputs(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Vec<FragmentOutput> {
    let mut outputs = Vec::new();
    for Entry { key: name, value } in entries_of(node, "outputs", diagnostics) {
        report_bad_id(name, "an output of a fragment", diagnostics);
        let is_map = value.map().is_some();
        if is_map {
            report_unknown_keys(value, OUTPUT_KEYS, "an output of a fragment", diagnostics);
        }
        let from = if is_map {
            value.get("from")
        } else {
            Some(value)
        };
        let Some((from, text)) = from.and_then(|node| Some((node, node.text()?))) else {
            let what = format!("the output `{}`", name.name);
            let wanted = "an output within the fragment such as `filter.out`";
            diagnostics.push(shape(value, &what, wanted));
            continue;
        };
        if let Some(from) = reference::read(from, text, diagnostics) {
            outputs.push(FragmentOutput {
                name: name.clone(),
                description: read_description(value, diagnostics),
                from,
            });
        }
    }
    outputs
}

fn read_type(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<(Type, Span)> {
    let ty = node.text().and_then(parse_type);
    if ty.is_none() {
        let what = match node.text() {
            Some(text) => format!("unknown type `{text}`"),
            None => format!("a type must be a name, not {}", node.kind()),
        };
        let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, node.span, what);
        diagnostics.push(diagnostic.help(format!("{TYPES}, and Text")));
    }
    Some((ty?, node.span))
}

fn read_unit(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<(Unit, Span)> {
    let text = match &node.value {
        Value::Text(text) => Some(text.as_str()),
        Value::Int(1) => Some("1"),
        _ => None,
    };
    let unit = text.and_then(Unit::parse);
    if text.and_then(si_unit).is_none() {
        let (message, help) = match (text, unit) {
            (Some(text), Some((unit, _))) => (
                format!("values are in SI units, and `{text}` is not one"),
                format!("write `unit: {unit}`; constants may be in any unit: `20 mm`"),
            ),
            (Some(text), None) => (format!("unknown unit `{text}`"), UNITS.to_string()),
            (None, _) => (
                format!("a unit must be a name, not {}", node.kind()),
                UNITS.to_string(),
            ),
        };
        let diagnostic = Diagnostic::error(codes::BAD_QUANTITY, node.span, message);
        diagnostics.push(diagnostic.help(help));
        return None;
    }
    Some((unit?.0, node.span))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::syntax::literal::LiteralShape;

    #[test]
    fn a_fragment_is_read_as_it_is_written() {
        let text = "\
fragments:
  smooth:
    description: low pass
    parameters: {gain: {type: Real, default: 0.2}, device: {type: Text}}
    inputs: {x: {type: Real, unit: m}, y: null}
    outputs: {out: filter.out, first: {from: \"filter.all[0]\", description: of all}}
    primitives: {filter: {type: LowPass, parameters: {gain: $gain}, inputs: {in: x}, active: on}}
    discard: [filter.other]
";
        let root = rcc_config::yaml::parse(text).unwrap();
        let mut diagnostics = Vec::new();
        let fragments = read_all(&root, &mut diagnostics);
        assert_eq!(diagnostics, []);
        let [fragment] = fragments.as_slice() else {
            panic!("one fragment")
        };
        assert_eq!(fragment.span, Span::new(13, text.len() - 1));
        let [gain, device] = fragment.parameters.as_slice() else {
            panic!("two parameters")
        };
        assert_eq!(gain.ty.map(|(ty, _)| ty), Some(Type::Real));
        assert!(device.default.is_none());
        let inputs: Vec<_> = fragment
            .inputs
            .iter()
            .map(|input| input.unit.map(|(unit, _)| unit))
            .collect();
        assert_eq!(inputs, [Some(Unit::METRE), None]);
        let outputs: Vec<_> = fragment
            .outputs
            .iter()
            .map(|output| output.from.to_string())
            .collect();
        assert_eq!(outputs, ["filter.out", "filter.all[0]"]);
        let filter = &fragment.primitives[0];
        assert!(matches!(
            &filter.parameters[0].1.shape,
            LiteralShape::Parameterised(_)
        ));
        assert!(filter.active.is_some());
        assert_eq!(fragment.discard.len(), 1);
    }
}
