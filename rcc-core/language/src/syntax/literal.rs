//! Constants of a net: numbers with and without units, truth values, null, poses, rotations, lists and names.
//! Read without knowing the port; the port decides later what they become. The loader's threads.

use std::fmt;

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::quantity::{self, Quantity};
use rcc_config::yaml::{Node, Value};
use rcc_core::pose::Pose;
use rcc_core::types::{ELEMENTS_MAX, NULL_BOOL, NULL_INT, NULL_REAL, Store, Type};
use rcc_core::unit::Unit;

use super::{legs, report_unknown_keys, shape};
use crate::fault;
use crate::write;

/// A quaternion whose length differs from 1 by more was not meant to be one.
const LENGTH_TOLERANCE: f64 = 1e-3;
/// One whose length differs from 1 by no more is as good as it can be; it stays as it is, to the bit.
const LENGTH_NOISE: f64 = 4.0 * f64::EPSILON;

/// A constant and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Literal {
    /// The constant.
    pub shape: Shape,
    /// Its place.
    pub span: Span,
    /// How people wrote it, where the shape alone does not say that.
    pub written: Written,
}

/// How a constant was written; the meaning is in its shape. What is made by a program is `Usual`.
#[derive(Clone, Debug, PartialEq)]
pub enum Written {
    /// As the shape says: numbers in SI, with the unit if they have one.
    Usual,
    /// As a text: `deg(30)`, `100 Hz`.
    Text(String),
    /// As a mapping: `{xyz: …, rpy: …}`.
    Parts(Vec<(String, Literal)>),
    /// As a list of mappings: poses, or legs of a path.
    Rows(Node),
}

/// What a constant looks like.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Null of any type.
    Null,
    /// A truth value.
    Bool(bool),
    /// A whole number: an Int or a Real, as the port wants.
    Int(i64),
    /// A number in SI units, with its unit if one is written.
    Real(f64, Option<Unit>),
    /// A name, for parameters.
    Text(String),
    /// `{rpy: …}` or `{quat: …}`: unit quaternion `[x y z w]`.
    Rotation([f64; 4]),
    /// `{xyz: …, rpy: …}` or `{xyz: …, quat: …}`: `[x y z qx qy qz qw]`, m.
    Pose([f64; 7]),
    /// A list of constants of one kind.
    List(Vec<Literal>),
    /// In a fragment: a constant that is or contains parameters of it (`$gain`, `[$x, 0, 0]`), as written. Instances have
    /// none any more.
    Open(Node),
    /// Something that was refused; its fault is reported, and it fits everywhere.
    Refused,
}

/// A constant as it lies in an arena.
#[derive(Clone, Debug, PartialEq)]
pub enum Stored {
    /// In the arena of `Real`.
    Reals(Vec<f64>),
    /// In the arena of `Bool`.
    Bools(Vec<u8>),
    /// In the arena of `Int`.
    Ints(Vec<i64>),
}

impl Stored {
    /// The arena that it lies in.
    #[must_use]
    pub fn store(&self) -> Store {
        match self {
            Stored::Reals(_) => Store::Real,
            Stored::Bools(_) => Store::Bool,
            Stored::Ints(_) => Store::Int,
        }
    }

    /// Number of elements.
    #[must_use]
    pub fn width(&self) -> u32 {
        let count = match self {
            Stored::Reals(values) => values.len(),
            Stored::Bools(values) => values.len(),
            Stored::Ints(values) => values.len(),
        };
        // Types have at most 2^16 elements.
        count as u32
    }

    /// Null of a type.
    #[must_use]
    pub fn null(ty: Type) -> Stored {
        let width = ty.width() as usize;
        match ty.store() {
            Some(Store::Bool) => Stored::Bools(vec![NULL_BOOL; width]),
            Some(Store::Int) => Stored::Ints(vec![NULL_INT; width]),
            _ => Stored::Reals(vec![NULL_REAL; width]),
        }
    }
}

impl Literal {
    /// A constant that is written as its shape says.
    #[must_use]
    pub fn new(shape: Shape, span: Span) -> Literal {
        Literal {
            shape,
            span,
            written: Written::Usual,
        }
    }

    /// True if its fault is already reported.
    #[must_use]
    pub fn is_refused(&self) -> bool {
        match &self.shape {
            Shape::Refused => true,
            Shape::List(elements) => elements.iter().any(Literal::is_refused),
            _ => false,
        }
    }

