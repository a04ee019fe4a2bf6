//! Reads the settings that a driver's table names, each in its form, so that an error names the key and the expected value.
//! Used once, when the driver is opened.

use std::ffi::CString;
use std::net::SocketAddr;

use rcc_driver_kit::driver::{DriverError, Settings};
use rcc_driver_kit::rcc_config::{DeviceConfig, quantity};
use rcc_driver_kit::rcc_core::unit::Unit;
use rcc_driver_kit::serde_json::Value;

use crate::ffi::{Description, SettingRow};

/// `RCC_NUMBER`, `RCC_DURATION`, `RCC_ADDRESS`; every other form is a text.
const NUMBER: i32 = 1;
const DURATION: i32 = 2;
const ADDRESS: i32 = 3;

/// Returns text and number of each setting of the table.
///
/// # Errors
/// Returns an error for a setting that is missing, unknown or not of its form.
pub fn read(
    table: &Description,
    device: &DeviceConfig,
) -> Result<Vec<(CString, f64)>, DriverError> {
    let mut settings = Settings::of(device);
    let mut values = Vec::new();
    for row in &table.settings {
        let fallback = row.fallback.and_then(|text| fallback(row, text));
        values.push(settings.read(row.key, row.expected, fallback, |value| of(row, value))?);
    }
    settings.finish()?;
    Ok(values)
}

/// A number stands in the table as text.
fn fallback(row: &SettingRow, text: &str) -> Option<(CString, f64)> {
    let value = match row.form {
        NUMBER => Value::from(text.parse::<f64>().ok()?),
        _ => Value::from(text),
    };
    of(row, &value)
}

fn of(row: &SettingRow, value: &Value) -> Option<(CString, f64)> {
    let (text, number) = match row.form {
        NUMBER => {
            let number = value.as_f64().filter(|number| number.is_finite())?;
            (number.to_string(), number)
        }
        DURATION => {
            let text = value.as_str()?;
            let quantity = quantity::parse(text).ok()?;
            let seconds = quantity.value;
            let good = quantity.unit == Some(Unit::SECOND) && seconds > 0.0 && seconds <= 3600.0;
            good.then(|| (text.to_owned(), seconds))?
        }
        ADDRESS => {
            let address: SocketAddr = value.as_str()?.parse().ok()?;
            (address.to_string(), f64::NAN)
        }
        _ => (value.as_str()?.to_owned(), f64::NAN),
    };
    Some((CString::new(text).ok()?, number))
}
