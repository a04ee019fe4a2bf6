//! A net as text: the model back to YAML or JSON, so that what is written reads back as the same model, to the bit.
//! Used by the command line and by programs that make nets, never on the real-time thread.

use rcc_config::diagnostic::Span;
use rcc_config::yaml::layout::{Block, Entry, Tree, render};
use rcc_config::yaml::{Key, scalar};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use crate::syntax::fragment::{Fragment, FragmentOutput, Library};
use crate::syntax::literal::{Literal, Shape, Written};
use crate::syntax::reference::Reference;
use crate::syntax::{Kind, Link, Net, Primitive, Source};

/// The net as YAML, in the layout that `rcc-cli fmt` gives.
///
/// Something refused and numbers that are not finite are written as null, so a net that was read with faults does not
/// come back.
#[must_use]
pub fn yaml(net: &Net) -> String {
    render(&tree(net))
}

/// The net as JSON, on one line.
#[must_use]
pub fn json(net: &Net) -> String {
    tree(net).to_json()
}

/// A constant as YAML on one line.
#[must_use]
pub fn constant(literal: &Literal) -> String {
    literal_tree(literal)
        .on_one_line(usize::MAX)
        .unwrap_or_default()
}

/// A library as YAML.
#[must_use]
pub fn library(library: &Library) -> String {
    let mut block = open_block();
    block.push("library", text(&library.name.name));
    block.described(&library.description);
    block.uses(&library.uses);
    block.push("fragments", fragments(&library.fragments));
    render(&Tree::Map(block))
}

/// The net as a tree: keys in the order of the manual, everything else in the order of the model.
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

/// A mapping with an entry a line.
fn open_block() -> Block {
    Block {
        open: true,
        ..Block::default()
    }
}

/// What nets, libraries and fragments have in common.
trait Entries {
    fn push(&mut self, key: &str, value: Tree);

    fn ports<'a>(&mut self, key: &str, ports: impl Iterator<Item = (&'a Key, Tree)>) {
        let ports: Vec<_> = ports
            .map(|(name, tree)| (name.name.clone(), tree))
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

impl Entries for Block {
    fn push(&mut self, key: &str, value: Tree) {
        self.entries.push(Entry::new(key, value));
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

/// What a fragment says about a parameter or an input.
fn port(
    description: &str,
    ty: Option<(Type, Span)>,
    unit: Option<(Unit, Span)>,
    default: Option<&Literal>,
) -> Tree {
    let mut block = Block::default();
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
        .map(|one| Entry::new(one.id.name.as_str(), primitive(one)));
    Tree::Map(Block {
        open: true,
        aligned: true,
        ..Block::new(entries.collect())
    })
}

fn primitive(primitive: &Primitive) -> Tree {
    let kind = match primitive.kind {
        Kind::Type => "type",
        Kind::Fragment => "fragment",
    };
    let mut entries = vec![(kind.to_string(), text(&primitive.type_name.name))];
    if !primitive.parameters.is_empty() {
        let given = primitive.parameters.iter();
        let parameters = given.map(|(key, literal)| (key.name.clone(), literal_tree(literal)));
        entries.push(("parameters".to_string(), Tree::map(parameters)));
    }
    if !primitive.inputs.is_empty() {
        let given = primitive.inputs.iter();
        let inputs = given.map(|(key, source)| (key.name.clone(), source_tree(source)));
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

/// A constant as a tree.
#[must_use]
pub fn literal_tree(literal: &Literal) -> Tree {
    match &literal.written {
        Written::Text(written) => return text(written),
        Written::Parts(parts) => {
            let parts = parts.iter();
            return Tree::map(parts.map(|(key, part)| (key.clone(), literal_tree(part))));
        }
        Written::Rows(node) => return Tree::of(node),
        Written::Usual => {}
    }
    match &literal.shape {
        Shape::Null | Shape::Refused => plain("null"),
        Shape::Bool(value) => plain(&value.to_string()),
        Shape::Int(value) => plain(&value.to_string()),
        Shape::Real(value, _) if !value.is_finite() => plain("null"),
        Shape::Real(value, None) => Tree::Plain(scalar::real(*value)),
        Shape::Real(value, Some(unit)) => Tree::Text(format!("{} {unit}", scalar::real(*value))),
        Shape::Text(value) => text(value),
        Shape::Rotation(quaternion) => Tree::map([("quat".to_string(), reals(quaternion))]),
        Shape::Pose([x, y, z, quaternion @ ..]) => Tree::map([
            ("xyz".to_string(), reals(&[*x, *y, *z])),
            ("quat".to_string(), reals(quaternion)),
        ]),
        Shape::Open(node) => Tree::of(node),
        Shape::List(elements) => Tree::list(elements.iter().map(literal_tree)),
    }
}

fn reals(values: &[f64]) -> Tree {
    Tree::list(values.iter().map(|value| Tree::Plain(scalar::real(*value))))
}
