//! The settings of the driver: where the line is connected, its terminals by name, and times.
//! Read once, when the driver is opened.

use std::time::Duration;

use rcc_driver_kit::driver::{DriverError, Settings};
use rcc_driver_kit::rcc_config::{DeviceConfig, quantity};
use rcc_driver_kit::rcc_core::unit::Unit;
use serde_json::{Map, Value};

use super::axis_settings::{self, AxisSettings};
use super::terminal_settings::{self, TerminalSettings};
use crate::session::ClockOptions;
use crate::wire::Interface;

/// Longest watchdog that the registers hold.
const WATCHDOG_MAX: Duration = Duration::from_micros(6_553_500);
/// Largest `lost_after`.
const LOST_AFTER_MAX: u64 = 10_000;

/// There are axes, and no robot.
const NO_ROBOT: &str = "settings.axes moves the joints of a robot: name its file, such as `robot: robots/table.yaml`, or remove `axes`";
/// There is a robot, and there are no axes.
const NO_AXES: &str =
    "the joints of a robot are moved by drives: name them in settings.axes, or remove `robot`";

/// All settings.
#[derive(Clone, Debug, PartialEq)]
pub struct EthercatSettings {
    /// Where the line is connected.
    pub interface: Interface,
    /// Period of the exchanges.
    pub period: Duration,
    /// Limit of the answer to an exchange.
    pub timeout: Duration,
    /// Number of lost exchanges in a row after which the device is lost.
    pub lost_after: u32,
    /// Time without outputs after which the terminals switch them off.
    pub watchdog: Duration,
    /// Distributed clocks; `None`: the period is this machine's.
    pub clocks: Option<ClockOptions>,
    /// The terminals in the order of the line.
    pub terminals: Vec<TerminalSettings>,
    /// The axes in the order of the joints; empty without a robot.
    pub axes: Vec<AxisSettings>,
}

impl EthercatSettings {
    /// Reads and checks all settings of a device.
    ///
    /// # Errors
    /// Returns what is wrong, with its key and what is expected.
    pub fn new(device: &DeviceConfig) -> Result<EthercatSettings, DriverError> {
        let mut settings = Settings::of(device);
        let interface = settings.read("interface", Interface::EXPECTED, None, |value| {
            Interface::read(value.as_str()?)
        })?;
        let period = settings.duration("period", Duration::from_millis(1))?;
        let timeout = settings.duration("timeout", Duration::from_millis(10))?;
        let expected = "a number of lost exchanges in a row, from 1 to 10000";
        let lost_after = settings.read("lost_after", expected, Some(5), |value| {
            let number = value
                .as_u64()
                .filter(|number| (1..=LOST_AFTER_MAX).contains(number));
            number.and_then(|number| u32::try_from(number).ok())
        })?;
        let watchdog = settings.duration("watchdog", Duration::from_millis(100))?;
        let listed = "the terminals by name, such as {lamps: {position: 2, type: EL2008}}";
        let value = settings.read("terminals", listed, None, |value| {
            value.as_object().filter(|all| !all.is_empty()).cloned()
        })?;
        let expected = "one axis for each joint of the robot, such as {joint_1: {terminal: x_drive, counts_per_rad: 1000000, following_window: 0.02 rad}}; linear axes have counts_per_metre";
        let axes = settings.read("axes", expected, Some(Map::new()), |value| {
            let tables = |all: &&Map<String, Value>| all.values().all(Value::is_object);
            let found = value.as_object().filter(tables);
            found.filter(|all| !all.is_empty()).cloned()
        })?;
        let clocks = clocks(&mut settings, period)?;
        settings.finish()?;
        let fault = |key: &str, cause: String, expected| DriverError::Setting {
            device: device.name.clone(),
            key: key.to_owned(),
            cause,
            expected,
        };
        if watchdog > WATCHDOG_MAX || watchdog <= timeout.max(2 * period) {
            let cause = format!(
                "{watchdog:?} is not between {:?} and {WATCHDOG_MAX:?}",
                timeout.max(2 * period)
            );
            let expected =
                "a time that is longer than `timeout` and two periods, such as \"100 ms\"";
            return Err(fault("watchdog", cause, expected));
        }
        let mut placed: Vec<(usize, TerminalSettings)> = Vec::new();
        for (name, value) in &value {
            let found = terminal_settings::read(device, name, value)?;
            if let Some((_, other)) = placed.iter().find(|(position, _)| *position == found.0) {
                let cause = format!("position {} is already that of '{}'", found.0, other.name);
                let key = format!("terminals.{name}.position");
                return Err(fault(&key, cause, "a position that no other terminal has"));
            }
            placed.push(found);
        }
        placed.sort_by_key(|(position, _)| *position);
        let gap = placed
            .iter()
            .zip(1..)
            .find(|((position, _), place)| position != place);
        if let Some((_, missing)) = gap {
            let cause = format!("no terminal has position {missing}");
            let expected = "all terminals of the line, from position 1, couplers too";
            return Err(fault("terminals", cause, expected));
        }
        let terminals: Vec<_> = placed.into_iter().map(|(_, terminal)| terminal).collect();
        if let Some(terminal) = terminals.iter().find(|one| one.sync0 && clocks.is_none()) {
            let key = format!("terminals.{}.sync0", terminal.name);
            let cause = "the line has no distributed clocks".to_owned();
            return Err(fault(
                &key,
                cause,
                "`distributed_clocks: true` beside `terminals`",
            ));
        }
        let robot = |cause| DriverError::Robot {
            device: device.name.clone(),
            cause,
        };
        let axes = match (&device.robot, axes.is_empty()) {
            (None, true) => Vec::new(),
            (None, false) => return Err(robot(NO_ROBOT)),
            (Some(_), true) => return Err(robot(NO_AXES)),
            (Some(of), false) => axis_settings::read(device, of, &axes, &terminals)?,
        };
        if !axes.is_empty() && axis_settings::interpolation(period).is_none() {
            let cause = format!("{period:?} does not fit into the object 0x60C2 of a drive");
            let expected = "up to 255 whole units of 1 ms, 100 µs or 10 µs";
            return Err(fault("period", cause, expected));
        }
        Ok(EthercatSettings {
            interface,
            period,
            timeout,
            lost_after,
            watchdog,
            clocks,
            terminals,
            axes,
        })
    }
}

