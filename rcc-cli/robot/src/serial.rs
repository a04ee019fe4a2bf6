//! Takes the axes of a chain as they are, for an arm without closed-form inverse kinematics. Pure mathematics; runs once
//! per import.

use nalgebra::SMatrix;
use rcc_core::kinematics::{AXES_MAX, Arm, JointAxis, SerialArm};

use crate::chain::{listed, pose};
use crate::{ImportError, JointChain, samples};

/// Returns the arm with the axes of a chain.
pub(crate) fn arm(chain: &JointChain) -> Result<Arm, ImportError> {
    let (lines, tip) = chain.at_zero();
    let axes = lines.into_iter().map(|[direction, point]| JointAxis {
        point: point.into(),
        direction: direction.into(),
    });
    let axes: Vec<JointAxis> = axes.collect();
    let arm = SerialArm::new(&axes, pose(&tip), 0);
    let arm = arm.and_then(|arm| match arm.redundant_joint() {
        Some(_) => SerialArm::new(&axes, pose(&tip), redundant_joint(&arm)),
        None => Some(arm),
    });
    arm.map(Arm::Serial).ok_or_else(|| ImportError::Count {
        count: axes.len(),
        joints: listed(chain.revolute_joints.iter().map(|it| it.name.as_str())),
    })
}

/// Returns the joint, from 0, that moves most on average while the flange stays: held, it costs the arm least.
fn redundant_joint(arm: &SerialArm) -> usize {
    let mut sums = [0.0; AXES_MAX];
    for joints in samples(AXES_MAX) {
        let rows = arm.jacobian(&joints);
        // The null vector by cofactors: its element k is the determinant without column k.
        let minor = |k: usize| {
            let columns = (0..AXES_MAX).filter(|column| *column != k);
            let columns: Vec<usize> = columns.collect();
            SMatrix::<f64, 6, 6>::from_fn(|row, column| rows[row][columns[column]]).determinant()
        };
        let minors: [f64; AXES_MAX] = std::array::from_fn(|k| minor(k).abs());
        let length = minors.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length > 0.0 {
            for (sum, minor) in sums.iter_mut().zip(minors) {
                *sum += minor / length;
            }
        }
    }
    let most = sums
        .iter()
        .enumerate()
        .max_by(|(_, a), (_, b)| a.total_cmp(b));
    most.map_or(0, |(joint, _)| joint)
}
