//! What a primitive is: its spec (for the loader and for people) and its kernels (for the cycle).
//!
//! A primitive is one file in `primitives/` that defines one [`Entry`], and two lines in
//! `primitives.rs`. The loader reads only the spec; the real-time thread runs only kernels.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::types::{Store, Type};
use crate::unit::Unit;

/// The type of a port in a spec.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortType {
    /// Exactly this type.
    Is(Type),
    /// Any type that can be in the arena; the same for all `Any` ports of one primitive.
    Any,
    /// `Bool`, `Int` or `Real`; the same for all `Scalar` ports of one primitive.
    Scalar,
    /// `Int` or `Real`; the same for all `Number` ports of one primitive.
    Number,
    /// `Real[n]` with n the number of joints of the primitive's device.
    Joints,
}

impl PortType {
    /// True if links and literals decide the type.
    pub const fn is_open(self) -> bool {
        matches!(self, PortType::Any | PortType::Scalar | PortType::Number)
    }

    /// True if values of more than one width can be at the port.
    pub const fn is_wide(self) -> bool {
        matches!(self, PortType::Any | PortType::Joints)
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
    /// The unit that the cell's configuration gives to the channel.
    Channel,
    /// The type says it all (`Pose`, `Twist`, `Wrench`, `Rotation`) or there is none (`Bool`, `Int`).
    Typed,
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
    /// The name of a device that has an arm.
    Arm,
    /// The name of any device.
    Device,
    /// The name of a channel of the device that the parameter `device` names.
    Channel(ChannelKind),
    /// How often per second; becomes a whole number of cycles.
    Rate,
}

impl ParameterKind {
    /// Type and unit of a parameter that is a value.
    pub const fn value(self) -> Option<(PortType, UnitRule)> {
        match self {
            ParameterKind::Value(ty, unit) => Some((ty, unit)),
            ParameterKind::Start(ty, unit) => Some((PortType::Is(ty), unit)),
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

    /// It must not be greater than `bound`.
    pub const fn at_most(self, bound: f64) -> Parameter {
        Parameter {
            at_most: Some(bound),
            ..self
        }
    }
}

/// What a primitive remembers from cycle to cycle; each kind is one contiguous block in the arena.
/// Reals start as null (NaN), Bools as null, Ints as 0, unless `prepare` or a [`ParameterKind::Start`] sets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct State {
    /// Number of `f64`.
    pub reals: u32,
    /// Number of `Bool`.
    pub bools: u32,
    /// Number of `i64`.
    pub ints: u32,
}

impl State {
    /// Remembers nothing.
    pub const NONE: State = State {
        reals: 0,
        bools: 0,
        ints: 0,
    };
}

/// What the loader and the executor must do for a primitive besides running its kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Nothing.
    Plain,
    /// Its `value` input is copied out after the cycle; it has no kernel.
    Monitor,
    /// Its `value` is put into a constant slot that stands for its output; it has no kernel.
    Constant,
    /// Every net needs one.
    Termination,
    /// A net with one can be cancelled.
    Cancel,
    /// Needs a path clock.
    Motion,
    /// Commands the joints of its device: a unique resource.
    CommandsArm,
    /// Commands a channel of its device: a unique resource.
    CommandsChannel,
}

/// How null passes from inputs to outputs, for the loader; [`Spec::null`] says it to people.
///
/// The loader asks it whether a loop can ever lose a null again, so it takes the best case: what the
/// outputs may be if every known input has a helpful value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NullRule {
    /// A null input gives null outputs.
    Propagates,
    /// One known input is enough for known outputs.
    AnyKnown,
    /// The first input must be known, and one of the others.
    FirstAndAnyKnown,
    /// Outputs are known whatever the inputs are.
    Known,
}

/// Everything that people and the loader know about a primitive.
#[derive(Clone, Copy, Debug)]
pub struct Spec {
    /// The type's name in nets.
    pub name: &'static str,
    /// One sentence.
    pub summary: &'static str,
    /// What null at an input does.
    pub null: &'static str,
    /// The same for the loader.
    pub null_rule: NullRule,
    /// Inputs, in operand order.
    pub inputs: &'static [Port],
    /// Outputs, in operand order.
    pub outputs: &'static [Port],
    /// Parameters, in operand order.
    pub parameters: &'static [Parameter],
    /// State.
    pub state: State,
    /// Role.
    pub role: Role,
}

/// The null rule of most primitives.
pub const PROPAGATES: &str = "a null input gives null outputs";

impl Spec {
    /// A plain primitive; fill in the rest with struct update syntax.
    pub const PLAIN: Spec = Spec {
        name: "",
        summary: "",
        null: PROPAGATES,
        null_rule: NullRule::Propagates,
        inputs: &[],
        outputs: &[],
        parameters: &[],
        state: State::NONE,
        role: Role::Plain,
    };

    /// True if the primitive works on values of several widths; the operands of a kernel that is not
    /// for single values then end with the width.
    pub fn is_wide(&self) -> bool {
        let ports = self.inputs.iter().chain(self.outputs).map(|port| port.ty);
        let values = self
            .parameters
            .iter()
            .filter_map(|parameter| Some(parameter.kind.value()?.0));
        ports.chain(values).any(PortType::is_wide)
    }

