//! Constants in the predecessor's notation. Used by `rcc-cli convert`.

use std::fmt::Write as _;

use rcc_language::syntax::literal::{Literal, LiteralShape};

use super::TextWriter;
use crate::values::ForeignType;

impl TextWriter<'_, '_> {
    /// Returns a constant in the predecessor's notation.
    pub(super) fn constant(&mut self, literal: &Literal, ty: ForeignType) -> String {
        let numbers = match &literal.shape {
            LiteralShape::List(elements) => elements
                .iter()
                .map(Literal::number)
                .collect::<Option<Vec<_>>>(),
            _ => None,
        };
        let mut text = String::new();
        // Writing into a String cannot fail.
        let _ = match (&literal.shape, numbers.as_deref(), ty) {
            (LiteralShape::Bool(value), ..) => write!(text, "{value}"),
            (LiteralShape::Int(value), ..) => write!(text, "{value}"),
            (LiteralShape::Real(value, _), ..) => write!(text, "{value:?}"),
            (LiteralShape::Null, _, ForeignType::Double | ForeignType::Time) => write!(text, "nan"),
            (LiteralShape::Text(name), ..) => {
                write!(text, "{}", name.replace('\\', "\\\\").replace('\'', "\\'"))
            }
            (_, Some([x, y, z]), ForeignType::Vector) => {
                write!(text, "{{x:{x:?},y:{y:?},z:{z:?}}}")
            }
            (_, Some([a, b, c, d, e, f]), ForeignType::Twist) => {
                write!(
                    text,
                    "{{vel:{{x:{a:?},y:{b:?},z:{c:?}}},rot:{{x:{d:?},y:{e:?},z:{f:?}}}}}"
                )
            }
            (_, Some([a, b, c, d, e, f]), ForeignType::Wrench) => {
                write!(
                    text,
                    "{{force:{{x:{a:?},y:{b:?},z:{c:?}}},torque:{{x:{d:?},y:{e:?},z:{f:?}}}}}"
                )
            }
            (LiteralShape::Rotation(q), ..) => write!(text, "{{{}}}", angles(*q)),
            (LiteralShape::Pose([x, y, z, q @ ..]), ..) => {
                write!(
                    text,
                    "{{pos:{{x:{x:?},y:{y:?},z:{z:?}}},rot:{{{}}}}}",
                    angles(*q)
                )
            }
            _ => {
                self.refuse(literal.span, format!("the constant {literal}"));
                Ok(())
            }
        };
        text
    }
}

/// Returns the rotation as turns about z, y and x: `a:…,b:…,c:…`, rad.
fn angles(orientation: [f64; 4]) -> String {
    let [roll, pitch, yaw] = rcc_core::rotation::to_rpy(orientation);
    format!("a:{yaw:?},b:{pitch:?},c:{roll:?}")
}
