//! Motion: motions along paths, online goals and their corrections.

use super::CatalogueEntry;

mod circular_motion;
mod force_control;
mod joint_goal;
mod joint_motion;
mod linear_motion;
mod motion_sequence;
mod online_trajectory;
mod path_correction;
mod path_motion;
mod pose_goal;
mod scalar_goal;
mod spline_motion;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &circular_motion::ENTRY,
    &force_control::ENTRY,
    &joint_goal::ENTRY,
    &joint_motion::ENTRY,
    &linear_motion::ENTRY,
    &motion_sequence::ENTRY,
    &online_trajectory::ENTRY,
    &path_correction::ENTRY,
    &pose_goal::ENTRY,
    &scalar_goal::ENTRY,
    &spline_motion::ENTRY,
];
