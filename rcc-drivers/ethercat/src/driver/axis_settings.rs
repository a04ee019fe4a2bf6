//! The setting `axes`: the drive of each joint, its resolution, and the place of its values in the process data.
//! Read once, when the driver is opened.

use std::time::Duration;

use rcc_driver_kit::driver::DriverError;
use rcc_driver_kit::rcc_config::{DeviceConfig, RobotConfig, quantity};
use rcc_driver_kit::rcc_core::unit::Unit;
use serde_json::{Map, Value};

use super::address::{Format, Place};
use super::terminal_settings::TerminalSettings;
use crate::session::{ObjectData, ObjectValue};
use crate::terminals::Channels;

/// Mode of operation: cyclic synchronous position.
const CYCLIC_POSITION: i8 = 8;
/// Options for a quick stop and for a fault: the quick stop ramp, then no torque.
const QUICK_STOP_RAMP: i16 = 2;
/// Largest window of the following error, counts: one more switches its supervision off (IEC 61800-7-201, object 0x6065).
const WINDOW_COUNTS_MAX: u32 = u32::MAX - 1;
/// Keys of an axis, and their form.
const FORM: &str = "{terminal: x_drive, counts_per_rad: 1000000, following_window: 0.02 rad}; a linear axis: counts_per_metre: \
                    1000000, following_window: 2 mm; optional: zero, following_timeout, controlword, target, statusword, position, \
                    error_code";
const KEYS: [&str; 11] = [
    "terminal",
    "counts_per_rad",
    "counts_per_metre",
    "following_window",
    "following_timeout",
    "zero",
    "controlword",
    "target",
    "statusword",
    "position",
    "error_code",
];

/// First bytes of the values of a drive in the process data of its terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DrivePlace {
    /// Index of the terminal, from 0.
    pub terminal: usize,
    /// Controlword (0x6040), in the outputs.
    pub control: usize,
    /// Target position (0x607A), in the outputs.
    pub target: usize,
    /// Statusword (0x6041), in the inputs.
    pub status: usize,
    /// Actual position (0x6064), in the inputs.
    pub position: usize,
    /// Error code (0x603F), in the inputs; `None` if it is not exchanged.
    pub error: Option<usize>,
}

impl DrivePlace {
    /// Returns the places of controlword and target position.
    pub fn places(&self) -> impl Iterator<Item = Place> {
        let terminal = self.terminal;
        let values = [(self.control, Format::U16), (self.target, Format::I32)];
        values.into_iter().map(move |(byte, format)| Place {
            terminal,
            bit: 8 * byte,
            format,
            status: None,
        })
    }

    /// Returns how many bytes of outputs and of inputs its terminal must have.
    #[must_use]
    pub fn sizes(&self) -> [usize; 2] {
        let error = self.error.map_or(0, |at| at + 2);
        let inputs = (self.status + 2).max(self.position + 4).max(error);
        [(self.control + 2).max(self.target + 4), inputs]
    }
}

/// An axis.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisSettings {
    /// Name of the joint.
    pub joint: String,
    /// Name of the terminal.
    pub terminal: String,
    /// Its values.
    pub place: DrivePlace,
    /// Counts per rad, of a linear axis per m; negative if the drive turns the other way.
    pub counts_per_unit: f64,
    /// Position of the joint at count 0, rad or m.
    pub zero: f64,
    /// Window of the drive's following error, rad or m; from 1 to [`u32::MAX`] - 1 counts.
    pub following_window: f64,
    /// Longest time outside of the window.
    pub following_timeout: Duration,
    /// Deceleration of a quick stop, rad/s² or m/s²; 1 to [`u32::MAX`] counts/s².
    pub deceleration: f64,
}

impl AxisSettings {
    /// Returns a joint position, rad or m, of counts.
    #[must_use]
    pub fn to_position(&self, counts: i32) -> f64 {
        f64::from(counts) / self.counts_per_unit + self.zero
    }

