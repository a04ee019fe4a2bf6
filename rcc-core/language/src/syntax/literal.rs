//! Constants of a net: numbers with and without units, truth values, null, poses, rotations, lists and names. Read
//! independently of the port, which later determines the type. Runs on the loader's threads.

use std::fmt;

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::quantity::{self, Quantity};
use rcc_config::yaml::{Node, Value};
use rcc_core::pose::Pose;
use rcc_core::types::{ELEMENTS_MAX, NULL_BOOL, NULL_INT, NULL_REAL, Store, Type};
use rcc_core::unit::Unit;

use super::{legs, report_unknown_keys, shape};
use crate::codes;
use crate::write;

/// A quaternion whose length deviates from 1 by more is refused as a mistake.
const LENGTH_TOLERANCE: f64 = 1e-3;
/// A quaternion whose length deviates from 1 by no more is kept to the bit; normalising it would not improve it.
const LENGTH_NOISE: f64 = 4.0 * f64::EPSILON;

/// A constant and its span.
#[derive(Clone, Debug, PartialEq)]
pub struct Literal {
    /// The constant.
    pub shape: LiteralShape,
    /// Span.
    pub span: Span,
    /// The notation, if the shape alone does not determine it.
    pub notation: Notation,
}

/// The notation of a constant; its meaning is in its shape. Generated constants are `Canonical`.
#[derive(Clone, Debug, PartialEq)]
pub enum Notation {
    /// As the shape determines: numbers in SI units, with the unit if they have one.
    Canonical,
    /// As a text: `deg(30)`, `100 Hz`.
    Text(String),
    /// As a mapping: `{xyz: …, rpy: …}`.
    Mapping(Vec<(String, Literal)>),
    /// As a list of mappings: poses, or legs of a path.
    Rows(Node),
}

/// The kinds of constants.
#[derive(Clone, Debug, PartialEq)]
pub enum LiteralShape {
    /// Null of any type.
    Null,
    /// A truth value.
    Bool(bool),
    /// A whole number; the port decides whether it is an Int or a Real.
    Int(i64),
    /// A number in SI units, with its unit if one is given.
    Real(f64, Option<Unit>),
    /// A name, for parameters.
    Text(String),
    /// `{rpy: …}` or `{quat: …}`: unit quaternion `[x y z w]`.
    Rotation([f64; 4]),
    /// `{xyz: …, rpy: …}` or `{xyz: …, quat: …}`: `[x y z qx qy qz qw]`, m.
    Pose([f64; 7]),
    /// A list of constants of one kind.
    List(Vec<Literal>),
    /// In a fragment: a constant that is or contains parameters (`$gain`, `[$x, 0, 0]`), as written. It does not occur
    /// after expansion.
    Parameterised(Node),
    /// Refused; the error is reported, and the constant fits every type.
    Refused,
}

/// A constant as it is stored in an arena.
#[derive(Clone, Debug, PartialEq)]
pub enum StoredValue {
    /// In the arena of `Real`.
    Reals(Vec<f64>),
    /// In the arena of `Bool`.
    Bools(Vec<u8>),
    /// In the arena of `Int`.
    Ints(Vec<i64>),
}

impl StoredValue {
    /// Returns the arena.
    #[must_use]
    pub fn store(&self) -> Store {
        match self {
            StoredValue::Reals(_) => Store::Real,
            StoredValue::Bools(_) => Store::Bool,
            StoredValue::Ints(_) => Store::Int,
        }
    }

    /// Returns the number of elements.
    #[must_use]
    pub fn width(&self) -> u32 {
        let count = match self {
            StoredValue::Reals(values) => values.len(),
            StoredValue::Bools(values) => values.len(),
            StoredValue::Ints(values) => values.len(),
        };
        // Types have at most 2^16 elements.
        count as u32
    }

    /// Returns null of a type.
    #[must_use]
    pub fn null(ty: Type) -> StoredValue {
        let width = ty.width() as usize;
        match ty.store() {
            Some(Store::Bool) => StoredValue::Bools(vec![NULL_BOOL; width]),
            Some(Store::Int) => StoredValue::Ints(vec![NULL_INT; width]),
            _ => StoredValue::Reals(vec![NULL_REAL; width]),
        }
    }
}

impl Literal {
    /// Creates a constant in canonical notation.
    #[must_use]
    pub fn new(shape: LiteralShape, span: Span) -> Literal {
        Literal {
            shape,
            span,
            notation: Notation::Canonical,
        }
    }

