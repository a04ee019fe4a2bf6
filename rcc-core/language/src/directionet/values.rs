//! Parameters of the predecessor as constants of ours: `1.0E-4`, `true`, `{pos:{x:1},rot:{a:0.1}}`, `[1,2]`.
//! What it took silently for 0 is refused here. The loader's threads.

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_core::pose::Pose;
use rcc_core::types::Type as Ours;

use crate::fault;
use crate::syntax::literal::{Literal, Shape};

/// A type of the predecessor's ports and parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Type {
    /// `bool`.
    Bool,
    /// `int`; also the unsigned numbers of four types that it could not set.
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
    /// `matrix`, of which no net contains any.
    Matrix,
}

impl Type {
    /// By its name there, without `[]`.
    #[must_use]
    pub fn named(name: &str) -> Option<Type> {
        Some(match name {
            "bool" => Type::Bool,
            "int" | "uint" => Type::Int,
            "double" => Type::Double,
            "string" => Type::Text,
            "nsecs" => Type::Time,
            "Vector" => Type::Vector,
            "Rotation" => Type::Rotation,
            "Frame" => Type::Frame,
            "Twist" => Type::Twist,
            "Wrench" => Type::Wrench,
            "T" => Type::Any,
            "matrix" => Type::Matrix,
            _ => return None,
        })
    }

    /// The type of ours; `None`: none of a port.
    #[must_use]
    pub fn ours(self) -> Option<Ours> {
        Some(match self {
            Type::Bool => Ours::Bool,
            Type::Int => Ours::Int,
            Type::Double | Type::Time => Ours::Real,
            Type::Vector => Ours::Vector3,
            Type::Rotation => Ours::Rotation,
            Type::Frame => Ours::Pose,
            Type::Twist => Ours::Twist,
            Type::Wrench => Ours::Wrench,
            Type::Text | Type::Any | Type::Matrix => return None,
        })
    }

