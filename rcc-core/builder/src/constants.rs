//! Rust values as constants and as sources of inputs: numbers, truth values, texts, arrays. Used by applications, never on
//! a real-time thread.

use rcc_config::yaml::layout::Tree;

use crate::builder::{AnyIn, In};
use crate::value::{
    AnyValue, Bool, Int, Joints, Matrix, Real, Reals, Text, Twist, Untyped, Value, Vector3, Wrench,
    literal, number, reals,
};

/// Conversions from Rust values to constants of one type.
macro_rules! constants {
    ($(<$($n:ident)*> $from:ty => $to:ty, $value:ident: $tree:expr;)*) => {
        $(
            impl<$(const $n: usize),*> From<$from> for Value<$to> {
                fn from($value: $from) -> Value<$to> {
                    Value::new($tree)
                }
            }
            impl<$(const $n: usize),*> From<$from> for In<'_, $to> {
                fn from($value: $from) -> Self {
                    In::constant($tree)
                }
            }
        )*
    };
}

constants! {
    <> bool => Bool, value: Tree::Plain(value.to_string());
    <> i64 => Int, value: Tree::Plain(value.to_string());
    <> i32 => Int, value: Tree::Plain(value.to_string());
    <> f64 => Real, value: number(value);
    <> &str => Real, value: Tree::Text(value.to_string());
    <> [f64; 3] => Vector3, value: reals(&value);
    <> [f64; 6] => Twist, value: reals(&value);
    <> [f64; 6] => Wrench, value: reals(&value);
    <N> [f64; N] => Joints, value: reals(&value);
    <N> [f64; N] => Reals<N>, value: reals(&value);
    <R C> [[f64; C]; R] => Matrix<R, C>, value: Tree::list(value.iter().map(|row| reals(row)));
}

impl From<&str> for Value<Text> {
    fn from(value: &str) -> Value<Text> {
        Value::new(Tree::Text(value.to_string()))
    }
}

/// Conversions for values whose type is checked when the net is loaded.
macro_rules! any {
    ($($from:ty, $value:ident: $tree:expr;)*) => {
        $(
            impl From<$from> for AnyValue {
                fn from($value: $from) -> AnyValue {
                    AnyValue::new($tree)
                }
            }
            impl From<$from> for AnyIn<'_> {
                fn from($value: $from) -> Self {
                    AnyIn::constant($tree)
                }
            }
        )*
    };
}

any! {
    bool, value: Tree::Plain(value.to_string());
    i64, value: Tree::Plain(value.to_string());
    i32, value: Tree::Plain(value.to_string());
    f64, value: number(value);
    &str, value: literal::<Untyped>(value).tree();
    &[f64], value: reals(value);
    Vec<f64>, value: reals(&value);
}
