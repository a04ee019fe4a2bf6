//! Offset of an arm from its set-points, and its decay: at the start of a net, and after an exchange without a set-point.
//! Pure; run by the host's thread.
//!
//! Per joint the offset o follows the start blend b, which ends at 0: ö = b̈ − 2ω·(ȯ − ḃ) − ω²·(o − b) (critically damped).
//! |ö| is bounded by a share of the acceleration that the set-points leave, and ȯ by the velocity that they leave. So the sum
//! stays within the limits that the set-points keep. Where they leave nothing, ȯ stays and the offset may grow by some
//! milliradians; it decays once they leave room.

use rcc_core::guard::JointLimits;
use rcc_core::message::{JOINTS_MAX, Joints};

use super::limits::ArmLimits;
use super::start_blend::StartBlend;

/// ω, 1/s: 2 % of an offset remain after a quarter of a second.
const OMEGA: f64 = 25.0;
/// Share of the acceleration left by the set-points that the offset may use.
const SHARE: f64 = 0.5;
/// Distance from the blend below which the offset is set to it, rad.
const NEAR: f64 = 1e-9;

/// Decaying offset that is added to the set-points.
#[derive(Clone, Copy, Debug)]
pub struct TrackingOffset {
    blend: StartBlend,
    /// Mean rate of the blend over the last step, rad/s.
    blend_rate: Joints,
    offset: Joints,
    rate: Joints,
}

/// One step of the set-points, and what was sent before it.
#[derive(Clone, Copy, Debug)]
pub struct OffsetStep<'a> {
    /// Set-point at the end of the step, rad.
    pub set_point: &'a Joints,
    /// Position that was sent last, rad.
    pub sent_position: &'a Joints,
    /// Its mean velocity since the position before, rad/s.
    pub sent_velocity: &'a Joints,
    /// Duration of the step, s, > 0.
    pub dt_s: f64,
    /// Time between the middles of the last step and of this one, s, > 0.
    pub between_s: f64,
}

impl TrackingOffset {
    /// The offset of an arm at rest at `hold` from the net's first set-point, both rad.
    #[must_use]
    pub fn new(hold: &Joints, first: &Joints, limits: &ArmLimits) -> TrackingOffset {
        let blend = StartBlend::new(hold, first, limits);
        TrackingOffset {
            blend,
            blend_rate: [0.0; JOINTS_MAX],
            offset: blend.at(),
            rate: [0.0; JOINTS_MAX],
        }
    }

    /// Returns the present rate of change, rad/s.
    #[must_use]
    pub fn rate(&self) -> Joints {
        self.rate
    }

    /// Returns true if the offset from the start of the net has had its time.
    #[must_use]
    pub fn has_blended(&self) -> bool {
        self.blend.is_over()
    }

    /// Replaces the offset (rad) and its rate (rad/s) after `dt_s` (s).
    pub fn replace(&mut self, offset: Joints, rate: Joints, dt_s: f64) {
        self.advance_blend(dt_s);
        (self.offset, self.rate) = (offset, rate);
    }

    /// Advances by one step; returns the set-point with the offset, rad.
    pub fn advance(&mut self, step: &OffsetStep<'_>, limits: &JointLimits) -> Joints {
        let (before, before_rate) = (self.blend.at(), self.blend_rate);
        self.advance_blend(step.dt_s);
        let goal = self.blend.at();
        let mut position = *step.set_point;
        for (joint, place) in position.iter_mut().enumerate() {
            let (offset, rate) = (self.offset[joint], self.rate[joint]);
            let error = offset - before[joint];
            let error_rate = rate - before_rate[joint];
            let is_near = error.abs() < NEAR && error_rate.abs() * step.dt_s < 2.0 * NEAR;
            let wanted = if is_near {
                (goal[joint] - offset) / step.dt_s
            } else {
                let acceleration = -2.0 * OMEGA * error_rate - OMEGA * OMEGA * error;
                self.blend_rate[joint] + error_rate + acceleration * step.dt_s
            };
            let next = within_room(wanted, step, limits, (joint, offset, rate));
            // Exactly the blend, at last 0, so that set-points are sent unchanged.
            self.offset[joint] = if is_near && next == wanted {
                goal[joint]
            } else {
                offset + next * step.dt_s
            };
            self.rate[joint] = next;
            *place += self.offset[joint];
        }
        position
    }

    fn advance_blend(&mut self, dt_s: f64) {
        let before = self.blend.at();
        self.blend.advance(dt_s);
        let rows = self.blend.at().into_iter().zip(before);
        for (place, (now, before)) in self.blend_rate.iter_mut().zip(rows) {
            *place = (now - before) / dt_s;
        }
    }
}

