//! Target `cell`: arbitrary text as the configuration of a cell. It must not panic, every fault must have a position,
//! and an accepted configuration must be usable. Run by the thread of the target.

use std::collections::BTreeMap;

use rcc_config::CellConfig;
use rcc_language::devices::DeviceTable;

use crate::shipped::repository;

/// Parses the bytes as a cell's text.
pub fn run(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    // Any other path would read a file of this machine.
    let elsewhere = text
        .lines()
        .any(|line| line.contains("robot:") && !line.contains("../robots/lwr4plus.yaml"));
    if elsewhere {
        return;
    }
    let names = ["fri", "io"];
    let ports: BTreeMap<String, u16> = names.into_iter().map(str::to_owned).zip(1..).collect();
    let base = repository().join("configs/cells");
    match CellConfig::parse(text, "cell.yaml", &base, &ports) {
        Ok(cell) => {
            let table = DeviceTable::from(&cell);
            assert_eq!(cell.models().len(), table.devices.len());
            assert!(cell.period_ns > 0 && cell.fingerprint() == table.fingerprint);
            for model in cell.models() {
                let limits = model.limits;
                for joint in 0..limits.joints {
                    assert!(
                        limits.lower[joint] < limits.upper[joint],
                        "a joint has a range"
                    );
                    assert!(
                        limits.velocity_max[joint] > 0.0 && limits.acceleration_max[joint] > 0.0
                    );
                }
            }
        }
        Err(faults) => super::net::check_faults(&faults, true),
    }
}
