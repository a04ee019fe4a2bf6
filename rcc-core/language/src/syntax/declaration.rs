//! Types and units as a text declares them: `Real[7]`, `m/s`. Runs on the loader's threads.

use rcc_core::types::{ELEMENTS_MAX, Type};
use rcc_core::unit::Unit;

/// The types of ports, as help text.
pub const TYPES: &str = "types: Bool, Int, Real, Vector3, Rotation, Pose, Twist, Wrench, Bool[n], Int[n], Real[n], Real[r,c]";
/// Units, as help text.
pub const UNITS: &str = "write an SI unit such as `m/s`, `N`, `rad`, or `1`";

/// Parses a type as it is printed: `Real`, `Real[7]`, `Real[4,4]`, `Pose`.
#[must_use]
pub fn parse_type(text: &str) -> Option<Type> {
    let text = text.trim();
    let Some((name, sizes)) = text.split_once('[') else {
        return Some(match text {
            "Bool" => Type::Bool,
            "Int" => Type::Int,
            "Real" => Type::Real,
            "Text" => Type::Text,
            "Vector3" => Type::Vector3,
            "Rotation" => Type::Rotation,
            "Pose" => Type::Pose,
            "Twist" => Type::Twist,
            "Wrench" => Type::Wrench,
            _ => return None,
        });
    };
    let sizes = sizes.strip_suffix(']')?;
    if let Some((rows, columns)) = sizes.split_once(',') {
        let size = |text: &str| text.trim().parse().ok().filter(|size: &u8| *size > 0);
        return (name == "Real").then_some(Type::Matrix(size(rows)?, size(columns)?));
    }
    let length = sizes.trim().parse().ok()?;
    let length = Some(length).filter(|length| (1..=ELEMENTS_MAX).contains(length))?;
    match name {
        "Bool" => Some(Type::Bools(length)),
        "Int" => Some(Type::Ints(length)),
        "Real" => Some(Type::Reals(length)),
        _ => None,
    }
}

/// Parses a coherent SI unit: `m/s`, but not `mm/s`.
#[must_use]
pub fn si_unit(text: &str) -> Option<Unit> {
    let (unit, factor) = Unit::parse(text)?;
    #[allow(clippy::float_cmp)] // The factor of a coherent SI unit is exactly 1.
    let is_si = factor == 1.0;
    is_si.then_some(unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_type_is_read_as_it_is_printed() {
        for ty in [
            Type::Bool,
            Type::Int,
            Type::Real,
            Type::Text,
            Type::Vector3,
            Type::Rotation,
            Type::Pose,
            Type::Twist,
            Type::Wrench,
            Type::Reals(7),
            Type::Bools(1),
            Type::Ints(1024),
            Type::TRANSFORM,
        ] {
            assert_eq!(parse_type(&ty.to_string()), Some(ty));
        }
        for text in [
            "real",
            "Real[0]",
            "Real[1025]",
            "Real[2",
            "Pose[2]",
            "Bool[2,2]",
            "Real[-1]",
        ] {
            assert_eq!(parse_type(text), None, "{text}");
        }
    }
}
