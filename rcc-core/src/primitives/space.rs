//! Space: vectors, rotations, poses, twists and wrenches.

use super::CatalogueEntry;

mod angle_between;
mod compose;
mod cross;
mod invert;
mod make_pose;
mod make_twist;
mod make_vector;
mod make_wrench;
mod normalize;
mod pose_add_twist;
mod pose_error;
mod pose_from_transform;
mod rotate;
mod rotation_bezier;
mod rotation_error;
mod rotation_from_axes;
mod rotation_from_axis_angle;
mod rotation_from_matrix;
mod rotation_from_quaternion;
mod rotation_from_rpy;
mod rotation_from_two_vectors;
mod rotation_from_vector;
mod rotation_to_axis_angle;
mod rotation_to_matrix;
mod rotation_to_quaternion;
mod rotation_to_rpy;
mod rotation_to_vector;
mod split_pose;
mod split_twist;
mod split_vector;
mod split_wrench;
mod transform_from_pose;
mod transform_from_position;
mod transform_point;
mod twist_from_poses;
mod twist_shift;
mod twist_transform;
mod wrench_compensation;
mod wrench_shift;
mod wrench_transform;

/// The rows of the catalogue, one for each primitive.
pub(super) const ENTRIES: &[&CatalogueEntry] = &[
    &angle_between::ENTRY,
    &compose::ENTRY,
    &cross::ENTRY,
    &invert::ENTRY,
    &make_pose::ENTRY,
    &make_twist::ENTRY,
    &make_vector::ENTRY,
    &make_wrench::ENTRY,
    &normalize::ENTRY,
    &pose_add_twist::ENTRY,
    &pose_error::ENTRY,
    &pose_from_transform::ENTRY,
    &rotate::ENTRY,
    &rotation_bezier::ENTRY,
    &rotation_error::ENTRY,
    &rotation_from_axes::ENTRY,
    &rotation_from_axis_angle::ENTRY,
    &rotation_from_matrix::ENTRY,
    &rotation_from_quaternion::ENTRY,
    &rotation_from_rpy::ENTRY,
    &rotation_from_two_vectors::ENTRY,
    &rotation_from_vector::ENTRY,
    &rotation_to_axis_angle::ENTRY,
    &rotation_to_matrix::ENTRY,
    &rotation_to_quaternion::ENTRY,
    &rotation_to_rpy::ENTRY,
    &rotation_to_vector::ENTRY,
    &split_pose::ENTRY,
    &split_twist::ENTRY,
    &split_vector::ENTRY,
    &split_wrench::ENTRY,
    &transform_from_pose::ENTRY,
    &transform_from_position::ENTRY,
    &transform_point::ENTRY,
    &twist_from_poses::ENTRY,
    &twist_shift::ENTRY,
    &twist_transform::ENTRY,
    &wrench_compensation::ENTRY,
    &wrench_shift::ENTRY,
    &wrench_transform::ENTRY,
];
