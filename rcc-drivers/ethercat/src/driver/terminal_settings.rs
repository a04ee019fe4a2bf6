//! The setting `terminals`: name, place and type of each terminal of the line.
//! Read once, when the driver is opened.

use rcc_driver_kit::driver::DriverError;
use rcc_driver_kit::rcc_config::DeviceConfig;
use serde_json::Value;

use crate::session::TERMINALS_MAX;
use crate::terminals::Model;

/// A terminal as the configuration names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TerminalSettings {
    /// Its name in addresses of channels.
    pub name: String,
    /// Vendor number.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Its type, if the driver knows it.
    pub model: Option<&'static Model>,
    /// Its SYNC0 is switched on.
    pub sync0: bool,
}

impl TerminalSettings {
    /// Returns its type for messages.
    #[must_use]
    pub fn type_name(&self) -> String {
        match self.model {
            Some(model) => model.name.to_owned(),
            None => format!("vendor {:#x}, product {:#010x}", self.vendor, self.product),
        }
    }
}

/// Reads one terminal and its position, from 1.
///
/// # Errors
/// Returns what is wrong, with its key and what is expected.
pub fn read(
    device: &DeviceConfig,
    name: &str,
    value: &Value,
) -> Result<(usize, TerminalSettings), DriverError> {
    let fault = |key: &str, cause: String, expected| DriverError::Setting {
        device: device.name.clone(),
        key: format!("terminals.{name}{key}"),
        cause,
        expected,
    };
    let form = "{position: 2, type: EL2008}, or {position: 2, vendor: 0x2, product: 0x044c2c52} for another type";
    let mut letters = name.chars();
    let named = letters
        .next()
        .is_some_and(|first| first.is_ascii_lowercase())
        && letters.all(|letter| {
            letter.is_ascii_lowercase() || letter.is_ascii_digit() || "_-".contains(letter)
        });
    if !named {
        let expected = "a name of lower-case letters, digits, `_` and `-`";
        return Err(fault("", format!("invalid name '{name}'"), expected));
    }
    let Some(fields) = value.as_object() else {
        return Err(fault("", format!("invalid value {value}"), form));
    };
    let keys = ["position", "type", "vendor", "product", "sync0"];
    if let Some(key) = fields.keys().find(|key| !keys.contains(&key.as_str())) {
        return Err(fault(&format!(".{key}"), "unknown key".to_owned(), form));
    }
    let position = fields.get("position").and_then(Value::as_u64);
    let position = position.and_then(|position| usize::try_from(position).ok());
    let position = position.filter(|position| (1..=TERMINALS_MAX).contains(position));
    let Some(position) = position else {
        let cause = match fields.get("position") {
            None => "is missing".to_owned(),
            Some(value) => format!("invalid value {value}"),
        };
        return Err(fault(
            ".position",
            cause,
            "the place in the line, from 1 to 64",
        ));
    };
    let number = |key: &str| match fields.get(key) {
        None => Ok(None),
        Some(value) => match read_u32(value) {
            Some(number) => Ok(Some(number)),
            None => Err(fault(
                &format!(".{key}"),
                format!("invalid value {value}"),
                "a number of 32 bits, such as 0x044c2c52",
            )),
        },
    };
    let (vendor, product) = (number("vendor")?, number("product")?);
    let (vendor, product, model) = match (fields.get("type"), vendor, product) {
        (Some(wanted), None, None) => {
            let model = wanted.as_str().and_then(Model::named);
            let Some(model) = model else {
                let expected = "EL1008, EL2008, EL3064, EL4004 or CiA402; for another type give `vendor` and `product`";
                return Err(fault(".type", format!("unknown type {wanted}"), expected));
            };
            (model.vendor, model.product, Some(model))
        }
        (None, Some(vendor), Some(product)) => (vendor, product, None),
        _ => {
            let cause = "its type is missing or given twice".to_owned();
            return Err(fault("", cause, form));
        }
    };
    let sync0 = match fields.get("sync0").map_or(Some(false), Value::as_bool) {
        Some(true) if model.is_some_and(|model| !model.has_clock()) => {
            let cause = "this type has no distributed clock".to_owned();
            return Err(fault(
                ".sync0",
                cause,
                "a terminal with a distributed clock",
            ));
        }
        Some(on) => on,
        None => {
            let cause = format!(
                "invalid value {}",
                fields.get("sync0").unwrap_or(&Value::Null)
            );
            return Err(fault(".sync0", cause, "true or false"));
        }
    };
    let name = name.to_owned();
    let terminal = TerminalSettings {
        name,
        vendor,
        product,
        model,
        sync0,
    };
    Ok((position, terminal))
}

/// Reads a number, or a text with a hexadecimal one.
fn read_u32(value: &Value) -> Option<u32> {
    match value {
        Value::String(text) => u32::from_str_radix(text.strip_prefix("0x")?, 16).ok(),
        other => u32::try_from(other.as_u64()?).ok(),
    }
}
