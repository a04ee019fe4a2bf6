//! The environment of the flange: an elastic wall, a load, and an injected wrench.
//! Pure; run by the clock thread.

use super::Joints;
use super::dynamics::FlangeLoad;
use super::model::Geometry;

/// An elastic plane. In position control the arm feels it but does not yield; in impedance control it yields.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// A point of the plane, m, base frame.
    pub point: [f64; 3],
    /// Normal towards the free side, base frame; any length except 0.
    pub normal: [f64; 3],
    /// Stiffness, N/m.
    pub stiffness: f64,
    /// Damping against the velocity into the wall, N s/m.
    #[serde(default)]
    pub damping: f64,
}

/// Why a wall is invalid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum WallError {
    /// The normal has length 0 or is not finite.
    #[error("the wall's normal has no direction: its length must be finite and not 0")]
    Normal,
    /// Stiffness or damping is negative or not finite, or the point is not finite.
    #[error("the wall's point must be finite, its stiffness and damping finite and not negative")]
    Range,
}

impl Wall {
    /// Returns the wall with a normal of length 1.
    ///
    /// # Errors
    /// Returns an error for a normal of length 0, or values out of range.
    pub fn checked(mut self) -> Result<Self, WallError> {
        let length = self.normal.iter().map(|n| n * n).sum::<f64>().sqrt();
        if !(length.is_finite() && length > 0.0) {
            return Err(WallError::Normal);
        }
        let sound = |value: f64| value.is_finite() && value >= 0.0;
        if !(self.point.iter().all(|p| p.is_finite())
            && sound(self.stiffness)
            && sound(self.damping))
        {
            return Err(WallError::Range);
        }
        self.normal = self.normal.map(|n| n / length);
        Ok(self)
    }

    /// Returns the force on a flange at `position` (m) with `velocity` (m/s), N, base axes. The wall pushes but never
    /// pulls.
    pub fn force(&self, position: &[f64; 3], velocity: &[f64; 3]) -> [f64; 3] {
        let along = |v: &[f64; 3]| (0..3).map(|i| self.normal[i] * v[i]).sum::<f64>();
        let depth = along(&self.point) - along(position);
        if depth <= 0.0 {
            return [0.0; 3];
        }
        let push = (self.stiffness * depth - self.damping * along(velocity)).max(0.0);
        self.normal.map(|n| n * push)
    }
}

/// All external influences on the flange.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Environment {
    /// The wall; its normal has length 1.
    pub wall: Option<Wall>,
    /// Load that the controller does not know about.
    pub load: Option<FlangeLoad>,
    /// Injected wrench: force N and torque Nm, base axes, at the flange.
    pub injected: [f64; 6],
}

impl Environment {
    /// Returns the wrench on the flange: force N and torque Nm, base axes.
    pub fn wrench(&self, geometry: &Geometry, joint_velocity: &Joints) -> [f64; 6] {
        let mut wrench = self.injected;
        if let Some(load) = &self.load {
            for (sum, part) in wrench.iter_mut().zip(load.wrench(geometry)) {
                *sum += part;
            }
        }
        if let Some(wall) = &self.wall {
            let force = wall.force(
                &geometry.position,
                &geometry.flange_velocity(joint_velocity),
            );
            for (sum, part) in wrench.iter_mut().zip(force) {
                *sum += part;
            }
        }
        wrench
    }
}

/// Converts a wrench to KUKA's order Fx Fy Fz Tz Ty Tx.
pub fn wire_wrench(wrench: &[f64; 6]) -> [f32; 6] {
    let [fx, fy, fz, tx, ty, tz] = wrench.map(|value| value as f32);
    [fx, fy, fz, tz, ty, tx]
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOOR: Wall = Wall {
        point: [0.0, 0.0, 0.2],
        normal: [0.0, 0.0, 2.0],
        stiffness: 1000.0,
        damping: 10.0,
    };

    #[test]
    fn a_wall_pushes_towards_its_free_side_and_only_when_entered() {
        let floor = FLOOR.checked().unwrap();
        assert_eq!(floor.force(&[0.3, 0.0, 0.201], &[0.0; 3]), [0.0; 3]);
        let force = floor.force(&[0.3, 0.0, 0.19], &[0.0; 3]);
        assert!((force[2] - 10.0).abs() < 1e-9 && force[0] == 0.0);
        let entering = floor.force(&[0.3, 0.0, 0.19], &[0.0, 0.0, -0.1]);
        assert!((entering[2] - 11.0).abs() < 1e-9);
    }

    #[test]
    fn a_wall_never_pulls() {
        let floor = FLOOR.checked().unwrap();
        assert_eq!(floor.force(&[0.3, 0.0, 0.199], &[0.0, 0.0, 5.0]), [0.0; 3]);
    }

    #[test]
    fn a_wall_without_direction_or_with_negative_stiffness_is_refused() {
        assert_eq!(
            Wall {
                normal: [0.0; 3],
                ..FLOOR
            }
            .checked(),
            Err(WallError::Normal)
        );
        assert_eq!(
            Wall {
                stiffness: -1.0,
                ..FLOOR
            }
            .checked(),
            Err(WallError::Range)
        );
    }

    #[test]
    fn kuka_sends_the_torques_from_z_to_x() {
        assert_eq!(
            wire_wrench(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            [1.0, 2.0, 3.0, 6.0, 5.0, 4.0]
        );
    }
}
