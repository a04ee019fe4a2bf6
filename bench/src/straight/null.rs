//! The operations of the graphs with in-band null: a Real is null if it is NaN, a Bool if it is 2, an Int if it is
//! `i64::MIN`. Branch-free, like the interpreter's. Used by the benchmarks.

use super::WordHash;
#[allow(unused_imports)] // Without straight-line code.
pub use super::common::*;

pub type B = u8;
pub const FALSE: B = 0;
const NULL: B = 2;

macro_rules! operations {
    ($($name:ident($($argument:ident: $type:ty),*) -> $result:ty $body:block)*) => {
        $(#[inline(always)] pub fn $name($($argument: $type),*) -> $result $body)*
    };
}

operations! {
    truth(value: bool) -> B { value as B }
    gt(a: f64, b: f64) -> B { if a.is_nan() | b.is_nan() { NULL } else { (a > b) as B } }
    lt(a: f64, b: f64) -> B { if a.is_nan() | b.is_nan() { NULL } else { (a < b) as B } }
    igt(a: i64, b: i64) -> B { if (a == i64::MIN) | (b == i64::MIN) { NULL } else { (a > b) as B } }
    and(a: B, b: B) -> B { if (a | b) & NULL != 0 { NULL } else { a & b } }
    or(a: B, b: B) -> B { if (a | b) & NULL != 0 { NULL } else { a | b } }
    xor(a: B, b: B) -> B { if (a | b) & NULL != 0 { NULL } else { a ^ b } }
    not(a: B) -> B { if a & NULL != 0 { NULL } else { a ^ 1 } }
    min(a: f64, b: f64) -> f64 { if (a < b) | a.is_nan() { a } else { b } }
    max(a: f64, b: f64) -> f64 { if (a > b) | a.is_nan() { a } else { b } }
    select(s: B, a: f64, b: f64) -> f64 { if s & NULL != 0 { f64::NAN } else if s == 1 { b } else { a } }
    div(a: f64, b: f64) -> f64 { if b == 0.0 { f64::NAN } else { a / b } }
    nullif(x: f64, b: B) -> f64 { if b == 0 { x } else { f64::NAN } }
    dflt(x: f64, c: f64) -> f64 { if x.is_nan() { c } else { x } }
    isnull(x: f64) -> B { x.is_nan() as B }
    iadd(a: i64, b: i64) -> i64 {
        if (a == i64::MIN) | (b == i64::MIN) { i64::MIN } else { a.wrapping_add(b) }
    }
    iand(a: i64, mask: i64) -> i64 { if a == i64::MIN { a } else { a & mask } }
    i2r(a: i64) -> f64 { if a == i64::MIN { f64::NAN } else { a as f64 } }
    lowpass(x: f64, g: f64, y: &mut f64) -> f64 {
        let next = *y + (x - *y) * g;
        *y = if next.is_nan() { *y } else { next };
        next
    }
    edge(b: B, before: &mut B) -> B {
        let rises = b & (*before ^ 1);
        *before = if b & NULL != 0 { *before } else { b };
        if b & NULL != 0 { NULL } else { rises }
    }
    count(b: B, n: &mut i64) -> i64 {
        *n += (b == 1) as i64;
        if b & NULL != 0 { i64::MIN } else { *n }
    }
    b_hash(hash: &mut WordHash, value: &B) -> () { hash.word(u64::from(*value)) }
}
