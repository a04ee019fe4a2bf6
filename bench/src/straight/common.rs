//! The operations of the graphs that are the same with and without null, because NaN passes through them. Used by the
//! benchmarks.

use super::WordHash;

macro_rules! operations {
    ($($name:ident($($argument:ident: $type:ty),*) -> $result:ty $body:block)*) => {
        $(#[inline(always)] pub fn $name($($argument: $type),*) -> $result $body)*
    };
}

operations! {
    add(a: f64, b: f64) -> f64 { a + b }
    sub(a: f64, b: f64) -> f64 { a - b }
    mul(a: f64, b: f64) -> f64 { a * b }
    neg(a: f64) -> f64 { -a }
    abs(a: f64) -> f64 { a.abs() }
    sqrt(a: f64) -> f64 { a.abs().sqrt() }
    limit(x: f64, low: f64, high: f64) -> f64 { if x < low { low } else if x > high { high } else { x } }
    mget(m: &[f64; 16], index: usize) -> f64 { m[index] }
    r_hash(hash: &mut WordHash, value: &f64) -> () { hash.real(*value) }
    i_hash(hash: &mut WordHash, value: &i64) -> () { hash.word(*value as u64) }
}

/// Returns a frame; every element is null if a coordinate is.
#[allow(clippy::too_many_arguments)] // As in the graphs: three coordinates, then the rotation row by row.
#[inline(always)]
pub fn mkframe(
    x: f64,
    y: f64,
    z: f64,
    a: f64,
    b: f64,
    c: f64,
    d: f64,
    e: f64,
    f: f64,
    g: f64,
    h: f64,
    i: f64,
) -> [f64; 16] {
    let null = x.is_nan() | y.is_nan() | z.is_nan();
    let frame = [a, b, c, x, d, e, f, y, g, h, i, z, 0.0, 0.0, 0.0, 1.0];
    frame.map(|element| if null { f64::NAN } else { element })
}

/// Returns the product of two frames.
#[inline(always)]
pub fn mmul(a: &[f64; 16], b: &[f64; 16]) -> [f64; 16] {
    let mut out = [0.0; 16];
    for row in 0..4 {
        for column in 0..4 {
            let at = |k: usize| a[row * 4 + k] * b[k * 4 + column];
            out[row * 4 + column] = ((at(0) + at(1)) + at(2)) + at(3);
        }
    }
    out
}

/// Returns the inverse of a frame.
#[inline(always)]
pub fn minv(m: &[f64; 16]) -> [f64; 16] {
    let mut out = [0.0; 16];
    for row in 0..3 {
        for column in 0..3 {
            out[row * 4 + column] = m[column * 4 + row];
        }
        let at = |k: usize| m[k * 4 + row] * m[k * 4 + 3];
        out[row * 4 + 3] = -((at(0) + at(1)) + at(2));
    }
    out[15] = m[15];
    out
}

/// Adds a matrix to the hash; it is null if its last element is.
#[inline(always)]
pub fn m_hash(hash: &mut WordHash, value: &[f64; 16]) {
    if value[15].is_nan() {
        hash.real(f64::NAN);
    } else {
        value.iter().for_each(|element| hash.real(*element));
    }
}
