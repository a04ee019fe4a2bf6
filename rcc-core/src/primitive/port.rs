//! Ports and parameters in specs: names, types, units, defaults and ranges. For the loader and for people; the cycle never
//! looks at them.

use crate::types::{Store, Type};
use crate::unit::Unit;

/// The type of a port in a spec. A primitive has one open type, which links and literals decide, and up to
/// [`super::DIMS_MAX`] open lengths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortType {
    /// Exactly this type.
    Is(Type),
    /// The open type, any that can be in the arena.
    Any,
    /// The open type: `Bool`, `Int` or `Real`.
    Scalar,
    /// The open type: `Int` or `Real`.
    Number,
    /// The open type: what can be added element by element: `Int`, `Real`, `Vector3`, `Twist`, `Wrench`, arrays of numbers,
    /// matrices.
    Linear,
    /// The open type: a member of this family.
    Of(Family),
    /// One number of the open type: `Int` if that is of whole numbers, else `Real`.
    Part,
    /// An array.
    Array(Elements, Dim),
    /// `Real[rows,columns]`.
    Matrix(Dim, Dim),
    /// So many values of the open type, written as a list.
    Many(Dim),
    /// `Real[n]` with n the number of joints of the primitive's device.
    Joints,
    /// `Real[rows,n]` with n the number of joints of the primitive's device.
    JointColumns(u8),
}

/// A few types that an operation means the same for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// `Rotation`, `Pose`, or `Real[4,4]`, a homogeneous transform: where a frame is in another one.
    Frame,
    /// `Rotation` or `Pose`.
    Turn,
    /// `Vector3`, `Twist` or `Wrench`: one or two vectors in axes of a frame.
    Axes,
    /// `Vector3` or `Real[n]`.
    Vector,
}

impl Family {
    /// True for its members.
    pub const fn has(self, ty: Type) -> bool {
        match self {
            Family::Frame => matches!(ty, Type::Rotation | Type::Pose | Type::TRANSFORM),
            Family::Turn => matches!(ty, Type::Rotation | Type::Pose),
            Family::Axes => matches!(ty, Type::Vector3 | Type::Twist | Type::Wrench),
            Family::Vector => matches!(ty, Type::Vector3 | Type::Reals(_)),
        }
    }

    /// Its members, for people.
    pub const fn words(self) -> &'static str {
        match self {
            Family::Frame => "Rotation, Pose or Real[4,4]",
            Family::Turn => "Rotation or Pose",
            Family::Axes => "Vector3, Twist or Wrench",
            Family::Vector => "Vector3 or Real[n]",
        }
    }
}

/// The elements of an array in a spec.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Elements {
    /// Of this type: `Bool`, `Int` or `Real`.
    Are(Type),
    /// Of the open type, which is then `Bool`, `Int` or `Real`.
    Open,
}

impl Elements {
    /// The arena; `None`: that of the open type.
    pub const fn store(self) -> Option<Store> {
        match self {
            Elements::Are(ty) => ty.store(),
            Elements::Open => None,
        }
    }
}

/// A length in a spec.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dim {
    /// Exactly this.
    Is(u16),
    /// A length variable, less than [`super::DIMS_MAX`]: the same wherever it occurs.
    Var(u8),
    /// A length variable for the sides of matrices that are solved or inverted: at most [`crate::linear::SIDE_MAX`].
    Small(u8),
    /// The sum of two length variables; not in a matrix.
    Sum(u8, u8),
}

impl PortType {
    /// True if links and literals decide the type, but for lengths.
    pub const fn is_open(self) -> bool {
        match self {
            PortType::Any
            | PortType::Scalar
            | PortType::Number
            | PortType::Linear
            | PortType::Of(_)
            | PortType::Part
            | PortType::Many(_) => true,
            PortType::Array(elements, _) => matches!(elements, Elements::Open),
            PortType::Is(_)
            | PortType::Matrix(..)
            | PortType::Joints
            | PortType::JointColumns(_) => false,
        }
    }

    /// True if values of more than one width can be at the port, because of the open type or the device.
    pub const fn is_wide(self) -> bool {
        matches!(
            self,
            PortType::Any
                | PortType::Linear
                | PortType::Of(_)
                | PortType::Joints
                | PortType::JointColumns(_)
                | PortType::Many(_)
        )
    }