/// Reads `distributed_clocks`: `true`, `false`, or the shift of the exchanges.
fn clocks(
    settings: &mut Settings<'_>,
    period: Duration,
) -> Result<Option<ClockOptions>, DriverError> {
    let expected = "true, false, or {shift: 500 us}: the time from SYNC0 to an exchange, from a tenth to nine tenths of the period";
    settings.read("distributed_clocks", expected, Some(None), |value| {
        let shift = match value {
            Value::Bool(on) => return Some(on.then_some(ClockOptions { shift: period / 2 })),
            Value::Object(fields) if fields.len() == 1 => fields.get("shift")?.as_str()?,
            _ => return None,
        };
        let shift = quantity::parse(shift).ok()?;
        let seconds = (shift.unit == Some(Unit::SECOND)).then_some(shift.value)?;
        let shift = Duration::try_from_secs_f64(seconds).ok()?;
        let fits = 10 * shift >= period && 10 * shift <= 9 * period;
        fits.then_some(Some(ClockOptions { shift }))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(terminals: Value) -> Result<EthercatSettings, String> {
        let settings = json!({"interface": "eth1", "terminals": terminals});
        let device = rcc_driver_kit::conformance::device("ethercat", settings, &[]);
        EthercatSettings::new(&device).map_err(|error| error.to_string())
    }

    #[test]
    fn the_terminals_are_sorted_by_their_position() {
        let read = read(json!({
            "lamps": {"position": 2, "type": "EL2008"},
            "coupler": {"position": 1, "vendor": 2, "product": "0x044c2c52"},
        }));
        let all = read.unwrap().terminals;
        let names: Vec<&str> = all.iter().map(|one| one.name.as_str()).collect();
        assert_eq!(names, ["coupler", "lamps"]);
        assert_eq!((all[0].product, all[0].model), (0x044c_2c52, None));
        assert_eq!(all[0].type_name(), "vendor 0x2, product 0x044c2c52");
        assert_eq!(all[1].type_name(), "EL2008");
    }

    #[test]
    fn every_mistake_is_told_with_its_key() {
        for (terminals, key, words) in [
            (
                json!({"a": {"position": 2, "type": "EL1008"}}),
                "terminals",
                "no terminal has position 1",
            ),
            (
                json!({"a": {"type": "EL1008"}}),
                "terminals.a.position",
                "is missing",
            ),
            (
                json!({"a": {"position": 1, "type": "EL1234"}}),
                "terminals.a.type",
                "unknown type",
            ),
            (
                json!({"a": {"position": 1}}),
                "terminals.a",
                "its type is missing",
            ),
            (
                json!({"a": {"position": 1, "type": "EL1008", "vendor": 2}}),
                "terminals.a",
                "given twice",
            ),
            (
                json!({"a": {"position": 1, "kind": "EL1008"}}),
                "terminals.a.kind",
                "unknown key",
            ),
            (
                json!({"A": {"position": 1, "type": "EL1008"}}),
                "terminals.A",
                "invalid name",
            ),
            (
                json!({"a": {"position": 1, "vendor": 2, "product": "EL"}}),
                "terminals.a.product",
                "invalid value",
            ),
            (
                json!({"a": {"position": 1, "type": "EL1008"}, "b": {"position": 1, "type": "EL1008"}}),
                "terminals.b.position",
                "already that of 'a'",
            ),
        ] {
            let error = read(terminals).unwrap_err();
            assert!(
                error.starts_with(&format!("devices.device.settings.{key}: ")),
                "{error}"
            );
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn distributed_clocks_have_a_shift_within_the_period() {
        let read = |clocks: Value, sync0: Value| {
            let terminals = json!({"x": {"position": 1, "type": "CiA402", "sync0": sync0}});
            let settings =
                json!({"interface": "eth1", "terminals": terminals, "distributed_clocks": clocks});
            let device = rcc_driver_kit::conformance::device("ethercat", settings, &[]);
            let read = EthercatSettings::new(&device).map_err(|error| error.to_string())?;
            Ok::<_, String>(read.clocks.map(|clocks| clocks.shift))
        };
        let half = Duration::from_micros(500);
        assert_eq!(read(json!(true), json!(true)), Ok(Some(half)));
        assert_eq!(read(json!(false), json!(false)), Ok(None));
        let shift = |text: &str| json!({ "shift": text });
        assert_eq!(
            read(shift("250 us"), json!(true)),
            Ok(Some(Duration::from_micros(250)))
        );
        for wrong in [shift("0 us"), shift("1 ms"), shift("2 m"), json!("on")] {
            let error = read(wrong, json!(true)).unwrap_err();
            assert!(error.contains("distributed_clocks: "), "{error}");
        }
        let error = read(json!(false), json!(true)).unwrap_err();
        assert!(
            error.contains("terminals.x.sync0: the line has no"),
            "{error}"
        );
        let error = read(json!(true), json!(1)).unwrap_err();
        assert!(
            error.contains("terminals.x.sync0: invalid value 1"),
            "{error}"
        );
    }
}
