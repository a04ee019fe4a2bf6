//! Values as the library writes them (`true`, `1.0E-4`, `{pos:{x:1.0,…},rot:{…}}`, `[a,b]`) and as the REST interface
//! does. Pure functions.

use rcc_config::diagnostic::Span;
use rcc_core::pose::Pose;
use rcc_directionet::values::{ForeignType, read};
use rcc_language::syntax::literal::{Literal, LiteralShape};
use serde_json::{Value, json};

/// Returns the text for a value of a net; `None` for null, which is not reported, and for a type that the library does
/// not have.
#[must_use]
pub fn to_library(type_name: &str, value: &Value) -> Option<String> {
    if value.is_null() {
        return None;
    }
    if let Some((element, _)) = type_name.split_once('[') {
        let elements = value.as_array()?.iter();
        // In an array of numbers null is NaN, which the library has a text for.
        let texts: Option<Vec<String>> = elements
            .map(|value| match (element, value) {
                ("Real", Value::Null) => Some("nan".to_owned()),
                _ => to_library(element, value),
            })
            .collect();
        return Some(format!("[{}]", texts?.join(",")));
    }
    match type_name {
        "Bool" => Some(value.as_bool()?.to_string()),
        "Int" => Some(value.as_i64()?.to_string()),
        "Real" => number(value),
        "Vector3" => vector(&numbers(value)?),
        "Rotation" => rotation(&numbers(value)?),
        "Pose" => {
            let all = numbers(value)?;
            let (position, orientation) = all.split_at_checked(3)?;
            Some(format!(
                "{{pos:{},rot:{}}}",
                vector(position)?,
                rotation(orientation)?
            ))
        }
        "Twist" => pair(&numbers(value)?, "vel", "rot"),
        "Wrench" => pair(&numbers(value)?, "force", "torque"),
        _ => None,
    }
}

fn numbers(value: &Value) -> Option<Vec<f64>> {
    let elements = value.as_array()?.iter();
    elements.map(as_real).collect()
}

/// Returns a number; infinity is a text in JSON.
fn as_real(value: &Value) -> Option<f64> {
    match value {
        Value::String(text) => text.parse().ok(),
        value => value.as_f64(),
    }
}

fn number(value: &Value) -> Option<String> {
    as_real(value).map(written)
}

/// Writes a number as the library reads it: it knows `nan`, `+inf` and `-inf` only.
fn written(number: f64) -> String {
    match number {
        f64::INFINITY => "+inf".to_owned(),
        f64::NEG_INFINITY => "-inf".to_owned(),
        number if number.is_nan() => "nan".to_owned(),
        number => format!("{number:?}"),
    }
}

fn vector(values: &[f64]) -> Option<String> {
    let [x, y, z] = <[f64; 3]>::try_from(values).ok()?.map(written);
    Some(format!("{{x:{x},y:{y},z:{z}}}"))
}

/// Writes a unit quaternion `[x y z w]` as `a`, `b`, `c`: yaw, pitch and roll, rad.
fn rotation(quaternion: &[f64]) -> Option<String> {
    let [x, y, z, w] = <[f64; 4]>::try_from(quaternion).ok()?;
    // Third row and first column of the rotation matrix, and the second row where the pitch leaves a and c undetermined.
    let sine = 2.0 * (w * y - x * z);
    let [a, b, c] = match sine.abs() > 1.0 - 1e-12 {
        true => {
            let a = f64::atan2(2.0 * (z * w - x * y), 1.0 - 2.0 * (x * x + z * z));
            [a, std::f64::consts::FRAC_PI_2.copysign(sine), 0.0]
        }
        false => [
            f64::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
            sine.asin(),
            f64::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        ],
    };
    let [a, b, c] = [a, b, c].map(written);
    Some(format!("{{a:{a},b:{b},c:{c}}}"))
}

fn pair(values: &[f64], first: &str, second: &str) -> Option<String> {
    let (linear, angular) = values.split_at_checked(3)?;
    let (linear, angular) = (vector(linear)?, vector(angular)?);
    Some(format!("{{{first}:{linear},{second}:{angular}}}"))
}

/// Reads a value for an input of a net, as JSON of the REST interface.
///
/// # Errors
/// Returns what was expected instead.
pub fn from_library(type_name: &str, text: &str) -> Result<Value, String> {
    let (element, is_array) = match type_name.split_once('[') {
        Some((element, _)) => (element, true),
        None => (type_name, false),
    };
    let ty = match element {
        "Bool" => ForeignType::Bool,
        "Int" => ForeignType::Int,
        "Real" => ForeignType::Double,
        "Vector3" => ForeignType::Vector,
        "Rotation" => ForeignType::Rotation,
        "Pose" => ForeignType::Frame,
        "Twist" => ForeignType::Twist,
        "Wrench" => ForeignType::Wrench,
        other => return Err(format!("no value of type {other} can be set")),
    };
    let text = match text {
        "+inf" => "inf",
        text => text,
    };
    let literal = read(text, Span::default(), ty, is_array);
    let literal = literal.map_err(|diagnostic| diagnostic.message.clone())?;
    as_json(&literal).ok_or_else(|| format!("`{text}` cannot be set"))
}

