//! Random expressions: their text, and their value by an evaluator of the tree that uses the mathematics of the primitives,
//! but none of their code.

use rcc_core::pose::Pose;
use rcc_core::rotation::{self, Quaternion};

/// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(seed)
    }

    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) % count as u64) as usize
    }
}

/// The value of a tree; `None` elements are null.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    Real(Option<f64>),
    Int(Option<i64>),
    Bool(Option<bool>),
    /// The elements of a vector, array, rotation, pose or twist.
    Elements(Vec<Option<f64>>),
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// A random tree: its text, and its value.
pub struct Trees<'r> {
    pub random: &'r mut Random,
    pub reals: Vec<Option<f64>>,
    pub ints: Vec<Option<i64>>,
    pub bools: Vec<Option<bool>>,
}

impl Trees<'_> {
    pub fn below(&mut self, count: usize) -> usize {
        self.random.below(count)
    }

    fn real(&mut self, depth: usize) -> (String, Option<f64>) {
        if depth == 0 {
            if self.below(4) == 0 {
                let value = (self.below(9) as f64 - 4.0) * 0.37;
                return (format!("({value:?})"), Some(value));
            }
            let index = self.below(self.reals.len());
            return (format!("r{index}.value"), self.reals[index]);
        }
        let next = depth - 1;
        match self.below(16) {
            0 => self.pair(next, "+", |a, b| finite(a + b)),
            1 => self.pair(next, "-", |a, b| finite(a - b)),
            2 => self.pair(next, "*", |a, b| finite(a * b)),
            3 => self.pair(
                next,
                "/",
                |a, b| if b == 0.0 { None } else { finite(a / b) },
            ),
            4 => {
                let (a, x) = self.real(next);
                (format!("-({a})"), x.map(|x| -x))
            }
            5 => {
                let (a, x) = self.real(next);
                (format!("abs({a})"), x.map(f64::abs))
            }
            6 => {
                let (a, x) = self.real(next);
                (format!("sqrt({a})"), x.filter(|x| *x >= 0.0).map(f64::sqrt))
            }
            7 => {
                let (c, condition) = self.truth(next);
                let ((a, x), (b, y)) = (self.real(next), self.real(next));
                let value = condition.and_then(|yes| if yes { x } else { y });
                (format!("(if {c} then {a} else {b})"), value)
            }
            8 => {
                let (a, x) = self.vector(next);
                let index = self.below(3);
                (format!("({a}).{}", ["x", "y", "z"][index]), x[index])
            }
            9 => {
                let ((a, x), (b, y)) = (self.real(next), self.real(next));
                (format!("or_else({a}, {b})"), x.or(y))
            }
            10 => {
                let (a, x) = self.int(next);
                (format!("to_real({a})"), x.map(|x| x as f64))
            }
            11 => {
                let (a, x) = self.array(next);
                let index = self.below(4);
                (format!("({a})[{index}]"), x[index])
            }
            12 => {
                let (a, x) = self.pose(next.min(1));
                let index = self.below(3);
                let part = x.map(|x| x.position[index]);
                (format!("(({a}).{} / 1 m)", ["x", "y", "z"][index]), part)
            }
            13 => {
                let ((a, x), (b, y), (c, z)) = (self.real(next), self.real(0), self.real(0));
                let all = x.zip(y).zip(z);
                let value = all.map(|((x, y), z)| greatest(greatest(x, y), z));
                (format!("max({a}, {b}, {c})"), value)
            }
            14 => {
                let ((a, x), (b, y)) = (self.real(next), self.real(0));
                let value = x.zip(y).map(|(x, y)| if x < y { x } else { y });
                (format!("min({a}, {b})"), value)
            }
            _ => {
                let (a, x) = self.real(next);
                let value = x.map(|x| x.clamp(-1.25, 2.5));
                (format!("clamp({a}, -1.25, 2.5)"), value)
            }
        }
    }

    fn pair(
        &mut self,
        depth: usize,
        symbol: &str,
        apply: impl Fn(f64, f64) -> Option<f64>,
    ) -> (String, Option<f64>) {
        let ((a, x), (b, y)) = (self.real(depth), self.real(depth));
        let value = x.zip(y).and_then(|(x, y)| apply(x, y));
        (format!("({a} {symbol} {b})"), value)
    }

    fn int(&mut self, depth: usize) -> (String, Option<i64>) {
        if depth == 0 {
            let index = self.below(self.ints.len());
            return (format!("i{index}.value"), self.ints[index]);
        }
        let ((a, x), (b, y)) = (self.int(depth - 1), self.int(depth - 1));
        let both = x.zip(y);
        let whole = |value: Option<i64>| value.filter(|value| *value != i64::MIN);
        match self.below(4) {
            0 => (
                format!("({a} + {b})"),
                whole(both.and_then(|(x, y)| x.checked_add(y))),
            ),
            1 => (
                format!("({a} - {b})"),
                whole(both.and_then(|(x, y)| x.checked_sub(y))),
            ),
            2 => (
                format!("({a} * {b})"),
                whole(both.and_then(|(x, y)| x.checked_mul(y))),
            ),
            _ => (
                format!("max({a}, {b}, 1)"),
                both.map(|(x, y)| x.max(y).max(1)),
            ),
        }
    }

    fn truth(&mut self, depth: usize) -> (String, Option<bool>) {
        if depth == 0 {
            let index = self.below(self.bools.len());
            return (format!("b{index}.value"), self.bools[index]);
        }
        let next = depth - 1;
        match self.below(9) {
            0 => {
                let (a, x) = self.truth(next);
                (format!("(not {a})"), x.map(|x| !x))
            }
            1 | 2 => {
                let ((a, x), (b, y)) = (self.truth(next), self.truth(next));
                if self.below(2) == 0 {
                    return (format!("({a} and {b})"), x.zip(y).map(|(x, y)| x && y));
                }
                (format!("({a} or {b})"), x.zip(y).map(|(x, y)| x || y))
            }
            3 => {
                let ((a, x), (b, y)) = (self.int(next), self.int(next));
                (format!("({a} != {b})"), x.zip(y).map(|(x, y)| x != y))
            }
            case => {
                let ((a, x), (b, y)) = (self.real(next), self.real(next));
                let both = x.zip(y);
                let (symbol, value) = match case {
                    4 => ("<", both.map(|(x, y)| x < y)),
                    5 => ("<=", both.map(|(x, y)| x <= y)),
                    6 => (">", both.map(|(x, y)| x > y)),
                    7 => (">=", both.map(|(x, y)| x >= y)),
                    _ => ("==", both.map(|(x, y)| x == y)),
                };
                (format!("({a} {symbol} {b})"), value)
            }
        }
    }

    fn vector(&mut self, depth: usize) -> (String, [Option<f64>; 3]) {
        let next = depth.saturating_sub(1);
        if depth == 0 || self.below(3) == 0 {
            let parts = [self.real(next.min(1)), self.real(0), self.real(0)];
            let [(a, x), (b, y), (c, z)] = parts;
            let known = x.is_some() && y.is_some() && z.is_some();
            let value = if known { [x, y, z] } else { [None; 3] };
            return (format!("vector({a}, {b}, {c})"), value);
        }
        let (a, x) = self.vector(next);
        if self.below(2) == 0 {
            let (k, factor) = self.real(next);
            let value = x.map(|x| x.zip(factor).and_then(|(x, k)| finite(x * k)));
            return (format!("({a} * {k})"), value);
        }
        let (b, y) = self.vector(next);
        let sum = |index: usize| x[index].zip(y[index]).and_then(|(x, y)| finite(x + y));
        (format!("({a} + {b})"), [sum(0), sum(1), sum(2)])
    }

    /// Four numbers, each of which may be null.
    fn array(&mut self, depth: usize) -> (String, [Option<f64>; 4]) {
        let next = depth.saturating_sub(1);
        if depth == 0 || self.below(3) == 0 {
            let [(a, x), (b, y), (c, z)] = [self.real(next.min(1)), self.real(0), self.real(0)];
            let (d, w) = self.real(0);
            return (format!("copy([{a}, {b}, {c}, {d}])"), [x, y, z, w]);
        }
        let (a, x) = self.array(next);
        if self.below(2) == 0 {
            let (k, factor) = self.real(next);
            let value = x.map(|x| x.zip(factor).and_then(|(x, k)| finite(x * k)));
            return (format!("({a} * {k})"), value);
        }
        let (b, y) = self.array(next);
        let pairs = |index: usize| x[index].zip(y[index]).and_then(|(x, y)| finite(x - y));
        (format!("({a} - {b})"), [0, 1, 2, 3].map(pairs))
    }

    fn rotation(&mut self, depth: usize) -> (String, Option<Quaternion>) {
        let next = depth.saturating_sub(1);
        if depth == 0 || self.below(3) == 0 {
            let [(a, x), (b, y), (c, z)] = [self.real(next.min(1)), self.real(0), self.real(0)];
            let angles = x.zip(y).zip(z).map(|((x, y), z)| [x, y, z]);
            let text = format!("rotation_from_rpy({a} * 1 rad, {b} * 1 rad, {c} * 1 rad)");
            return (text, angles.map(rotation::from_rpy));
        }
        let (a, x) = self.rotation(next);
        let unit = |rotation: Option<Quaternion>| rotation.and_then(rotation::unit);
        if self.below(3) == 0 {
            return (format!("invert({a})"), unit(x).map(rotation::inverse));
        }
        let (b, y) = self.rotation(next);
        let value = unit(x).zip(unit(y)).map(|(x, y)| rotation::product(x, y));
        (format!("compose({a}, {b})"), value)
    }

    fn pose(&mut self, depth: usize) -> (String, Option<Pose>) {
        let next = depth.saturating_sub(1);
        if depth == 0 || self.below(3) == 0 {
            let ((v, position), (r, orientation)) = (self.vector(next), self.rotation(next));
            let [x, y, z] = position;
            let position = x.zip(y).zip(z).map(|((x, y), z)| [x, y, z]);
            let parts = position.zip(orientation.and_then(rotation::unit));
            let value = parts.map(|(position, orientation)| Pose {
                position,
                orientation,
            });
            return (format!("make_pose({v} * 1 m, {r})"), value);
        }
        let (a, x) = self.pose(next);
        if self.below(3) == 0 {
            let value = x.map(|x| x.inverse()).filter(Pose::is_finite);
            return (format!("invert({a})"), value);
        }
        let (b, y) = self.pose(next);
        let value = x.zip(y).map(|(x, y)| x.compose(&y));
        (format!("compose({a}, {b})"), value.filter(Pose::is_finite))
    }

    /// A tree whose value has several elements.
    fn elements(&mut self, depth: usize) -> (String, Vec<Option<f64>>) {
        match self.below(4) {
            0 => {
                let (text, value) = self.array(depth);
                (text, value.to_vec())
            }
            1 => {
                let (text, value) = self.rotation(depth);
                let value = value.map_or([None; 4], |value| value.map(finite));
                (text, value.to_vec())
            }
            2 => {
                let (text, value) = self.pose(depth);
                let value = value.map_or([None; 7], |value| value.to_slots().map(finite));
                (text, value.to_vec())
            }
            _ => {
                let (text, value) = self.vector(depth);
                (text, value.to_vec())
            }
        }
    }

    /// A tree of any type.
    pub fn tree(&mut self, depth: usize) -> (String, Value) {
        match self.below(4) {
            0 => {
                let (text, value) = self.int(depth);
                (text, Value::Int(value))
            }
            1 => {
                let (text, value) = self.truth(depth);
                (text, Value::Bool(value))
            }
            2 => {
                let (text, value) = self.elements(depth);
                (text, Value::Elements(value))
            }
            _ => {
                let (text, value) = self.real(depth);
                (text, Value::Real(value))
            }
        }
    }
}

fn greatest(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Compares by the bits; null equals null.
pub fn same(found: &[f64], want: &Value) -> bool {
    let real = |found: f64, want: Option<f64>| match want {
        None => found.is_nan(),
        Some(want) => found.to_bits() == want.to_bits(),
    };
    match want {
        Value::Real(want) => real(found[0], *want),
        Value::Int(want) => real(found[0], want.map(|want| want as f64)),
        Value::Bool(want) => real(found[0], want.map(|want| f64::from(u8::from(want)))),
        Value::Elements(want) => {
            let mut pairs = found.iter().zip(want);
            found.len() == want.len() && pairs.all(|(found, want)| real(*found, *want))
        }
    }
}

pub fn maybe<T>(trees: &mut Trees<'_>, value: T) -> Option<T> {
    (trees.below(6) != 0).then_some(value)
}
