//! The conversion of each of the predecessor's types: one row per type, with its ports, its parameters and either an
//! RCC net in the predecessor's notation or the reason why there is none. Runs on the loader's threads.

mod core;
mod devices;
mod generic;
mod world;

use std::collections::BTreeMap;
use std::sync::OnceLock;

use super::text::{self, AstFragment};
use super::values::ForeignType;

/// The implied inputs of a primitive of the predecessor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PrimitiveClass {
    /// None.
    M,
    /// Active: it has the input `inActive`.
    A,
    /// Stateful: it has the inputs `inActive` and `inReset`.
    S,
}

/// How the predecessor reads an input that is null.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NullReading {
    /// As the last value that was not null.
    Last,
    /// As the parameter of the same name.
    Parameter,
    /// As null.
    Null,
}

/// Why a type has no counterpart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoCounterpart {
    /// No cell has such a device.
    Device,
    /// It never worked in the predecessor.
    Dead,
    /// No generator uses it, and it can be composed of other primitives.
    Rare,
    /// It reads a clock, which a cycle must not do.
    Clock,
    /// It belongs to safety hardware, not to a net.
    Safety,
    /// RCC provides it in another way.
    Elsewhere,
    /// Only a library of the predecessor has it.
    Library,
}

/// Conversions that a net cannot express.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpecialConversion {
    /// A delayed link.
    Pre,
    /// A constant list.
    Array,
    /// An element.
    ArrayGet,
    /// A list with one element replaced.
    ArraySet,
    /// A range of elements.
    ArraySlice,
    /// `IsNull` of the array.
    ArrayIsNull,
    /// `NullIf` for a list.
    ArraySetNull,
    /// An `Input` with the key as its id.
    NetcommIn,
    /// A `Monitor` with the key as its id, or a `Publish`.
    NetcommOut,
    /// A `Subscribe` to a value of another net.
    InterNetcommIn,
    /// A `Publish` for another net.
    InterNetcommOut,
    /// Inverse kinematics; the hint decides which primitive.
    InvKin,
    /// Elements of one `JointState`.
    JointMonitor,
    /// An element of one `JointPositionCommand`.
    JointPosition,
}

/// The counterpart of a type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counterpart {
    /// An RCC net in the predecessor's notation, in which `parent` has the inputs and parameters of the primitive.
    /// Three types are not primitives; each has the one port `x`: `List(a=…,b=…)` is an array of its arguments,
    /// `At(of=…,index=…)` an element, `Else(link=parent.…,otherwise=…)` the first argument if the primitive's input is
    /// connected, else the second one.
    Net(&'static str),
    /// One of two nets: the first if this Bool parameter is true, else the second.
    By(&'static str, &'static str, &'static str),
    /// A conversion in code.
    Special(SpecialConversion),
    /// None; the row's note gives the reason.
    None(NoCounterpart),
}

/// A type of the predecessor.
#[derive(Clone, Copy, Debug)]
pub struct ConversionRow {
    /// Its name; in the families the part after `Core::Double` and the like.
    pub name: &'static str,
    /// Its implied inputs.
    pub kind: PrimitiveClass,
    /// Inputs as `name:type`, with `*` after the name of a required one.
    pub inputs: &'static str,
    /// Outputs as `name:type`.
    pub outputs: &'static str,
    /// Parameters as `name:type=default`; without a default, that of the type.
    pub parameters: &'static str,
    /// How it reads inputs that are null.
    pub reads: NullReading,
    /// Its outputs can be null although its inputs are not.
    pub may_be_null: bool,
    /// Its counterpart.
    pub to: Counterpart,
    /// The difference to the counterpart, or the reason why there is none; one sentence, or empty.
    pub note: &'static str,
}

impl ConversionRow {
    const fn new(
        name: &'static str,
        kind: PrimitiveClass,
        inputs: &'static str,
        outputs: &'static str,
        parameters: &'static str,
    ) -> ConversionRow {
        ConversionRow {
            name,
            kind,
            inputs,
            outputs,
            parameters,
            reads: NullReading::Last,
            may_be_null: false,
            to: Counterpart::Net(""),
            note: "",
        }
    }

    const fn to(self, reads: NullReading, to: Counterpart) -> ConversionRow {
        ConversionRow { reads, to, ..self }
    }

    const fn may_be_null(self) -> ConversionRow {
        ConversionRow {
            may_be_null: true,
            ..self
        }
    }

    const fn note(self, note: &'static str) -> ConversionRow {
        ConversionRow { note, ..self }
    }
}

/// An input, output or parameter of a type.
#[derive(Clone, Copy, Debug)]
pub struct ForeignPort {
    /// Its name.
    pub name: &'static str,
    /// Its type.
    pub ty: ForeignType,
    /// True for an array of that type.
    pub array: bool,
    /// True for an input that must be connected.
    pub required: bool,
    /// Default of a parameter.
    pub default: Option<&'static str>,
}

/// A type with its ports.
#[derive(Debug)]
pub struct TypeEntry {
    /// Its full name.
    pub name: String,
    /// Its row.
    pub row: &'static ConversionRow,
    /// Its inputs, with `inActive` and `inReset` if it has them.
    pub inputs: Vec<ForeignPort>,
    /// Its outputs.
    pub outputs: Vec<ForeignPort>,
    /// Its parameters.
    pub parameters: Vec<ForeignPort>,
    /// The parsed nets of the counterpart: one for `Counterpart::Net`, two for `Counterpart::By`.
    pub nets: Vec<AstFragment>,
}

impl TypeEntry {
    /// Returns an input by name.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<&ForeignPort> {
        self.inputs.iter().find(|port| port.name == name)
    }

    /// Returns an output by name.
    #[must_use]
    pub fn output(&self, name: &str) -> Option<&ForeignPort> {
        self.outputs.iter().find(|port| port.name == name)
    }

    /// Returns a parameter by name.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<&ForeignPort> {
        self.parameters.iter().find(|port| port.name == name)
    }
}