    /// The type that a constant has whatever its port says; `None` if the port decides.
    #[must_use]
    pub fn firm_type(&self) -> Option<Type> {
        match &self.shape {
            Shape::Bool(_) => Some(Type::Bool),
            Shape::Real(..) => Some(Type::Real),
            Shape::Rotation(_) => Some(Type::Rotation),
            Shape::Pose(_) => Some(Type::Pose),
            Shape::List(elements) => match first_known(elements)? {
                Shape::Bool(_) => Some(Type::Bools(length(elements))),
                Shape::List(_) => matrix_type(elements),
                _ => None,
            },
            _ => None,
        }
    }

    /// The type that it gets where nothing else decides; `None` for null and names.
    #[must_use]
    pub fn usual_type(&self) -> Option<Type> {
        match &self.shape {
            Shape::Int(_) => Some(Type::Real),
            Shape::List(elements) => Some(match first_known(elements)? {
                Shape::Bool(_) => Type::Bools(length(elements)),
                Shape::List(_) => matrix_type(elements)?,
                _ => Type::Reals(length(elements)),
            }),
            _ => self.firm_type(),
        }
    }

    /// The units that are written in it, with their places.
    pub fn units(&self) -> Vec<(Unit, Span)> {
        match &self.shape {
            Shape::Real(_, Some(unit)) => vec![(*unit, self.span)],
            Shape::List(elements) => elements.iter().flat_map(Literal::units).collect(),
            _ => Vec::new(),
        }
    }

    /// The constant as a value of a type; `None` if it is none of it.
    #[must_use]
    pub fn stored(&self, ty: Type) -> Option<Stored> {
        if matches!(self.shape, Shape::Null | Shape::Refused) {
            return Some(Stored::null(ty));
        }
        match (ty, &self.shape) {
            (Type::Bool, Shape::Bool(value)) => Some(Stored::Bools(vec![u8::from(*value)])),
            (Type::Int, Shape::Int(value)) => Some(Stored::Ints(vec![*value])),
            (Type::Real, _) => Some(Stored::Reals(vec![self.number()?])),
            (Type::Pose, Shape::Pose(elements)) => Some(Stored::Reals(elements.to_vec())),
            (Type::Rotation, Shape::Rotation(elements)) => Some(Stored::Reals(elements.to_vec())),
            (_, Shape::List(elements)) => stored_list(ty, elements),
            _ => None,
        }
    }

    fn number_or_null(&self) -> Option<f64> {
        match self.shape {
            Shape::Null => Some(NULL_REAL),
            _ => self.number(),
        }
    }

    /// The place of a word in a list of them.
    #[must_use]
    pub fn word(&self, words: &[&str]) -> Option<usize> {
        match &self.shape {
            Shape::Text(text) => words.iter().position(|word| word == text),
            _ => None,
        }
    }

    /// The number, if it is one.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self.shape {
            #[allow(clippy::cast_precision_loss)]
            // Nobody writes 2^53 as a Real without meaning it.
            Shape::Int(value) => Some(value as f64),
            Shape::Real(value, _) => Some(value),
            _ => None,
        }
    }
}

impl Literal {
    /// The numbers in it, in order; empty if it has none.
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        match &self.shape {
            Shape::List(elements) => elements.iter().flat_map(Literal::numbers).collect(),
            _ => self.number().into_iter().collect(),
        }
    }
}

/// What the first element of a list that is not null looks like.
fn first_known(elements: &[Literal]) -> Option<&Shape> {
    let mut shapes = elements.iter().map(|element| &element.shape);
    shapes.find(|shape| **shape != Shape::Null)
}

/// The type of a list of rows; reading has refused rows of different lengths.
fn matrix_type(rows: &[Literal]) -> Option<Type> {
    let Shape::List(first) = &rows.first()?.shape else {
        return None;
    };
    let count = |length: usize| u8::try_from(length).ok();
    Some(Type::Matrix(count(rows.len())?, count(first.len())?))
}

