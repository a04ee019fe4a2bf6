//! Table of all drivers: one module and one entry each.
//! Read once at start-up.

use rcc_config::DeviceConfig;

use crate::driver::{Driver, DriverError};
use crate::host::reason::Reason;

pub mod fri_iiwa;
pub mod fri_lwr;
pub mod fri_socket;
pub mod ideal_arm;
pub mod modbus;
#[cfg(test)]
pub mod template;

/// One driver in [`DRIVERS`].
#[derive(Debug)]
pub struct DriverEntry {
    /// Name in a cell's configuration.
    pub name: &'static str,
    /// Opens the driver, see [`Driver::open`].
    pub open: fn(&DeviceConfig) -> Result<Box<dyn Driver>, DriverError>,
    /// Meaning of the driver's reason numbers, which start at 100.
    pub reasons: &'static [Reason],
}

/// All drivers, by name.
pub const DRIVERS: &[DriverEntry] = &[
    DriverEntry {
        name: "fri-iiwa",
        open: boxed::<fri_iiwa::FriIiwa>,
        reasons: fri_iiwa::REASONS,
    },
    DriverEntry {
        name: "fri-lwr",
        open: boxed::<fri_lwr::FriLwr>,
        reasons: fri_lwr::REASONS,
    },
    DriverEntry {
        name: "ideal-arm",
        open: boxed::<ideal_arm::IdealArm>,
        reasons: ideal_arm::REASONS,
    },
    DriverEntry {
        name: "modbus",
        open: boxed::<modbus::Modbus>,
        reasons: modbus::REASONS,
    },
];

fn boxed<D: Driver + 'static>(device: &DeviceConfig) -> Result<Box<dyn Driver>, DriverError> {
    D::open(device).map(|driver| Box::new(driver) as Box<dyn Driver>)
}

/// Returns the driver that a device's configuration names.
///
/// # Errors
/// Returns [`DriverError::UnknownDriver`] if no driver has this name.
pub fn find(device: &DeviceConfig) -> Result<&'static DriverEntry, DriverError> {
    let row = DRIVERS.iter().find(|row| row.name == device.driver);
    row.ok_or_else(|| DriverError::UnknownDriver {
        device: device.name.clone(),
        driver: device.driver.clone(),
        known: DRIVERS
            .iter()
            .map(|row| row.name)
            .collect::<Vec<_>>()
            .join(", "),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    use crate::host::reason::HOST_REASONS;

    #[test]
    fn every_reason_has_one_number_and_drivers_begin_at_100() {
        for row in DRIVERS {
            let all = HOST_REASONS.iter().chain(row.reasons);
            let numbers: BTreeSet<u32> = all.map(|reason| reason.0).collect();
            assert_eq!(numbers.len(), HOST_REASONS.len() + row.reasons.len());
            assert!(row.reasons.iter().all(|reason| reason.0 >= 100));
        }
    }
}