fn as_json(literal: &Literal) -> Option<Value> {
    Some(match &literal.shape {
        LiteralShape::Null => Value::Null,
        LiteralShape::Bool(value) => json!(value),
        LiteralShape::Int(value) => json!(value),
        LiteralShape::Real(value, _) => json!(value),
        LiteralShape::Rotation(quaternion) => json!({"quat": quaternion}),
        LiteralShape::Pose([x, y, z, orientation @ ..]) => {
            json!({"xyz": [x, y, z], "quat": orientation})
        }
        LiteralShape::List(elements) => {
            Value::Array(elements.iter().map(as_json).collect::<Option<_>>()?)
        }
        _ => return None,
    })
}

/// Returns `[a b c]` as a unit quaternion `[x y z w]`.
#[must_use]
pub fn quaternion_of([a, b, c]: [f64; 3]) -> [f64; 4] {
    Pose::from_xyz_rpy([0.0; 3], [c, b, a]).orientation
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_is_written_without_blanks() {
        for (ty, value, text) in [
            ("Bool", json!(true), "true"),
            ("Int", json!(-12), "-12"),
            ("Real", json!(0.1), "0.1"),
            ("Real", json!(1), "1.0"),
            ("Real", json!("inf"), "+inf"),
            ("Real", json!("-inf"), "-inf"),
            ("Real[2]", json!([1.5, null]), "[1.5,nan]"),
            ("Bool[2]", json!([true, false]), "[true,false]"),
            ("Vector3", json!([1, 2, 3.5]), "{x:1.0,y:2.0,z:3.5}"),
            ("Rotation", json!([0, 0, 0, 1]), "{a:0.0,b:0.0,c:0.0}"),
            (
                "Twist",
                json!([1, 2, 3, 4, 5, 6]),
                "{vel:{x:1.0,y:2.0,z:3.0},rot:{x:4.0,y:5.0,z:6.0}}",
            ),
            (
                "Wrench",
                json!([1, 2, 3, 4, 5, 6]),
                "{force:{x:1.0,y:2.0,z:3.0},torque:{x:4.0,y:5.0,z:6.0}}",
            ),
        ] {
            assert_eq!(to_library(ty, &value).as_deref(), Some(text), "{ty}");
        }
    }

    #[test]
    fn null_is_not_reported() {
        for (ty, value) in [
            ("Bool", Value::Null),
            ("Pose", Value::Null),
            ("Bool[2]", json!([true, null])),
        ] {
            assert_eq!(to_library(ty, &value), None, "{ty}");
        }
    }

    #[test]
    fn a_rotation_comes_back_as_the_same_orientation() {
        let right = std::f64::consts::FRAC_PI_2;
        for angles in [
            [0.3, -0.2, 1.1],
            [-3.0, 1.5, 3.1],
            [2.0, right, 0.0],
            [-1.0, -right, 0.5],
            [0.0, std::f64::consts::PI, 0.0],
        ] {
            let given = quaternion_of(angles);
            let text = to_library("Rotation", &json!(given)).expect("a rotation");
            let read = from_library("Rotation", &text).expect("a rotation");
            let back: Vec<f64> = numbers(&read["quat"]).expect("numbers");
            let dot: f64 = back.iter().zip(given).map(|(a, b)| a * b).sum();
            assert!(
                (dot.abs() - 1.0).abs() < 1e-12,
                "{angles:?}: {text} {back:?} {given:?}"
            );
        }
    }

    #[test]
    fn values_of_the_library_become_constants() {
        for (ty, text, value) in [
            ("Real", "1.0E-4", json!(1e-4)),
            ("Real", "nan", Value::Null),
            ("Bool", "true", json!(true)),
            ("Int", "-3", json!(-3)),
            ("Real[3]", "[1, 2,3.5]", json!([1.0, 2.0, 3.5])),
            ("Vector3", "{x:1,z:2}", json!([1.0, 0.0, 2.0])),
            (
                "Pose",
                "{pos:{x:1},rot:{}}",
                json!({"xyz": [1.0, 0.0, 0.0], "quat": [0.0, 0.0, 0.0, 1.0]}),
            ),
        ] {
            assert_eq!(from_library(ty, text), Ok(value), "{ty}");
        }
        for (ty, text) in [
            ("Real", "x"),
            ("Bool", "1"),
            ("Real[2]", "1"),
            ("Text", "a"),
        ] {
            assert!(from_library(ty, text).is_err(), "{ty} {text}");
        }
    }
}
