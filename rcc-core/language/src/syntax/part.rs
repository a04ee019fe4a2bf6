//! Parts of values: `[2]`, `[2..5]`, `[1,2]`, `[1,..]` and `.x` after the name of an output. A part is a range of the
//! slots of the whole value, so reading it costs nothing. Runs on the loader's threads.

use std::fmt;

use rcc_config::article::with_article;
use rcc_core::types::Type;
use rcc_core::unit::Unit;

/// A part of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ValuePart {
    /// `[i]`: an element of an array, or of a matrix in row-major order.
    Element(u32),
    /// `[from..to]`: a shorter array, without element `to`.
    Slice(u32, u32),
    /// `[row,column]` of a matrix.
    Cell(u32, u32),
    /// `[row,..]` of a matrix.
    Row(u32),
    /// `.x`: one of [`MEMBERS`].
    Member(&'static str),
}

/// Members of composites: name, composite, offset, and type of the member.
const MEMBERS: &[(&str, Type, u32, Type)] = &[
    ("x", Type::Vector3, 0, Type::Real),
    ("y", Type::Vector3, 1, Type::Real),
    ("z", Type::Vector3, 2, Type::Real),
    ("x", Type::Rotation, 0, Type::Real),
    ("y", Type::Rotation, 1, Type::Real),
    ("z", Type::Rotation, 2, Type::Real),
    ("w", Type::Rotation, 3, Type::Real),
    ("x", Type::Pose, 0, Type::Real),
    ("y", Type::Pose, 1, Type::Real),
    ("z", Type::Pose, 2, Type::Real),
    ("position", Type::Pose, 0, Type::Vector3),
    ("rotation", Type::Pose, 3, Type::Rotation),
    ("linear", Type::Twist, 0, Type::Vector3),
    ("angular", Type::Twist, 3, Type::Vector3),
    ("force", Type::Wrench, 0, Type::Vector3),
    ("torque", Type::Wrench, 3, Type::Vector3),
];

/// Returns the member with this name, of any type.
#[must_use]
pub fn member(name: &str) -> Option<ValuePart> {
    let row = MEMBERS.iter().find(|row| row.0 == name)?;
    Some(ValuePart::Member(row.0))
}

/// Describes the parts of values of a type; `None` if it has none.
#[must_use]
pub fn parts_of(ty: Type) -> Option<String> {
    let members = MEMBERS.iter().filter(|row| row.1 == ty);
    let members: Vec<String> = members.map(|row| format!("`.{}`", row.0)).collect();
    match ty {
        _ if !members.is_empty() => {
            Some(format!("{} has {}", with_article(ty), members.join(", ")))
        }
        Type::Matrix(rows, columns) => Some(format!(
            "rows are counted from 0 to {}, columns to {}: `[0,0]`, a row `[0,..]`",
            i32::from(rows) - 1,
            i32::from(columns) - 1
        )),
        Type::Reals(_) | Type::Bools(_) | Type::Ints(_) => {
            Some(format!("elements are counted from 0 to {}", ty.width() - 1))
        }
        _ => None,
    }
}

/// The unit of a part of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartUnit {
    /// The unit of the port.
    Port,
    /// This unit.
    Is(Unit),
    /// Implied by the type, or different between elements.
    None,
}

impl ValuePart {
    /// Returns offset and type of the part in a value of type `ty`; `None` if there is no such part.
    #[must_use]
    pub fn of(self, ty: Type) -> Option<(u32, Type)> {
        match (self, ty) {
            (ValuePart::Member(name), _) => {
                let row = MEMBERS.iter().find(|row| row.0 == name && row.1 == ty)?;
                Some((row.2, row.3))
            }
            (ValuePart::Element(index), _) if index < ty.width() => Some((index, ty.element()?)),
            (ValuePart::Slice(from, to), Type::Reals(_) | Type::Bools(_) | Type::Ints(_)) => {
                let length = u16::try_from(to.checked_sub(from)?).ok()?;
                let fits = length > 0 && to <= ty.width();
                fits.then_some((from, ty.scalar().array(length)?))
            }
            (ValuePart::Cell(row, column), Type::Matrix(rows, columns)) => {
                let (rows, columns) = (u32::from(rows), u32::from(columns));
                let fits = row < rows && column < columns;
                fits.then(|| (row * columns + column, Type::Real))
            }
            (ValuePart::Row(row), Type::Matrix(rows, columns)) => {
                let fits = row < u32::from(rows);
                fits.then(|| (row * u32::from(columns), Type::Reals(columns.into())))
            }
            _ => None,
        }
    }
}

