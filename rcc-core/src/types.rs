//! The types of values that ports carry, and their layout in the arena.
//!
//! Used by every thread; the real-time thread only uses `Store` and widths.

use serde::{Deserialize, Serialize};

use core::fmt;

/// The type of a port. Composites lie contiguously in the arena, in the element order given here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Type {
    /// True or false (three-valued with null).
    Bool,
    /// 64-bit signed integer; `i64::MIN` is null.
    Int,
    /// IEEE-754 double; NaN is null.
    Real,
    /// At most 64 bytes of UTF-8; parameters only.
    Text,
    /// `[x y z]`.
    Vector3,
    /// Unit quaternion `[x y z w]`.
    Rotation,
    /// `[x y z qx qy qz qw]`, m and unit quaternion.
    Pose,
    /// `[vx vy vz wx wy wz]`, m/s and rad/s.
    Twist,
    /// `[fx fy fz tx ty tz]`, N and N·m.
    Wrench,
    /// `Real[n]`.
    Reals(u16),
    /// `Bool[n]`.
    Bools(u16),
    /// `Int[n]`.
    Ints(u16),
    /// `Real[r,c]`, row-major. `Real[4,4]` is a homogeneous transform: its unit applies to the position (elements 3, 7
    /// and 11); the other elements are dimensionless.
    Matrix(u8, u8),
}

/// Which of the three typed arenas holds a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Store {
    /// `f64`; null is NaN, in every element of a composite.
    Real,
    /// `u8`: 0 false, 1 true, 2 null.
    Bool,
    /// `i64`; null is `i64::MIN`.
    Int,
}

/// The null of a `Bool` slot.
pub const NULL_BOOL: u8 = 2;
/// The null of an `Int` slot.
pub const NULL_INT: i64 = i64::MIN;
/// The null of a `Real` slot. Any NaN counts as null; this is the bit pattern that the core writes.
pub const NULL_REAL: f64 = f64::NAN;
/// Longest text value in bytes.
pub const TEXT_MAX: usize = 64;
/// Maximum number of elements of an array or matrix.
pub const ELEMENTS_MAX: u16 = 1024;

impl Type {
    /// Returns the name of a type without sizes; `None` for arrays and matrices.
    pub const fn name(self) -> Option<&'static str> {
        Some(match self {
            Type::Bool => "Bool",
            Type::Int => "Int",
            Type::Real => "Real",
            Type::Text => "Text",
            Type::Vector3 => "Vector3",
            Type::Rotation => "Rotation",
            Type::Pose => "Pose",
            Type::Twist => "Twist",
            Type::Wrench => "Wrench",
            Type::Reals(_) | Type::Bools(_) | Type::Ints(_) | Type::Matrix(..) => return None,
        })
    }

    /// A homogeneous 4×4 transform of an inner frame in an outer frame, row-major: x_outer = R · x_inner + position.
    pub const TRANSFORM: Type = Type::Matrix(4, 4);

    /// Returns the arena that holds values of this type; `None` for `Text`, which never reaches the cycle.
    pub const fn store(self) -> Option<Store> {
        match self {
            Type::Bool | Type::Bools(_) => Some(Store::Bool),
            Type::Int | Type::Ints(_) => Some(Store::Int),
            Type::Text => None,
            _ => Some(Store::Real),
        }
    }

    /// Returns the number of elements that a value occupies in the arena.
    pub const fn width(self) -> u32 {
        match self {
            Type::Bool | Type::Int | Type::Real => 1,
            Type::Text => 0,
            Type::Vector3 => 3,
            Type::Rotation => 4,
            Type::Pose => 7,
            Type::Twist | Type::Wrench => 6,
            Type::Reals(n) | Type::Bools(n) | Type::Ints(n) => n as u32,
            Type::Matrix(rows, columns) => rows as u32 * columns as u32,
        }
    }

    /// Returns true for types that can be added element by element and multiplied by a number.
    pub const fn is_linear(self) -> bool {
        matches!(
            self,
            Type::Int
                | Type::Real
                | Type::Vector3
                | Type::Twist
                | Type::Wrench
                | Type::Reals(_)
                | Type::Ints(_)
                | Type::Matrix(..)
        )
    }

    /// Returns the array type of `length` elements of this scalar type; `None` if this is not `Real`, `Bool` or `Int`.
    pub const fn array(self, length: u16) -> Option<Type> {
        match self {
            Type::Real => Some(Type::Reals(length)),
            Type::Bool => Some(Type::Bools(length)),
            Type::Int => Some(Type::Ints(length)),
            _ => None,
        }
    }

    /// Returns the type of one element: `Bool` or `Int` for types in those arenas, otherwise `Real`.
    pub const fn scalar(self) -> Type {
        match self.store() {
            Some(Store::Bool) => Type::Bool,
            Some(Store::Int) => Type::Int,
            _ => Type::Real,
        }
    }

    /// Returns the number and type of the items when a value of this type is written as a list: the rows of a matrix,
    /// the numbers of a vector. `None` for types that are not written as plain lists.
    pub const fn items(self) -> Option<(u32, Type)> {
        match self {
            Type::Matrix(rows, columns) => Some((rows as u32, Type::Reals(columns as u16))),
            Type::Vector3 | Type::Twist | Type::Wrench => Some((self.width(), Type::Real)),
            Type::Reals(_) | Type::Bools(_) | Type::Ints(_) => Some((self.width(), self.scalar())),
            _ => None,
        }
    }

    /// Returns false for elements that are dimensionless whatever the unit of the port: the rotation part of a
    /// homogeneous transform.
    pub const fn element_has_unit(self, index: u32) -> bool {
        match self {
            Type::TRANSFORM => index % 4 == 3 && index < 12,
            _ => true,
        }
    }

    /// Returns the type of `port[i]`; `None` for types that cannot be indexed.
    pub const fn element(self) -> Option<Type> {
        match self {
            Type::Reals(_) | Type::Matrix(..) => Some(Type::Real),
            Type::Bools(_) => Some(Type::Bool),
            Type::Ints(_) => Some(Type::Int),
            _ => None,
        }
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Type::Reals(n) => write!(f, "Real[{n}]"),
            Type::Bools(n) => write!(f, "Bool[{n}]"),
            Type::Ints(n) => write!(f, "Int[{n}]"),
            Type::Matrix(r, c) => write!(f, "Real[{r},{c}]"),
            named => f.write_str(named.name().unwrap_or("")),
        }
    }
}
