//! Units of ports: exponents of metre, kilogram, second, ampere, kelvin and radian.
//!
//! Values are SI everywhere inside; only text has scaled units. Used off the real-time thread.

use core::f64::consts::PI;
use core::fmt;

/// A product of powers of base units. The radian counts as a base unit, so that an angle is not mistaken for a
/// dimensionless number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Unit {
    /// Exponents of m, kg, s, A, K, rad.
    pub exponents: [i8; 6],
}

const BASE: [&str; 6] = ["m", "kg", "s", "A", "K", "rad"];

const fn unit(m: i8, kg: i8, s: i8, a: i8, k: i8, rad: i8) -> Unit {
    Unit {
        exponents: [m, kg, s, a, k, rad],
    }
}

impl Unit {
    /// Dimensionless.
    pub const ONE: Unit = unit(0, 0, 0, 0, 0, 0);
    /// Length.
    pub const METRE: Unit = unit(1, 0, 0, 0, 0, 0);
    /// Mass.
    pub const KILOGRAM: Unit = unit(0, 1, 0, 0, 0, 0);
    /// Time.
    pub const SECOND: Unit = unit(0, 0, 1, 0, 0, 0);
    /// Angle.
    pub const RADIAN: Unit = unit(0, 0, 0, 0, 0, 1);
    /// Force.
    pub const NEWTON: Unit = unit(1, 1, -2, 0, 0, 0);
    /// Torque.
    pub const NEWTON_METRE: Unit = unit(2, 1, -2, 0, 0, 0);
    /// Frequency.
    pub const HERTZ: Unit = unit(0, 0, -1, 0, 0, 0);
    /// Speed.
    pub const METRE_PER_SECOND: Unit = unit(1, 0, -1, 0, 0, 0);
    /// Acceleration.
    pub const METRE_PER_SECOND2: Unit = unit(1, 0, -2, 0, 0, 0);
    /// Jerk.
    pub const METRE_PER_SECOND3: Unit = unit(1, 0, -3, 0, 0, 0);
    /// Angular speed.
    pub const RADIAN_PER_SECOND: Unit = unit(0, 0, -1, 0, 0, 1);
    /// Angular acceleration.
    pub const RADIAN_PER_SECOND2: Unit = unit(0, 0, -2, 0, 0, 1);
    /// Angular jerk.
    pub const RADIAN_PER_SECOND3: Unit = unit(0, 0, -3, 0, 0, 1);

    /// Returns the unit of joint positions, divided by `order` seconds: rad, or m for linear axes.
    #[must_use]
    pub fn of_joints(linear: bool, order: u8) -> Unit {
        let position = match linear {
            true => Unit::METRE,
            false => Unit::RADIAN,
        };
        (0..order).fold(position, |unit, _| unit.per(Unit::SECOND))
    }

    /// Returns the unit of a product.
    pub const fn times(self, other: Unit) -> Unit {
        self.combine(other, 1)
    }

    /// Returns the unit of a quotient.
    pub const fn per(self, other: Unit) -> Unit {
        self.combine(other, -1)
    }

    /// Returns the square root of the unit; `None` if an exponent is odd.
    pub const fn root(self) -> Option<Unit> {
        let [a, b, c, d, e, f] = self.exponents;
        if (a | b | c | d | e | f) & 1 != 0 {
            return None;
        }
        Some(unit(a / 2, b / 2, c / 2, d / 2, e / 2, f / 2))
    }

    const fn combine(self, other: Unit, sign: i8) -> Unit {
        let [a, b, c, d, e, f] = self.exponents;
        let [u, v, w, x, y, z] = other.exponents;
        Unit {
            exponents: [
                a.saturating_add(u.saturating_mul(sign)),
                b.saturating_add(v.saturating_mul(sign)),
                c.saturating_add(w.saturating_mul(sign)),
                d.saturating_add(x.saturating_mul(sign)),
                e.saturating_add(y.saturating_mul(sign)),
                f.saturating_add(z.saturating_mul(sign)),
            ],
        }
    }

    /// Returns the name of the unit, such as `N`; `None` if it has none of its own, as `m/s`.
    pub fn name(self) -> Option<&'static str> {
        let mut names = UNIT_NAMES.iter();
        let named = names.find(|named| named.unit == self && named.factor == 1.0)?;
        Some(named.name)
    }

    /// Parses `m/s`, `N`, `deg/s^2`, `mm`, …; returns the SI unit and the factor to it. `None` if a name is not in
    /// [`UNIT_NAMES`], or a power is above 8 or below -8.
    pub fn parse(text: &str) -> Option<(Unit, f64)> {
        let mut result = (Unit::ONE, 1.0);
        let mut sign = 1;
        let mut rest = text.trim();
        loop {
            let end = rest.find(['*', '/', '·']).unwrap_or(rest.len());
            let (factor, tail) = rest.split_at_checked(end)?;
            let (name, power) = match factor.split_once('^') {
                Some((name, power)) => (name.trim(), power.trim().parse::<i8>().ok()?),
                None => (factor.trim(), 1),
            };
            let named = UNIT_NAMES.iter().find(|named| named.name == name)?;
            let count = Some(power.unsigned_abs()).filter(|count| *count <= POWER_MAX)?;
            for _ in 0..count {
                let step = sign * power.signum();
                result.0 = result.0.combine(named.unit, step);
                result.1 *= if step > 0 {
                    named.factor
                } else {
                    1.0 / named.factor
                };
            }
            let mut symbols = tail.chars();
            match symbols.next() {
                None => return Some(result),
                Some('/') => sign = -1,
                Some(_) => sign = 1,
            }
            rest = symbols.as_str();
        }
    }
}

