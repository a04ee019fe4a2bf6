//! Parameters of the predecessor as constants: `1.0E-4`, `true`, `{pos:{x:1},rot:{a:0.1}}`, `[1,2]`. Malformed values,
//! which the predecessor silently read as 0, are refused. Runs on the loader's threads.

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_core::pose::Pose;
use rcc_core::types::Type as RccType;
use rcc_language::codes;
use rcc_language::syntax::literal::{Literal, LiteralShape};

/// A type of the predecessor's ports and parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ForeignType {
    /// `bool`.
    Bool,
    /// `int`; also the unsigned parameters of four types, which the predecessor could not set.
    Int,
    /// `double`.
    Double,
    /// `string`.
    Text,
    /// `nsecs`: seconds in a Real here.
    Time,
    /// `Vector`.
    Vector,
    /// `Rotation`.
    Rotation,
    /// `Frame`: a Pose.
    Frame,
    /// `Twist`.
    Twist,
    /// `Wrench`.
    Wrench,
    /// The element type of a family.
    Any,
    /// `matrix`, which no net contains.
    Matrix,
}

impl ForeignType {
    /// Returns the type with this name, without `[]`.
    #[must_use]
    pub fn named(name: &str) -> Option<ForeignType> {
        Some(match name {
            "bool" => ForeignType::Bool,
            "int" | "uint" => ForeignType::Int,
            "double" => ForeignType::Double,
            "string" => ForeignType::Text,
            "nsecs" => ForeignType::Time,
            "Vector" => ForeignType::Vector,
            "Rotation" => ForeignType::Rotation,
            "Frame" => ForeignType::Frame,
            "Twist" => ForeignType::Twist,
            "Wrench" => ForeignType::Wrench,
            "T" => ForeignType::Any,
            "matrix" => ForeignType::Matrix,
            _ => return None,
        })
    }

    /// Returns the RCC type; `None` if it is not a port type.
    #[must_use]
    pub fn rcc_type(self) -> Option<RccType> {
        Some(match self {
            ForeignType::Bool => RccType::Bool,
            ForeignType::Int => RccType::Int,
            ForeignType::Double | ForeignType::Time => RccType::Real,
            ForeignType::Vector => RccType::Vector3,
            ForeignType::Rotation => RccType::Rotation,
            ForeignType::Frame => RccType::Pose,
            ForeignType::Twist => RccType::Twist,
            ForeignType::Wrench => RccType::Wrench,
            ForeignType::Text | ForeignType::Any | ForeignType::Matrix => return None,
        })
    }

    /// Returns the default value.
    #[must_use]
    pub fn zero(self, span: Span) -> Literal {
        let real = |span| Literal::new(LiteralShape::Real(0.0, None), span);
        let shape = match self {
            ForeignType::Bool => LiteralShape::Bool(false),
            ForeignType::Int => LiteralShape::Int(0),
            ForeignType::Double | ForeignType::Time | ForeignType::Any | ForeignType::Matrix => {
                LiteralShape::Real(0.0, None)
            }
            ForeignType::Text => LiteralShape::Text(String::new()),
            ForeignType::Vector => LiteralShape::List(vec![real(span); 3]),
            ForeignType::Twist | ForeignType::Wrench => LiteralShape::List(vec![real(span); 6]),
            ForeignType::Rotation => LiteralShape::Rotation([0.0, 0.0, 0.0, 1.0]),
            ForeignType::Frame => LiteralShape::Pose([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        };
        Literal::new(shape, span)
    }
}

/// Parses a constant.
///
/// # Errors
/// Returns a diagnostic with the span in the text if the constant does not have the type.
pub fn read(
    text: &str,
    span: Span,
    ty: ForeignType,
    array: bool,
) -> Result<Literal, Box<Diagnostic>> {
    let mut reader = ValueParser { text, at: 0, span };
    let shape = match (ty, array) {
        (ForeignType::Text, _) => {
            return Ok(Literal::new(LiteralShape::Text(text.to_string()), span));
        }
        (_, true) => reader.list(ty)?,
        (_, false) => reader.value(ty)?,
    };
    reader.blanks();
    if reader.at < text.len() {
        return Err(reader.wrong(ty));
    }
    Ok(Literal::new(shape, span))
}

struct ValueParser<'t> {
    text: &'t str,
    at: usize,
    span: Span,
}

type ParseResult<T> = Result<T, Box<Diagnostic>>;

impl<'t> ValueParser<'t> {
    fn wrong(&self, ty: ForeignType) -> Box<Diagnostic> {
        let wanted = match ty {
            ForeignType::Bool => "`true` or `false`",
            ForeignType::Int => "a whole number",
            ForeignType::Vector => "a vector such as `{x:1,y:2,z:3}`",
            ForeignType::Rotation => "a rotation such as `{a:1,b:2,c:3}`, rad",
            ForeignType::Frame => "a frame such as `{pos:{x:1,y:2,z:3},rot:{a:1,b:2,c:3}}`",
            ForeignType::Twist => "a twist such as `{vel:{x:1,y:2,z:3},rot:{x:1,y:2,z:3}}`",
            ForeignType::Wrench => "a wrench such as `{force:{x:1,y:2,z:3},torque:{x:1,y:2,z:3}}`",
            _ => "a number",
        };
        let message = format!("`{}` is not {wanted}", shortened(self.text));
        let diagnostic = Diagnostic::error(codes::BAD_QUANTITY, self.span, message);
        Box::new(
            diagnostic.help("correct it: the predecessor silently read 0, false or a part of it"),
        )
    }

