//! The arguments of the simulators in a cell's configuration. Pure.

use rcc_config::{DeviceConfig, SimulatorConfig};

/// Driver whose arm needs no simulator; its settings give the start position.
pub(super) const IDEAL_ARM: &str = "ideal-arm";

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

/// Parses finite numbers that are separated by commas; `None` if one of them is not.
pub(super) fn numbers(text: &str) -> Option<Vec<f64>> {
    let parts = text.split(',').map(|part| part.trim().parse::<f64>().ok());
    parts
        .map(|number| number.filter(|number| number.is_finite()))
        .collect()
}