    /// Returns the counts of a joint position, rad or m, rounded.
    #[must_use]
    pub fn to_counts(&self, position: f64) -> f64 {
        ((position - self.zero) * self.counts_per_unit).round()
    }

    /// Returns the objects that the drive needs before it is enabled; `period` is that of the exchanges.
    #[must_use]
    pub fn objects(&self, period: Duration) -> Vec<ObjectValue> {
        // Both were checked when the settings were read.
        let counts = |value: f64| unsigned_counts(value, self.counts_per_unit).unwrap_or(u32::MAX);
        let timeout = u16::try_from(self.following_timeout.as_millis()).unwrap_or(u16::MAX);
        let (units, exponent) = interpolation(period).unwrap_or((1, -3));
        let object = |index, sub_index, value| ObjectValue {
            index,
            sub_index,
            value,
        };
        vec![
            object(0x6060, 0, ObjectData::I8(CYCLIC_POSITION)),
            object(0x605a, 0, ObjectData::I16(QUICK_STOP_RAMP)),
            object(0x605e, 0, ObjectData::I16(QUICK_STOP_RAMP)),
            object(0x6065, 0, ObjectData::U32(counts(self.following_window))),
            object(0x6066, 0, ObjectData::U16(timeout)),
            object(0x6085, 0, ObjectData::U32(counts(self.deceleration))),
            object(0x60c2, 1, ObjectData::U8(units)),
            object(0x60c2, 2, ObjectData::I8(exponent)),
        ]
    }
}

/// Returns the counts of a distance, speed or acceleration of either sign as an object of 32 bits holds them; `None` if it
/// does not: more would be a gentler quick stop, and less than one count none.
fn unsigned_counts(value: f64, counts_per_unit: f64) -> Option<u32> {
    let counts = (value * counts_per_unit).abs().round();
    (1.0..=f64::from(u32::MAX))
        .contains(&counts)
        .then_some(counts as u32)
}

/// Returns a period as the object 0x60C2 holds it: a number of 8 bits, and the exponent of its unit; `None` if it does not fit.
#[must_use]
pub fn interpolation(period: Duration) -> Option<(u8, i8)> {
    let nanos = period.as_nanos();
    let fit = |(unit, exponent)| {
        let units = u8::try_from(nanos / unit).ok()?;
        (nanos.is_multiple_of(unit) && units > 0).then_some((units, exponent))
    };
    [(1_000_000, -3), (100_000, -4), (10_000, -5)]
        .into_iter()
        .find_map(fit)
}

/// Reads one axis for each joint of the robot, in the order of the joints.
///
/// # Errors
/// Returns what is wrong, with its key and what is expected.
pub fn read(
    device: &DeviceConfig,
    robot: &RobotConfig,
    axes: &Map<String, Value>,
    terminals: &[TerminalSettings],
) -> Result<Vec<AxisSettings>, DriverError> {
    let fault = |key: String, cause: String, expected| DriverError::Setting {
        device: device.name.clone(),
        key: format!("axes{key}"),
        cause,
        expected,
    };
    let names = robot.joints.iter().map(|joint| joint.name.as_str());
    let names: Vec<&str> = names.collect();
    if let Some(other) = axes.keys().find(|name| !names.contains(&name.as_str())) {
        let cause = format!(
            "the robot has no joint '{other}'; its joints are {}",
            names.join(", ")
        );
        return Err(fault(
            format!(".{other}"),
            cause,
            "one row for each joint of the robot",
        ));
    }
    let mut found: Vec<AxisSettings> = Vec::new();
    for joint in &robot.joints {
        let Some(fields) = axes.get(&joint.name).and_then(Value::as_object) else {
            return Err(fault(
                format!(".{}", joint.name),
                "is missing".to_owned(),
                FORM,
            ));
        };
        let reader = AxisReader {
            device,
            joint: &joint.name,
            fields,
            words: match robot.arm.is_linear() {
                true => &LINEAR,
                false => &ROTARY,
            },
        };
        let axis = AxisSettings {
            deceleration: joint.acceleration_rad_s2,
            ..reader.read(terminals)?
        };
        if let Some(other) = found.iter().find(|other| other.terminal == axis.terminal) {
            let cause = format!(
                "its terminal is already that of the joint '{}'",
                other.joint
            );
            return Err(reader.fault(".terminal", cause, "a drive of its own for each joint"));
        }
        let fits = |position: f64| axis.to_counts(position).abs() < f64::from(i32::MAX);
        if ![joint.lower_rad, joint.upper_rad].into_iter().all(fits) {
            let cause = "the range of the joint has more counts than 32 bits hold".to_owned();
            let expected = "a resolution and a zero with which the whole range fits";
            return Err(reader.fault(&format!(".{}", reader.words.counts), cause, expected));
        }
        if unsigned_counts(axis.deceleration, axis.counts_per_unit).is_none() {
            return Err(reader.quick_stop_fault(&axis));
        }
        found.push(axis);
    }
    Ok(found)
}

