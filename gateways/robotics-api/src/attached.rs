//! The devices of a cell that the gateway is attached to, as the library knows them. Read once, by the main thread.

use std::str::FromStr;

use rcc_api::bodies::DeviceView;

use crate::devices::{ArmGeometry, ArmSpec, DeviceKind, DhTable, IoSpec, JointSpec};
use crate::state::ReportedDevice;

/// A device of the cell under a name of the library: `lwr=left:kuka_lwr_sim`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceAlias {
    /// Name in the library.
    pub name: String,
    /// Name in the cell.
    pub cell_name: String,
    /// Type in the library; without it that of an arm with as many joints, or `io`.
    pub type_name: Option<String>,
}

impl FromStr for DeviceAlias {
    type Err = String;

    fn from_str(text: &str) -> Result<DeviceAlias, String> {
        let wrong = || format!("`{text}` names no device: write NAME=DEVICE or NAME=DEVICE:TYPE");
        let (name, rest) = text.split_once('=').ok_or_else(wrong)?;
        let (cell_name, type_name) = match rest.split_once(':') {
            Some((cell_name, ty)) => (cell_name, Some(ty.to_owned())),
            None => (rest, None),
        };
        if [name, cell_name].contains(&"") || type_name.as_deref() == Some("") {
            return Err(wrong());
        }
        Ok(DeviceAlias {
            name: name.to_owned(),
            cell_name: cell_name.to_owned(),
            type_name,
        })
    }
}

/// Returns the devices of a cell by their names in the library: those of the aliases, and all others under their own.
///
/// # Errors
/// Returns an alias whose device the cell does not have.
pub fn reported(
    devices: &[DeviceView],
    aliases: &[DeviceAlias],
) -> Result<Vec<(String, ReportedDevice)>, String> {
    let missing = aliases
        .iter()
        .find(|alias| devices.iter().all(|device| device.name != alias.cell_name));
    if let Some(alias) = missing {
        let known: Vec<&str> = devices.iter().map(|device| device.name.as_str()).collect();
        return Err(format!(
            "the cell has no device '{}'; it has {}",
            alias.cell_name,
            known.join(", ")
        ));
    }
    let mut all = Vec::new();
    for device in devices {
        let mut named = aliases
            .iter()
            .filter(|alias| alias.cell_name == device.name)
            .peekable();
        if named.peek().is_none() {
            all.push((device.name.clone(), of(device, None)));
        }
        all.extend(named.map(|alias| (alias.name.clone(), of(device, alias.type_name.as_deref()))));
    }
    Ok(all)
}

fn of(device: &DeviceView, type_name: Option<&str>) -> ReportedDevice {
    let count = |kind: &str| {
        device
            .channels
            .iter()
            .filter(|channel| channel.kind == kind)
            .count()
    };
    let joint = JointSpec {
        least: 0.0,
        greatest: 0.0,
        home: 0.0,
        velocity: 0.0,
        acceleration: 0.0,
    };
    let kind = match device.joints.len() {
        0 => DeviceKind::Io(IoSpec {
            digin: count("digital input"),
            digout: count("digital output"),
            anin: count("analog input"),
            anout: count("analog output"),
        }),
        // Only the number of joints is reported; their limits are the cell's.
        joints => DeviceKind::Arm(ArmSpec {
            joints: vec![joint; joints],
            geometry: ArmGeometry::Dh(DhTable::default()),
        }),
    };
    let usual = match device.joints.len() {
        0 => "io",
        7 => "kuka_lwr_sim",
        _ => "kuka_kr_arm_sim",
    };
    ReportedDevice {
        type_name: type_name.unwrap_or(usual).to_owned(),
        kind,
        cell_name: device.name.clone(),
        state: "off",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_has_its_own_name_or_those_of_its_aliases() {
        let device = |name: &str, joints: usize| DeviceView {
            name: name.to_owned(),
            joints: vec![String::new(); joints],
            ..DeviceView::default()
        };
        let devices = [device("left", 7), device("io", 0), device("kr", 6)];
        let alias = |text: &str| text.parse::<DeviceAlias>().expect(text);
        let all = reported(
            &devices,
            &[alias("lwr=left"), alias("lwr2=left:kuka_iiwa_sim")],
        )
        .expect("devices");
        let all: Vec<_> = all
            .iter()
            .map(|(name, device)| (&**name, &*device.cell_name, &*device.type_name))
            .collect();
        assert_eq!(
            all,
            [
                ("lwr", "left", "kuka_lwr_sim"),
                ("lwr2", "left", "kuka_iiwa_sim"),
                ("io", "io", "io"),
                ("kr", "kr", "kuka_kr_arm_sim")
            ]
        );
        assert!(
            reported(&devices, &[alias("lwr=right")])
                .expect_err("missing")
                .contains("right")
        );
        for wrong in ["lwr", "=a", "a=", "a=b:"] {
            assert!(wrong.parse::<DeviceAlias>().is_err(), "{wrong}");
        }
    }
}