fn stored_list(ty: Type, elements: &[Literal]) -> Option<Stored> {
    if let Type::Matrix(..) = ty {
        let rows = elements.iter().map(|row| match &row.shape {
            Shape::List(row) => Some(row.iter()),
            _ => None,
        });
        let rows: Vec<_> = rows.collect::<Option<_>>()?;
        let values = rows.into_iter().flatten().map(Literal::number_or_null);
        let values: Vec<f64> = values.collect::<Option<_>>()?;
        return (matrix_type(elements) == Some(ty)).then_some(Stored::Reals(values));
    }
    if ty.width() as usize != elements.len() {
        return None;
    }
    match ty {
        Type::Bools(_) => {
            let value = |element: &Literal| match element.shape {
                Shape::Bool(value) => Some(u8::from(value)),
                Shape::Null => Some(NULL_BOOL),
                _ => None,
            };
            elements
                .iter()
                .map(value)
                .collect::<Option<_>>()
                .map(Stored::Bools)
        }
        Type::Ints(_) => {
            let value = |element: &Literal| match element.shape {
                Shape::Int(value) => Some(value),
                Shape::Null => Some(NULL_INT),
                _ => None,
            };
            elements
                .iter()
                .map(value)
                .collect::<Option<_>>()
                .map(Stored::Ints)
        }
        Type::Reals(_) | Type::Vector3 | Type::Twist | Type::Wrench => {
            let values = elements.iter().map(Literal::number_or_null);
            values.collect::<Option<_>>().map(Stored::Reals)
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
            Shape::Null => f.write_str("null"),
            Shape::Bool(value) => write!(f, "{value}"),
            Shape::Int(value) => write!(f, "{value}"),
            Shape::Real(value, None) => write!(f, "{value}"),
            Shape::Real(value, Some(unit)) => write!(f, "{value} {unit}"),
            Shape::Text(text) => write!(f, "`{text}`"),
            Shape::Rotation(_) => f.write_str("a rotation"),
            Shape::Pose(_) => f.write_str("a pose"),
            Shape::List(elements) => write!(f, "a list of {}", elements.len()),
            Shape::Open(node) => write!(f, "`{}`", node.text().unwrap_or("parameters")),
            Shape::Refused => f.write_str("something refused"),
        }
    }
}

/// True for `$gain`: a parameter of the fragment that it stands in.
#[must_use]
pub fn is_parameter(text: &str) -> bool {
    text.starts_with('$')
}

/// True if a text is or contains parameters of a fragment.
fn is_open(node: &Node) -> bool {
    match &node.value {
        Value::Text(text) => is_parameter(text),
        Value::List(nodes) => nodes.iter().any(is_open),
        Value::Map(entries) => entries.iter().any(|entry| is_open(&entry.value)),
        _ => false,
    }
}

/// Reads a constant; text that is no quantity is taken as a name.
pub fn read(node: &Node, faults: &mut Vec<Diagnostic>) -> Literal {
    let shape = match &node.value {
        _ if is_open(node) => Shape::Open(node.clone()),
        Value::Null => Shape::Null,
        Value::Bool(value) => Shape::Bool(*value),
        Value::Int(value) => Shape::Int(*value),
        Value::Real(value) => Shape::Real(*value, None),
        Value::Text(text) if !quantity::looks_like(text) => Shape::Text(text.clone()),
        Value::Text(_) => read_quantity(node, faults).map_or(Shape::Refused, |quantity| {
            Shape::Real(quantity.value, quantity.unit)
        }),
        Value::List(nodes) => read_list(node, nodes, faults),
        Value::Map(_) => read_pose(node, faults).unwrap_or(Shape::Refused),
    };
    let usual = Literal::new(shape, node.span);
    let written = match &node.value {
        _ if usual.is_refused() || matches!(usual.shape, Shape::Open(_)) => return usual,
        Value::Text(text) if !matches!(usual.shape, Shape::Text(_)) => {
            Written::Text(text.trim().to_string())
        }
        Value::List(nodes) if nodes.iter().any(|node| node.map().is_some()) => {
            Written::Rows(node.clone())
        }
        Value::Map(entries) => {
            // They have been read without a fault.
            let part = |node| read(node, &mut Vec::new());
            let parts = entries.iter();
            let parts = parts.map(|entry| (entry.key.name.clone(), part(&entry.value)));
            Written::Parts(parts.collect())
        }
        _ => return usual,
    };
    let tree = write::literal_tree(&usual);
    let literal = Literal { written, ..usual };
    if write::literal_tree(&literal) == tree {
        return Literal {
            written: Written::Usual,
            ..literal
        };
    }
    literal
}