/// Names and expected values of the settings of a kind of joint.
struct JointWords {
    unit: Unit,
    /// Key of the resolution, and that of the other kind.
    counts: &'static str,
    other_counts: &'static str,
    resolution: &'static str,
    kind: &'static str,
    window: &'static str,
    zero: &'static str,
}

const ROTARY: JointWords = JointWords {
    unit: Unit::RADIAN,
    counts: "counts_per_rad",
    other_counts: "counts_per_metre",
    resolution: "counts_per_rad: counts of the drive for 1 rad of the joint; negative if it turns the other way",
    kind: "this joint turns",
    window: "a following error of the drive, such as \"0.02 rad\"",
    zero: "the position of the joint at count 0, such as \"0.1 rad\"",
};
const LINEAR: JointWords = JointWords {
    unit: Unit::METRE,
    counts: "counts_per_metre",
    other_counts: "counts_per_rad",
    resolution: "counts_per_metre: counts of the drive for 1 m of the axis; negative if it turns the other way",
    kind: "this joint is a linear axis",
    window: "a following error of the drive, such as \"2 mm\"",
    zero: "the position of the axis at count 0, such as \"100 mm\"",
};

/// Reads the fields of one axis.
struct AxisReader<'a> {
    device: &'a DeviceConfig,
    joint: &'a str,
    fields: &'a Map<String, Value>,
    words: &'static JointWords,
}