    /// What it is where nothing says anything.
    #[must_use]
    pub fn zero(self, span: Span) -> Literal {
        let real = |span| Literal::new(Shape::Real(0.0, None), span);
        let shape = match self {
            Type::Bool => Shape::Bool(false),
            Type::Int => Shape::Int(0),
            Type::Double | Type::Time | Type::Any | Type::Matrix => Shape::Real(0.0, None),
            Type::Text => Shape::Text(String::new()),
            Type::Vector => Shape::List(vec![real(span); 3]),
            Type::Twist | Type::Wrench => Shape::List(vec![real(span); 6]),
            Type::Rotation => Shape::Rotation([0.0, 0.0, 0.0, 1.0]),
            Type::Frame => Shape::Pose([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        };
        Literal::new(shape, span)
    }
}

/// Reads a constant.
///
/// # Errors
/// What is wrong, with the place in the text.
pub fn read(text: &str, span: Span, ty: Type, array: bool) -> Result<Literal, Box<Diagnostic>> {
    let mut reader = Reader { text, at: 0, span };
    let shape = match (ty, array) {
        (Type::Text, _) => return Ok(Literal::new(Shape::Text(text.to_string()), span)),
        (_, true) => reader.list(ty)?,
        (_, false) => reader.value(ty)?,
    };
    reader.blanks();
    if reader.at < text.len() {
        return Err(reader.wrong(ty));
    }
    Ok(Literal::new(shape, span))
}

struct Reader<'t> {
    text: &'t str,
    at: usize,
    span: Span,
}

type Read<T> = Result<T, Box<Diagnostic>>;

impl<'t> Reader<'t> {
    fn wrong(&self, ty: Type) -> Box<Diagnostic> {
        let wanted = match ty {
            Type::Bool => "`true` or `false`",
            Type::Int => "a whole number",
            Type::Vector => "a vector such as `{x:1,y:2,z:3}`",
            Type::Rotation => "a rotation such as `{a:1,b:2,c:3}`, rad",
            Type::Frame => "a frame such as `{pos:{x:1,y:2,z:3},rot:{a:1,b:2,c:3}}`",
            Type::Twist => "a twist such as `{vel:{x:1,y:2,z:3},rot:{x:1,y:2,z:3}}`",
            Type::Wrench => "a wrench such as `{force:{x:1,y:2,z:3},torque:{x:1,y:2,z:3}}`",
            _ => "a number",
        };
        let message = format!("`{}` is not {wanted}", shortened(self.text));
        let fault = Diagnostic::error(fault::BAD_QUANTITY, self.span, message);
        Box::new(
            fault.help(
                "correct it: the predecessor silently took 0, false or what it could read of it",
            ),
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

    fn value(&mut self, ty: Type) -> Read<Shape> {
        Ok(match ty {
            Type::Bool => match self.word() {
                "true" => Shape::Bool(true),
                "false" => Shape::Bool(false),
                _ => return Err(self.wrong(ty)),
            },
            Type::Int => match self.word().parse() {
                Ok(value) => Shape::Int(value),
                Err(_) => return Err(self.wrong(ty)),
            },
            Type::Vector => Shape::List(self.numbers(ty, &["x", "y", "z"])?),
            Type::Rotation => {
                let [a, b, c] = self.three(ty, ["a", "b", "c"])?;
                Shape::Rotation(Pose::from_xyz_rpy([0.0; 3], [c, b, a]).orientation)
            }
            Type::Frame => {
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
                Shape::Pose([x, y, z, qx, qy, qz, qw])
            }
            Type::Twist => self.six(ty, "vel", "rot")?,
            Type::Wrench => self.six(ty, "force", "torque")?,
            _ => {
                let value = self.number(ty)?;
                if value.is_nan() {
                    Shape::Null
                } else {
                    Shape::Real(value, None)
                }
            }
        })
    }

    /// A number as Java and C++ print it. NaN, which is null here, only where a number stands alone.
    fn number(&mut self, ty: Type) -> Read<f64> {
        match self.word() {
            "nan" | "NaN" if ty == Type::Double => Ok(f64::NAN),
            word => match word.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(self.wrong(ty)),
            },
        }
    }

    /// `{name: …, name: …}` in any order; what is left out keeps what it is.
    fn members(
        &mut self,
        ty: Type,
        mut member: impl FnMut(&mut Self, &str) -> Read<()>,
    ) -> Read<()> {
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

    fn three(&mut self, ty: Type, names: [&str; 3]) -> Read<[f64; 3]> {
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

    fn numbers(&mut self, ty: Type, names: &[&str; 3]) -> Read<Vec<Literal>> {
        let values = self.three(ty, *names)?;
        Ok(reals(&values, self.span))
    }

    fn six(&mut self, ty: Type, first: &str, second: &str) -> Read<Shape> {
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
        Ok(Shape::List(reals(values.as_flattened(), self.span)))
    }

    fn list(&mut self, ty: Type) -> Read<Shape> {
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
        Ok(Shape::List(elements))
    }
}

fn reals(values: &[f64], span: Span) -> Vec<Literal> {
    let real = |value: &f64| Literal::new(Shape::Real(*value, None), span);
    values.iter().map(real).collect()
}

/// At most 40 characters of a text.
fn shortened(text: &str) -> String {
    match text.char_indices().nth(40) {
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
        None => text.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(text: &str, ty: Type) -> Shape {
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
                shape(text, Type::Double),
                Shape::Real(value, None),
                "{text}"
            );
        }
        assert_eq!(shape("nan", Type::Double), Shape::Null);
        assert_eq!(shape("-12", Type::Int), Shape::Int(-12));
        assert_eq!(shape("true", Type::Bool), Shape::Bool(true));
    }

    #[test]
    fn composites_are_read_whatever_is_left_out() {
        let Shape::List(vector) = shape("{x:1, z:3}", Type::Vector) else {
            panic!("a list");
        };
        let numbers: Vec<_> = vector.iter().filter_map(Literal::number).collect();
        assert_eq!(numbers, [1.0, 0.0, 3.0]);
        // A quarter turn about z.
        let Shape::Pose([x, _, _, qx, qy, qz, qw]) = shape(
            "{pos:{x:0.5},rot:{a:1.5707963267948966,b:-0.0,c:0.0}}",
            Type::Frame,
        ) else {
            panic!("a pose");
        };
        let half = 0.5_f64.sqrt();
        assert!(x == 0.5 && qx.abs() + qy.abs() < 1e-15);
        assert!((qz - half).abs() < 1e-15 && (qw - half).abs() < 1e-15);
        let Shape::List(twist) = shape("{rot:{y:2},vel:{x:1}}", Type::Twist) else {
            panic!("a list");
        };
        let numbers: Vec<_> = twist.iter().filter_map(Literal::number).collect();
        assert_eq!(numbers, [1.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
    }

    #[test]
    fn what_the_predecessor_took_for_nothing_is_refused() {
        for (text, ty) in [
            ("abc", Type::Double),
            ("", Type::Double),
            ("inf", Type::Double),
            ("1.7", Type::Int),
            ("yes", Type::Bool),
            ("1 2", Type::Double),
            ("{x:1,w:2}", Type::Vector),
            ("{x:}", Type::Vector),
            ("{x:1", Type::Vector),
            ("{{", Type::Frame),
        ] {
            let fault = read(text, Span::new(3, 4), ty, false).unwrap_err();
            assert_eq!(
                (fault.code, fault.place),
                (fault::BAD_QUANTITY, Some(Span::new(3, 4)))
            );
        }
        for text in ["[1", "[,]", "[:]", "1"] {
            assert!(
                read(text, Span::default(), Type::Double, true).is_err(),
                "{text}"
            );
        }
        let list = read("[1, 2 3]", Span::default(), Type::Double, true).unwrap();
        assert!(matches!(list.shape, Shape::List(elements) if elements.len() == 3));
    }
}
