//! Validates the settings of drivers and simulators that a simulation uses, like their programs do: ignoring a start
//! position or a wall would simulate another cell than the configured one. Pure.

use rcc_config::{CellConfig, DeviceConfig, RobotConfig};

use super::arguments::{IDEAL_ARM, arguments_of, value_of};
use super::device::STRATEGIES;
use super::dynamics::FlangeLoad;
use super::wall::ElasticWall;

/// Settings of `ideal-arm`.
const KNOWN: [&str; 2] = ["period", "start"];

/// Returns a message about the first setting that its program would refuse.
#[must_use]
pub fn first_invalid_setting(config: &CellConfig) -> Option<String> {
    config.devices.iter().find_map(|device| {
        let robot = device.robot.as_ref()?;
        let wrong = match device.driver.is(IDEAL_ARM) {
            true => invalid_driver_setting(device, robot),
            false => invalid_simulator_argument(&arguments_of(device, &config.simulators), robot),
        };
        Some(format!("device `{}`: {}", device.name, wrong?))
    })
}

fn invalid_driver_setting(device: &DeviceConfig, robot: &RobotConfig) -> Option<String> {
    let mut names = device
        .settings
        .as_object()
        .into_iter()
        .flat_map(|map| map.keys());
    if let Some(name) = names.find(|name| !KNOWN.contains(&name.as_str())) {
        return Some(format!(
            "unknown setting `{name}` of {IDEAL_ARM}; available settings: {}",
            KNOWN.join(" and ")
        ));
    }
    let start = device.settings.get("start")?;
    robot.positions(start).is_none().then(|| {
        format!(
            "`start: {start}` must be {} joint positions within their ranges, such as [0, \"-30 deg\", 0.5] (rad, or with a unit)",
            robot.joints.len()
        )
    })
}

fn invalid_simulator_argument(arguments: &[&str], robot: &RobotConfig) -> Option<String> {
    if let Some(start) = value_of(arguments, "--start=") {
        let numbers: Vec<f64> = start
            .split(',')
            .filter_map(|part| part.trim().parse().ok())
            .collect();
        let mut ranges = robot.joints.iter().zip(&numbers);
        let inside = |(joint, number): (&rcc_config::JointConfig, &f64)| {
            (joint.lower_rad..=joint.upper_rad).contains(number)
        };
        let whole =
            numbers.len() == robot.joints.len() && start.split(',').count() == numbers.len();
        if !whole || !ranges.all(inside) {
            return Some(format!(
                "`--start={start}` must be {} joint positions within their ranges, rad",
                robot.joints.len()
            ));
        }
    }
    if let Some(wall) =
        value_of(arguments, "--wall=").filter(|_| ElasticWall::of(arguments).is_none())
    {
        return Some(format!(
            "`--wall={wall}` must be PX,PY,PZ,NX,NY,NZ,K,D: a point (m), a direction to the free side, N/m and N·s/m, 0 or more"
        ));
    }
    if let Some(load) =
        value_of(arguments, "--load=").filter(|load| FlangeLoad::parse(load).is_none())
    {
        return Some(format!(
            "`--load={load}` must be KG or KG,X,Y,Z: a mass, 0 or more, and its centre in the flange frame, m"
        ));
    }
    let strategy = value_of(arguments, "--strategy=")?;
    let names = STRATEGIES.map(|(word, _)| word);
    if names.contains(&strategy) {
        return None;
    }
    Some(format!(
        "`--strategy={strategy}` must be one of {}",
        names.join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use rcc_config::DriverConfig;

    use super::*;

    fn cell(name: &str) -> CellConfig {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../configs/cells")
            .join(name);
        CellConfig::load_offline(&path).unwrap_or_else(|faults| panic!("{faults}"))
    }

    /// Returns the message for the cell `table.yaml` with this argument before the others of the arm's simulator.
    fn message_for(argument: &str) -> String {
        let mut cell = cell("table.yaml");
        cell.simulators[0].arguments.insert(0, argument.to_owned());
        first_invalid_setting(&cell).unwrap_or_else(|| panic!("{argument} is taken"))
    }

    #[test]
    fn settings_that_a_program_would_refuse_are_reported() {
        for name in [
            "demo.yaml",
            "table.yaml",
            "two-arms.yaml",
            "impedance.yaml",
            "lwr.yaml",
        ] {
            assert_eq!(first_invalid_setting(&cell(name)), None, "{name}");
        }
        let degrees = "--start=0,-30,0,90,0,-60,0";
        for start in [
            degrees,
            "--start=0,0,0",
            "--start=nan,0,0,0,0,0,0",
            "--start=0,0,0,0,0,0,x",
        ] {
            assert!(
                message_for(start).contains("7 joint positions"),
                "{}",
                message_for(start)
            );
        }
        for wall in [
            "--wall=0,0,1,0,0,1,500",
            "--wall=0,0,1,0,0,0,500,1",
            "--wall=0,0,1,0,0,1,-500,1",
        ] {
            assert!(
                message_for(wall).contains("PX,PY,PZ"),
                "{}",
                message_for(wall)
            );
        }
        for load in ["--load=-1", "--load=1,2", "--load=x"] {
            let message = message_for(load);
            assert!(message.contains("KG or KG,X,Y,Z"), "{message}");
        }
        assert!(message_for("--strategy=joint-imp").contains("one of position"));
    }

    #[test]
    fn an_ideal_arm_requires_a_valid_start() {
        for (name, value) in [
            ("start", "[0, -90, 90, 0, 45, 0]"),
            ("start", "[0, 0, 0]"),
            ("start", "null"),
            ("strat", "[0, 0, 0, 0, 0, 0, 0]"),
        ] {
            let mut cell = cell("table.yaml");
            let device = &mut cell.devices[0];
            device.driver = DriverConfig::Name(IDEAL_ARM.to_owned());
            device.settings = serde_json::from_str(&format!("{{\"{name}\": {value}}}")).unwrap();
            let message =
                first_invalid_setting(&cell).unwrap_or_else(|| panic!("{name}: {value} is taken"));
            assert!(
                message.contains("`lwr`") && message.contains(name),
                "{message}"
            );
        }
    }
}
