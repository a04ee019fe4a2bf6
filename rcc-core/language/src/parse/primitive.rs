//! Primitives, instances of fragments, and discarded outputs. Runs on the loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_config::yaml::{Entry, Key, Node, ShortText};

use super::shape::{mapping, report_bad_id, report_unknown_keys, shape};
use super::source::read_source;
use super::{literal, reference};
use crate::codes;
use crate::formula;
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::reference::Reference;
use crate::syntax::{Primitive, PrimitiveKind};

const PRIMITIVE_KEYS: &[&str] = &["type", "fragment", "parameters", "inputs", "active"];

/// The values of an entry of `primitives`, by key.
#[derive(Default)]
struct PrimitiveFields<'n> {
    type_name: Option<&'n Node>,
    fragment: Option<&'n Node>,
    parameters: Option<&'n Node>,
    inputs: Option<&'n Node>,
    active: Option<&'n Node>,
}

impl<'n> PrimitiveFields<'n> {
    /// Returns the fields of a mapping; other keys are reported.
    fn of(node: &'n Node, entries: &'n [Entry], diagnostics: &mut Vec<Diagnostic>) -> Self {
        let mut fields = PrimitiveFields::default();
        let mut has_unknown = false;
        for Entry { key, value } in entries {
            match key.name.as_str() {
                "type" => fields.type_name = Some(value),
                "fragment" => fields.fragment = Some(value),
                "parameters" => fields.parameters = Some(value),
                "inputs" => fields.inputs = Some(value),
                "active" => fields.active = Some(value),
                _ => has_unknown = true,
            }
        }
        if has_unknown {
            report_unknown_keys(node, PRIMITIVE_KEYS, "a primitive", diagnostics);
        }
        fields
    }
}

pub fn read_primitive(entry: &Entry, diagnostics: &mut Vec<Diagnostic>) -> Primitive {
    let (id, node) = (&entry.key, &entry.value);
    report_bad_id(id, "the id of a primitive", diagnostics);
    let mut primitive = Primitive {
        id: id.clone(),
        kind: PrimitiveKind::Type,
        type_name: Key {
            name: ShortText::default(),
            span: id.span,
        },
        parameters: Vec::new(),
        inputs: Vec::new(),
        active: None,
    };
    let Some(entries) = node.map() else {
        let wanted = "a mapping such as `{type: Time}`";
        diagnostics.push(shape(node, &format!("primitive `{}`", id.name), wanted));
        return primitive;
    };
    let fields = PrimitiveFields::of(node, entries, diagnostics);
    read_kind(&mut primitive, &fields, diagnostics);
    let given = mapping(fields.parameters, "parameters", diagnostics);
    primitive.parameters.reserve_exact(given.len());
    for entry in given {
        let value = match formula::is_expression(&primitive, &entry.key) {
            true => read_expression(&entry.value, diagnostics),
            false => literal::read(&entry.value, diagnostics),
        };
        primitive.parameters.push((entry.key.clone(), value));
    }
    let given = mapping(fields.inputs, "inputs", diagnostics);
    primitive.inputs.reserve_exact(given.len());
    for entry in given {
        let source = read_source(&entry.value, diagnostics);
        primitive.inputs.push((entry.key.clone(), source));
    }
    primitive.active = fields.active.map(|node| read_source(node, diagnostics));
    primitive
}

/// Reads the expression of a `Formula`, which may begin like a number.
fn read_expression(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Literal {
    let shape = match node.text() {
        Some(text) => LiteralShape::Text(text.to_owned()),
        None => {
            let wanted = "an expression in quotes such as `\"2 * x\"`";
            diagnostics.push(shape(node, "`expr`", wanted));
            LiteralShape::Refused
        }
    };
    Literal::new(shape, node.span)
}

/// Reads `type: Add` or `fragment: smooth`.
fn read_kind(
    primitive: &mut Primitive,
    fields: &PrimitiveFields<'_>,
    diagnostics: &mut Vec<Diagnostic>,
) {
    let (kind, what, given) = match (fields.type_name, fields.fragment) {
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
        name: name.into(),
        span: given.span,
    };
}

pub fn read_discard(root: &Node, diagnostics: &mut Vec<Diagnostic>) -> Vec<Reference> {
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