    /// True if the length variable occurs in it.
    pub fn has_dim(self, dim: u8) -> bool {
        let has = |length: Dim| match length {
            Dim::Is(_) => false,
            Dim::Var(a) | Dim::Small(a) => a == dim,
            Dim::Sum(a, b) => a == dim || b == dim,
        };
        match self {
            PortType::Array(_, length) | PortType::Many(length) => has(length),
            PortType::Matrix(rows, columns) => has(rows) || has(columns),
            _ => false,
        }
    }

    /// False for what the open type cannot be because of this port.
    pub const fn admits(self, open: Type) -> bool {
        match self {
            PortType::Number => matches!(open, Type::Int | Type::Real),
            PortType::Scalar | PortType::Array(Elements::Open, _) => {
                matches!(open, Type::Bool | Type::Int | Type::Real)
            }
            PortType::Linear => open.is_linear(),
            PortType::Of(family) => family.has(open),
            _ => true,
        }
    }
}

/// The unit of a port in a spec. `Var(i)` stands for any unit, the same wherever it occurs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnitRule {
    /// Exactly this unit.
    Is(Unit),
    /// Any unit, the same for all ports with this number.
    Var(u8),
    /// The product of two variables.
    Product(u8, u8),
    /// The quotient of two variables.
    Quotient(u8, u8),
    /// The square root of a variable: a unit whose powers are odd has none.
    Root(u8),
    /// A variable per second.
    PerSecond(u8),
    /// A variable per second squared.
    PerSecond2(u8),
    /// A variable per second cubed.
    PerSecond3(u8),
    /// The unit that the cell's configuration gives to the channel.
    Channel,
    /// The type says it all (`Pose`, `Twist`, `Wrench`, `Rotation`) or there is none (`Bool`, `Int`).
    Typed,
}

impl UnitRule {
    /// A plain number.
    pub const ONE: UnitRule = UnitRule::Is(Unit::ONE);
    /// An angle.
    pub const RADIAN: UnitRule = UnitRule::Is(Unit::RADIAN);
    /// A time.
    pub const SECOND: UnitRule = UnitRule::Is(Unit::SECOND);
    /// A frequency.
    pub const HERTZ: UnitRule = UnitRule::Is(Unit::HERTZ);
}

/// A default value in a spec.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Literal {
    /// A real number in SI units.
    Real(f64),
    /// An integer.
    Int(i64),
    /// A truth value.
    Bool(bool),
    /// One of the words of a [`ParameterKind::Word`].
    Word(&'static str),
    /// No value.
    Null,
}

/// An input or output port.
#[derive(Clone, Copy, Debug)]
pub struct Port {
    /// As written in nets.
    pub name: &'static str,
    /// Type.
    pub ty: PortType,
    /// Unit.
    pub unit: UnitRule,
    /// One phrase with frame and element order.
    pub doc: &'static str,
    /// Value of an input that no link feeds; `None`: it must be connected.
    pub default: Option<Literal>,
    /// An output that may be left unread without `discard`.
    pub diagnostic: bool,
    /// Of an output: it is never less than this.
    pub least: Option<f64>,
    /// Of an output: it is never greater than this.
    pub greatest: Option<f64>,
}

impl Port {
    /// A port that must be connected (input) or read (output).
    pub const fn new(name: &'static str, ty: PortType, unit: UnitRule, doc: &'static str) -> Port {
        Port {
            name,
            ty,
            unit,
            doc,
            default: None,
            diagnostic: false,
            least: None,
            greatest: None,
        }
    }

    /// A `Real` port.
    pub const fn real(name: &'static str, unit: UnitRule, doc: &'static str) -> Port {
        Port::new(name, PortType::Is(Type::Real), unit, doc)
    }

    /// An `Int` port.
    pub const fn int(name: &'static str, doc: &'static str) -> Port {
        Port::new(name, PortType::Is(Type::Int), UnitRule::Typed, doc)
    }