    /// Returns true if the constant, or an element of it, is refused.
    #[must_use]
    pub fn is_refused(&self) -> bool {
        match &self.shape {
            LiteralShape::Refused => true,
            LiteralShape::List(elements) => elements.iter().any(Literal::is_refused),
            _ => false,
        }
    }

    /// Returns the type of the constant independent of its port; `None` if the port decides.
    #[must_use]
    pub fn certain_type(&self) -> Option<Type> {
        match &self.shape {
            LiteralShape::Bool(_) => Some(Type::Bool),
            LiteralShape::Real(..) => Some(Type::Real),
            LiteralShape::Rotation(_) => Some(Type::Rotation),
            LiteralShape::Pose(_) => Some(Type::Pose),
            LiteralShape::List(elements) => match first_known(elements)? {
                LiteralShape::Bool(_) => Some(Type::Bools(length(elements))),
                LiteralShape::List(_) => matrix_type(elements),
                _ => None,
            },
            _ => None,
        }
    }

    /// Returns the type that the constant takes if nothing else determines it; `None` for null and names.
    #[must_use]
    pub fn default_type(&self) -> Option<Type> {
        match &self.shape {
            LiteralShape::Int(_) => Some(Type::Real),
            LiteralShape::List(elements) => Some(match first_known(elements)? {
                LiteralShape::Bool(_) => Type::Bools(length(elements)),
                LiteralShape::List(_) => matrix_type(elements)?,
                _ => Type::Reals(length(elements)),
            }),
            _ => self.certain_type(),
        }
    }

    /// Returns the units in the constant with their spans.
    pub fn units(&self) -> Vec<(Unit, Span)> {
        match &self.shape {
            LiteralShape::Real(_, Some(unit)) => vec![(*unit, self.span)],
            LiteralShape::List(elements) => elements.iter().flat_map(Literal::units).collect(),
            _ => Vec::new(),
        }
    }

    /// Returns the constant as a value of the type; `None` if it does not fit.
    #[must_use]
    pub fn stored(&self, ty: Type) -> Option<StoredValue> {
        if matches!(self.shape, LiteralShape::Null | LiteralShape::Refused) {
            return Some(StoredValue::null(ty));
        }
        match (ty, &self.shape) {
            (Type::Bool, LiteralShape::Bool(value)) => {
                Some(StoredValue::Bools(vec![u8::from(*value)]))
            }
            (Type::Int, LiteralShape::Int(value)) => Some(StoredValue::Ints(vec![*value])),
            (Type::Real, _) => Some(StoredValue::Reals(vec![self.number()?])),
            (Type::Pose, LiteralShape::Pose(elements)) => {
                Some(StoredValue::Reals(elements.to_vec()))
            }
            (Type::Rotation, LiteralShape::Rotation(elements)) => {
                Some(StoredValue::Reals(elements.to_vec()))
            }
            (_, LiteralShape::List(elements)) => stored_list(ty, elements),
            _ => None,
        }
    }

    fn number_or_null(&self) -> Option<f64> {
        match self.shape {
            LiteralShape::Null => Some(NULL_REAL),
            _ => self.number(),
        }
    }

    /// Returns the index of the constant in a list of words.
    #[must_use]
    pub fn word(&self, words: &[&str]) -> Option<usize> {
        match &self.shape {
            LiteralShape::Text(text) => words.iter().position(|word| word == text),
            _ => None,
        }
    }

    /// Returns the number, if the constant is one.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self.shape {
            #[allow(clippy::cast_precision_loss)]
            // A whole number above 2^53 loses precision as a Real.
            LiteralShape::Int(value) => Some(value as f64),
            LiteralShape::Real(value, _) => Some(value),
            _ => None,
        }
    }
}

impl Literal {
    /// Returns all numbers in the constant, in order.
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        match &self.shape {
            LiteralShape::List(elements) => elements.iter().flat_map(Literal::numbers).collect(),
            _ => self.number().into_iter().collect(),
        }
    }
}

/// Returns the shape of the first element that is not null.
fn first_known(elements: &[Literal]) -> Option<&LiteralShape> {
    let mut shapes = elements.iter().map(|element| &element.shape);
    shapes.find(|shape| **shape != LiteralShape::Null)
}

