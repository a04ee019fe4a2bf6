//! Arms: kinematics of arms.

use super::CatalogueEntry;

mod arm_angle;
mod arm_angle_limits;
mod forward_kinematics;
mod inverse_kinematics;
mod inverse_kinematics_near;
mod inverse_velocity_kinematics;
mod jacobian;
mod joint_torque_from_wrench;
mod start_pose;
mod velocity_kinematics;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &arm_angle::ENTRY,
    &arm_angle_limits::ENTRY,
    &forward_kinematics::ENTRY,
    &inverse_kinematics::ENTRY,
    &inverse_kinematics_near::ENTRY,
    &inverse_velocity_kinematics::ENTRY,
    &jacobian::ENTRY,
    &joint_torque_from_wrench::ENTRY,
    &start_pose::ENTRY,
    &velocity_kinematics::ENTRY,
];