    /// A port for numbers, `Int` or `Real`, of one unit with all others of the variable.
    pub const fn number(name: &'static str, unit: UnitRule, doc: &'static str) -> Port {
        Port::new(name, PortType::Number, unit, doc)
    }

    /// A port for everything that can be added, of one unit with all others of the variable.
    pub const fn linear(name: &'static str, unit: UnitRule, doc: &'static str) -> Port {
        Port::new(name, PortType::Linear, unit, doc)
    }

    /// A port for the members of a family, of one unit with all others of the variable.
    pub const fn of(name: &'static str, family: Family, unit: UnitRule, doc: &'static str) -> Port {
        Port::new(name, PortType::Of(family), unit, doc)
    }

    /// A `Bool` port.
    pub const fn bool(name: &'static str, doc: &'static str) -> Port {
        Port::new(name, PortType::Is(Type::Bool), UnitRule::Typed, doc)
    }

    /// A port of a composite whose type says the unit.
    pub const fn typed(name: &'static str, ty: Type, doc: &'static str) -> Port {
        Port::new(name, PortType::Is(ty), UnitRule::Typed, doc)
    }

    /// This input may be left unconnected and then has this value.
    pub const fn default(self, value: Literal) -> Port {
        Port {
            default: Some(value),
            ..self
        }
    }

    /// This output is null or in this range, whatever the inputs are; a constant at this input must be in it.
    pub const fn within(self, least: f64, greatest: f64) -> Port {
        Port {
            least: Some(least),
            greatest: Some(greatest),
            ..self
        }
    }

    /// This output may be left unread.
    pub const fn diagnostic(self) -> Port {
        Port {
            diagnostic: true,
            ..self
        }
    }
}

/// What a channel of a device carries, seen from the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChannelKind {
    /// A Bool that the device measures.
    DigitalInput,
    /// A Bool that the device is told.
    DigitalOutput,
    /// A Real that the device measures.
    AnalogInput,
    /// A Real that the device is told.
    AnalogOutput,
}

/// What a parameter is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterKind {
    /// A value; it gets a constant slot, as if it were an input nobody connected.
    Value(PortType, UnitRule),
    /// The start value of the primitive's state in the arena of this type; it may be null. No operand: it is in the
    /// initial arena and costs the cycle nothing.
    Start(Type, UnitRule),
    /// The value that the primitive's memory begins with, of the open type; it may be null. No operand.
    First(UnitRule),
    /// The value of a length variable, an `Int`. No operand of its own: every length variable is one.
    Length(u8),
    /// A time that becomes a whole number of evaluations, the nearest, 1 to [`super::CYCLES_MAX`]: the window of the
    /// primitive's memory. Its operand is the size [`super::Size::Cycles`].
    Window,
    /// One of these words; its operand is a slot with the word's place in the list, an `Int`.
    Word(&'static [&'static str]),
    /// The name of a device that has an arm.
    Arm,
    /// The name of any device.
    Device,
    /// The name of a channel of the device that the parameter `device` names.
    Channel(ChannelKind),
    /// The name of a topic: a letter, and letters, digits and `_ - . /`. No operand.
    Topic,
    /// What the open type is, where links and values do not tell it. No operand.
    Type,
    /// What the unit variable is, where links and values do not tell it; of the SI. No operand.
    Unit(u8),
    /// How often per second; becomes a whole number of cycles.
    Rate,
    /// Poses, one or more: a row of seven numbers each, as many as the length variable says.
    Poses(Dim),
    /// Legs of a path: a row of [`crate::path::record::WIDTH`] numbers each (a spline has one for each of its points), as many
    /// as the length variable says.
    Path(Dim),
}

impl ParameterKind {
    /// True if it is an operand at the place of parameters.
    pub const fn is_operand(self) -> bool {
        !matches!(
            self,
            ParameterKind::Start(..)
                | ParameterKind::First(_)
                | ParameterKind::Length(_)
                | ParameterKind::Window
                | ParameterKind::Topic
                | ParameterKind::Type
                | ParameterKind::Unit(_)
                | ParameterKind::Rate
        )
    }