/// Returns the unit of a part of type `part` at `offset` in a value of type `whole`.
#[must_use]
pub fn unit_of(whole: Type, offset: u32, part: Type) -> PartUnit {
    let first = offset < 3;
    match whole {
        _ if whole == part => PartUnit::Port,
        Type::Pose if part == Type::Rotation => PartUnit::None,
        Type::Pose => PartUnit::Is(Unit::METRE),
        Type::Rotation => PartUnit::Is(Unit::ONE),
        Type::Twist if first => PartUnit::Is(Unit::METRE_PER_SECOND),
        Type::Twist => PartUnit::Is(Unit::RADIAN_PER_SECOND),
        Type::Wrench if first => PartUnit::Is(Unit::NEWTON),
        Type::Wrench => PartUnit::Is(Unit::NEWTON_METRE),
        Type::TRANSFORM if part != Type::Real => PartUnit::None,
        _ if whole.element_has_unit(offset) => PartUnit::Port,
        _ => PartUnit::Is(Unit::ONE),
    }
}

/// A position in a list of links, outermost list first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ListPosition {
    /// Index and count in the list, and in the row if the element is a list itself.
    pub steps: [Option<(u32, u32)>; 2],
}

/// As text: `[2]`, `[1,2]`; empty for a value that is not in a list.
impl fmt::Display for ListPosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.steps {
            [Some((row, _)), Some((column, _))] => write!(f, "[{row},{column}]"),
            [Some((index, _)), _] => write!(f, "[{index}]"),
            _ => Ok(()),
        }
    }
}

impl ListPosition {
    /// Returns the position of an element in a list of `count` elements at this position; `None` if it is nested too
    /// deeply.
    #[must_use]
    pub fn inside(self, index: u32, count: u32) -> Option<ListPosition> {
        let step = Some((index, count));
        match self.steps {
            [None, _] => Some(ListPosition {
                steps: [step, None],
            }),
            [outer, None] => Some(ListPosition {
                steps: [outer, step],
            }),
            _ => None,
        }
    }

    /// Returns offset and type of the position in a value of a type; `None` if the list does not fit the type.
    #[must_use]
    pub fn of(self, ty: Type) -> Option<(u32, Type)> {
        let mut steps = self.steps.into_iter().flatten();
        steps.try_fold((0, ty), |(offset, ty), (index, count)| {
            let (items, item) = ty.items()?;
            (items == count).then(|| (offset + index * item.width(), item))
        })
    }
}

impl fmt::Display for ValuePart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ValuePart::Element(index) => write!(f, "[{index}]"),
            ValuePart::Slice(from, to) => write!(f, "[{from}..{to}]"),
            ValuePart::Cell(row, column) => write!(f, "[{row},{column}]"),
            ValuePart::Row(row) => write!(f, "[{row},..]"),
            ValuePart::Member(name) => write!(f, ".{name}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_a_range_of_the_whole_value() {
        let vector = Type::Vector3;
        for (part, ty, want) in [
            (ValuePart::Element(2), Type::Reals(3), Some((2, Type::Real))),
            (ValuePart::Element(3), Type::Reals(3), None),
            (
                ValuePart::Slice(1, 3),
                Type::Ints(3),
                Some((1, Type::Ints(2))),
            ),
            (ValuePart::Slice(1, 4), Type::Ints(3), None),
            (ValuePart::Slice(2, 2), Type::Ints(3), None),
            (
                ValuePart::Cell(1, 2),
                Type::Matrix(2, 3),
                Some((5, Type::Real)),
            ),
            (ValuePart::Cell(1, 3), Type::Matrix(2, 3), None),
            (
                ValuePart::Row(1),
                Type::Matrix(2, 3),
                Some((3, Type::Reals(3))),
            ),
            (ValuePart::Member("position"), Type::Pose, Some((0, vector))),
            (ValuePart::Member("torque"), Type::Wrench, Some((3, vector))),
            (ValuePart::Member("w"), vector, None),
            (ValuePart::Element(0), vector, None),
        ] {
            assert_eq!(part.of(ty), want, "{part} of {ty}");
        }
    }

    #[test]
    fn a_list_position_is_a_position_in_the_value() {
        let place = ListPosition::default().inside(1, 2).unwrap();
        assert_eq!(place.of(Type::Matrix(2, 3)), Some((3, Type::Reals(3))));
        assert_eq!(place.of(Type::Vector3), None);
        let cell = place.inside(2, 3).unwrap();
        assert_eq!(cell.of(Type::Matrix(2, 3)), Some((5, Type::Real)));
        assert_eq!(cell.inside(0, 1), None);
        assert_eq!(
            ListPosition::default().of(Type::Pose),
            Some((0, Type::Pose))
        );
    }
}
