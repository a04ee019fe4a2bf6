//! The keys of a net. Runs on the loader's threads.

use rcc_config::FileKind;
use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::{Key, Node, ShortText, Value};

use super::primitive::{read_discard, read_primitive};
use super::shape::{expect_kind, read_description, report_unknown_keys, shape};
use super::{fragment, literal};
use crate::codes;
use crate::syntax::{Net, Primitive, Timing, bad_net_name};

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

/// Reads a net from the tree of its text.
pub fn read_net(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<Net> {
    expect_kind(root, FileKind::Net, diagnostics)?;
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

fn read_timing(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Timing {
    let mut read = |key| root.get(key).map(|node| literal::read(node, diagnostics));
    Timing {
        period: read("period"),
        rate: read("rate"),
        phase: read("phase"),
    }
}

fn read_name(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Key {
    let unnamed = Key {
        name: ShortText::default(),
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
        name: name.into(),
        span: node.span,
    };
    diagnostics.extend(bad_net_name(&name));
    name
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