    fn blanks(&mut self) {
        let rest = self.text.get(self.at..).unwrap_or_default();
        self.at += rest.len() - rest.trim_start().len();
    }

    fn take(&mut self, c: char) -> bool {
        self.blanks();
        let there = self
            .text
            .get(self.at..)
            .is_some_and(|rest| rest.starts_with(c));
        self.at += if there { c.len_utf8() } else { 0 };
        there
    }

    fn word(&mut self) -> &'t str {
        self.blanks();
        let rest = self.text.get(self.at..).unwrap_or_default();
        let end = rest.find(|c: char| ",:{}[]".contains(c) || c.is_whitespace());
        let word = rest.get(..end.unwrap_or(rest.len())).unwrap_or_default();
        self.at += word.len();
        word
    }

    fn value(&mut self, ty: ForeignType) -> ParseResult<LiteralShape> {
        Ok(match ty {
            ForeignType::Bool => match self.word() {
                "true" => LiteralShape::Bool(true),
                "false" => LiteralShape::Bool(false),
                _ => return Err(self.wrong(ty)),
            },
            ForeignType::Int => match self.word().parse() {
                Ok(value) => LiteralShape::Int(value),
                Err(_) => return Err(self.wrong(ty)),
            },
            ForeignType::Vector => LiteralShape::List(self.numbers(ty, &["x", "y", "z"])?),
            ForeignType::Rotation => {
                let [a, b, c] = self.three(ty, ["a", "b", "c"])?;
                LiteralShape::Rotation(Pose::from_xyz_rpy([0.0; 3], [c, b, a]).orientation)
            }
            ForeignType::Frame => {
                let [mut position, mut rotation] = [[0.0; 3]; 2];
                self.members(ty, |reader, name| {
                    match name {
                        "pos" => position = reader.three(ty, ["x", "y", "z"])?,
                        "rot" => rotation = reader.three(ty, ["a", "b", "c"])?,
                        _ => return Err(reader.wrong(ty)),
                    }
                    Ok(())
                })?;
                let [a, b, c] = rotation;
                let pose = Pose::from_xyz_rpy(position, [c, b, a]);
                let ([x, y, z], [qx, qy, qz, qw]) = (pose.position, pose.orientation);
                LiteralShape::Pose([x, y, z, qx, qy, qz, qw])
            }
            ForeignType::Twist => self.six(ty, "vel", "rot")?,
            ForeignType::Wrench => self.six(ty, "force", "torque")?,
            _ => {
                let value = self.number(ty)?;
                if value.is_nan() {
                    LiteralShape::Null
                } else {
                    LiteralShape::Real(value, None)
                }
            }
        })
    }

    /// Parses a number as Java and C++ print it. NaN, which is null here, is allowed only as a single number.
    fn number(&mut self, ty: ForeignType) -> ParseResult<f64> {
        match self.word() {
            "nan" | "NaN" if ty == ForeignType::Double => Ok(f64::NAN),
            word => match word.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(self.wrong(ty)),
            },
        }
    }

    /// Parses `{name: …, name: …}` in any order; members that are not given keep their defaults.
    fn members(
        &mut self,
        ty: ForeignType,
        mut member: impl FnMut(&mut Self, &str) -> ParseResult<()>,
    ) -> ParseResult<()> {
        if !self.take('{') {
            return Err(self.wrong(ty));
        }
        while !self.take('}') {
            let name = self.word();
            if name.is_empty() || !self.take(':') {
                return Err(self.wrong(ty));
            }
            member(self, name)?;
            self.take(',');
        }
        Ok(())
    }

    fn three(&mut self, ty: ForeignType, names: [&str; 3]) -> ParseResult<[f64; 3]> {
        let mut values = [0.0; 3];
        self.members(ty, |reader, name| {
            let place = names.iter().position(|known| *known == name);
            let Some(place) = place.and_then(|place| values.get_mut(place)) else {
                return Err(reader.wrong(ty));
            };
            *place = reader.number(ty)?;
            Ok(())
        })?;
        Ok(values)
    }

    fn numbers(&mut self, ty: ForeignType, names: &[&str; 3]) -> ParseResult<Vec<Literal>> {
        let values = self.three(ty, *names)?;
        Ok(reals(&values, self.span))
    }

    fn six(&mut self, ty: ForeignType, first: &str, second: &str) -> ParseResult<LiteralShape> {
        let mut values = [[0.0; 3]; 2];
        let [linear, angular] = &mut values;
        self.members(ty, |reader, name| {
            let place = match name {
                name if name == first => &mut *linear,
                name if name == second => &mut *angular,
                _ => return Err(reader.wrong(ty)),
            };
            *place = reader.three(ty, ["x", "y", "z"])?;
            Ok(())
        })?;
        Ok(LiteralShape::List(reals(values.as_flattened(), self.span)))
    }

    fn list(&mut self, ty: ForeignType) -> ParseResult<LiteralShape> {
        if !self.take('[') {
            return Err(self.wrong(ty));
        }
        let mut elements = Vec::new();
        while !self.take(']') {
            let before = self.at;
            let shape = self.value(ty)?;
            if self.at == before {
                return Err(self.wrong(ty));
            }
            elements.push(Literal::new(shape, self.span));
            self.take(',');
        }
        Ok(LiteralShape::List(elements))
    }
}

