//! Ports and parameters in specs: names, types, units, defaults and ranges. For the loader and for people; not used in
//! the cycle.

use crate::types::{Store, Type};
use crate::unit::Unit;

/// The type of a port in a spec. A primitive has at most one open type, which is inferred from links and literals, and
/// up to [`super::DIMS_MAX`] open lengths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortType {
    /// Exactly this type.
    Is(Type),
    /// The open type: any type that can be in an arena.
    Any,
    /// The open type: `Bool`, `Int` or `Real`.
    Scalar,
    /// The open type: `Int` or `Real`.
    Number,
    /// The open type, with element-wise addition: `Int`, `Real`, `Vector3`, `Twist`, `Wrench`, arrays of numbers,
    /// matrices.
    Linear,
    /// The open type: a member of this family.
    Of(TypeFamily),
    /// One element of the open type: `Int` if its elements are integers, otherwise `Real`.
    Part,
    /// An array.
    Array(ElementType, Dim),
    /// `Real[rows,columns]`.
    Matrix(Dim, Dim),
    /// A list of values of the open type; the length is the `Dim`.
    Many(Dim),
    /// `Real[n]` with n the number of joints of the primitive's device.
    Joints,
    /// `Real[rows,n]` with n the number of joints of the primitive's device.
    JointColumns(u8),
}

/// A group of types for which an operation has the same meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TypeFamily {
    /// `Rotation`, `Pose`, or `Real[4,4]` (homogeneous transform): one frame expressed in another.
    Frame,
    /// `Rotation` or `Pose`.
    Turn,
    /// `Vector3`, `Twist` or `Wrench`: one or two vectors in axes of a frame.
    Axes,
    /// `Vector3` or `Real[n]`.
    Vector,
}

impl TypeFamily {
    /// Returns true for members of the family.
    pub const fn has(self, ty: Type) -> bool {
        match self {
            TypeFamily::Frame => matches!(ty, Type::Rotation | Type::Pose | Type::TRANSFORM),
            TypeFamily::Turn => matches!(ty, Type::Rotation | Type::Pose),
            TypeFamily::Axes => matches!(ty, Type::Vector3 | Type::Twist | Type::Wrench),
            TypeFamily::Vector => matches!(ty, Type::Vector3 | Type::Reals(_)),
        }
    }

    /// Returns the names of the members, for messages and the manual.
    pub const fn members(self) -> &'static str {
        match self {
            TypeFamily::Frame => "Rotation, Pose or Real[4,4]",
            TypeFamily::Turn => "Rotation or Pose",
            TypeFamily::Axes => "Vector3, Twist or Wrench",
            TypeFamily::Vector => "Vector3 or Real[n]",
        }
    }
}

/// The element type of an array in a spec.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementType {
    /// This type: `Bool`, `Int` or `Real`.
    Are(Type),
    /// The open type, which is then `Bool`, `Int` or `Real`.
    Open,
}

impl ElementType {
    /// Returns the arena of the elements; `None`: the arena of the open type.
    pub const fn store(self) -> Option<Store> {
        match self {
            ElementType::Are(ty) => ty.store(),
            ElementType::Open => None,
        }
    }
}

/// A length in a spec.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dim {
    /// A fixed length.
    Is(u16),
    /// Length variable with this index, less than [`super::DIMS_MAX`]; the same length wherever it occurs.
    Var(u8),
    /// Length variable for the sides of matrices that are solved or inverted: at most [`crate::linear::SIDE_MAX`].
    Small(u8),
    /// The sum of two length variables; not in a matrix.
    Sum(u8, u8),
}

impl PortType {
    /// Returns true if the type (apart from lengths) is inferred from links and literals.
    pub const fn is_open(self) -> bool {
        match self {
            PortType::Any
            | PortType::Scalar
            | PortType::Number
            | PortType::Linear
            | PortType::Of(_)
            | PortType::Part
            | PortType::Many(_) => true,
            PortType::Array(elements, _) => matches!(elements, ElementType::Open),
            PortType::Is(_)
            | PortType::Matrix(..)
            | PortType::Joints
            | PortType::JointColumns(_) => false,
        }
    }

    /// Returns true if the port accepts values of more than one width, depending on the open type or on the device.
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

    /// Returns true if the length variable `dim` occurs in the type.
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

    /// Returns false if this port excludes `open` as the open type.
    pub const fn admits(self, open: Type) -> bool {
        match self {
            PortType::Number => matches!(open, Type::Int | Type::Real),
            PortType::Scalar | PortType::Array(ElementType::Open, _) => {
                matches!(open, Type::Bool | Type::Int | Type::Real)
            }
            PortType::Linear => open.is_linear(),
            PortType::Of(family) => family.has(open),
            _ => true,
        }
    }
}

