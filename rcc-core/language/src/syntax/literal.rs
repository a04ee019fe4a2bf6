//! Constants of a net: numbers with and without units, truth values, null, poses, rotations, lists and names. Runs on
//! the loader's threads.

use std::fmt;

use rcc_config::diagnostic::Span;
use rcc_config::yaml::Node;
use rcc_core::types::{NULL_BOOL, NULL_INT, NULL_REAL, Type};
use rcc_core::unit::Unit;

use super::stored_value::StoredValue;

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
    Rows(Box<Node>),
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
    Parameterised(Box<Node>),
    /// Refused; the error is reported, and the constant fits every type.
    Refused,
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

    /// Returns true for null.
    #[must_use]
    pub fn is_null(&self) -> bool {
        matches!(self.shape, LiteralShape::Null)
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
            (Type::Bool, LiteralShape::Bool(value)) => Some(StoredValue::bool(u8::from(*value))),
            (Type::Int, LiteralShape::Int(value)) => Some(StoredValue::int(*value)),
            (Type::Real, _) => Some(StoredValue::real(self.number()?)),
            (Type::Pose, LiteralShape::Pose(elements)) => Some(StoredValue::reals(*elements)),
            (Type::Rotation, LiteralShape::Rotation(elements)) => {
                Some(StoredValue::reals(*elements))
            }
            (_, LiteralShape::List(elements)) => stored_list(ty, elements),
            _ => None,
        }
    }

    /// Returns true if the constant is a value of the type.
    #[must_use]
    pub fn fits(&self, ty: Type) -> bool {
        self.stored(ty).is_some()
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

    /// Returns the elements of a list, or the constant alone, as numbers; `None` for null and for anything that is not a
    /// number, so that the index is that of the element.
    pub fn elements_or_null(&self) -> impl Iterator<Item = Option<f64>> {
        let elements = match &self.shape {
            LiteralShape::List(elements) => elements.as_slice(),
            _ => std::slice::from_ref(self),
        };
        elements.iter().map(Literal::number)
    }

    /// Returns all numbers in the constant, in order; nulls are left out.
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        match &self.shape {
            LiteralShape::List(elements) => elements.iter().flat_map(Literal::numbers).collect(),
            _ => self.number().into_iter().collect(),
        }
    }
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

/// Returns the shape of the first element that is not null.
fn first_known(elements: &[Literal]) -> Option<&LiteralShape> {
    let mut shapes = elements.iter().map(|element| &element.shape);
    shapes.find(|shape| !matches!(shape, LiteralShape::Null))
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
        return (matrix_type(elements) == Some(ty)).then(|| StoredValue::reals(values));
    }
    if ty.width() as usize != elements.len() {
        return None;
    }
    let shapes = elements.iter().map(|element| &element.shape);
    match ty {
        Type::Bools(_) => {
            let values = shapes.map(|shape| match shape {
                LiteralShape::Bool(value) => Some(u8::from(*value)),
                LiteralShape::Null => Some(NULL_BOOL),
                _ => None,
            });
            let values: Vec<u8> = values.collect::<Option<_>>()?;
            Some(StoredValue::bools(values))
        }
        Type::Ints(_) => {
            let values = shapes.map(|shape| match shape {
                LiteralShape::Int(value) => Some(*value),
                LiteralShape::Null => Some(NULL_INT),
                _ => None,
            });
            let values: Vec<i64> = values.collect::<Option<_>>()?;
            Some(StoredValue::ints(values))
        }
        Type::Reals(_) | Type::Vector3 | Type::Twist | Type::Wrench => {
            let values = elements.iter().map(Literal::number_or_null);
            let values: Vec<f64> = values.collect::<Option<_>>()?;
            Some(StoredValue::reals(values))
        }
        _ => None,
    }
}

#[allow(clippy::cast_possible_truncation)] // A longer list is refused when it is read.
fn length(elements: &[Literal]) -> u16 {
    elements.len() as u16
}