    /// Type and unit of a parameter that is a value.
    pub const fn value(self) -> Option<(PortType, UnitRule)> {
        match self {
            ParameterKind::Value(ty, unit) => Some((ty, unit)),
            ParameterKind::Start(ty, unit) => Some((PortType::Is(ty), unit)),
            ParameterKind::First(unit) => Some((PortType::Any, unit)),
            ParameterKind::Length(_) => Some((PortType::Is(Type::Int), UnitRule::Typed)),
            ParameterKind::Window => Some((PortType::Is(Type::Real), UnitRule::Is(Unit::SECOND))),
            ParameterKind::Poses(rows) => {
                Some((PortType::Matrix(rows, Dim::Is(7)), UnitRule::Typed))
            }
            ParameterKind::Path(rows) => {
                let width = Dim::Is(crate::path::record::WIDTH as u16);
                Some((PortType::Matrix(rows, width), UnitRule::Typed))
            }
            _ => None,
        }
    }
}

/// A parameter of a primitive, set once when the net is loaded.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// As written in nets.
    pub name: &'static str,
    /// What it is.
    pub kind: ParameterKind,
    /// One phrase.
    pub doc: &'static str,
    /// `None`: it must be given.
    pub default: Option<Literal>,
    /// A `Real` must be greater than this, `Some(0.0)` for speeds and the like.
    pub above: Option<f64>,
    /// A `Real` must not be less than this.
    pub at_least: Option<f64>,
    /// A `Real` must not be greater than this.
    pub at_most: Option<f64>,
    /// The numbers of an array must rise from element to element.
    pub rising: bool,
    /// A frequency must be less than half of the rate at which the net is evaluated.
    pub below_nyquist: bool,
}

impl Parameter {
    /// A parameter that must be given.
    pub const fn new(name: &'static str, kind: ParameterKind, doc: &'static str) -> Parameter {
        Parameter {
            name,
            kind,
            doc,
            default: None,
            above: None,
            at_least: None,
            at_most: None,
            rising: false,
            below_nyquist: false,
        }
    }

    /// Its numbers must rise from element to element.
    pub const fn rising(self) -> Parameter {
        Parameter {
            rising: true,
            ..self
        }
    }

    /// A `Real` that must be given.
    pub const fn real(name: &'static str, unit: UnitRule, doc: &'static str) -> Parameter {
        Parameter::new(
            name,
            ParameterKind::Value(PortType::Is(Type::Real), unit),
            doc,
        )
    }

    /// A truth value that must be given.
    pub const fn bool(name: &'static str, doc: &'static str) -> Parameter {
        Parameter::new(
            name,
            ParameterKind::Value(PortType::Is(Type::Bool), UnitRule::Typed),
            doc,
        )
    }

    /// A whole number that must be given.
    pub const fn int(name: &'static str, doc: &'static str) -> Parameter {
        Parameter::new(
            name,
            ParameterKind::Value(PortType::Is(Type::Int), UnitRule::Typed),
            doc,
        )
    }

    /// The device with an arm that the primitive belongs to.
    pub const fn arm() -> Parameter {
        Parameter::new(
            "device",
            ParameterKind::Arm,
            "name of an arm in the cell's configuration",
        )
    }

    /// The device that the primitive belongs to.
    pub const fn device() -> Parameter {
        Parameter::new(
            "device",
            ParameterKind::Device,
            "name of a device in the cell's configuration",
        )
    }

    /// It may be left out and then has this value.
    pub const fn default(self, value: Literal) -> Parameter {
        Parameter {
            default: Some(value),
            ..self
        }
    }

    /// It must be greater than `bound`.
    pub const fn above(self, bound: f64) -> Parameter {
        Parameter {
            above: Some(bound),
            ..self
        }
    }

    /// It must not be less than `bound`.
    pub const fn at_least(self, bound: f64) -> Parameter {
        Parameter {
            at_least: Some(bound),
            ..self
        }
    }

    /// A frequency that sampled values can show: less than half of the rate at which the net is evaluated.
    pub const fn below_nyquist(self) -> Parameter {
        Parameter {
            below_nyquist: true,
            ..self
        }
    }

    /// It must not be greater than `bound`.
    pub const fn at_most(self, bound: f64) -> Parameter {
        Parameter {
            at_most: Some(bound),
            ..self
        }
    }
}
