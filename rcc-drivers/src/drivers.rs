//! Table of all drivers: one module and one entry each.
//! Read once at start-up.

use rcc_driver_kit::driver::DriverEntry;

pub mod fri_iiwa;
pub mod fri_lwr;
pub mod fri_socket;
pub mod ideal_arm;
pub mod modbus;
pub mod software;

/// All drivers, by name.
pub const DRIVERS: &[DriverEntry] = &[
    DriverEntry::new::<fri_iiwa::FriIiwa>("fri-iiwa", fri_iiwa::REASONS),
    DriverEntry::new::<fri_lwr::FriLwr>("fri-lwr", fri_lwr::REASONS),
    DriverEntry::new::<ideal_arm::IdealArm>("ideal-arm", ideal_arm::REASONS),
    DriverEntry::new::<modbus::Modbus>("modbus", modbus::REASONS),
    DriverEntry::new::<software::Software>("software", software::REASONS),
];

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    use rcc_driver_kit::host::reason::HOST_REASONS;

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