fn reals(values: &[f64], span: Span) -> Vec<Literal> {
    let real = |value: &f64| Literal::new(LiteralShape::Real(*value, None), span);
    values.iter().map(real).collect()
}

/// Returns at most 40 characters of a text.
fn shortened(text: &str) -> String {
    match text.char_indices().nth(40) {
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
        None => text.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(text: &str, ty: ForeignType) -> LiteralShape {
        read(text, Span::default(), ty, false).unwrap().shape
    }

    #[test]
    fn numbers_are_read_as_java_and_c_write_them() {
        for (text, value) in [
            ("1.0E-4", 1e-4),
            ("-0.0", -0.0),
            ("3", 3.0),
            ("+2.5e3", 2500.0),
        ] {
            assert_eq!(
                shape(text, ForeignType::Double),
                LiteralShape::Real(value, None),
                "{text}"
            );
        }
        assert_eq!(shape("nan", ForeignType::Double), LiteralShape::Null);
        assert_eq!(shape("-12", ForeignType::Int), LiteralShape::Int(-12));
        assert_eq!(shape("true", ForeignType::Bool), LiteralShape::Bool(true));
    }

    #[test]
    fn composites_are_read_whatever_is_left_out() {
        let LiteralShape::List(vector) = shape("{x:1, z:3}", ForeignType::Vector) else {
            panic!("a list");
        };
        let numbers: Vec<_> = vector.iter().filter_map(Literal::number).collect();
        assert_eq!(numbers, [1.0, 0.0, 3.0]);
        // A quarter turn about z.
        let LiteralShape::Pose([x, _, _, qx, qy, qz, qw]) = shape(
            "{pos:{x:0.5},rot:{a:1.5707963267948966,b:-0.0,c:0.0}}",
            ForeignType::Frame,
        ) else {
            panic!("a pose");
        };
        let half = 0.5_f64.sqrt();
        assert!(x == 0.5 && qx.abs() + qy.abs() < 1e-15);
        assert!((qz - half).abs() < 1e-15 && (qw - half).abs() < 1e-15);
        let LiteralShape::List(twist) = shape("{rot:{y:2},vel:{x:1}}", ForeignType::Twist) else {
            panic!("a list");
        };
        let numbers: Vec<_> = twist.iter().filter_map(Literal::number).collect();
        assert_eq!(numbers, [1.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
    }

    #[test]
    fn what_the_predecessor_took_for_nothing_is_refused() {
        for (text, ty) in [
            ("abc", ForeignType::Double),
            ("", ForeignType::Double),
            ("inf", ForeignType::Double),
            ("1.7", ForeignType::Int),
            ("yes", ForeignType::Bool),
            ("1 2", ForeignType::Double),
            ("{x:1,w:2}", ForeignType::Vector),
            ("{x:}", ForeignType::Vector),
            ("{x:1", ForeignType::Vector),
            ("{{", ForeignType::Frame),
        ] {
            let diagnostic = read(text, Span::new(3, 4), ty, false).unwrap_err();
            assert_eq!(
                (diagnostic.code, diagnostic.place),
                (codes::BAD_QUANTITY, Some(Span::new(3, 4)))
            );
        }
        for text in ["[1", "[,]", "[:]", "1"] {
            assert!(
                read(text, Span::default(), ForeignType::Double, true).is_err(),
                "{text}"
            );
        }
        let list = read("[1, 2 3]", Span::default(), ForeignType::Double, true).unwrap();
        assert!(matches!(list.shape, LiteralShape::List(elements) if elements.len() == 3));
    }
}
