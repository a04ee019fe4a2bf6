//! What becomes of each of the predecessor's types: one row a type, with its ports, its parameters and either a net of ours
//! in its own notation or the reason why there is none. The loader's threads.

mod core;
mod devices;
mod generic;
mod world;

use std::collections::HashMap;
use std::sync::OnceLock;

use super::text::{self, Fragment};
use super::values::Type;

/// What a primitive of the predecessor is besides what its row says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Nothing.
    M,
    /// Active: it has the input `inActive`.
    A,
    /// Stateful: it has the inputs `inActive` and `inReset`.
    S,
}

/// What an input that is null does there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reads {
    /// The last value that was not null counts.
    Last,
    /// The parameter of the same name counts.
    Parameter,
    /// It is null.
    Null,
}

/// Why there is nothing of ours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// No cell has such a device.
    Device,
    /// It never worked there.
    Dead,
    /// Nothing generates it, and it is made from other primitives.
    Rare,
    /// A cycle looks at no clock.
    Clock,
    /// It does not belong into a net.
    Safety,
    /// It is said in another place.
    Elsewhere,
    /// Only a library has it.
    Library,
}

/// What needs more than a net.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Builtin {
    /// A delayed link.
    Pre,
    /// A constant list.
    Array,
    /// An element.
    ArrayGet,
    /// A list with another element.
    ArraySet,
    /// Some elements.
    ArraySlice,
    /// `IsNull` of any element.
    ArrayIsNull,
    /// `NullIf` for a list.
    ArraySetNull,
    /// An `Input` with the key as its id.
    NetcommIn,
    /// A `Monitor` with the key as its id, or a `Publish`.
    NetcommOut,
    /// A `Subscribe` to what another net gives.
    InterNetcommIn,
    /// A `Publish` for another net.
    InterNetcommOut,
    /// Inverse kinematics as the hint wants it.
    InvKin,
    /// Elements of one `JointState`.
    JointMonitor,
    /// An element of one `JointPositionCommand`.
    JointPosition,
}

/// What a type becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum To {
    /// A net of ours in the predecessor's notation, `parent` being the primitive's inputs and parameters. Three types
    /// are not primitives; the port of all is `x`: `List(a=…,b=…)` is an array of its arguments, `At(of=…,index=…)` an
    /// element, `Else(link=parent.…,otherwise=…)` the first if the primitive's input is linked.
    Net(&'static str),
    /// One net or another, as a parameter that is a truth value says.
    By(&'static str, &'static str, &'static str),
    /// Something of our own.
    Special(Builtin),
    /// Nothing; the row's note says why.
    None(Reason),
}

/// One of the predecessor's types.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Its name; in the families what stands behind `Core::Double` and the like.
    pub name: &'static str,
    /// What it is.
    pub kind: Kind,
    /// `name:type`, with `*` behind the name of what must be connected.
    pub inputs: &'static str,
    /// `name:type`.
    pub outputs: &'static str,
    /// `name:type=default`; without a default that of the type.
    pub parameters: &'static str,
    /// What null does at its inputs.
    pub reads: Reads,
    /// Its outputs can be null although its inputs are not.
    pub may_be_null: bool,
    /// What it becomes.
    pub to: To,
    /// What differs, or why there is nothing; one sentence or nothing.
    pub note: &'static str,
}

impl Row {
    const fn new(
        name: &'static str,
        kind: Kind,
        inputs: &'static str,
        outputs: &'static str,
        parameters: &'static str,
    ) -> Row {
        Row {
            name,
            kind,
            inputs,
            outputs,
            parameters,
            reads: Reads::Last,
            may_be_null: false,
            to: To::Net(""),
            note: "",
        }
    }

    const fn to(self, reads: Reads, to: To) -> Row {
        Row { reads, to, ..self }
    }

    const fn may_be_null(self) -> Row {
        Row {
            may_be_null: true,
            ..self
        }
    }

    const fn note(self, note: &'static str) -> Row {
        Row { note, ..self }
    }
}

/// An input, output or parameter of a type.
#[derive(Clone, Copy, Debug)]
pub struct Port {
    /// Its name.
    pub name: &'static str,
    /// Its type.
    pub ty: Type,
    /// It is an array of that type.
    pub array: bool,
    /// An input that must be connected.
    pub required: bool,
    /// What a parameter is if nobody gives it.
    pub default: Option<&'static str>,
}

