//! Constants, read independently of the port, which later determines the type. Runs on the loader's threads.

pub(crate) mod legs;
mod pose;

use rcc_config::diagnostic::Diagnostic;
use rcc_config::quantity::{self, Quantity};
use rcc_config::yaml::{Node, Value};
use rcc_core::types::ELEMENTS_MAX;

use super::shape::shape;
use crate::codes;
use crate::syntax::literal::{Literal, LiteralShape, Notation, is_parameter};
use crate::write;
use pose::read_pose;

pub use pose::POSE_KEYS;

/// Reads a constant; text that is not a quantity is a name.
pub fn read(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Literal {
    let shape = match &node.value {
        _ if has_parameters(node) => LiteralShape::Parameterised(Box::new(node.clone())),
        Value::Null => LiteralShape::Null,
        Value::Bool(value) => LiteralShape::Bool(*value),
        Value::Int(value) => LiteralShape::Int(*value),
        Value::Real(value) => LiteralShape::Real(*value, None),
        Value::Text(text) if !quantity::looks_like(text) => LiteralShape::Text(text.to_string()),
        Value::Text(_) => read_quantity(node, diagnostics)
            .map_or(LiteralShape::Refused, |quantity| {
                LiteralShape::Real(quantity.value, quantity.unit)
            }),
        Value::List(nodes) => read_list(node, nodes, diagnostics),
        Value::Map(_) => read_pose(node, diagnostics).unwrap_or(LiteralShape::Refused),
    };
    let canonical = Literal::new(shape, node.span);
    let notation = match &node.value {
        // Legs that are refused keep their notation: outputs that their conditions read count as read.
        Value::List(nodes) if canonical.is_refused() && legs::are_legs(nodes) => {
            return Literal {
                notation: Notation::Rows(Box::new(node.clone())),
                ..canonical
            };
        }
        _ if canonical.is_refused()
            || matches!(canonical.shape, LiteralShape::Parameterised(_)) =>
        {
            return canonical;
        }
        Value::Text(text) if !matches!(canonical.shape, LiteralShape::Text(_)) => {
            let text = text.trim();
            return match canonical.shape {
                LiteralShape::Real(value, Some(unit)) if text == write::quantity(value, unit) => {
                    canonical
                }
                _ => Literal {
                    notation: Notation::Text(text.to_string()),
                    ..canonical
                },
            };
        }
        Value::List(nodes) if nodes.iter().any(|node| node.map().is_some()) => {
            Notation::Rows(Box::new(node.clone()))
        }
        Value::Map(entries) => {
            // The entries have been read without an error.
            let part = |node| read(node, &mut Vec::new());
            let parts = entries.iter();
            let parts = parts.map(|entry| (entry.key.name.to_string(), part(&entry.value)));
            Notation::Mapping(parts.collect())
        }
        _ => return canonical,
    };
    let tree = write::literal_tree(&canonical);
    let literal = Literal {
        notation,
        ..canonical
    };
    if write::literal_tree(&literal) == tree {
        return Literal {
            notation: Notation::Canonical,
            ..literal
        };
    }
    literal
}

fn read_quantity(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<Quantity> {
    quantity::of(node)
        .map_err(|error| {
            diagnostics.push(Diagnostic::error(
                codes::BAD_QUANTITY,
                node.span,
                error.to_string(),
            ));
        })
        .ok()
}

/// Returns true if the node is or contains parameters of a fragment.
fn has_parameters(node: &Node) -> bool {
    match &node.value {
        Value::Text(text) => is_parameter(text),
        Value::List(nodes) => nodes.iter().any(has_parameters),
        Value::Map(entries) => entries.iter().any(|entry| has_parameters(&entry.value)),
        _ => false,
    }
}

fn read_list(node: &Node, nodes: &[Node], diagnostics: &mut Vec<Diagnostic>) -> LiteralShape {
    if nodes.is_empty() || nodes.len() > usize::from(ELEMENTS_MAX) {
        let message = format!(
            "a list has 1 to {ELEMENTS_MAX} elements, this one has {}",
            nodes.len()
        );
        diagnostics.push(Diagnostic::error(codes::WRONG_SHAPE, node.span, message));
        return LiteralShape::Refused;
    }
    if legs::are_legs(nodes) {
        return legs::read(nodes, diagnostics).map_or(LiteralShape::Refused, LiteralShape::List);
    }
    let elements: Vec<Literal> = nodes.iter().map(|node| read(node, diagnostics)).collect();
    if elements.iter().any(Literal::is_refused) {
        return LiteralShape::Refused;
    }
    if let Some(rows) = pose_rows(&elements) {
        return LiteralShape::List(rows);
    }
    let kind = |element: &Literal| match &element.shape {
        LiteralShape::Bool(_) => ElementKind::Bools,
        LiteralShape::Null => ElementKind::Null,
        LiteralShape::List(row)
            if row
                .iter()
                .all(|x| x.number().is_some() || x.shape == LiteralShape::Null) =>
        {
            ElementKind::Rows(row.len())
        }
        _ if element.number().is_some() => ElementKind::Numbers,
        _ => ElementKind::Nothing,
    };
    let mut kinds = elements.iter().map(kind);
    let first = kinds.find(|kind| *kind != ElementKind::Null);
    let first = first.unwrap_or(ElementKind::Nothing);
    let mismatch = elements.iter().zip(nodes).find(|(element, _)| {
        let kind = kind(element);
        let null =
            kind == ElementKind::Null && matches!(first, ElementKind::Numbers | ElementKind::Bools);
        !null && (kind == ElementKind::Nothing || kind != first)
    });
    if let Some((_, node)) = mismatch {
        let wanted = match first {
            ElementKind::Bools => "a truth value as the first one".to_string(),
            ElementKind::Rows(length) => format!("a row of {length} numbers as the first one"),
            _ => "a number".to_string(),
        };
        diagnostics.push(shape(node, "an element of a list", &wanted));
        return LiteralShape::Refused;
    }
    LiteralShape::List(elements)
}

/// Returns poses as rows of seven numbers; `None` if an element is not a pose.
fn pose_rows(elements: &[Literal]) -> Option<Vec<Literal>> {
    let row = |element: &Literal| match &element.shape {
        LiteralShape::Pose(numbers) => {
            let number =
                |number: &f64| Literal::new(LiteralShape::Real(*number, None), element.span);
            let row = LiteralShape::List(numbers.iter().map(number).collect());
            Some(Literal::new(row, element.span))
        }
        _ => None,
    };
    elements.iter().map(row).collect()
}

/// The kind of the elements of a list.
#[derive(Clone, Copy, PartialEq)]
enum ElementKind {
    Bools,
    Numbers,
    /// Lists of this many numbers.
    Rows(usize),
    /// Null, which mixes with truth values and numbers.
    Null,
    Nothing,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::syntax::stored_value::StoredValue;
    use rcc_core::types::{Store, Type};

    fn literal(text: &str) -> Result<Literal, Vec<&'static str>> {
        let root = rcc_config::yaml::parse(&format!("x: {text}\n")).unwrap();
        let mut diagnostics = Vec::new();
        let literal = read(root.get("x").unwrap(), &mut diagnostics);
        if diagnostics.is_empty() {
            Ok(literal)
        } else {
            assert!(literal.is_refused(), "{text}");
            Err(diagnostics
                .iter()
                .map(|diagnostic| diagnostic.code)
                .collect())
        }
    }

    fn reals(text: &str, ty: Type) -> Option<Vec<f64>> {
        let stored = literal(text).unwrap().stored(ty)?;
        assert_eq!(stored.store(), Store::Real);
        Some(stored.words().iter().copied().map(f64::from_bits).collect())
    }

    #[test]
    fn a_whole_number_takes_the_type_of_the_port() {
        assert_eq!(
            literal("3").unwrap().stored(Type::Int),
            Some(StoredValue::int(3))
        );
        assert_eq!(reals("3", Type::Real), Some(vec![3.0]));
        assert_eq!(literal("3").unwrap().stored(Type::Bool), None);
        assert_eq!(literal("3.5").unwrap().stored(Type::Int), None);
    }

    #[test]
    fn a_list_becomes_an_array_or_a_vector() {
        assert_eq!(
            reals("[1, 2.5, 3 mm]", Type::Vector3),
            Some(vec![1.0, 2.5, 0.003])
        );
        assert_eq!(reals("[1, 2]", Type::Reals(2)), Some(vec![1.0, 2.0]));
        assert_eq!(reals("[1, 2]", Type::Reals(3)), None);
        let bools = literal("[true, false]").unwrap();
        assert_eq!(
            bools.stored(Type::Bools(2)),
            Some(StoredValue::bools([1, 0]))
        );
        assert_eq!(literal("[true, 1]"), Err(vec![codes::WRONG_SHAPE]));
        assert_eq!(literal("[]"), Err(vec![codes::WRONG_SHAPE]));
    }

    #[test]
    fn a_list_of_rows_becomes_a_matrix() {
        let text = "[[1, 2, 3], [4, 5, 6.5]]";
        let values = Some(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.5]);
        assert_eq!(reals(text, Type::Matrix(2, 3)), values);
        assert_eq!(
            literal(text).unwrap().certain_type(),
            Some(Type::Matrix(2, 3))
        );
        for ty in [Type::Matrix(3, 2), Type::Reals(6), Type::Real] {
            assert_eq!(reals(text, ty), None, "{ty}");
        }
        assert_eq!(reals("[1, 2]", Type::Matrix(1, 2)), None);
        for bad in [
            "[[1, 2], [3]]",
            "[[1], 2]",
            "[[true]]",
            "[[[1]]]",
            "[1, [2]]",
        ] {
            assert_eq!(literal(bad), Err(vec![codes::WRONG_SHAPE]), "{bad}");
        }
    }

    #[test]
    fn a_pose_turns_about_fixed_axes() {
        let pose = reals("{xyz: [1, 20 mm, 0.3], rpy: [deg(180), 0, 0]}", Type::Pose).unwrap();
        let want = [1.0, 0.02, 0.3, 1.0, 0.0, 0.0, 0.0];
        assert!(
            pose.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-15),
            "{pose:?}"
        );
        let pose = reals("{xyz: [0, 0, 0], quat: [0, 0, 0.7071, 0.7071]}", Type::Pose).unwrap();
        assert!((pose[5] - 0.5_f64.sqrt()).abs() < 1e-15);
        assert!(reals("{rpy: [0, 0, 1]}", Type::Rotation).is_some());
    }

    #[test]
    fn bad_poses_are_refused() {
        for (text, code) in [
            ("{xyz: [0, 0], rpy: [0, 0, 0]}", codes::WRONG_SHAPE),
            ("{xyz: [0, 0, 0]}", codes::WRONG_SHAPE),
            (
                "{xyz: [0, 0, 0], rpy: [0, 0, 0], quat: [0, 0, 0, 1]}",
                codes::WRONG_SHAPE,
            ),
            (
                "{xyz: [0, 0, 0], quat: [0, 0, 1, 1]}",
                codes::NOT_NORMALISED,
            ),
            ("{xyz: [0, 0, 1 s], rpy: [0, 0, 0]}", codes::UNIT_MISMATCH),
            ("{xyz: [0, 0, 1 x], rpy: [0, 0, 0]}", codes::BAD_QUANTITY),
            ("{xzy: [0, 0, 0], rpy: [0, 0, 0]}", codes::UNKNOWN_KEY),
        ] {
            assert_eq!(literal(text), Err(vec![code]), "{text}");
        }
    }
}
