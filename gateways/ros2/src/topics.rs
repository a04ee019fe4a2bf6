//! Values of nets' topics as messages of ROS: the type for each of ours, and how a value is encoded. Pure.

use rcc_recording::cdr::CdrWriter;
use serde_json::Value;

/// How a value is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Bool,
    Int,
    Real,
    /// So many numbers without a length: a message of that many fields.
    Fields(usize),
    Reals,
    Ints,
    Bools,
}

/// A type of ours as one of ROS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TopicType {
    /// `PACKAGE/TYPE`.
    pub ros: &'static str,
    kind: Kind,
}

const TYPES: [(&str, &str, Kind); 8] = [
    ("Bool", "std_msgs/Bool", Kind::Bool),
    ("Int", "std_msgs/Int64", Kind::Int),
    ("Real", "std_msgs/Float64", Kind::Real),
    ("Vector3", "geometry_msgs/Vector3", Kind::Fields(3)),
    ("Rotation", "geometry_msgs/Quaternion", Kind::Fields(4)),
    ("Pose", "geometry_msgs/Pose", Kind::Fields(7)),
    ("Twist", "geometry_msgs/Twist", Kind::Fields(6)),
    ("Wrench", "geometry_msgs/Wrench", Kind::Fields(6)),
];
const ARRAYS: [(&str, &str, Kind); 3] = [
    ("Real[", "std_msgs/Float64MultiArray", Kind::Reals),
    ("Int[", "std_msgs/Int64MultiArray", Kind::Ints),
    ("Bool[", "std_msgs/UInt8MultiArray", Kind::Bools),
];

impl TopicType {
    /// Returns the type of ROS for one of ours; `None` if there is none, as for `Text`.
    #[must_use]
    pub fn of(ty: &str) -> Option<TopicType> {
        let whole = TYPES.iter().find(|(ours, ..)| *ours == ty);
        let array = || ARRAYS.iter().find(|(ours, ..)| ty.starts_with(ours));
        let (_, ros, kind) = whole.or_else(array)?;
        Some(TopicType { ros, kind: *kind })
    }

    /// Writes a value as the loader's stream has it. Returns false if there is nothing to send: null has no place in a `Bool`
    /// or an integer. In a floating-point number it is NaN.
    pub fn encode(self, value: &Value, out: &mut CdrWriter) -> bool {
        out.clear();
        match self.kind {
            Kind::Bool => match value.as_bool() {
                Some(value) => out.u8(u8::from(value)),
                None => return false,
            },
            Kind::Int => match value.as_i64() {
                Some(value) => out.i64(value),
                None => return false,
            },
            Kind::Real => out.f64(real(value)),
            Kind::Fields(count) => {
                let elements = value.as_array().map(Vec::as_slice).unwrap_or_default();
                for index in 0..count {
                    out.f64(elements.get(index).map_or(f64::NAN, real));
                }
            }
            Kind::Reals | Kind::Ints | Kind::Bools => return self.array(value, out),
        }
        true
    }

    /// Writes an array: no dimensions, no offset, then the data. An array of `Real` that is null as a whole is an empty one.
    fn array(self, value: &Value, out: &mut CdrWriter) -> bool {
        let elements = value.as_array().map(Vec::as_slice).unwrap_or_default();
        let has_null = value.is_null() || elements.iter().any(Value::is_null);
        if self.kind != Kind::Reals && has_null {
            return false;
        }
        out.length(0);
        out.u32(0);
        out.length(elements.len());
        for element in elements {
            match self.kind {
                Kind::Ints => out.i64(element.as_i64().unwrap_or_default()),
                Kind::Bools => out.u8(u8::from(element.as_bool() == Some(true))),
                _ => out.f64(real(element)),
            }
        }
        true
    }
}

/// Null is NaN; infinities are texts in the loader's JSON.
fn real(value: &Value) -> f64 {
    match value.as_str() {
        Some("inf") => f64::INFINITY,
        Some("-inf") => f64::NEG_INFINITY,
        _ => value.as_f64().unwrap_or(f64::NAN),
    }
}

#[cfg(test)]
mod tests {
    use rcc_recording::cdr::CdrReader;
    use serde_json::json;

    use super::*;

    fn sent(ty: &str, value: &Value) -> Option<Vec<u8>> {
        let mut out = CdrWriter::new();
        let ty = TopicType::of(ty).expect("a type");
        ty.encode(value, &mut out).then(|| out.bytes().to_vec())
    }

    fn reals(message: &[u8], count: usize) -> Vec<f64> {
        let mut reader = CdrReader::new(message).expect("a header");
        (0..count)
            .map(|_| reader.f64().expect("a number"))
            .collect()
    }

    #[test]
    fn each_type_has_one_of_ros() {
        for (ours, ros) in [
            ("Real", "std_msgs/Float64"),
            ("Real[7]", "std_msgs/Float64MultiArray"),
            ("Real[2,3]", "std_msgs/Float64MultiArray"),
            ("Int[2]", "std_msgs/Int64MultiArray"),
            ("Pose", "geometry_msgs/Pose"),
            ("Bool", "std_msgs/Bool"),
        ] {
            assert_eq!(TopicType::of(ours).map(|ty| ty.ros), Some(ros), "{ours}");
        }
        assert_eq!(TopicType::of("Text"), None);
    }

    #[test]
    fn null_is_nan_where_there_is_one_and_silence_elsewhere() {
        let real = sent("Real", &Value::Null).expect("a message");
        assert!(reals(&real, 1)[0].is_nan());
        let pose = sent("Pose", &Value::Null).expect("a message");
        assert!(reals(&pose, 7).iter().all(|value| value.is_nan()));
        assert_eq!(sent("Bool", &Value::Null), None);
        assert_eq!(sent("Int", &Value::Null), None);
        assert_eq!(sent("Int[2]", &json!([1, null])), None);
        assert_eq!(sent("Bool[2]", &Value::Null), None);
        let empty = sent("Real[2]", &Value::Null).expect("a message");
        assert_eq!(empty.len(), 4 + 3 * 4);
        let infinite = sent("Real", &json!("-inf")).expect("a message");
        assert_eq!(reals(&infinite, 1), [f64::NEG_INFINITY]);
    }

    #[test]
    fn an_array_has_its_layout_before_its_data() {
        let message = sent("Real[2]", &json!([1.5, null])).expect("a message");
        let mut reader = CdrReader::new(&message).expect("a header");
        let head = [reader.u32(), reader.u32(), reader.u32()];
        assert_eq!(head, [Some(0), Some(0), Some(2)]);
        assert_eq!(reader.f64(), Some(1.5));
        assert!(reader.f64().is_some_and(f64::is_nan));
    }
}
