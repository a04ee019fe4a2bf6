//! Writes a net as YAML or JSON. The text reads back as the same model, to the bit. Used by the command line and by
//! programs that generate nets; never on the real-time thread.

use rcc_config::diagnostic::Span;
use rcc_config::yaml::layout::{Tree, TreeBlock, TreeEntry, render};
use rcc_config::yaml::{Key, scalar};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use crate::syntax::fragment::{Fragment, FragmentOutput, Library};
use crate::syntax::literal::{Literal, LiteralShape, Notation};
use crate::syntax::reference::Reference;
use crate::syntax::{Link, Net, Primitive, PrimitiveKind, Source};

/// Returns a net as YAML, in the layout of `rcc-cli fmt`.
///
/// Refused parts and numbers that are not finite are written as null, so a net that was read with errors does not
/// round-trip.
#[must_use]
pub fn yaml(net: &Net) -> String {
    render(&tree(net))
}

/// Returns a net as JSON on one line.
#[must_use]
pub fn json(net: &Net) -> String {
    tree(net).to_json()
}

/// Returns a constant as YAML on one line.
#[must_use]
pub fn constant(literal: &Literal) -> String {
    literal_tree(literal)
        .on_one_line(usize::MAX)
        .unwrap_or_default()
}

/// Returns a library as YAML.
#[must_use]
pub fn library(library: &Library) -> String {
    let mut block = open_block();
    block.push("library", text(&library.name.name));
    block.described(&library.description);
    block.uses(&library.uses);
    block.push("fragments", fragments(&library.fragments));
    render(&Tree::Map(block))
}

/// Returns a net as a tree: keys in the order of the manual, everything else in the order of the model.
#[must_use]
pub fn tree(net: &Net) -> Tree {
    let mut block = open_block();
    block.push("net", text(&net.name.name));
    block.described(&net.description);
    if net.survives_device_loss {
        block.push("on_device_loss", plain("null"));
    }
    let timing = [
        ("period", &net.timing.period),
        ("rate", &net.timing.rate),
        ("phase", &net.timing.phase),
    ];
    for (key, literal) in timing {
        if let Some(literal) = literal {
            block.push(key, literal_tree(literal));
        }
    }
    block.uses(&net.uses);
    if !net.fragments.is_empty() {
        block.push("fragments", fragments(&net.fragments));
    }
    block.push("primitives", primitives(&net.primitives));
    block.discarded(&net.discard);
    Tree::Map(block)
}

/// Returns an empty mapping that is laid out with one entry per line.
fn open_block() -> TreeBlock {
    TreeBlock {
        open: true,
        ..TreeBlock::default()
    }
}

/// Entries that nets, libraries and fragments have in common.
trait Entries {
    fn push(&mut self, key: &str, value: Tree);

    fn ports<'a>(&mut self, key: &str, ports: impl Iterator<Item = (&'a Key, Tree)>) {
        let ports: Vec<_> = ports
            .map(|(name, tree)| (name.name.to_string(), tree))
            .collect();
        if !ports.is_empty() {
            self.push(key, Tree::map(ports));
        }
    }

    fn described(&mut self, description: &str) {
        if !description.is_empty() {
            self.push("description", text(description));
        }
    }

    fn uses(&mut self, uses: &[Key]) {
        if !uses.is_empty() {
            self.push("use", Tree::list(uses.iter().map(|path| text(&path.name))));
        }
    }

    fn discarded(&mut self, outputs: &[Reference]) {
        if !outputs.is_empty() {
            self.push(
                "discard",
                Tree::list(outputs.iter().map(|output| text(&output.to_string()))),
            );
        }
    }
}

impl Entries for TreeBlock {
    fn push(&mut self, key: &str, value: Tree) {
        self.entries.push(TreeEntry::new(key, value));
    }
}

fn fragments(fragments: &[Fragment]) -> Tree {
    let mut block = open_block();
    for one in fragments {
        block.push(&one.name.name, fragment(one));
    }
    Tree::Map(block)
}

fn fragment(fragment: &Fragment) -> Tree {
    let mut block = open_block();
    block.described(&fragment.description);
    let parameters = fragment.parameters.iter();
    let parameters = parameters.map(|one| {
        (
            &one.name,
            port(&one.description, one.ty, one.unit, one.default.as_ref()),
        )
    });
    let inputs = fragment.inputs.iter();
    let inputs = inputs.map(|one| {
        (
            &one.name,
            port(&one.description, one.ty, one.unit, one.default.as_ref()),
        )
    });
    let outputs = fragment
        .outputs
        .iter()
        .map(|output| (&output.name, fragment_output(output)));
    block.ports("parameters", parameters);
    block.ports("inputs", inputs);
    block.ports("outputs", outputs);
    block.push("primitives", primitives(&fragment.primitives));
    block.discarded(&fragment.discard);
    Tree::Map(block)
}

fn fragment_output(output: &FragmentOutput) -> Tree {
    let from = text(&output.from.to_string());
    if output.description.is_empty() {
        return from;
    }
    Tree::map([
        ("from".to_string(), from),
        ("description".to_string(), text(&output.description)),
    ])
}

