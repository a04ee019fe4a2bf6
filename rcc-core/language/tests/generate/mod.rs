//! Generators of nets from the catalogue's specs: texts of one primitive, and random nets of any size, valid by
//! construction. Additions to the catalogue are covered without a change here. Used by tests.

use rcc_core::primitive::{
    ChannelKind, Dim, ElementType, Parameter, ParameterKind, PortType, Spec,
};
use rcc_core::types::Type;

#[allow(dead_code)] // Not every test makes whole nets.
mod net;

#[allow(unused_imports)] // Not every test makes whole nets.
pub use net::{RandomNet, random_net};

/// Lengths of arrays, by length variable.
pub const LENGTHS: [u16; 4] = [3, 4, 2, 3];
/// The possible values of an open type.
pub const OPEN: [Type; 10] = [
    Type::Real,
    Type::Int,
    Type::Bool,
    Type::Vector3,
    Type::Twist,
    Type::Pose,
    Type::Rotation,
    Type::Reals(3),
    Type::Ints(2),
    Type::Matrix(2, 2),
];

/// Seeded pseudo-random numbers: SplitMix64.
#[derive(Clone, Debug)]
pub struct TestRandom(pub u64);

impl TestRandom {
    /// Returns 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a number less than `bound`; 0 if `bound` is 0.
    pub fn below(&mut self, bound: usize) -> usize {
        (self.bits() % (bound.max(1) as u64)) as usize
    }

    /// Returns true once in `times`.
    pub fn once_in(&mut self, times: usize) -> bool {
        self.below(times) == 0
    }

    /// Returns a number from 0 to 1.
    pub fn share(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns one of several values.
    pub fn pick<'a, T>(&mut self, from: &'a [T]) -> Option<&'a T> {
        from.get(self.below(from.len()))
    }
}

fn length(dim: Dim) -> Option<u16> {
    let of = |variable: u8| LENGTHS.get(usize::from(variable)).copied();
    match dim {
        Dim::Is(length) => Some(length),
        Dim::Var(a) | Dim::Small(a) => of(a),
        Dim::Sum(a, b) => Some(of(a)? + of(b)?),
    }
}

/// Returns the type of a port if the open one is `open`; `None` if the port takes several types.
pub fn type_of(ty: PortType, open: Type) -> Option<Type> {
    let array = |element: Type, length: u16| match element {
        Type::Real => Some(Type::Reals(length)),
        Type::Int => Some(Type::Ints(length)),
        Type::Bool => Some(Type::Bools(length)),
        _ => None,
    };
    match ty {
        PortType::Is(ty) => Some(ty),
        PortType::Any
        | PortType::Scalar
        | PortType::Number
        | PortType::Linear
        | PortType::Of(_) => Some(open),
        PortType::Part => Some(match open {
            Type::Int | Type::Ints(_) => Type::Int,
            _ => Type::Real,
        }),
        PortType::Array(ElementType::Are(element), dim) => array(element, length(dim)?),
        PortType::Array(ElementType::Open, dim) => array(open, length(dim)?),
        PortType::Matrix(rows, columns) => {
            let (rows, columns) = (length(rows)?, length(columns)?);
            Some(Type::Matrix(rows as u8, columns as u8))
        }
        PortType::Joints => Some(Type::Reals(7)),
        PortType::JointColumns(rows) => Some(Type::Matrix(rows, 7)),
        PortType::Many(_) => None,
    }
}

/// Returns the number of values of the open type that a port takes as a list.
pub fn many(ty: PortType) -> Option<u16> {
    match ty {
        PortType::Many(dim) => length(dim),
        _ => None,
    }
}

/// Returns a constant of a type in the notation of nets.
pub fn constant(ty: Type, random: &mut TestRandom) -> String {
    let real = |random: &mut TestRandom| format!("{:.6}", random.share() * 2.0 - 1.0);
    let int = |random: &mut TestRandom| random.below(9).to_string();
    let bool = |random: &mut TestRandom| random.once_in(2).to_string();
    let three = |random: &mut TestRandom| list(3, || real(random));
    match ty {
        Type::Real => real(random),
        Type::Int => int(random),
        Type::Bool => bool(random),
        Type::Pose => format!("{{xyz: {}, rpy: {}}}", three(random), three(random)),
        Type::Rotation => format!("{{rpy: {}}}", three(random)),
        Type::Matrix(rows, columns) => list(u32::from(rows), || {
            list(u32::from(columns), || real(random))
        }),
        Type::Bools(n) => list(u32::from(n), || bool(random)),
        Type::Ints(n) => list(u32::from(n), || int(random)),
        Type::Text => "text".to_owned(),
        Type::Vector3 | Type::Twist | Type::Wrench | Type::Reals(_) => {
            list(ty.width(), || real(random))
        }
    }
}

fn list(count: u32, mut one: impl FnMut() -> String) -> String {
    let words: Vec<String> = (0..count).map(|_| one()).collect();
    format!("[{}]", words.join(", "))
}

/// Returns a channel of the golden cell.
pub fn channel(kind: ChannelKind) -> (&'static str, &'static str) {
    match kind {
        ChannelKind::DigitalInput => ("io", "button"),
        ChannelKind::DigitalOutput => ("io", "lamp"),
        ChannelKind::AnalogInput => ("io", "level"),
        ChannelKind::AnalogOutput => ("io", "speed"),
    }
}

