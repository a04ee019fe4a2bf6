//! An elastic wall that an arm's flange meets in virtual time, as `lwr-sim --wall=` has it. In position control the arm
//! feels it and does not give way, in impedance control two springs share the way at once. The caller's thread.

use rcc_core::vector::{self, Vector};

use super::device::value_of;

/// A plane that pushes back and never pulls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElasticWall {
    /// A point of it, base frame, m.
    point: Vector,
    /// To the free side, length 1.
    normal: Vector,
    /// N/m.
    stiffness: f64,
    /// Against the velocity into the wall, N·s/m.
    damping: f64,
    /// Where the flange was in the cycle before, m.
    last: Option<Vector>,
}

impl ElasticWall {
    /// Reads `--wall=PX,PY,PZ,NX,NY,NZ,K,D` among a simulator's arguments; `None` without one that its program would take.
    #[must_use]
    pub fn of(arguments: &[&str]) -> Option<ElasticWall> {
        let given = value_of(arguments, "--wall=")?;
        let numbers: Result<Vec<f64>, _> =
            given.split(',').map(|part| part.trim().parse()).collect();
        let [px, py, pz, nx, ny, nz, stiffness, damping] = numbers.ok()?.try_into().ok()?;
        let sound = |value: f64| value.is_finite() && value >= 0.0;
        (sound(stiffness) && sound(damping)).then_some(ElasticWall {
            point: [px, py, pz],
            normal: vector::normalized([nx, ny, nz])?,
            stiffness,
            damping,
            last: None,
        })
    }

    /// To the free side, length 1.
    #[must_use]
    pub fn normal(&self) -> Vector {
        self.normal
    }

    /// The force on a flange that hangs on springs: unpressed it would be at `position` (m), and along the normal it gives
    /// way by `compliance` (m/N, 0 or more). At rest, without damping; N, base axes.
    #[must_use]
    pub fn force_of_springs(&self, position: Vector, compliance: f64) -> Vector {
        let depth = vector::dot(self.normal, vector::subtract(self.point, position));
        let push = self.stiffness * depth.max(0.0) / (1.0 + self.stiffness * compliance);
        vector::scale(self.normal, push)
    }

    /// The force on a flange that is at `position` (m) now, one period (s) after the last call; N, base axes.
    pub fn force(&mut self, position: Vector, period_s: f64) -> Vector {
        let last = self.last.replace(position).unwrap_or(position);
        let speed = vector::dot(self.normal, vector::subtract(position, last)) / period_s;
        let depth = vector::dot(self.normal, vector::subtract(self.point, position));
        let push = match depth > 0.0 {
            true => (self.stiffness * depth - self.damping * speed).max(0.0),
            false => 0.0,
        };
        vector::scale(self.normal, push)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_pushes_to_its_free_side_with_the_depth_and_against_the_speed() {
        let mut wall = ElasticWall::of(&["--start=0", "--wall=0,0,0.3,0,0,2,1000,50"]).expect("a wall");
        assert_eq!(wall.force([0.1, 0.0, 0.31], 1e-3), [0.0; 3]);
        let [x, y, z] = wall.force([0.1, 0.0, 0.29], 0.1);
        assert!((z - 20.0).abs() < 1e-9 && x == 0.0 && y == 0.0, "{z}");
        let [_, _, z] = wall.force([0.1, 0.0, 0.29], 0.1);
        assert!((z - 10.0).abs() < 1e-9, "{z}");
        // Drawn out quickly it does not pull.
        assert_eq!(wall.force([0.1, 0.0, 0.299], 1e-3), [0.0; 3]);
    }

    #[test]
    fn springs_share_the_way_into_it() {
        let wall = ElasticWall::of(&["--wall=0,0,0.3,0,0,1,1500,50"]).expect("a wall");
        // 500 N/m and 1500 N/m one behind the other: 375 N/m.
        let [_, _, z] = wall.force_of_springs([0.1, 0.0, 0.28], 1.0 / 500.0);
        assert!((z - 7.5).abs() < 1e-12, "{z}");
        assert_eq!(wall.force_of_springs([0.1, 0.0, 0.31], 0.002), [0.0; 3]);
    }

    #[test]
    fn what_the_simulator_refuses_is_no_wall() {
        for text in [
            "--wall=1,2",
            "--wall=0,0,0,0,0,0,1,1",
            "--wall=0,0,0,0,0,1,-1,0",
            "--wal=0",
        ] {
            assert_eq!(ElasticWall::of(&[text]), None, "{text}");
        }
    }
}