pub(super) fn read_quantity(node: &Node, faults: &mut Vec<Diagnostic>) -> Option<Quantity> {
    quantity::of(node)
        .map_err(|error| {
            faults.push(Diagnostic::error(
                fault::BAD_QUANTITY,
                node.span,
                error.to_string(),
            ));
        })
        .ok()
}

fn read_list(node: &Node, nodes: &[Node], faults: &mut Vec<Diagnostic>) -> Shape {
    if nodes.is_empty() || nodes.len() > usize::from(ELEMENTS_MAX) {
        let message = format!(
            "a list has 1 to {ELEMENTS_MAX} elements, this one has {}",
            nodes.len()
        );
        faults.push(Diagnostic::error(fault::WRONG_SHAPE, node.span, message));
        return Shape::Refused;
    }
    if legs::are_legs(nodes) {
        return legs::read(nodes, faults).map_or(Shape::Refused, Shape::List);
    }
    let elements: Vec<Literal> = nodes.iter().map(|node| read(node, faults)).collect();
    if elements.iter().any(Literal::is_refused) {
        return Shape::Refused;
    }
    if let Some(rows) = pose_rows(&elements) {
        return Shape::List(rows);
    }
    let kind = |element: &Literal| match &element.shape {
        Shape::Bool(_) => ListOf::Bools,
        Shape::Null => ListOf::Nulls,
        Shape::List(row)
            if row
                .iter()
                .all(|x| x.number().is_some() || x.shape == Shape::Null) =>
        {
            ListOf::Rows(row.len())
        }
        _ if element.number().is_some() => ListOf::Numbers,
        _ => ListOf::Nothing,
    };
    let mut kinds = elements.iter().map(kind);
    let first = kinds.find(|kind| *kind != ListOf::Nulls);
    let first = first.unwrap_or(ListOf::Nothing);
    let odd = elements.iter().zip(nodes).find(|(element, _)| {
        let kind = kind(element);
        let null = kind == ListOf::Nulls && matches!(first, ListOf::Numbers | ListOf::Bools);
        !null && (kind == ListOf::Nothing || kind != first)
    });
    if let Some((_, node)) = odd {
        let wanted = match first {
            ListOf::Bools => "a truth value as the first one".to_string(),
            ListOf::Rows(length) => format!("a row of {length} numbers as the first one"),
            _ => "a number".to_string(),
        };
        faults.push(shape(node, "an element of a list", &wanted));
        return Shape::Refused;
    }
    Shape::List(elements)
}

/// Poses as rows of seven numbers; `None` if one of the elements is none.
fn pose_rows(elements: &[Literal]) -> Option<Vec<Literal>> {
    let row = |element: &Literal| match &element.shape {
        Shape::Pose(numbers) => {
            let number = |number: &f64| Literal::new(Shape::Real(*number, None), element.span);
            let row = Shape::List(numbers.iter().map(number).collect());
            Some(Literal::new(row, element.span))
        }
        _ => None,
    };
    elements.iter().map(row).collect()
}

/// What a list consists of.
#[derive(Clone, Copy, PartialEq)]
enum ListOf {
    Bools,
    Numbers,
    /// Lists of so many numbers.
    Rows(usize),
    /// Null, which goes with truth values and numbers.
    Nulls,
    Nothing,
}

const POSE_KEYS: &[&str] = &["xyz", "rpy", "quat"];

fn read_pose(node: &Node, faults: &mut Vec<Diagnostic>) -> Option<Shape> {
    let before = faults.len();
    report_unknown_keys(node, POSE_KEYS, "a pose", faults);
    if faults.len() > before {
        return None;
    }
    let rotation = match (node.get("rpy"), node.get("quat")) {
        (Some(rpy), None) => {
            let angles = read_numbers::<3>(rpy, "`rpy`", Unit::RADIAN, faults);
            angles.map(|rpy| Pose::from_xyz_rpy([0.0; 3], rpy).orientation)
        }
        (None, Some(quat)) => read_quaternion(quat, faults),
        (given, _) => {
            let message = match given {
                Some(_) => "a rotation is given twice",
                None => "the rotation is missing",
            };
            let fault = Diagnostic::error(fault::WRONG_SHAPE, node.span, message);
            faults
                .push(fault.help("give one of `rpy: [roll, pitch, yaw]` and `quat: [x, y, z, w]`"));
            None
        }
    };
    let Some(xyz) = node.get("xyz") else {
        return rotation.map(Shape::Rotation);
    };
    let position = read_numbers::<3>(xyz, "`xyz`", Unit::METRE, faults);
    let ([x, y, z], [qx, qy, qz, qw]) = (position?, rotation?);
    Some(Shape::Pose([x, y, z, qx, qy, qz, qw]))
}