/// Returns a number within the bounds of a parameter.
fn bounded(parameter: &Parameter, random: &mut TestRandom) -> f64 {
    let low = parameter.at_least.or(parameter.above);
    let share = random.share() * 0.9 + 0.05;
    match (low, parameter.at_most) {
        (Some(low), Some(high)) => low + (high - low) * share,
        (Some(low), None) => low + share,
        (None, Some(high)) => high - share,
        (None, None) => share,
    }
}

/// Returns parameters that cannot be random: few paths can be followed from where the tests hold the arm, and the rows of
/// a state machine are states and indices.
fn fixed(name: &str) -> Option<&'static str> {
    Some(match name {
        "JointMotion" => "{device: lwr, to: [0.4, 0.6, -0.1, -1.5, 0.2, 0.9, 0.3]}",
        "LinearMotion" => {
            "{device: lwr, from: {xyz: [-0.5, -0.05, 0.39], rpy: [-3.1, 0, 2.8]}, to: {xyz: [-0.5, -0.1, 0.42], rpy: [-3.1, 0, 2.8]}, velocity: 0.1}"
        }
        "CircularMotion" => {
            "{device: lwr, via: [-0.5, -0.05, 0.39], to: {xyz: [-0.5, -0.1, 0.42], rpy: [-3.1, 0, 2.8]}, velocity: 0.1}"
        }
        "SplineMotion" => {
            "{device: lwr, through: [{xyz: [-0.5, -0.05, 0.39], rpy: [-3.1, 0, 2.8]}, {xyz: [-0.5, -0.1, 0.42], rpy: [-3.1, 0, 2.8]}]}"
        }
        "MotionSequence" => {
            "{device: lwr, path: [{lin: {xyz: [0.05, 0, 0], rpy: [0, 0, 0]}, relative: base, blend: 20 mm}, {ptp: {joints: [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4]}}]}"
        }
        "StateMachine" => "{transitions: [[0, 1, 0], [1, 0, 0]]}",
        _ => return None,
    })
}

/// Returns the parameters of a primitive in the golden cell (`tests/nets/cell.yaml`), in the notation of nets. Returns
/// `None` if they cannot be generated, so that the spec's first example must provide them.
pub fn parameters(spec: &Spec, open: Type, random: &mut TestRandom) -> Option<String> {
    if let Some(fixed) = fixed(spec.name) {
        return Some(fixed.to_owned());
    }
    let example = spec.examples.first().map(|example| example.parameters);
    let mut words = Vec::new();
    // The channel determines the device.
    let channel = spec
        .parameters
        .iter()
        .find_map(|parameter| match parameter.kind {
            ParameterKind::Channel(kind) => Some(channel(kind)),
            _ => None,
        });
    for parameter in spec.parameters {
        let optional = parameter.default.is_some();
        // The initial value determines its type; other values of the open type are not always possible (an order).
        let open_value = parameter
            .kind
            .value()
            .is_some_and(|(ty, _)| ty == PortType::Any);
        let says_type = open_value && parameter.name == "initial";
        if optional && !says_type && (open_value || random.once_in(2)) {
            continue;
        }
        let value = match parameter.kind {
            ParameterKind::Value(ty, _) => {
                let ty = type_of(ty, open);
                match ty {
                    Some(Type::Real) => Some(format!("{:?}", bounded(parameter, random))),
                    Some(Type::Int) => Some((bounded(parameter, random).ceil() as i64).to_string()),
                    Some(Type::Reals(n)) if parameter.rising => {
                        let mut last = -1.0;
                        Some(list(u32::from(n), || {
                            last += 0.1 + random.share();
                            format!("{last:.6}")
                        }))
                    }
                    Some(ty) => Some(constant(ty, random)),
                    None => None,
                }
            }
            ParameterKind::Start(ty, _) => Some(constant(ty, random)),
            ParameterKind::First(_) => Some(constant(open, random)),
            ParameterKind::Length(dim) => length(Dim::Var(dim)).map(|length| length.to_string()),
            ParameterKind::Window => Some(format!("{} ms", 1 + random.below(20))),
            ParameterKind::Arm => Some("lwr".to_owned()),
            ParameterKind::Device => Some(channel.map_or("lwr", |(device, _)| device).to_owned()),
            ParameterKind::Channel(_) => channel.map(|(_, channel)| channel.to_owned()),
            ParameterKind::Rate => Some("100 Hz".to_owned()),
            ParameterKind::Word(words) => random.pick(words).map(|word| (*word).to_owned()),
            // Unique within a net.
            ParameterKind::Topic => Some(format!("t/{}", random.below(1 << 40))),
            // Inferred from links and values.
            ParameterKind::Type | ParameterKind::Unit(_) => None,
            #[allow(unreachable_patterns)] // Kinds to come are told by their examples.
            _ => None,
        };
        match value {
            Some(value) => words.push(format!("{}: {value}", parameter.name)),
            None if optional => {}
            None => {
                return example
                    .filter(|example| !example.is_empty())
                    .map(str::to_owned);
            }
        }
    }
    Some(format!("{{{}}}", words.join(", ")))
}