    /// The operands of a kernel of this primitive, in order: inputs, outputs, parameters, state
    /// (reals, bools, ints), path clock, width. This order is the contract between loader, check and
    /// kernels.
    pub fn operands(&self, kernel: &Kernel) -> impl Iterator<Item = Operand> + use<'_> {
        let (store, has_width) = (kernel.store, self.has_width(kernel));
        let width = if has_width {
            Width::Operand
        } else {
            Width::Fixed(1)
        };
        let port = move |ty: PortType, written: bool| match ty {
            PortType::Is(ty) => Operand::slot(ty.store(), Width::Fixed(ty.width()), written),
            PortType::Any => Operand::slot(store, width, written),
            PortType::Scalar | PortType::Number => Operand::slot(store, Width::Fixed(1), written),
            PortType::Joints => Operand::slot(Some(Store::Real), width, written),
        };
        let state = [
            (Store::Real, self.state.reals),
            (Store::Bool, self.state.bools),
            (Store::Int, self.state.ints),
        ];
        let inputs = self.inputs.iter().map(move |p| port(p.ty, false));
        let outputs = self.outputs.iter().map(move |p| port(p.ty, true));
        let parameters = self.parameters.iter().filter_map(move |p| match p.kind {
            ParameterKind::Value(ty, _) => Some(port(ty, false)),
            ParameterKind::Arm => Some(Operand::Arm),
            ParameterKind::Device => Some(Operand::Device),
            ParameterKind::Channel(kind) => Some(Operand::Channel(kind)),
            ParameterKind::Start(..) | ParameterKind::Rate => None,
        });
        let state = state.into_iter().filter(|(_, count)| *count > 0);
        let state = state.map(|(store, count)| Operand::Slot {
            store,
            width: Width::Fixed(count),
            written: true,
        });
        let clock = (self.role == Role::Motion).then_some(Operand::Clock);
        let width = has_width.then_some(Operand::Width);
        inputs
            .chain(outputs)
            .chain(parameters)
            .chain(state)
            .chain(clock)
            .chain(width)
    }

    /// True if the operands of this kernel end with the width.
    pub fn has_width(&self, kernel: &Kernel) -> bool {
        self.is_wide() && !kernel.single
    }

    /// Finds an input and its place.
    pub fn input(&self, name: &str) -> Option<(usize, &'static Port)> {
        self.inputs
            .iter()
            .enumerate()
            .find(|(_, port)| port.name == name)
    }

    /// Finds an output and its place.
    pub fn output(&self, name: &str) -> Option<(usize, &'static Port)> {
        self.outputs
            .iter()
            .enumerate()
            .find(|(_, port)| port.name == name)
    }
}

/// How many elements a slot operand has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// This many.
    Fixed(u32),
    /// As many as the width operand says.
    Operand,
}

/// What a number in the operand list means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operand {
    /// Index of the first element in the arena of `store`.
    Slot {
        /// Which arena.
        store: Store,
        /// How many elements.
        width: Width,
        /// The kernel writes it.
        written: bool,
    },
    /// Index of a device that has an arm.
    Arm,
    /// Index of a device.
    Device,
    /// Index of a channel of the device before it.
    Channel(ChannelKind),
    /// Index of a path clock.
    Clock,
    /// Width of the polymorphic slots.
    Width,
}

impl Operand {
    fn slot(store: Option<Store>, width: Width, written: bool) -> Operand {
        Operand::Slot {
            store: store.unwrap_or(Store::Real),
            width,
            written,
        }
    }
}

/// The executable form of a primitive for one arena.
#[derive(Clone, Copy)]
pub struct Kernel {
    /// The arena of its open ports; `None` if it has none.
    pub store: Option<Store>,
    /// Only for values of one element; its operands have no width.
    pub single: bool,
    /// Runs all primitives of a run: `operands` is a whole number of operand groups.
    pub run: fn(&mut Frame<'_>, operands: &[u32]),
}

impl Kernel {
    /// The kernel of a primitive without open ports.
    pub const fn new(run: fn(&mut Frame<'_>, &[u32])) -> Kernel {
        Kernel {
            store: None,
            single: false,
            run,
        }
    }

    /// The kernel for one arena.
    pub const fn of(store: Store, run: fn(&mut Frame<'_>, &[u32])) -> Kernel {
        Kernel {
            store: Some(store),
            single: false,
            run,
        }
    }

    /// The kernel for single values of one arena, of a primitive that also takes wide ones.
    pub const fn single(store: Store, run: fn(&mut Frame<'_>, &[u32])) -> Kernel {
        Kernel {
            store: Some(store),
            single: true,
            run,
        }
    }
}

/// Computes the start values of one primitive when its command becomes ready, off the RT thread.
pub type Prepare = fn(&mut Preparation<'_>, operands: &[u32]) -> Result<(), PrepareFault>;

/// One row of the catalogue.
#[derive(Clone, Copy)]
pub struct Entry {
    /// For people and the loader.
    pub spec: Spec,
    /// For the cycle; at most 8. The first one that fits is taken, so that those for single values come first.
    pub kernels: &'static [Kernel],
    /// Start values that depend on the devices.
    pub prepare: Option<Prepare>,
}

impl Entry {
    /// A primitive without start values of its own.
    pub const fn new(spec: Spec, kernels: &'static [Kernel]) -> Entry {
        Entry {
            spec,
            kernels,
            prepare: None,
        }
    }

    /// Adds the computation of start values.
    pub const fn prepared_by(self, prepare: Prepare) -> Entry {
        Entry {
            prepare: Some(prepare),
            ..self
        }
    }

    /// Index of the kernel for an arena (of its open ports, `None` if it has none) and a width.
    pub fn kernel_for(&self, store: Option<Store>, width: u32) -> Option<usize> {
        let fits = |kernel: &Kernel| kernel.store == store && (!kernel.single || width == 1);
        self.kernels.iter().position(fits)
    }
}

mod step;

pub use step::{
    Outcome, choose, compare_int, compare_real, each, each_bool, each_int, each_real, real_unless,
};
