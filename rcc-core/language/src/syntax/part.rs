//! Parts of values: `[2]`, `[2..5]`, `[1,2]`, `[1,..]` and `.x` behind the name of an output. A part lies where it lies in
//! the whole value, so that reading it costs nothing. The loader's threads.

use std::fmt;

use rcc_core::types::Type;
use rcc_core::unit::Unit;

/// A part of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// `[i]`: one element of an array, or of a matrix row by row.
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

/// Members of composites: name, where the composite has it, and what it is.
const TABLE: &[(&str, Type, u32, Type)] = &[
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

/// The member of this name, of whatever type.
#[must_use]
pub fn member(name: &str) -> Option<Part> {
    let row = TABLE.iter().find(|row| row.0 == name)?;
    Some(Part::Member(row.0))
}

/// The parts that values of a type have, in words.
#[must_use]
pub fn parts_of(ty: Type) -> Option<String> {
    let members = TABLE.iter().filter(|row| row.1 == ty);
    let members: Vec<String> = members.map(|row| format!("`.{}`", row.0)).collect();
    match ty {
        _ if !members.is_empty() => Some(format!("a {ty} has {}", members.join(", "))),
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
    /// That of the whole value's port.
    Port,
    /// This one.
    Is(Unit),
    /// Its own type says it, or its elements differ.
    None,
}

impl Part {
    /// Where the part begins in a value of a type, and what it is; `None` if there is no such part.
    #[must_use]
    pub fn of(self, ty: Type) -> Option<(u32, Type)> {
        match (self, ty) {
            (Part::Member(name), _) => {
                let row = TABLE.iter().find(|row| row.0 == name && row.1 == ty)?;
                Some((row.2, row.3))
            }
            (Part::Element(index), _) if index < ty.width() => Some((index, ty.element()?)),
            (Part::Slice(from, to), Type::Reals(_) | Type::Bools(_) | Type::Ints(_)) => {
                let length = u16::try_from(to.checked_sub(from)?).ok()?;
                let fits = length > 0 && to <= ty.width();
                fits.then_some((from, ty.scalar().array(length)?))
            }
            (Part::Cell(row, column), Type::Matrix(rows, columns)) => {
                let (rows, columns) = (u32::from(rows), u32::from(columns));
                let fits = row < rows && column < columns;
                fits.then(|| (row * columns + column, Type::Real))
            }
            (Part::Row(row), Type::Matrix(rows, columns)) => {
                let fits = row < u32::from(rows);
                fits.then(|| (row * u32::from(columns), Type::Reals(columns.into())))
            }
            _ => None,
        }
    }
}

/// The unit of the elements of a value of type `whole` that begin at `offset` and are a `part`.
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

/// A place in a list of links, from the outside in: index and count of each list.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// In the list, and in the row that is a list itself.
    pub steps: [Option<(u32, u32)>; 2],
}

impl Place {
    /// The place of an element of a list of `count` at this place; `None` if it is too deep.
    #[must_use]
    pub fn inside(self, index: u32, count: u32) -> Option<Place> {
        let step = Some((index, count));
        match self.steps {
            [None, _] => Some(Place {
                steps: [step, None],
            }),
            [outer, None] => Some(Place {
                steps: [outer, step],
            }),
            _ => None,
        }
    }

    /// Where it lies in a value of a type, and of which type it is there; `None` if the list does not fit the type.
    #[must_use]
    pub fn of(self, ty: Type) -> Option<(u32, Type)> {
        let mut steps = self.steps.into_iter().flatten();
        steps.try_fold((0, ty), |(offset, ty), (index, count)| {
            let (items, item) = ty.items()?;
            (items == count).then(|| (offset + index * item.width(), item))
        })
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Part::Element(index) => write!(f, "[{index}]"),
            Part::Slice(from, to) => write!(f, "[{from}..{to}]"),
            Part::Cell(row, column) => write!(f, "[{row},{column}]"),
            Part::Row(row) => write!(f, "[{row},..]"),
            Part::Member(name) => write!(f, ".{name}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_where_it_lies_in_the_whole() {
        let vector = Type::Vector3;
        for (part, ty, want) in [
            (Part::Element(2), Type::Reals(3), Some((2, Type::Real))),
            (Part::Element(3), Type::Reals(3), None),
            (Part::Slice(1, 3), Type::Ints(3), Some((1, Type::Ints(2)))),
            (Part::Slice(1, 4), Type::Ints(3), None),
            (Part::Slice(2, 2), Type::Ints(3), None),
            (Part::Cell(1, 2), Type::Matrix(2, 3), Some((5, Type::Real))),
            (Part::Cell(1, 3), Type::Matrix(2, 3), None),
            (Part::Row(1), Type::Matrix(2, 3), Some((3, Type::Reals(3)))),
            (Part::Member("position"), Type::Pose, Some((0, vector))),
            (Part::Member("torque"), Type::Wrench, Some((3, vector))),
            (Part::Member("w"), vector, None),
            (Part::Element(0), vector, None),
        ] {
            assert_eq!(part.of(ty), want, "{part} of {ty}");
        }
    }

    #[test]
    fn a_place_in_lists_is_one_of_the_value() {
        let place = Place::default().inside(1, 2).unwrap();
        assert_eq!(place.of(Type::Matrix(2, 3)), Some((3, Type::Reals(3))));
        assert_eq!(place.of(Type::Vector3), None);
        let cell = place.inside(2, 3).unwrap();
        assert_eq!(cell.of(Type::Matrix(2, 3)), Some((5, Type::Real)));
        assert_eq!(cell.inside(0, 1), None);
        assert_eq!(Place::default().of(Type::Pose), Some((0, Type::Pose)));
    }
}