/// Returns the type of a list of rows; rows of different lengths are refused when they are read.
fn matrix_type(rows: &[Literal]) -> Option<Type> {
    let LiteralShape::List(first) = &rows.first()?.shape else {
        return None;
    };
    let count = |length: usize| u8::try_from(length).ok();
    Some(Type::Matrix(count(rows.len())?, count(first.len())?))
}

fn stored_list(ty: Type, elements: &[Literal]) -> Option<StoredValue> {
    if let Type::Matrix(..) = ty {
        let rows = elements.iter().map(|row| match &row.shape {
            LiteralShape::List(row) => Some(row.iter()),
            _ => None,
        });
        let rows: Vec<_> = rows.collect::<Option<_>>()?;
        let values = rows.into_iter().flatten().map(Literal::number_or_null);
        let values: Vec<f64> = values.collect::<Option<_>>()?;
        return (matrix_type(elements) == Some(ty)).then_some(StoredValue::Reals(values));
    }
    if ty.width() as usize != elements.len() {
        return None;
    }
    match ty {
        Type::Bools(_) => {
            let value = |element: &Literal| match element.shape {
                LiteralShape::Bool(value) => Some(u8::from(value)),
                LiteralShape::Null => Some(NULL_BOOL),
                _ => None,
            };
            elements
                .iter()
                .map(value)
                .collect::<Option<_>>()
                .map(StoredValue::Bools)
        }
        Type::Ints(_) => {
            let value = |element: &Literal| match element.shape {
                LiteralShape::Int(value) => Some(value),
                LiteralShape::Null => Some(NULL_INT),
                _ => None,
            };
            elements
                .iter()
                .map(value)
                .collect::<Option<_>>()
                .map(StoredValue::Ints)
        }
        Type::Reals(_) | Type::Vector3 | Type::Twist | Type::Wrench => {
            let values = elements.iter().map(Literal::number_or_null);
            values.collect::<Option<_>>().map(StoredValue::Reals)
        }
        _ => None,
    }
}

#[allow(clippy::cast_possible_truncation)] // A longer list is refused when it is read.
fn length(elements: &[Literal]) -> u16 {
    elements.len() as u16
}

impl fmt::Display for Literal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.shape {
            LiteralShape::Null => f.write_str("null"),
            LiteralShape::Bool(value) => write!(f, "{value}"),
            LiteralShape::Int(value) => write!(f, "{value}"),
            LiteralShape::Real(value, None) => write!(f, "{value}"),
            LiteralShape::Real(value, Some(unit)) => write!(f, "{value} {unit}"),
            LiteralShape::Text(text) => write!(f, "`{text}`"),
            LiteralShape::Rotation(_) => f.write_str("a rotation"),
            LiteralShape::Pose(_) => f.write_str("a pose"),
            LiteralShape::List(elements) => write!(f, "a list of {}", elements.len()),
            LiteralShape::Parameterised(node) => {
                write!(f, "`{}`", node.text().unwrap_or("parameters"))
            }
            LiteralShape::Refused => f.write_str("something refused"),
        }
    }
}

