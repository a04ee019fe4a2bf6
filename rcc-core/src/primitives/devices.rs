//! Devices: measurements of devices and commands to them.

use super::CatalogueEntry;

mod analog_input;
mod analog_output;
mod analog_output_state;
mod cartesian_impedance_command;
mod device_base;
mod device_status;
mod digital_input;
mod digital_output;
mod digital_output_state;
mod force_torque;
mod joint_impedance_command;
mod joint_position_command;
mod joint_state;
mod joint_velocity;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &analog_input::ENTRY,
    &analog_output::ENTRY,
    &analog_output_state::ENTRY,
    &cartesian_impedance_command::ENTRY,
    &device_base::ENTRY,
    &device_status::ENTRY,
    &digital_input::ENTRY,
    &digital_output::ENTRY,
    &digital_output_state::ENTRY,
    &force_torque::ENTRY,
    &joint_impedance_command::ENTRY,
    &joint_position_command::ENTRY,
    &joint_state::ENTRY,
    &joint_velocity::ENTRY,
];