/// Largest power in a text: more than any quantity of physics has, and far from the limits of an `i8`.
const POWER_MAX: u8 = 8;

/// A unit name that text may use.
#[derive(Clone, Copy, Debug)]
pub struct UnitName {
    /// As written.
    pub name: &'static str,
    /// Value in SI = value × factor.
    pub factor: f64,
    /// The SI unit.
    pub unit: Unit,
}

const fn named(name: &'static str, factor: f64, unit: Unit) -> UnitName {
    UnitName { name, factor, unit }
}

/// All names; the first name of a unit is the one that is printed.
pub const UNIT_NAMES: &[UnitName] = &[
    named("1", 1.0, Unit::ONE),
    named("m", 1.0, Unit::METRE),
    named("mm", 1e-3, Unit::METRE),
    named("um", 1e-6, Unit::METRE),
    named("kg", 1.0, Unit::KILOGRAM),
    named("g", 1e-3, Unit::KILOGRAM),
    named("s", 1.0, Unit::SECOND),
    named("ms", 1e-3, Unit::SECOND),
    named("us", 1e-6, Unit::SECOND),
    named("min", 60.0, Unit::SECOND),
    named("A", 1.0, unit(0, 0, 0, 1, 0, 0)),
    named("mA", 1e-3, unit(0, 0, 0, 1, 0, 0)),
    named("K", 1.0, unit(0, 0, 0, 0, 1, 0)),
    named("rad", 1.0, Unit::RADIAN),
    named("deg", PI / 180.0, Unit::RADIAN),
    named("N", 1.0, Unit::NEWTON),
    named("kN", 1e3, Unit::NEWTON),
    named("N·m", 1.0, Unit::NEWTON_METRE),
    named("Nm", 1.0, Unit::NEWTON_METRE),
    named("Hz", 1.0, Unit::HERTZ),
    named("kHz", 1e3, Unit::HERTZ),
    named("Pa", 1.0, unit(-1, 1, -2, 0, 0, 0)),
    named("bar", 1e5, unit(-1, 1, -2, 0, 0, 0)),
    named("W", 1.0, unit(2, 1, -3, 0, 0, 0)),
    named("V", 1.0, unit(2, 1, -3, -1, 0, 0)),
    named("mV", 1e-3, unit(2, 1, -3, -1, 0, 0)),
    named("%", 0.01, Unit::ONE),
];

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(name) = self.name() {
            return f.write_str(name);
        }
        let mut any = false;
        for (name, &power) in BASE
            .iter()
            .zip(&self.exponents)
            .filter(|(_, power)| **power > 0)
        {
            write_power(f, if any { "*" } else { "" }, name, power)?;
            any = true;
        }
        if !any {
            f.write_str("1")?;
        }
        for (name, &power) in BASE
            .iter()
            .zip(&self.exponents)
            .filter(|(_, power)| **power < 0)
        {
            write_power(f, "/", name, -power)?;
        }
        Ok(())
    }
}

fn write_power(f: &mut fmt::Formatter<'_>, before: &str, name: &str, power: i8) -> fmt::Result {
    match power {
        1 => write!(f, "{before}{name}"),
        _ => write!(f, "{before}{name}^{power}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn printed_units_can_be_parsed() {
        for unit in [
            Unit::ONE,
            Unit::NEWTON,
            Unit::METRE_PER_SECOND3,
            Unit::RADIAN_PER_SECOND2,
            Unit::NEWTON_METRE.per(Unit::RADIAN),
        ] {
            let text = unit.to_string();
            assert_eq!(Unit::parse(&text), Some((unit, 1.0)), "{text}");
        }
    }

    #[test]
    fn scaled_names_carry_their_factor() {
        assert_eq!(Unit::parse("mm"), Some((Unit::METRE, 1e-3)));
        let (unit, factor) = Unit::parse("deg/s").unwrap();
        assert_eq!(unit, Unit::RADIAN_PER_SECOND);
        assert!((factor - PI / 180.0).abs() < 1e-17);
    }

    #[test]
    fn powers_up_to_eight_are_exact() {
        let power = |power: i8| unit(power, 0, 0, 0, 0, 0);
        assert_eq!(Unit::parse("m^8"), Some((power(8), 1.0)));
        assert_eq!(Unit::parse("1/m^8"), Some((power(-8), 1.0)));
        assert_eq!(Unit::parse("m^-8"), Some((power(-8), 1.0)));
    }

    #[test]
    fn only_even_powers_have_a_root() {
        let area = Unit::METRE.times(Unit::METRE);
        assert_eq!(area.root(), Some(Unit::METRE));
        assert_eq!(Unit::ONE.per(area).root(), Some(Unit::ONE.per(Unit::METRE)));
        assert_eq!(Unit::METRE.root(), None);
        assert_eq!(Unit::ONE.root(), Some(Unit::ONE));
    }

    #[test]
    fn an_unknown_name_or_power_is_refused() {
        assert_eq!(Unit::parse("furlong"), None);
        assert_eq!(Unit::parse("m/"), None);
        assert_eq!(Unit::parse("m^9"), None);
        assert_eq!(Unit::parse("m^-9"), None);
        assert_eq!(Unit::parse("m^-128"), None);
        assert_eq!(Unit::parse(""), None);
    }
}