/// Returns the mapping of a parameter or an input of a fragment.
fn port(
    description: &str,
    ty: Option<(Type, Span)>,
    unit: Option<(Unit, Span)>,
    default: Option<&Literal>,
) -> Tree {
    let mut block = TreeBlock::default();
    if let Some((ty, _)) = ty {
        block.push("type", text(&ty.to_string()));
    }
    match unit {
        Some((Unit::ONE, _)) => block.push("unit", plain("1")),
        Some((unit, _)) => block.push("unit", text(&unit.to_string())),
        None => {}
    }
    if let Some(default) = default {
        block.push("default", literal_tree(default));
    }
    block.described(description);
    Tree::Map(block)
}

fn text(text: &str) -> Tree {
    Tree::Text(text.to_string())
}

fn plain(text: &str) -> Tree {
    Tree::Plain(text.to_string())
}

fn primitives(primitives: &[Primitive]) -> Tree {
    let entries = primitives
        .iter()
        .map(|one| TreeEntry::new(one.id.name.as_str(), primitive(one)));
    Tree::Map(TreeBlock {
        open: true,
        aligned: true,
        ..TreeBlock::new(entries.collect())
    })
}

fn primitive(primitive: &Primitive) -> Tree {
    let kind = match primitive.kind {
        PrimitiveKind::Type | PrimitiveKind::Product => "type",
        PrimitiveKind::Fragment => "fragment",
    };
    let mut entries = vec![(kind.to_string(), text(&primitive.type_name.name))];
    if !primitive.parameters.is_empty() {
        let given = primitive.parameters.iter();
        let parameters = given.map(|(key, literal)| (key.name.to_string(), literal_tree(literal)));
        entries.push(("parameters".to_string(), Tree::map(parameters)));
    }
    if !primitive.inputs.is_empty() {
        let given = primitive.inputs.iter();
        let inputs = given.map(|(key, source)| (key.name.to_string(), source_tree(source)));
        entries.push(("inputs".to_string(), Tree::map(inputs)));
    }
    if let Some(active) = &primitive.active {
        entries.push(("active".to_string(), source_tree(active)));
    }
    Tree::map(entries)
}

fn source_tree(source: &Source) -> Tree {
    match source {
        Source::Link(link) => link_tree(link),
        Source::Literal(literal) => literal_tree(literal),
        Source::List(list) => Tree::list(list.elements.iter().map(source_tree)),
        Source::Outcomes(outcomes) => {
            let rows = outcomes.rows.iter();
            Tree::map(rows.map(|(name, source)| (name.name.to_string(), source_tree(source))))
        }
        Source::Formula(formula) => text(&formula.text),
        Source::Refused => plain("null"),
    }
}

fn link_tree(link: &Link) -> Tree {
    let from = text(&link.from.to_string());
    if !link.delayed && link.initial.is_none() {
        return from;
    }
    let mut entries = vec![("from".to_string(), from)];
    if link.delayed {
        entries.push(("delayed".to_string(), plain("true")));
    }
    if let Some(initial) = &link.initial {
        entries.push(("initial".to_string(), literal_tree(initial)));
    }
    Tree::map(entries)
}

/// Returns a number with its unit, as it is written if nothing else is known of its notation.
pub(crate) fn quantity(value: f64, unit: Unit) -> String {
    format!("{} {unit}", scalar::real(value))
}

/// Returns a constant as a tree.
#[must_use]
pub fn literal_tree(literal: &Literal) -> Tree {
    match &literal.notation {
        Notation::Text(notation) => return text(notation),
        Notation::Mapping(parts) => {
            let parts = parts.iter();
            return Tree::map(parts.map(|(key, part)| (key.clone(), literal_tree(part))));
        }
        Notation::Rows(node) => return Tree::of(node),
        Notation::Canonical => {}
    }
    match &literal.shape {
        LiteralShape::Null | LiteralShape::Refused => plain("null"),
        LiteralShape::Bool(value) => plain(&value.to_string()),
        LiteralShape::Int(value) => plain(&value.to_string()),
        LiteralShape::Real(value, _) if !value.is_finite() => plain("null"),
        LiteralShape::Real(value, None) => Tree::Plain(scalar::real(*value)),
        LiteralShape::Real(value, Some(unit)) => Tree::Text(quantity(*value, *unit)),
        LiteralShape::Text(value) => text(value),
        LiteralShape::Rotation(quaternion) => Tree::map([("quat".to_string(), reals(quaternion))]),
        LiteralShape::Pose([x, y, z, quaternion @ ..]) => Tree::map([
            ("xyz".to_string(), reals(&[*x, *y, *z])),
            ("quat".to_string(), reals(quaternion)),
        ]),
        LiteralShape::Parameterised(node) => Tree::of(node),
        LiteralShape::List(elements) => Tree::list(elements.iter().map(literal_tree)),
    }
}

fn reals(values: &[f64]) -> Tree {
    Tree::list(values.iter().map(|value| Tree::Plain(scalar::real(*value))))
}