/// The prefixes of the families, with their element types.
pub const FAMILIES: &[(&str, ForeignType)] = &[
    ("Core::Boolean", ForeignType::Bool),
    ("Core::Double", ForeignType::Double),
    ("Core::Int", ForeignType::Int),
    ("World::Frame", ForeignType::Frame),
    ("World::Twist", ForeignType::Twist),
    ("World::Wrench", ForeignType::Wrench),
    ("World::Vector", ForeignType::Vector),
    ("World::Rotation", ForeignType::Rotation),
];

/// Returns the rows of all types, families first, each group with its title.
#[must_use]
pub fn rows() -> [(&'static str, &'static [ConversionRow]); 4] {
    [
        ("Families", generic::ROWS),
        ("Logic, arithmetic, time, interpolation", core::ROWS),
        ("Vectors, rotations, frames, twists, wrenches", world::ROWS),
        ("Devices", devices::ROWS),
    ]
}

/// Returns all types, by full name.
#[must_use]
pub fn all() -> &'static BTreeMap<String, TypeEntry> {
    static ALL: OnceLock<BTreeMap<String, TypeEntry>> = OnceLock::new();
    ALL.get_or_init(|| {
        let mut all = BTreeMap::new();
        for row in generic::ROWS {
            for (prefix, ty) in FAMILIES {
                insert(&mut all, format!("{prefix}{}", row.name), row, *ty);
            }
        }
        for row in [core::ROWS, world::ROWS, devices::ROWS]
            .into_iter()
            .flatten()
        {
            insert(&mut all, row.name.to_string(), row, ForeignType::Any);
        }
        all
    })
}

fn insert(
    all: &mut BTreeMap<String, TypeEntry>,
    name: String,
    row: &'static ConversionRow,
    any: ForeignType,
) {
    let mut inputs = ports(row.inputs, any);
    let implied: &[&str] = match row.kind {
        PrimitiveClass::M => &[],
        PrimitiveClass::A => &["inActive"],
        PrimitiveClass::S => &["inActive", "inReset"],
    };
    inputs.extend(implied.iter().map(|name| ForeignPort {
        name,
        ty: ForeignType::Bool,
        array: false,
        required: false,
        default: None,
    }));
    let nets = match row.to {
        Counterpart::Net(net) => vec![net],
        Counterpart::By(_, yes, no) => vec![yes, no],
        Counterpart::Special(_) | Counterpart::None(_) => Vec::new(),
    };
    let entry = TypeEntry {
        name: name.clone(),
        row,
        inputs,
        outputs: ports(row.outputs, any),
        parameters: ports(row.parameters, any),
        // A test parses the nets of all rows.
        nets: nets
            .into_iter()
            .filter_map(|net| Some(text::parse(net).ok()?.1))
            .collect(),
    };
    all.insert(name, entry);
}

/// Parses `name*:type[]=default name:type`.
fn ports(text: &'static str, any: ForeignType) -> Vec<ForeignPort> {
    text.split_whitespace()
        .filter_map(|port| {
            let (name, rest) = port.split_once(':')?;
            let (ty, default) = match rest.split_once('=') {
                Some((ty, default)) => (ty, Some(default)),
                None => (rest, None),
            };
            let array = ty.ends_with("[]");
            let ty = ForeignType::named(ty.trim_end_matches("[]"))?;
            Some(ForeignPort {
                name: name.trim_end_matches('*'),
                ty: if ty == ForeignType::Any { any } else { ty },
                array,
                required: name.ends_with('*'),
                default,
            })
        })
        .collect()
}
