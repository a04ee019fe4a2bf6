//! The arguments of the simulators in a cell's configuration. Pure.

use rcc_config::{DeviceConfig, SimulatorConfig};

/// Returns the arguments of the simulators of a device.
pub(super) fn arguments_of<'a>(
    config: &DeviceConfig,
    simulators: &'a [SimulatorConfig],
) -> Vec<&'a str> {
    simulators
        .iter()
        .filter(|simulator| simulator.device.as_deref() == Some(&config.name))
        .flat_map(|simulator| simulator.arguments.iter().map(String::as_str))
        .collect()
}

/// Returns the value of an option such as `--start=` among a simulator's arguments.
pub(super) fn value_of<'a>(arguments: &[&'a str], option: &str) -> Option<&'a str> {
    let mut values = arguments
        .iter()
        .filter_map(|argument| argument.strip_prefix(option));
    values.next()
}
