//! The operations of the graphs if nothing is ever null, as one would write them by hand. Used by the benchmarks.

use super::WordHash;
#[allow(unused_imports)] // Without straight-line code.
pub use super::common::*;

pub type B = bool;
pub const FALSE: B = false;

macro_rules! operations {
    ($($name:ident($($argument:ident: $type:ty),*) -> $result:ty $body:block)*) => {
        $(#[inline(always)] pub fn $name($($argument: $type),*) -> $result $body)*
    };
}

operations! {
    truth(value: bool) -> B { value }
    gt(a: f64, b: f64) -> B { a > b }
    lt(a: f64, b: f64) -> B { a < b }
    igt(a: i64, b: i64) -> B { a > b }
    and(a: B, b: B) -> B { a & b }
    or(a: B, b: B) -> B { a | b }
    xor(a: B, b: B) -> B { a ^ b }
    not(a: B) -> B { !a }
    min(a: f64, b: f64) -> f64 { if a < b { a } else { b } }
    max(a: f64, b: f64) -> f64 { if a > b { a } else { b } }
    select(s: B, a: f64, b: f64) -> f64 { if s { b } else { a } }
    iadd(a: i64, b: i64) -> i64 { a.wrapping_add(b) }
    iand(a: i64, mask: i64) -> i64 { a & mask }
    i2r(a: i64) -> f64 { a as f64 }
    lowpass(x: f64, g: f64, y: &mut f64) -> f64 { *y += (x - *y) * g; *y }
    edge(b: B, before: &mut B) -> B { b & !std::mem::replace(before, b) }
    count(b: B, n: &mut i64) -> i64 { *n += i64::from(b); *n }
    b_hash(hash: &mut WordHash, value: &B) -> () { hash.word(u64::from(*value)) }
}
