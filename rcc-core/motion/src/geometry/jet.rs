//! Numbers and jets (a value with its first three derivatives), so that a curve is written once and yields both. Plain
//! values; the real-time thread evaluates numbers, building a motion evaluates jets.

use core::ops::{Add, Mul, Neg, Sub};

/// The number type of a curve: `f64`, or [`Jet`] for derivatives as well.
pub trait JetScalar:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// A constant, independent of s.
    fn constant(value: f64) -> Self;
    /// The value without derivatives.
    fn value(self) -> f64;
    /// A function applied to this; `of` returns its value and first three derivatives.
    fn through(self, of: impl FnOnce(f64) -> [f64; 4]) -> Self;

    /// As [`JetScalar::through`], for a function whose value alone (`value`) is cheaper than with its derivatives.
    fn through_of(self, value: impl FnOnce(f64) -> f64, of: impl FnOnce(f64) -> [f64; 4]) -> Self;

    /// Multiplied by a number.
    #[must_use]
    fn scaled(self, factor: f64) -> Self;
    /// Divided by a number; exactly 1 if both are equal.
    #[must_use]
    fn over(self, divisor: f64) -> Self;

    /// Sine and cosine.
    #[must_use]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = libm::sincos(self.value());
        (
            self.through(|_| [sin, cos, -sin, -cos]),
            self.through(|_| [cos, -sin, -cos, sin]),
        )
    }

    /// The reciprocal.
    #[must_use]
    fn reciprocal(self) -> Self {
        self.through(|x| {
            let y = 1.0 / x;
            [y, -y * y, 2.0 * y * y * y, -6.0 * y * y * y * y]
        })
    }

    /// The square root.
    #[must_use]
    fn square_root(self) -> Self {
        self.through(|x| {
            let y = libm::sqrt(x);
            let first = 0.5 / y;
            let second = -0.5 * first / x;
            [y, first, second, -1.5 * second / x]
        })
    }
}

impl JetScalar for f64 {
    fn constant(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn scaled(self, factor: f64) -> Self {
        self * factor
    }

    #[inline(always)]
    fn over(self, divisor: f64) -> Self {
        self / divisor
    }

    fn value(self) -> f64 {
        self
    }

    #[inline(always)]
    fn through(self, of: impl FnOnce(f64) -> [f64; 4]) -> Self {
        let [value, ..] = of(self);
        value
    }

    #[inline(always)]
    fn through_of(self, value: impl FnOnce(f64) -> f64, _: impl FnOnce(f64) -> [f64; 4]) -> Self {
        value(self)
    }
}

/// A value and its first three derivatives by s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jet(pub [f64; 4]);

impl Jet {
    /// The variable s itself.
    #[must_use]
    pub fn variable(s: f64) -> Self {
        Self([s, 1.0, 0.0, 0.0])
    }

    /// The derivative of order 0 (the value) to 3; NaN for any other order.
    #[must_use]
    pub fn derivative(self, order: usize) -> f64 {
        self.0.get(order).copied().unwrap_or(f64::NAN)
    }
}

impl JetScalar for Jet {
    fn constant(value: f64) -> Self {
        Self([value, 0.0, 0.0, 0.0])
    }

    fn scaled(self, factor: f64) -> Self {
        Self(self.0.map(|x| x * factor))
    }

    fn over(self, divisor: f64) -> Self {
        Self(self.0.map(|x| x / divisor))
    }

    fn value(self) -> f64 {
        self.0[0]
    }

    /// The chain rule (Faà di Bruno).
    fn through(self, of: impl FnOnce(f64) -> [f64; 4]) -> Self {
        let Self([g, g1, g2, g3]) = self;
        let [f, f1, f2, f3] = of(g);
        Self([
            f,
            f1 * g1,
            f2 * g1 * g1 + f1 * g2,
            f3 * g1 * g1 * g1 + 3.0 * f2 * g1 * g2 + f1 * g3,
        ])
    }

    fn through_of(self, _: impl FnOnce(f64) -> f64, of: impl FnOnce(f64) -> [f64; 4]) -> Self {
        self.through(of)
    }
}

impl Add for Jet {
    type Output = Self;
    fn add(self, Self([e, f, g, h]): Self) -> Self {
        let Self([a, b, c, d]) = self;
        Self([a + e, b + f, c + g, d + h])
    }
}

impl Sub for Jet {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Neg for Jet {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl Mul for Jet {
    type Output = Self;
    /// Leibniz' rule.
    fn mul(self, Self([e, f, g, h]): Self) -> Self {
        let Self([a, b, c, d]) = self;
        Self([
            a * e,
            a * f + b * e,
            a * g + 2.0 * b * f + c * e,
            a * h + 3.0 * (b * g + c * f) + d * e,
        ])
    }
}

/// The product of two quaternions `[x y z w]`.
pub fn product<T: JetScalar>([ax, ay, az, aw]: [T; 4], [bx, by, bz, bw]: [T; 4]) -> [T; 4] {
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

/// The conjugate: the inverse of a unit quaternion.
pub fn conjugate<T: JetScalar>([x, y, z, w]: [T; 4]) -> [T; 4] {
    [-x, -y, -z, w]
}

/// The quaternion of a rotation by `angle` (rad) about `axis` (of length one).
pub fn turn<T: JetScalar>(axis: [f64; 3], angle: T) -> [T; 4] {
    let (sin, cos) = angle.scaled(0.5).sin_cos();
    let [x, y, z] = axis.map(|x| sin.scaled(x));
    [x, y, z, cos]
}

/// Modified Rodrigues parameters of a quaternion: tan(θ/4) times the axis; singular only at a whole turn. Schaub &
/// Junkins, "Analytical Mechanics of Space Systems", section 3.6.
pub fn to_rodrigues<T: JetScalar>([x, y, z, w]: [T; 4]) -> [T; 3] {
    let over = (T::constant(1.0) + w).reciprocal();
    [x * over, y * over, z * over]
}

/// The quaternion of three modified Rodrigues parameters.
pub fn from_rodrigues<T: JetScalar>([x, y, z]: [T; 3]) -> [T; 4] {
    let one = T::constant(1.0);
    let square = x * x + y * y + z * z;
    let over = (one + square).reciprocal();
    let twice = over.scaled(2.0);
    [x * twice, y * twice, z * twice, (one - square) * over]
}
