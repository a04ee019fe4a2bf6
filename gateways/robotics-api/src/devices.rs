//! The devices that the library creates: their types and parameters, what is reported of them, and the files of the
//! cell in which they are simulated. Pure functions.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::fmt::Write as _;

use crate::dio::DioValue;

mod cell_file;
mod dh;

pub use cell_file::{CellOptions, cell_file, robot_file};
pub use dh::urdf;

const DEG: f64 = PI / 180.0;

/// A device as it was requested.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceSpec {
    /// Its name in the library.
    pub name: String,
    /// Its type in the library.
    pub type_name: String,
    /// Kind of the device.
    pub kind: DeviceKind,
}

/// Kind of a device.
#[derive(Clone, Debug, PartialEq)]
pub enum DeviceKind {
    /// An arm.
    Arm(ArmSpec),
    /// Digital and analog channels.
    Io(IoSpec),
}

/// An arm with its limits as the library gives them.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmSpec {
    /// Its joints, from the base.
    pub joints: Vec<JointSpec>,
    /// Its geometry.
    pub geometry: ArmGeometry,
}

/// A joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSpec {
    /// Smallest position, rad.
    pub least: f64,
    /// Greatest position, rad.
    pub greatest: f64,
    /// Position at the beginning, rad.
    pub home: f64,
    /// Velocity for which the library plans, rad/s.
    pub velocity: f64,
    /// Acceleration for which the library plans, rad/s².
    pub acceleration: f64,
}

/// The geometry of an arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArmGeometry {
    /// Seven joints: heights and lengths in m, and the direction of each joint along z, y, z, y, z, y, z.
    Srs {
        /// Base to shoulder, shoulder to elbow, elbow to wrist, wrist to flange.
        lengths: [f64; 4],
        /// 1 or -1.
        signs: [i8; 7],
    },
    /// Six joints: rows of Denavit and Hartenberg in standard form, theta = q + t.
    Dh(DhTable),
}

/// Rows of Denavit and Hartenberg, in m and rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DhTable {
    /// Along the joint's axis.
    pub d: [f64; 6],
    /// Along the common normal.
    pub a: [f64; 6],
    /// Offset of the joint's angle.
    pub t: [f64; 6],
    /// Angle about the common normal.
    pub al: [f64; 6],
}

/// Numbers of channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IoSpec {
    /// Digital inputs.
    pub digin: usize,
    /// Digital outputs.
    pub digout: usize,
    /// Analog inputs.
    pub anin: usize,
    /// Analog outputs.
    pub anout: usize,
}

/// Most digital channels of a kind; the simulated station has as many.
const DIGITAL_MAX: usize = 64;
/// Most analog channels of a kind.
const ANALOG_MAX: usize = 16;

/// Why a device cannot be created.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// Not a type of this gateway.
    #[error("device type '{0}' is not simulated here; known types: {known}", known = TYPES.join(", "))]
    UnknownType(String),
    /// A parameter that cannot be read.
    #[error("parameter {name} of '{device}': {cause}")]
    Parameter {
        /// The device.
        device: String,
        /// The parameter.
        name: &'static str,
        /// The fault.
        cause: String,
    },
    /// A name that nets cannot carry.
    #[error(
        "invalid name '{0}' of a device: 1 to 64 ASCII characters without quotes, comma, equals sign and line break"
    )]
    Name(String),
}

/// The types of devices, as the library's drivers name them.
pub const TYPES: [&str; 4] = ["kuka_lwr_sim", "kuka_iiwa_sim", "kuka_kr_arm_sim", "io"];

/// Joints of an arm whose description leaves them out: ranges, velocities and accelerations in degrees.
struct ArmDefaults {
    ranges: [f64; 7],
    velocities: [f64; 7],
    accelerations: [f64; 7],
    lengths: [f64; 4],
    signs: [i8; 7],
}