/// The unit of a port in a spec. `Var(i)` is a unit variable: any unit, but the same wherever it occurs.
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
    /// The square root of a variable; undefined for a unit with odd exponents.
    Root(u8),
    /// A variable per second.
    PerSecond(u8),
    /// A variable per second squared.
    PerSecond2(u8),
    /// A variable per second cubed.
    PerSecond3(u8),
    /// The unit that the cell's configuration assigns to the channel.
    Channel,
    /// The unit of a joint position of the device, per second to this power: rad, or m for linear axes.
    Joint(u8),
    /// Given by the type (`Pose`, `Twist`, `Wrench`, `Rotation`), or none (`Bool`, `Int`).
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
pub enum DefaultValue {
    /// A real number in SI units.
    Real(f64),
    /// An integer.
    Int(i64),
    /// A truth value.
    Bool(bool),
    /// One of the keywords of a [`ParameterKind::Word`].
    Word(&'static str),
    /// Null.
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
    /// One phrase that states frame and element order.
    pub doc: &'static str,
    /// Value of an unconnected input; `None`: the input must be connected.
    pub default: Option<DefaultValue>,
    /// The output may be left unread without `discard`.
    pub diagnostic: bool,
    /// Smallest value: guaranteed for an output, required of a constant at an input.
    pub least: Option<f64>,
    /// Largest value: guaranteed for an output, required of a constant at an input.
    pub greatest: Option<f64>,
}

impl Port {
    /// Creates a port that must be connected (input) or read (output).
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

    /// Creates a `Real` port.
    pub const fn real(name: &'static str, unit: UnitRule, doc: &'static str) -> Port {
        Port::new(name, PortType::Is(Type::Real), unit, doc)
    }

    /// Creates an `Int` port.
    pub const fn int(name: &'static str, doc: &'static str) -> Port {
        Port::new(name, PortType::Is(Type::Int), UnitRule::Typed, doc)
    }

    /// Creates a port for a number, `Int` or `Real`.
    pub const fn number(name: &'static str, unit: UnitRule, doc: &'static str) -> Port {
        Port::new(name, PortType::Number, unit, doc)
    }

    /// Creates a port for the [`PortType::Linear`] types.
    pub const fn linear(name: &'static str, unit: UnitRule, doc: &'static str) -> Port {
        Port::new(name, PortType::Linear, unit, doc)
    }

    /// Creates a port for the members of a family.
    pub const fn of(
        name: &'static str,
        family: TypeFamily,
        unit: UnitRule,
        doc: &'static str,
    ) -> Port {
        Port::new(name, PortType::Of(family), unit, doc)
    }

    /// Creates a `Bool` port.
    pub const fn bool(name: &'static str, doc: &'static str) -> Port {
        Port::new(name, PortType::Is(Type::Bool), UnitRule::Typed, doc)
    }

    /// Creates a port of a type that determines its unit.
    pub const fn typed(name: &'static str, ty: Type, doc: &'static str) -> Port {
        Port::new(name, PortType::Is(ty), UnitRule::Typed, doc)
    }

    /// Allows this input to be left unconnected; it then has this value.
    pub const fn default(self, value: DefaultValue) -> Port {
        Port {
            default: Some(value),
            ..self
        }
    }

    /// Declares a range: this output is always null or in the range; a constant at this input must be in it.
    pub const fn within(self, least: f64, greatest: f64) -> Port {
        Port {
            least: Some(least),
            greatest: Some(greatest),
            ..self
        }
    }

    /// Allows this output to be left unread.
    pub const fn diagnostic(self) -> Port {
        Port {
            diagnostic: true,
            ..self
        }
    }
}

/// The kind of a device channel, as seen from the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChannelKind {
    /// `Bool`, measured by the device.
    DigitalInput,
    /// `Bool`, commanded to the device.
    DigitalOutput,
    /// `Real`, measured by the device.
    AnalogInput,
    /// `Real`, commanded to the device.
    AnalogOutput,
}