/// Returns true for `$gain`, a parameter of a fragment.
#[must_use]
pub fn is_parameter(text: &str) -> bool {
    text.starts_with('$')
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

/// Reads a constant; text that is not a quantity is a name.
pub fn read(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Literal {
    let shape = match &node.value {
        _ if has_parameters(node) => LiteralShape::Parameterised(node.clone()),
        Value::Null => LiteralShape::Null,
        Value::Bool(value) => LiteralShape::Bool(*value),
        Value::Int(value) => LiteralShape::Int(*value),
        Value::Real(value) => LiteralShape::Real(*value, None),
        Value::Text(text) if !quantity::looks_like(text) => LiteralShape::Text(text.clone()),
        Value::Text(_) => read_quantity(node, diagnostics)
            .map_or(LiteralShape::Refused, |quantity| {
                LiteralShape::Real(quantity.value, quantity.unit)
            }),
        Value::List(nodes) => read_list(node, nodes, diagnostics),
        Value::Map(_) => read_pose(node, diagnostics).unwrap_or(LiteralShape::Refused),
    };
    let canonical = Literal::new(shape, node.span);
    let notation = match &node.value {
        _ if canonical.is_refused()
            || matches!(canonical.shape, LiteralShape::Parameterised(_)) =>
        {
            return canonical;
        }
        Value::Text(text) if !matches!(canonical.shape, LiteralShape::Text(_)) => {
            Notation::Text(text.trim().to_string())
        }
        Value::List(nodes) if nodes.iter().any(|node| node.map().is_some()) => {
            Notation::Rows(node.clone())
        }
        Value::Map(entries) => {
            // The entries have been read without an error.
            let part = |node| read(node, &mut Vec::new());
            let parts = entries.iter();
            let parts = parts.map(|entry| (entry.key.name.clone(), part(&entry.value)));
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

pub(super) fn read_quantity(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<Quantity> {
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
        LiteralShape::Null => ElementKind::NullAnalysis,
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
    let first = kinds.find(|kind| *kind != ElementKind::NullAnalysis);
    let first = first.unwrap_or(ElementKind::Nothing);
    let mismatch = elements.iter().zip(nodes).find(|(element, _)| {
        let kind = kind(element);
        let null = kind == ElementKind::NullAnalysis
            && matches!(first, ElementKind::Numbers | ElementKind::Bools);
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
    NullAnalysis,
    Nothing,
}

const POSE_KEYS: &[&str] = &["xyz", "rpy", "quat"];

fn read_pose(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<LiteralShape> {
    let before = diagnostics.len();
    report_unknown_keys(node, POSE_KEYS, "a pose", diagnostics);
    if diagnostics.len() > before {
        return None;
    }
    let rotation = match (node.get("rpy"), node.get("quat")) {
        (Some(rpy), None) => {
            let angles = read_numbers::<3>(rpy, "`rpy`", Unit::RADIAN, diagnostics);
            angles.map(|rpy| Pose::from_xyz_rpy([0.0; 3], rpy).orientation)
        }
        (None, Some(quat)) => read_quaternion(quat, diagnostics),
        (given, _) => {
            let message = match given {
                Some(_) => "the rotation is given twice",
                None => "the rotation is missing",
            };
            let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, node.span, message);
            diagnostics.push(
                diagnostic.help("give either `rpy: [roll, pitch, yaw]` or `quat: [x, y, z, w]`"),
            );
            None
        }
    };
    let Some(xyz) = node.get("xyz") else {
        return rotation.map(LiteralShape::Rotation);
    };
    let position = read_numbers::<3>(xyz, "`xyz`", Unit::METRE, diagnostics);
    let ([x, y, z], [qx, qy, qz, qw]) = (position?, rotation?);
    Some(LiteralShape::Pose([x, y, z, qx, qy, qz, qw]))
}

fn read_quaternion(node: &Node, diagnostics: &mut Vec<Diagnostic>) -> Option<[f64; 4]> {
    let elements = read_numbers::<4>(node, "`quat`", Unit::ONE, diagnostics)?;
    let length = elements.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (length - 1.0).abs() <= LENGTH_NOISE {
        return Some(elements);
    }
    if (length - 1.0).abs() <= LENGTH_TOLERANCE {
        return Some(elements.map(|x| x / length));
    }
    let message = format!("the quaternion has length {length:.4}, not 1");
    let diagnostic = Diagnostic::error(codes::NOT_NORMALISED, node.span, message);
    diagnostics.push(diagnostic.help("the order is x, y, z, w; or use `rpy: [roll, pitch, yaw]`"));
    None
}

/// Reads `N` numbers, bare or in `unit`.
fn read_numbers<const N: usize>(
    node: &Node,
    what: &str,
    unit: Unit,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<[f64; N]> {
    let Some(nodes) = node.list().filter(|nodes| nodes.len() == N) else {
        let message = format!("{what} must be a list of {N} numbers");
        diagnostics.push(Diagnostic::error(codes::WRONG_SHAPE, node.span, message));
        return None;
    };
    let mut values = [0.0; N];
    let mut good = true;
    for (place, node) in values.iter_mut().zip(nodes) {
        let Some(quantity) = read_quantity(node, diagnostics) else {
            good = false;
            continue;
        };
        if let Some(have) = quantity.unit.filter(|have| *have != unit) {
            let message = format!("unit mismatch: {what} expects {unit}, found {have}");
            diagnostics.push(Diagnostic::error(codes::UNIT_MISMATCH, node.span, message));
            good = false;
        }
        *place = quantity.value;
    }
    good.then_some(values)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        match literal(text).unwrap().stored(ty)? {
            StoredValue::Reals(values) => Some(values),
            _ => None,
        }
    }

    #[test]
    fn a_whole_number_takes_the_type_of_the_port() {
        assert_eq!(
            literal("3").unwrap().stored(Type::Int),
            Some(StoredValue::Ints(vec![3]))
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
            Some(StoredValue::Bools(vec![1, 0]))
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