/// A type with its ports.
#[derive(Debug)]
pub struct Entry {
    /// Its whole name.
    pub name: String,
    /// Its row.
    pub row: &'static Row,
    /// Its inputs, with `inActive` and `inReset` if it has them.
    pub inputs: Vec<Port>,
    /// Its outputs.
    pub outputs: Vec<Port>,
    /// Its parameters.
    pub parameters: Vec<Port>,
    /// What it becomes, read: for `To::Net` one net, for `To::By` two.
    pub nets: Vec<Fragment>,
}

impl Entry {
    /// An input by name.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<&Port> {
        self.inputs.iter().find(|port| port.name == name)
    }

    /// An output by name.
    #[must_use]
    pub fn output(&self, name: &str) -> Option<&Port> {
        self.outputs.iter().find(|port| port.name == name)
    }

    /// A parameter by name.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<&Port> {
        self.parameters.iter().find(|port| port.name == name)
    }
}

/// The element types that each family is made for, with what stands before the name.
pub const FAMILIES: &[(&str, Type)] = &[
    ("Core::Boolean", Type::Bool),
    ("Core::Double", Type::Double),
    ("Core::Int", Type::Int),
    ("World::Frame", Type::Frame),
    ("World::Twist", Type::Twist),
    ("World::Wrench", Type::Wrench),
    ("World::Vector", Type::Vector),
    ("World::Rotation", Type::Rotation),
];

/// The rows of all types, families first, each with the title of its group.
#[must_use]
pub fn rows() -> [(&'static str, &'static [Row]); 4] {
    [
        ("Families", generic::ROWS),
        ("Logic, arithmetic, time, interpolation", core::ROWS),
        ("Vectors, rotations, frames, twists, wrenches", world::ROWS),
        ("Devices", devices::ROWS),
    ]
}

/// All types.
#[must_use]
pub fn all() -> &'static HashMap<String, Entry> {
    static ALL: OnceLock<HashMap<String, Entry>> = OnceLock::new();
    ALL.get_or_init(|| {
        let mut all = HashMap::new();
        for row in generic::ROWS {
            for (prefix, ty) in FAMILIES {
                insert(&mut all, format!("{prefix}{}", row.name), row, *ty);
            }
        }
        for row in [core::ROWS, world::ROWS, devices::ROWS]
            .into_iter()
            .flatten()
        {
            insert(&mut all, row.name.to_string(), row, Type::Any);
        }
        all
    })
}

fn insert(all: &mut HashMap<String, Entry>, name: String, row: &'static Row, any: Type) {
    let mut inputs = ports(row.inputs, any);
    let implied: &[&str] = match row.kind {
        Kind::M => &[],
        Kind::A => &["inActive"],
        Kind::S => &["inActive", "inReset"],
    };
    inputs.extend(implied.iter().map(|name| Port {
        name,
        ty: Type::Bool,
        array: false,
        required: false,
        default: None,
    }));
    let nets = match row.to {
        To::Net(net) => vec![net],
        To::By(_, yes, no) => vec![yes, no],
        To::Special(_) | To::None(_) => Vec::new(),
    };
    let entry = Entry {
        name: name.clone(),
        row,
        inputs,
        outputs: ports(row.outputs, any),
        parameters: ports(row.parameters, any),
        // A test reads every row's.
        nets: nets
            .into_iter()
            .filter_map(|net| Some(text::parse(net).ok()?.1))
            .collect(),
    };
    all.insert(name, entry);
}

/// Reads `name*:type[]=default name:type`.
fn ports(text: &'static str, any: Type) -> Vec<Port> {
    text.split_whitespace()
        .filter_map(|port| {
            let (name, rest) = port.split_once(':')?;
            let (ty, default) = match rest.split_once('=') {
                Some((ty, default)) => (ty, Some(default)),
                None => (rest, None),
            };
            let array = ty.ends_with("[]");
            let ty = Type::named(ty.trim_end_matches("[]"))?;
            Some(Port {
                name: name.trim_end_matches('*'),
                ty: if ty == Type::Any { any } else { ty },
                array,
                required: name.ends_with('*'),
                default,
            })
        })
        .collect()
}