/// The kind of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterKind {
    /// A value; it is stored in a constant slot, like an unconnected input.
    Value(PortType, UnitRule),
    /// The start value of the primitive's state in the arena of this type; may be null. Not an operand: it is stored in
    /// the initial arena and costs nothing in the cycle.
    Start(Type, UnitRule),
    /// The start value of the primitive's memory, of the open type; may be null. Not an operand.
    First(UnitRule),
    /// The value of a length variable, an `Int`. Not an operand of its own, because every length variable is passed as
    /// a size.
    Length(u8),
    /// A duration that is rounded to a whole number of evaluations, 1 to [`super::CYCLES_MAX`]: the window of the
    /// primitive's memory. Its operand is the size [`super::Size::Cycles`].
    Window,
    /// One of these keywords; its operand is an `Int` slot with the keyword's index in the list.
    Word(&'static [&'static str]),
    /// The name of a device that has an arm.
    Arm,
    /// The name of any device.
    Device,
    /// The name of a channel of the device that the parameter `device` names.
    Channel(ChannelKind),
    /// The name of a topic: a letter, then letters, digits and `_ - . /`. Not an operand.
    Topic,
    /// The open type, if it cannot be inferred from links and values. Not an operand.
    Type,
    /// The unit (SI) of a unit variable, if it cannot be inferred from links and values. Not an operand.
    Unit(u8),
    /// A rate, 1/s, that is converted to a whole number of cycles.
    Rate,
    /// One or more poses: a row of seven numbers for each; the number of rows is the length variable.
    Poses(Dim),
    /// Legs of a path: a row of [`crate::path::leg_row::WIDTH`] numbers for each (a spline has one row for each of its
    /// points); the number of rows is the length variable.
    Path(Dim),
}

impl ParameterKind {
    /// Returns true if the parameter is among the parameter operands.
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

    /// Returns type and unit of a parameter that is a value.
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
                let width = Dim::Is(crate::path::leg_row::WIDTH as u16);
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
    /// Kind.
    pub kind: ParameterKind,
    /// Description in one phrase.
    pub doc: &'static str,
    /// Default value; `None`: the parameter is required.
    pub default: Option<DefaultValue>,
    /// Exclusive lower bound of a `Real`, e.g. `Some(0.0)` for speeds.
    pub above: Option<f64>,
    /// Inclusive lower bound of a `Real`.
    pub at_least: Option<f64>,
    /// Inclusive upper bound of a `Real`.
    pub at_most: Option<f64>,
    /// The elements of an array must be strictly increasing.
    pub rising: bool,
    /// A frequency must be less than half of the net's evaluation rate.
    pub below_nyquist: bool,
}

impl Parameter {
    /// Creates a required parameter.
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

    /// Requires strictly increasing elements.
    pub const fn rising(self) -> Parameter {
        Parameter {
            rising: true,
            ..self
        }
    }

    /// Creates a required `Real` parameter.
    pub const fn real(name: &'static str, unit: UnitRule, doc: &'static str) -> Parameter {
        Parameter::new(
            name,
            ParameterKind::Value(PortType::Is(Type::Real), unit),
            doc,
        )
    }

    /// Creates a required `Bool` parameter.
    pub const fn bool(name: &'static str, doc: &'static str) -> Parameter {
        Parameter::new(
            name,
            ParameterKind::Value(PortType::Is(Type::Bool), UnitRule::Typed),
            doc,
        )
    }

    /// Creates a required `Int` parameter.
    pub const fn int(name: &'static str, doc: &'static str) -> Parameter {
        Parameter::new(
            name,
            ParameterKind::Value(PortType::Is(Type::Int), UnitRule::Typed),
            doc,
        )
    }

    /// Creates the parameter that names the primitive's arm.
    pub const fn arm() -> Parameter {
        Parameter::new(
            "device",
            ParameterKind::Arm,
            "name of an arm in the cell's configuration",
        )
    }

    /// Creates the parameter that names the primitive's device.
    pub const fn device() -> Parameter {
        Parameter::new(
            "device",
            ParameterKind::Device,
            "name of a device in the cell's configuration",
        )
    }

    /// Makes the parameter optional with this default.
    pub const fn default(self, value: DefaultValue) -> Parameter {
        Parameter {
            default: Some(value),
            ..self
        }
    }

    /// Requires a value greater than `bound`.
    pub const fn above(self, bound: f64) -> Parameter {
        Parameter {
            above: Some(bound),
            ..self
        }
    }

    /// Requires a value of at least `bound`.
    pub const fn at_least(self, bound: f64) -> Parameter {
        Parameter {
            at_least: Some(bound),
            ..self
        }
    }

    /// Requires a frequency below the Nyquist frequency: less than half of the net's evaluation rate.
    pub const fn below_nyquist(self) -> Parameter {
        Parameter {
            below_nyquist: true,
            ..self
        }
    }

    /// Requires a value of at most `bound`.
    pub const fn at_most(self, bound: f64) -> Parameter {
        Parameter {
            at_most: Some(bound),
            ..self
        }
    }
}
