//! An elastic wall in virtual time, like `lwr-sim --wall=`. In position control the arm feels it and does not yield; in
//! impedance control the two springs share the displacement at once. Used on the caller's thread.

use rcc_core::vector::{self, Vector};

use super::arguments::{numbers, value_of};

/// Stiffness of a wall without one, N/m.
pub const WALL_STIFFNESS: f64 = 5000.0;
/// Damping of a wall without one, N·s/m.
pub const WALL_DAMPING: f64 = 20.0;

/// A plane that pushes back and never pulls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElasticWall {
    /// Point of the plane, base frame, m.
    point: Vector,
    /// Unit normal towards the free side.
    normal: Vector,
    /// Stiffness, N/m.
    stiffness: f64,
    /// Damping of the velocity into the wall, N·s/m.
    damping: f64,
    /// Position of the flange in the previous cycle, m.
    last: Option<Vector>,
}

impl ElasticWall {
    /// Reads `--wall=` among a simulator's arguments; `None` if absent or invalid.
    #[must_use]
    pub fn of(arguments: &[&str]) -> Option<ElasticWall> {
        let given = value_of(arguments, "--wall=")?;
        // Like `lwr-sim`, which requires all eight numbers.
        (given.split(',').count() == 8)
            .then(|| ElasticWall::parse(given))
            .flatten()
    }

    /// Parses `PX,PY,PZ,NX,NY,NZ` or `PX,PY,PZ,NX,NY,NZ,K,D`; `None` if it is invalid. Without stiffness and damping
    /// the wall has those of `rcc-cli fault DEVICE wall`.
    #[must_use]
    pub fn parse(text: &str) -> Option<ElasticWall> {
        let (px, py, pz, nx, ny, nz, stiffness, damping) = match numbers(text)?[..] {
            [px, py, pz, nx, ny, nz] => (px, py, pz, nx, ny, nz, WALL_STIFFNESS, WALL_DAMPING),
            [px, py, pz, nx, ny, nz, k, d] => (px, py, pz, nx, ny, nz, k, d),
            _ => return None,
        };
        (stiffness >= 0.0 && damping >= 0.0).then_some(ElasticWall {
            point: [px, py, pz],
            normal: vector::normalized([nx, ny, nz])?,
            stiffness,
            damping,
            last: None,
        })
    }

    /// Returns the unit normal towards the free side.
    #[must_use]
    pub fn normal(&self) -> Vector {
        self.normal
    }

    /// Returns the force on a flange that is held by springs, N, base axes: without contact it would be at `position`
    /// (m), and it yields by `compliance` (m/N, 0 or more) along the normal; infinite if no spring holds it there, so that
    /// it yields without force. Static, without damping.
    #[must_use]
    pub fn force_of_springs(&self, position: Vector, compliance: f64) -> Vector {
        let depth = vector::dot(self.normal, vector::subtract(self.point, position));
        if compliance.is_infinite() {
            return [0.0; 3];
        }
        let push = self.stiffness * depth.max(0.0) / (1.0 + self.stiffness * compliance);
        vector::scale(self.normal, push)
    }

    /// Returns the force on a flange at `position` (m), one period (s) after the last call; N, base axes.
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
    fn the_force_grows_with_depth_and_speed_into_the_wall() {
        let mut wall =
            ElasticWall::of(&["--start=0", "--wall=0,0,0.3,0,0,2,1000,50"]).expect("a wall");
        assert_eq!(wall.force([0.1, 0.0, 0.31], 1e-3), [0.0; 3]);
        let [x, y, z] = wall.force([0.1, 0.0, 0.29], 0.1);
        assert!((z - 20.0).abs() < 1e-9 && x == 0.0 && y == 0.0, "{z}");
        let [_, _, z] = wall.force([0.1, 0.0, 0.29], 0.1);
        assert!((z - 10.0).abs() < 1e-9, "{z}");
        // Pulled out quickly, the wall does not pull.
        assert_eq!(wall.force([0.1, 0.0, 0.299], 1e-3), [0.0; 3]);
    }

    #[test]
    fn springs_share_the_displacement() {
        let wall = ElasticWall::of(&["--wall=0,0,0.3,0,0,1,1500,50"]).expect("a wall");
        // 500 N/m and 1500 N/m in series give 375 N/m.
        let [_, _, z] = wall.force_of_springs([0.1, 0.0, 0.28], 1.0 / 500.0);
        assert!((z - 7.5).abs() < 1e-12, "{z}");
        assert_eq!(wall.force_of_springs([0.1, 0.0, 0.31], 0.002), [0.0; 3]);
        // Nothing holds the flange against the wall.
        let free = wall.force_of_springs([0.1, 0.0, 0.28], f64::INFINITY);
        assert_eq!(free, [0.0; 3]);
    }

    #[test]
    fn walls_that_the_simulator_refuses_are_invalid() {
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