/// Returns the rate nearest to `wanted` (rad/s) that the limits permit to the `offset` (rad) of a `joint`, after `rate`
/// (rad/s).
///
/// With set-points within the limits, the sum of both velocities changes by no more than the acceleration permits; the sum
/// is then clamped to the velocity limit. As the sum before was within that limit, the clamp only makes its change smaller.
fn within_room(
    wanted: f64,
    step: &OffsetStep<'_>,
    limits: &JointLimits,
    (joint, offset, rate): (usize, f64, f64),
) -> f64 {
    let before = step.sent_position[joint] - offset;
    let velocity = (step.set_point[joint] - before) / step.dt_s;
    // Changes of the velocity, rad/s: of the set-points, and the largest one.
    let used = (velocity - (step.sent_velocity[joint] - rate)).abs();
    let change_max = limits.acceleration_max[joint] * step.between_s;
    let change = SHARE * (change_max - used).max(0.0);
    let velocity_max = limits.velocity_max[joint];
    // Set-points beyond the limit are not slowed down: the guard refuses them.
    let (least, most) = (-velocity_max - velocity, velocity_max - velocity);
    wanted
        .max(rate - change)
        .min(rate + change)
        .max(least.min(0.0))
        .min(most.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 1e-3;

    fn limits() -> ArmLimits {
        ArmLimits {
            joints: JointLimits {
                lower: [-10.0; JOINTS_MAX],
                upper: [10.0; JOINTS_MAX],
                velocity_max: [2.0; JOINTS_MAX],
                acceleration_max: [8.0; JOINTS_MAX],
                jerk_max: [2000.0; JOINTS_MAX],
                joints: 7,
            },
            jerk_max: [2000.0; JOINTS_MAX],
            impedance: None,
        }
    }

    /// An arm that follows set-points of all joints, with the offset that it has at rest.
    struct Arm {
        offset: TrackingOffset,
        position: Joints,
        velocity: Joints,
    }

    impl Arm {
        fn at_rest(offset: f64) -> Arm {
            let hold = [offset; JOINTS_MAX];
            Arm {
                offset: TrackingOffset::new(&hold, &[0.0; JOINTS_MAX], &limits()),
                position: hold,
                velocity: [0.0; JOINTS_MAX],
            }
        }

        /// Follows a set-point, rad; checks the limits.
        fn step(&mut self, set_point: f64) {
            let step = OffsetStep {
                set_point: &[set_point; JOINTS_MAX],
                sent_position: &self.position,
                sent_velocity: &self.velocity,
                dt_s: DT_S,
                between_s: DT_S,
            };
            let position = self.offset.advance(&step, &limits().joints);
            let velocity = (position[0] - self.position[0]) / DT_S;
            let acceleration = (velocity - self.velocity[0]) / DT_S;
            assert!(velocity.abs() <= 2.0 + 1e-9, "{velocity}");
            assert!(acceleration.abs() <= 8.0 + 1e-7, "{acceleration}");
            (self.position, self.velocity) = (position, [velocity; JOINTS_MAX]);
        }
    }

    #[test]
    fn decays_within_its_acceleration_also_when_it_is_added_to() {
        let mut arm = Arm::at_rest(0.0);
        for step in 0..2_000 {
            if step < 300 && step % 37 == 0 {
                // The set-points go back while the arm stays.
                let (mut offset, rate) = (arm.offset.offset, arm.offset.rate());
                offset[0] += 2e-3;
                arm.position[0] += 2e-3;
                arm.offset.replace(offset, rate, DT_S);
            }
            arm.step(0.0);
        }
        assert_eq!(arm.position[0], 0.0);
    }

    /// From rest to 2 rad/s, and back to rest, at exactly 8 rad/s².
    #[test]
    fn set_points_at_their_limits_leave_it_no_room_and_the_sum_stays_within_them() {
        for (sign, offset) in [(1.0, 2e-3), (1.0, -2e-3), (-1.0, 2e-3), (-1.0, -2e-3)] {
            for wait in [0, 20, 40, 60, 80] {
                let mut arm = Arm::at_rest(offset);
                (0..wait).for_each(|_| arm.step(0.0));
                let (mut velocity, mut place) = (0.0_f64, 0.0);
                for step in 0..3_000 {
                    let change = if step < 1_000 { 8.0 } else { -8.0 };
                    velocity = (velocity + change * DT_S).clamp(0.0, 2.0);
                    place += velocity * DT_S;
                    arm.step(sign * place);
                }
                assert_eq!(arm.position[0], sign * place, "{sign} {offset} {wait}");
            }
        }
    }
}