/// As `configs/robots/lwr4plus.yaml`.
const LWR: ArmDefaults = ArmDefaults {
    ranges: [170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 170.0],
    velocities: [110.0, 110.0, 128.0, 128.0, 204.0, 184.0, 184.0],
    accelerations: [1200.0, 1200.0, 1600.0, 1600.0, 2500.0, 4400.0, 4400.0],
    lengths: [0.3105, 0.4, 0.39, 0.078],
    signs: [1, -1, 1, 1, 1, -1, 1],
};
/// As `configs/robots/iiwa7.yaml`.
const IIWA: ArmDefaults = ArmDefaults {
    ranges: [170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0],
    velocities: [98.0, 98.0, 100.0, 130.0, 140.0, 180.0, 180.0],
    accelerations: [490.0, 490.0, 500.0, 650.0, 700.0, 900.0, 900.0],
    lengths: [0.34, 0.4, 0.4, 0.126],
    signs: [1, 1, 1, -1, 1, 1, 1],
};

/// Parameters of arms; those that only a real arm needs are read and have no effect on an ideal one.
const ARM_PARAMETERS: [&str; 14] = [
    "min_joint",
    "max_joint",
    "home_joint",
    "max_vel",
    "max_acc",
    "link_lengths",
    "mass",
    "com",
    "moi",
    "tcp",
    "dh_d",
    "dh_a",
    "dh_t",
    "dh_al",
];
const IO_PARAMETERS: [&str; 4] = ["digin", "digout", "anin", "anout"];

impl DeviceSpec {
    /// Reads the parameters of a device. Returns the names of those that have no meaning here, too.
    ///
    /// # Errors
    /// Returns the first parameter that cannot be used.
    pub fn read(
        name: &str,
        type_name: &str,
        parameters: &BTreeMap<String, String>,
    ) -> Result<(DeviceSpec, Vec<String>), DeviceError> {
        let is_fit = name
            .chars()
            .all(|c| (' '..='~').contains(&c) && !"'\"\\,=".contains(c));
        if name.trim() != name || name.is_empty() || name.len() > 64 || !is_fit {
            return Err(DeviceError::Name(name.to_owned()));
        }
        let reader = ParameterReader { name, parameters };
        let (kind, known) = match type_name {
            "kuka_lwr_sim" => (reader.srs(&LWR)?, &ARM_PARAMETERS[..]),
            "kuka_iiwa_sim" => (reader.srs(&IIWA)?, &ARM_PARAMETERS[..]),
            "kuka_kr_arm_sim" => (reader.six_axes()?, &ARM_PARAMETERS[..]),
            "io" => (reader.io()?, &IO_PARAMETERS[..]),
            other => return Err(DeviceError::UnknownType(other.to_owned())),
        };
        let unknown = parameters
            .keys()
            .filter(|key| !known.contains(&key.as_str()));
        let spec = DeviceSpec {
            name: name.to_owned(),
            type_name: type_name.to_owned(),
            kind,
        };
        Ok((spec, unknown.cloned().collect()))
    }

    /// Returns what is reported of the device: type and interfaces.
    #[must_use]
    pub fn description(&self) -> DioValue {
        describe(&self.type_name, &self.kind)
    }
}

/// Returns type and interfaces of a device.
#[must_use]
pub fn describe(type_name: &str, kind: &DeviceKind) -> DioValue {
    let text = |value: String| DioValue::Text(value);
    let map = |entries: Vec<(&str, DioValue)>| {
        DioValue::Map(
            entries
                .into_iter()
                .map(|(key, value)| (key.to_owned(), value))
                .collect(),
        )
    };
    let interfaces = match kind {
        DeviceKind::Arm(arm) => vec![
            (
                "robotarm",
                map(vec![("jointcount", text(arm.joints.len().to_string()))]),
            ),
            ("armkinematics", map(Vec::new())),
        ],
        DeviceKind::Io(io) => {
            let counts = [
                ("digin", io.digin),
                ("digout", io.digout),
                ("anin", io.anin),
                ("anout", io.anout),
            ];
            let counts = counts.map(|(key, count)| (key, text(count.to_string())));
            vec![("io", map(counts.to_vec()))]
        }
    };
    map(vec![
        ("type", text(type_name.to_owned())),
        ("interfaces", map(interfaces)),
    ])
}

