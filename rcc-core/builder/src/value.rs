//! The types of the net language as Rust types, and constants of these types. Used by applications, never on a
//! real-time thread.

use std::marker::PhantomData;

use rcc_config::yaml;
use rcc_config::yaml::layout::Tree;
use rcc_config::yaml::scalar;

/// A type of the language.
pub trait Type: Copy + std::fmt::Debug {}
/// `Bool`, `Int` or `Real`.
pub trait Scalar: Type {}
/// `Int` or `Real`.
pub trait Number: Scalar {}
/// Types that can be added: numbers, vectors, arrays of numbers, matrices.
pub trait Linear: Type {}

macro_rules! types {
    ($($(#[doc = $doc:literal])* $name:ident: $($more:ident)*;)*) => {
        $(
            $(#[doc = $doc])*
            #[derive(Clone, Copy, Debug)]
            pub enum $name {}
            impl Type for $name {}
            $(impl $more for $name {})*
        )*
    };
}

types! {
    /// True or false.
    Bool: Scalar;
    /// A signed 64-bit integer.
    Int: Scalar Number Linear;
    /// A real number with a unit.
    Real: Scalar Number Linear;
    /// A name.
    Text: ;
    /// `[x, y, z]`.
    Vector3: Linear;
    /// A rotation.
    Rotation: ;
    /// A position and a rotation.
    Pose: ;
    /// `[vx, vy, vz, wx, wy, wz]`.
    Twist: Linear;
    /// `[fx, fy, fz, tx, ty, tz]`.
    Wrench: Linear;
    /// A `Real` for each joint of the device.
    Joints: Linear;
    /// A type that is only known when the net is loaded.
    Untyped: ;
}

/// `Real[N]`.
#[derive(Clone, Copy, Debug)]
pub enum Reals<const N: usize> {}
impl<const N: usize> Type for Reals<N> {}
impl<const N: usize> Linear for Reals<N> {}

/// `Real[R,C]`.
#[derive(Clone, Copy, Debug)]
pub enum Matrix<const R: usize, const C: usize> {}
impl<const R: usize, const C: usize> Type for Matrix<R, C> {}
impl<const R: usize, const C: usize> Linear for Matrix<R, C> {}

/// A constant of type `T`.
#[derive(Clone, Debug)]
pub struct Value<T> {
    tree: Tree,
    ty: PhantomData<T>,
}

impl<T> Value<T> {
    pub(crate) fn new(tree: Tree) -> Value<T> {
        Value {
            tree,
            ty: PhantomData,
        }
    }

    pub(crate) fn tree(self) -> Tree {
        self.tree
    }
}

/// A constant whose type is checked when the net is loaded.
#[derive(Clone, Debug)]
pub struct AnyValue(Tree);

impl AnyValue {
    pub(crate) fn new(tree: Tree) -> AnyValue {
        AnyValue(tree)
    }

    pub(crate) fn tree(self) -> Tree {
        self.0
    }
}

impl<T> From<Value<T>> for AnyValue {
    fn from(value: Value<T>) -> AnyValue {
        AnyValue(value.tree)
    }
}

/// Returns null of any type.
#[must_use]
pub fn null<T>() -> Value<T> {
    Value::new(Tree::Plain("null".to_string()))
}

/// Returns a constant in the syntax of the language: `literal::<Real>("12 N")`, `literal::<Reals<2>>("[deg(3), 0]")`.
/// [`NetBuilder::build`](crate::NetBuilder::build) reports a mistake in it.
#[must_use]
pub fn literal<T>(text: &str) -> Value<T> {
    Value::new(match yaml::parse(text) {
        Ok(node) => Tree::of(&node),
        Err(_) => Tree::Text(text.to_string()),
    })
}

/// Returns a pose from a position in m and roll, pitch and yaw about the fixed axes x, y and z in rad.
#[must_use]
pub fn pose(xyz: [f64; 3], rpy: [f64; 3]) -> Value<Pose> {
    Value::new(Tree::map([
        ("xyz".to_string(), reals(&xyz)),
        ("rpy".to_string(), reals(&rpy)),
    ]))
}

/// Returns a rotation from roll, pitch and yaw about the fixed axes x, y and z in rad.
#[must_use]
pub fn rotation(rpy: [f64; 3]) -> Value<Rotation> {
    Value::new(Tree::map([("rpy".to_string(), reals(&rpy))]))
}

pub(crate) fn number(value: f64) -> Tree {
    // The language has no infinite numbers: they become null, like NaN.
    Tree::Plain(if value.is_finite() {
        scalar::real(value)
    } else {
        "null".to_string()
    })
}

pub(crate) fn reals(values: &[f64]) -> Tree {
    Tree::list(values.iter().map(|value| number(*value)))
}
