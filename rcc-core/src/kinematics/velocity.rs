//! Joint velocities for a desired twist of the flange, by damped least squares. A fixed number of steps, no heap; used
//! by the real-time thread.
//!
//! Nakamura and Hanafusa, J. Dyn. Sys. Meas. Control 108(3), 1986; Wampler, IEEE T-SMC 16(1), 1986: Jᵀ (J Jᵀ + λ² 1)⁻¹ twist.

use nalgebra::{Matrix6, SMatrix, Vector6};

use super::arm::Arm;
use crate::joints::{JOINTS_MAX, Joints};

impl Arm {
    /// Returns the smallest joint velocities (rad/s) that move the flange with a twist `[vx vy vz wx wy wz]` (m/s,
    /// rad/s, base axes, reference point the flange's origin) at joints in rad, with 1 m weighted as 1 rad. `damping`
    /// (λ) bounds them near singularities: none exceeds |twist|/(2 λ). `None` for null or infinite arguments, and at a
    /// singularity with a damping of 0.
    #[must_use]
    pub fn joint_velocities(
        &self,
        joints: &Joints,
        twist: &[f64; 6],
        damping: f64,
    ) -> Option<Joints> {
        let rows = self.jacobian(joints).into_iter().flatten();
        let jacobian = SMatrix::<f64, 6, JOINTS_MAX>::from_row_iterator(rows);
        let damped = jacobian * jacobian.transpose() + Matrix6::identity() * (damping * damping);
        let multipliers = damped.cholesky()?.solve(&Vector6::from(*twist));
        let rates: Joints = (jacobian.transpose() * multipliers).into();
        rates.iter().all(|rate| rate.is_finite()).then_some(rates)
    }
}