/// The place of a parameter in a joint.
type JointPlace = fn(&mut JointSpec) -> &mut f64;

struct ParameterReader<'p> {
    name: &'p str,
    parameters: &'p BTreeMap<String, String>,
}

impl ParameterReader<'_> {
    fn error(&self, name: &'static str, cause: String) -> DeviceError {
        DeviceError::Parameter {
            device: self.name.to_owned(),
            name,
            cause,
        }
    }

    /// Reads `[a,b,c]` with `count` finite numbers; `None` if the parameter is missing.
    fn numbers(&self, name: &'static str, count: usize) -> Result<Option<Vec<f64>>, DeviceError> {
        let Some(text) = self.parameters.get(name) else {
            return Ok(None);
        };
        let inner = text
            .trim()
            .strip_prefix('[')
            .and_then(|rest| rest.strip_suffix(']'));
        let parsed = inner.and_then(|inner| {
            let parts = inner
                .split([',', ' '])
                .map(str::trim)
                .filter(|part| !part.is_empty());
            parts
                .map(|part| part.parse::<f64>().ok().filter(|number| number.is_finite()))
                .collect::<Option<Vec<f64>>>()
        });
        match parsed {
            Some(numbers) if numbers.len() == count => Ok(Some(numbers)),
            _ => Err(self.error(
                name,
                format!("`{text}` is not a list of {count} numbers: [0.1,0.2,…]"),
            )),
        }
    }

    fn array<const N: usize>(&self, name: &'static str) -> Result<Option<[f64; N]>, DeviceError> {
        let numbers = self.numbers(name, N)?;
        Ok(numbers.and_then(|numbers| numbers.try_into().ok()))
    }

    fn joints(&self, defaults: &[JointSpec]) -> Result<Vec<JointSpec>, DeviceError> {
        let count = defaults.len();
        let mut joints = defaults.to_vec();
        let places: [(&'static str, JointPlace); 5] = [
            ("min_joint", |joint| &mut joint.least),
            ("max_joint", |joint| &mut joint.greatest),
            ("home_joint", |joint| &mut joint.home),
            ("max_vel", |joint| &mut joint.velocity),
            ("max_acc", |joint| &mut joint.acceleration),
        ];
        for (name, place) in places {
            for (joint, value) in joints
                .iter_mut()
                .zip(self.numbers(name, count)?.unwrap_or_default())
            {
                *place(joint) = value;
            }
        }
        if joints.iter().any(|joint| joint.least >= joint.greatest) {
            return Err(self.error(
                "max_joint",
                "each must be greater than that of min_joint".to_owned(),
            ));
        }
        if !self.parameters.contains_key("home_joint") {
            for joint in &mut joints {
                joint.home = joint.home.clamp(joint.least, joint.greatest);
            }
        }
        let outside = |joint: &JointSpec| joint.home < joint.least || joint.home > joint.greatest;
        if joints.iter().any(outside) {
            return Err(self.error(
                "home_joint",
                "each must be within min_joint and max_joint".to_owned(),
            ));
        }
        if joints.iter().any(|joint| joint.velocity <= 0.0) {
            return Err(self.error("max_vel", "each must be greater than 0".to_owned()));
        }
        if joints.iter().any(|joint| joint.acceleration <= 0.0) {
            return Err(self.error("max_acc", "each must be greater than 0".to_owned()));
        }
        Ok(joints)
    }

    fn srs(&self, defaults: &ArmDefaults) -> Result<DeviceKind, DeviceError> {
        let columns = defaults
            .ranges
            .iter()
            .zip(&defaults.velocities)
            .zip(&defaults.accelerations);
        let joints: Vec<JointSpec> = columns
            .map(|((range, velocity), acceleration)| JointSpec {
                least: -range * DEG,
                greatest: range * DEG,
                home: 0.0,
                velocity: velocity * DEG,
                acceleration: acceleration * DEG,
            })
            .collect();
        // Eight lengths: base to joint 1, each joint to the next, joint 7 to the flange. Along a straight arm two of
        // them each make the distance between shoulder, elbow and wrist.
        let lengths = match self.array::<8>("link_lengths")? {
            Some([l0, l1, l2, l3, l4, l5, l6, l7]) => [l0 + l1, l2 + l3, l4 + l5, l6 + l7],
            None => defaults.lengths,
        };
        let [shoulder, upper, fore, flange] = lengths;
        if shoulder < 0.0 || upper <= 0.0 || fore <= 0.0 || flange < 0.0 {
            let cause =
                "the lengths from shoulder to elbow and from elbow to wrist must be greater than 0";
            return Err(self.error("link_lengths", cause.to_owned()));
        }
        Ok(DeviceKind::Arm(ArmSpec {
            joints: self.joints(&joints)?,
            geometry: ArmGeometry::Srs {
                lengths,
                signs: defaults.signs,
            },
        }))
    }

    fn six_axes(&self) -> Result<DeviceKind, DeviceError> {
        let mut table = DhTable::default();
        for (name, column) in [
            ("dh_d", &mut table.d),
            ("dh_a", &mut table.a),
            ("dh_t", &mut table.t),
            ("dh_al", &mut table.al),
        ] {
            let given = self.array::<6>(name)?;
            *column = given.ok_or_else(|| self.error(name, "is missing".to_owned()))?;
        }
        let usual = JointSpec {
            least: -PI,
            greatest: PI,
            home: 0.0,
            velocity: 2.0,
            acceleration: 4.0,
        };
        Ok(DeviceKind::Arm(ArmSpec {
            joints: self.joints(&[usual; 6])?,
            geometry: ArmGeometry::Dh(table),
        }))
    }

    fn io(&self) -> Result<DeviceKind, DeviceError> {
        let count = |name, usual, most| match self.parameters.get(name) {
            None => Ok(usual),
            Some(text) => {
                let count = text.trim().parse().ok().filter(|count| *count <= most);
                count.ok_or_else(|| {
                    self.error(name, format!("`{text}` is not a number from 0 to {most}"))
                })
            }
        };
        let io = IoSpec {
            digin: count("digin", 16, DIGITAL_MAX)?,
            digout: count("digout", 16, DIGITAL_MAX)?,
            anin: count("anin", 8, ANALOG_MAX)?,
            anout: count("anout", 8, ANALOG_MAX)?,
        };
        if io.digin + io.digout + io.anin + io.anout == 0 {
            return Err(self.error("digin", "the device has no channel".to_owned()));
        }
        Ok(DeviceKind::Io(io))
    }
}

/// Returns a name of the library as an id of a cell, unlike those in `taken`.
#[must_use]
pub fn cell_name(name: &str, taken: &[&str]) -> String {
    let mut id = String::new();
    for letter in name.chars().map(|letter| letter.to_ascii_lowercase()) {
        let fits = matches!(letter, 'a'..='z' | '0'..='9');
        id.push(if fits { letter } else { '_' });
    }
    if !id.starts_with(|first: char| first.is_ascii_lowercase()) {
        id.insert(0, 'd');
    }
    id.truncate(24);
    let mut number = 1;
    let mut unique = id.clone();
    while taken.contains(&unique.as_str()) {
        number += 1;
        unique.clear();
        // Writing into a String cannot fail.
        let _ = write!(unique, "{id}_{number}");
    }
    unique
}

#[cfg(test)]
mod tests;