fn read_quaternion(node: &Node, faults: &mut Vec<Diagnostic>) -> Option<[f64; 4]> {
    let elements = read_numbers::<4>(node, "`quat`", Unit::ONE, faults)?;
    let length = elements.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (length - 1.0).abs() <= LENGTH_NOISE {
        return Some(elements);
    }
    if (length - 1.0).abs() <= LENGTH_TOLERANCE {
        return Some(elements.map(|x| x / length));
    }
    let message = format!("the quaternion is of length {length:.4}, not 1");
    let fault = Diagnostic::error(fault::NOT_NORMALISED, node.span, message);
    faults.push(fault.help("the order is x, y, z, w; or use `rpy: [roll, pitch, yaw]`"));
    None
}

/// `N` numbers, bare or in `unit`.
fn read_numbers<const N: usize>(
    node: &Node,
    what: &str,
    unit: Unit,
    faults: &mut Vec<Diagnostic>,
) -> Option<[f64; N]> {
    let Some(nodes) = node.list().filter(|nodes| nodes.len() == N) else {
        let message = format!("{what} must be a list of {N} numbers");
        faults.push(Diagnostic::error(fault::WRONG_SHAPE, node.span, message));
        return None;
    };
    let mut values = [0.0; N];
    let mut good = true;
    for (place, node) in values.iter_mut().zip(nodes) {
        let Some(quantity) = read_quantity(node, faults) else {
            good = false;
            continue;
        };
        if let Some(have) = quantity.unit.filter(|have| *have != unit) {
            let message = format!("unit mismatch: {what} is in {unit}, this is in {have}");
            faults.push(Diagnostic::error(fault::UNIT_MISMATCH, node.span, message));
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
        let mut faults = Vec::new();
        let literal = read(root.get("x").unwrap(), &mut faults);
        if faults.is_empty() {
            Ok(literal)
        } else {
            assert!(literal.is_refused(), "{text}");
            Err(faults.iter().map(|fault| fault.code).collect())
        }
    }

    fn reals(text: &str, ty: Type) -> Option<Vec<f64>> {
        match literal(text).unwrap().stored(ty)? {
            Stored::Reals(values) => Some(values),
            _ => None,
        }
    }

    #[test]
    fn a_whole_number_becomes_what_the_port_wants() {
        assert_eq!(
            literal("3").unwrap().stored(Type::Int),
            Some(Stored::Ints(vec![3]))
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
            Some(Stored::Bools(vec![1, 0]))
        );
        assert_eq!(literal("[true, 1]"), Err(vec![fault::WRONG_SHAPE]));
        assert_eq!(literal("[]"), Err(vec![fault::WRONG_SHAPE]));
    }

    #[test]
    fn a_list_of_rows_becomes_a_matrix() {
        let text = "[[1, 2, 3], [4, 5, 6.5]]";
        let values = Some(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.5]);
        assert_eq!(reals(text, Type::Matrix(2, 3)), values);
        assert_eq!(literal(text).unwrap().firm_type(), Some(Type::Matrix(2, 3)));
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
            assert_eq!(literal(bad), Err(vec![fault::WRONG_SHAPE]), "{bad}");
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
            ("{xyz: [0, 0], rpy: [0, 0, 0]}", fault::WRONG_SHAPE),
            ("{xyz: [0, 0, 0]}", fault::WRONG_SHAPE),
            (
                "{xyz: [0, 0, 0], rpy: [0, 0, 0], quat: [0, 0, 0, 1]}",
                fault::WRONG_SHAPE,
            ),
            (
                "{xyz: [0, 0, 0], quat: [0, 0, 1, 1]}",
                fault::NOT_NORMALISED,
            ),
            ("{xyz: [0, 0, 1 s], rpy: [0, 0, 0]}", fault::UNIT_MISMATCH),
            ("{xyz: [0, 0, 1 x], rpy: [0, 0, 0]}", fault::BAD_QUANTITY),
            ("{xzy: [0, 0, 0], rpy: [0, 0, 0]}", fault::UNKNOWN_KEY),
        ] {
            assert_eq!(literal(text), Err(vec![code]), "{text}");
        }
    }
}