impl AxisReader<'_> {
    /// Reads the resolution; refuses that of the other kind of joint.
    fn counts_per_unit(&self) -> Result<f64, DriverError> {
        let JointWords {
            counts,
            other_counts,
            resolution,
            kind,
            ..
        } = *self.words;
        if self.fields.contains_key(other_counts) {
            return Err(self.fault(&format!(".{other_counts}"), kind.to_owned(), resolution));
        }
        self.field(counts, (resolution, None), |value| {
            let counts = value.as_f64()?;
            (counts.is_finite() && counts.abs() >= 1.0).then_some(counts)
        })
    }

    fn fault(&self, key: &str, cause: String, expected: &'static str) -> DriverError {
        DriverError::Setting {
            device: self.device.name.clone(),
            key: format!("axes.{}{key}", self.joint),
            cause,
            expected,
        }
    }

    /// The deceleration of a quick stop does not fit into the drive.
    fn quick_stop_fault(&self, axis: &AxisSettings) -> DriverError {
        let JointWords { unit, counts, .. } = *self.words;
        let cause = format!(
            "a quick stop brakes by the acceleration of the joint, {} {unit}/s², which is {:.0} counts/s²; the drive (0x6085) holds 1 to {}",
            axis.deceleration,
            (axis.deceleration * axis.counts_per_unit).abs(),
            u32::MAX
        );
        let expected = "a resolution with which it fits (also set in the drive), or another acceleration of the joint in the robot's file";
        self.fault(&format!(".{counts}"), cause, expected)
    }

    /// Reads a field, or takes the default if it is missing.
    fn field<T>(
        &self,
        key: &str,
        (expected, default): (&'static str, Option<T>),
        read: impl FnOnce(&Value) -> Option<T>,
    ) -> Result<T, DriverError> {
        let found = self.fields.get(key);
        let fault = |cause| self.fault(&format!(".{key}"), cause, expected);
        match (found, default) {
            (Some(value), _) => read(value).ok_or_else(|| fault(format!("invalid value {value}"))),
            (None, Some(default)) => Ok(default),
            (None, None) => Err(fault("is missing".to_owned())),
        }
    }

    fn quantity(
        &self,
        key: &str,
        expected: (&'static str, Option<f64>),
        unit: Unit,
    ) -> Result<f64, DriverError> {
        self.field(key, expected, |value| {
            let quantity = quantity::parse(value.as_str()?).ok()?;
            let fits = quantity.unit == Some(unit) && quantity.value.is_finite();
            fits.then_some(quantity.value)
        })
    }

    fn read(&self, terminals: &[TerminalSettings]) -> Result<AxisSettings, DriverError> {
        let fields = self.fields;
        if let Some(key) = fields.keys().find(|key| !KEYS.contains(&key.as_str())) {
            return Err(self.fault(&format!(".{key}"), "unknown key".to_owned(), FORM));
        }
        let expected = (
            "a drive of settings.terminals: `type: CiA402`, or `vendor` and `product`",
            None,
        );
        let terminal = self.field("terminal", expected, |value| {
            let name = value.as_str()?;
            terminals.iter().position(|one| one.name == name)
        })?;
        let row = terminals.get(terminal);
        let model = row.and_then(|row| row.model);
        if model.is_some_and(|model| model.channels != Channels::Drive) {
            let cause = "this terminal is no drive".to_owned();
            return Err(self.fault(".terminal", cause, expected.0));
        }
        let counts_per_unit = self.counts_per_unit()?;
        let JointWords {
            unit, window, zero, ..
        } = *self.words;
        let following_window = self.quantity("following_window", (window, None), unit)?;
        let fits = unsigned_counts(following_window, counts_per_unit)
            .is_some_and(|counts| counts <= WINDOW_COUNTS_MAX);
        if following_window <= 0.0 || !fits {
            let cause = format!(
                "invalid value {following_window} {unit}: the drive holds 1 to {WINDOW_COUNTS_MAX} counts"
            );
            return Err(self.fault(".following_window", cause, window));
        }
        let timeout = ("a time from 1 ms to 60 s, such as \"10 ms\"", Some(0.01));
        let timeout_s = self.quantity("following_timeout", timeout, Unit::SECOND)?;
        if !(1e-3..=60.0).contains(&timeout_s) {
            return Err(self.fault(
                ".following_timeout",
                format!("invalid value {timeout_s} s"),
                timeout.0,
            ));
        }
        let byte = |key, default: Option<usize>| {
            let expected =
                "the first byte of this value in the process data of the drive, from 0 to 1000";
            self.field(key, (expected, default), |value| {
                let byte = usize::try_from(value.as_u64()?).ok()?;
                (byte <= 1000).then_some(byte)
            })
        };
        let error = match (fields.get("error_code"), model) {
            (None, None) => None,
            _ => Some(byte("error_code", Some(6))?),
        };
        Ok(AxisSettings {
            joint: self.joint.to_owned(),
            terminal: row.map_or_else(String::new, |row| row.name.clone()),
            place: DrivePlace {
                terminal,
                control: byte("controlword", Some(0))?,
                target: byte("target", Some(2))?,
                status: byte("statusword", Some(0))?,
                position: byte("position", Some(2))?,
                error,
            },
            counts_per_unit,
            zero: self.quantity("zero", (zero, Some(0.0)), unit)?,
            following_window,
            following_timeout: Duration::from_secs_f64(timeout_s),
            deceleration: 0.0,
        })
    }
}
