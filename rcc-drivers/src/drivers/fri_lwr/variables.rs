//! Addresses of the device's channels: variables of the KRL program, and fields of the controller's model.
//! Read at start; evaluated by the host's thread.

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::primitive::ChannelKind;
use serde_json::Value;

use crate::fri_lwr::wire::{JOINTS, MeasurementDatagram};
use rcc_driver_kit::driver::{DriverError, channel_error, channels, to_raw};

/// Rows of the Jacobian in our order and their places on the wire, where KUKA sends X Y Z Rz Ry Rx.
const JACOBIAN_ROWS: [(&str, usize); 6] = [
    ("x", 0),
    ("y", 1),
    ("z", 2),
    ("rx", 5),
    ("ry", 4),
    ("rz", 3),
];

/// Where the value of a channel is. Variables and joints are counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variable {
    /// `$FRI_TO_BOOL` or `$FRI_FRM_BOOL`.
    Boolean(usize),
    /// `$FRI_TO_REA` or `$FRI_FRM_REA`.
    Real(usize),
    /// `$FRI_TO_INT` or `$FRI_FRM_INT`.
    Integer(usize),
    /// A field of the measurement: index from its first real, of those that [`model_field`] names.
    Model(ModelField, usize),
}

/// A field of the measurement datagram that a channel can show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelField {
    /// 6×7, m/rad and 1.
    Jacobian,
    /// 7×7, kg m².
    MassMatrix,
    /// Joint torques by gravity, N·m.
    Gravity,
    /// Drive temperatures, in practice °C.
    Temperature,
}

/// A channel and where its value is.
#[derive(Clone, Debug)]
pub struct KrlChannel {
    /// Its place.
    pub variable: Variable,
    /// Its configuration.
    pub config: ChannelConfig,
}

impl Variable {
    /// Returns the raw value of an analog input; `None` if it is not finite.
    #[must_use]
    pub fn raw(&self, measured: &MeasurementDatagram) -> Option<f64> {
        let real = |values: &[f32], index: usize| values.get(index).copied().map(f64::from);
        let raw = match *self {
            Variable::Boolean(_) => None,
            Variable::Real(number) => real(&measured.krl.reals, number - 1),
            Variable::Integer(number) => {
                let integer = measured.krl.integers.get(number - 1);
                integer.copied().map(f64::from)
            }
            Variable::Model(ModelField::Jacobian, index) => real(&measured.jacobian, index),
            Variable::Model(ModelField::MassMatrix, index) => real(&measured.mass_matrix, index),
            Variable::Model(ModelField::Gravity, index) => real(&measured.gravity, index),
            Variable::Model(ModelField::Temperature, index) => real(&measured.temperature, index),
        };
        raw.filter(|raw| raw.is_finite())
    }
}

/// Returns the channels of one kind, in the order of the file.
///
/// # Errors
/// Returns an error for an address that is not a variable of this kind, or that another channel of this kind has.
pub fn krl_channels(
    device: &DeviceConfig,
    kind: ChannelKind,
) -> Result<Vec<KrlChannel>, DriverError> {
    let expected = expected(kind);
    let mut found: Vec<KrlChannel> = Vec::new();
    for channel in channels(device, kind) {
        let variable = variable(&channel.address, kind).ok_or_else(|| {
            let cause = format!("KRL variable {} does not exist", channel.address);
            channel_error(device, channel, cause, expected)
        })?;
        if let Some(other) = found.iter().find(|other| other.variable == variable) {
            let cause = format!(
                "number {} is already used by '{}'",
                channel.address, other.config.name
            );
            return Err(channel_error(device, channel, cause, expected));
        }
        if kind == ChannelKind::AnalogOutput && matches!(variable, Variable::Integer(_)) {
            check_integer_range(device, channel)?;
        }
        found.push(KrlChannel {
            variable,
            config: channel.clone(),
        });
    }
    Ok(found)
}

fn expected(kind: ChannelKind) -> &'static str {
    match kind {
        ChannelKind::AnalogInput => {
            "the number of a KRL real, 1 to 16, or `int N`, `gravity J`, `mass J J`, `jacobian ROW J` (x y z rx ry rz), \
             `temperature J`; no other analog input may have it"
        }
        ChannelKind::AnalogOutput => {
            "the number of a KRL real, 1 to 16, or `int N`, that no other analog output has"
        }
        _ => "the number of a KRL Boolean, 1 to 16, that no other channel of this kind has",
    }
}

fn variable(address: &Value, kind: ChannelKind) -> Option<Variable> {
    let analog = matches!(kind, ChannelKind::AnalogInput | ChannelKind::AnalogOutput);
    let numbered = |number: u64| {
        let number = usize::try_from(number).ok();
        number.filter(|number| (1..=16).contains(number))
    };
    if let Some(number) = address.as_u64() {
        let number = numbered(number)?;
        return Some(match analog {
            true => Variable::Real(number),
            false => Variable::Boolean(number),
        });
    }
    let words: Vec<&str> = address.as_str()?.split_whitespace().collect();
    match (words.as_slice(), kind) {
        (["int", number], _) if analog => numbered(number.parse().ok()?).map(Variable::Integer),
        (words, ChannelKind::AnalogInput) => model_field(words),
        _ => None,
    }
}

/// Returns the field of `gravity J`, `temperature J`, `mass J J` or `jacobian ROW J`; joints are counted from 1.
fn model_field(words: &[&str]) -> Option<Variable> {
    let joint = |word: &str| -> Option<usize> {
        let number: usize = word.parse().ok()?;
        (1..=JOINTS).contains(&number).then(|| number - 1)
    };
    let (field, index) = match words {
        ["gravity", of] => (ModelField::Gravity, joint(of)?),
        ["temperature", of] => (ModelField::Temperature, joint(of)?),
        ["mass", row, column] => (
            ModelField::MassMatrix,
            joint(row)? * JOINTS + joint(column)?,
        ),
        ["jacobian", row, column] => {
            let (_, place) = JACOBIAN_ROWS.iter().find(|(name, _)| name == row)?;
            (ModelField::Jacobian, place * JOINTS + joint(column)?)
        }
        _ => return None,
    };
    Some(Variable::Model(field, index))
}

/// Refuses an output whose range, in raw values, a KRL integer cannot hold.
fn check_integer_range(device: &DeviceConfig, channel: &ChannelConfig) -> Result<(), DriverError> {
    let fits = |value: f64| {
        let raw = to_raw(channel, value).round();
        raw >= f64::from(i32::MIN) && raw <= f64::from(i32::MAX)
    };
    if channel
        .range
        .is_some_and(|range| range.into_iter().all(fits))
    {
        return Ok(());
    }
    let cause = "its range does not fit into a KRL integer";
    let expected = "a `range` whose raw values are from -2147483648 to 2147483647";
    Err(channel_error(device, channel, cause, expected))
}
