//! The stream of commanded positions: supervised for range, velocity and acceleration, extrapolated when a command is
//! missed.
//! Pure; run by the clock thread.

use super::{JOINTS, Joints};
use thiserror::Error;

/// Allowance for rounding to binary32 in the second difference, in rounding steps.
const ROUNDING_STEPS: f64 = 4.0;

/// Limits of the commanded positions that a controller supervises, symmetric about 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SupervisedLimits {
    /// rad.
    pub position: Joints,
    /// rad/s.
    pub velocity: Joints,
    /// rad/s².
    pub acceleration: Joints,
}

/// By what a stream of commands is judged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamRules {
    /// Time from one command to the next, s.
    pub period_s: f64,
    /// Limits before scaling.
    pub limits: SupervisedLimits,
    /// Factor on the limits of velocity and acceleration, 0 to 1.
    pub scale: f64,
    /// Time constant of the low-pass that the acceleration is taken behind, s; 0: the second difference.
    pub acceleration_filter_s: f64,
}

/// Which limit a command violates. Joints are counted from 0 here and from 1 in messages.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum StreamFault {
    /// A commanded position is out of range.
    #[error("joint {} was commanded to {value} rad, the limit is ±{limit} rad", joint + 1)]
    Position {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad.
        value: f64,
        /// Limit, rad.
        limit: f64,
    },
    /// The commanded positions exceed the velocity limit.
    #[error("joint {} was commanded with {value} rad/s, the limit is ±{limit} rad/s", joint + 1)]
    Velocity {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad/s.
        value: f64,
        /// Limit, rad/s.
        limit: f64,
    },
    /// The commanded positions exceed the acceleration limit.
    #[error("joint {} was commanded with {value} rad/s², the limit is ±{limit} rad/s²", joint + 1)]
    Acceleration {
        /// Index of the joint.
        joint: usize,
        /// Commanded, rad/s².
        value: f64,
        /// Limit, rad/s².
        limit: f64,
    },
    /// A commanded position is NaN or infinite.
    #[error("joint {} was commanded to a value that is not a number", joint + 1)]
    NotFinite {
        /// Index of the joint.
        joint: usize,
    },
}

impl StreamFault {
    /// Returns the index of the joint.
    pub fn joint(&self) -> usize {
        match *self {
            Self::Position { joint, .. }
            | Self::Velocity { joint, .. }
            | Self::Acceleration { joint, .. }
            | Self::NotFinite { joint } => joint,
        }
    }
}

/// Position, velocity and spacing of the last accepted command.
///
/// KUKA does not publish how a controller judges the acceleration of a sampled stream. **Our choice:** the velocity passes
/// a first-order low-pass with [`StreamRules::acceleration_filter_s`], and the limit applies to the slope of its output, so
/// that a small step of the velocity, as at the start of KUKA's own sample, is not taken for a jolt. With 0 it is the
/// second difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandStream {
    position: Joints,
    velocity: Joints,
    /// `velocity` behind the low-pass, rad/s.
    filtered: Joints,
    /// Time between the last two accepted commands, s.
    spacing_s: f64,
    /// Number of periods since the last accepted command.
    missed: u64,
    /// Largest magnitude since the last reset, rad/s.
    pub velocity_max: Joints,
    /// Largest magnitude since the last reset, rad/s².
    pub acceleration_max: Joints,
}

impl CommandStream {
    /// A stream that starts at rest at `position` (rad).
    pub fn at_rest(position: Joints, period_s: f64) -> Self {
        Self {
            position,
            velocity: [0.0; JOINTS],
            filtered: [0.0; JOINTS],
            spacing_s: period_s,
            missed: 0,
            velocity_max: [0.0; JOINTS],
            acceleration_max: [0.0; JOINTS],
        }
    }

    /// Returns the position of the last command, rad.
    pub fn position(&self) -> Joints {
        self.position
    }

    /// Returns the velocity of the last command, rad/s.
    pub fn velocity(&self) -> Joints {
        self.velocity
    }

    /// Forgets the largest velocities and accelerations.
    pub fn reset_extremes(&mut self) {
        self.velocity_max = [0.0; JOINTS];
        self.acceleration_max = [0.0; JOINTS];
    }

    /// Counts a missed command and returns the position extrapolated with the last velocity, rad.
    pub fn extrapolate(&mut self, period_s: f64) -> Joints {
        self.missed += 1;
        let time_s = self.missed as f64 * period_s;
        std::array::from_fn(|joint| self.position[joint] + self.velocity[joint] * time_s)
    }

    /// Accepts a command, one period after the last tick.
    ///
    /// # Errors
    /// Returns a fault for the first joint that violates a limit; the stream is then unchanged.
    pub fn accept(&mut self, command: &Joints, rules: &StreamRules) -> Result<(), StreamFault> {
        if let Some(joint) = command.iter().position(|q| !q.is_finite()) {
            return Err(StreamFault::NotFinite { joint });
        }
        check(
            command,
            &rules.limits.position,
            1.0,
            |joint, value, limit| StreamFault::Position {
                joint,
                value,
                limit,
            },
        )?;
        let spacing_s = (self.missed + 1) as f64 * rules.period_s;
        let velocity = self.velocities(command, spacing_s);
        let acceleration = self.accelerations(&velocity, spacing_s);
        let (slope, filtered) = self.filtered(&velocity, spacing_s, rules);
        supervise(&velocity, &slope, spacing_s, rules)?;
        for joint in 0..JOINTS {
            self.velocity_max[joint] = self.velocity_max[joint].max(velocity[joint].abs());
            self.acceleration_max[joint] =
                self.acceleration_max[joint].max(acceleration[joint].abs());
        }
        *self = Self {
            position: *command,
            velocity,
            filtered,
            spacing_s,
            missed: 0,
            ..*self
        };
        Ok(())
    }

    fn velocities(&self, command: &Joints, spacing_s: f64) -> Joints {
        std::array::from_fn(|joint| (command[joint] - self.position[joint]) / spacing_s)
    }

    /// Returns the slope of the filtered velocity, rad/s², and its new value, rad/s.
    fn filtered(&self, velocity: &Joints, spacing_s: f64, rules: &StreamRules) -> (Joints, Joints) {
        let time_s = 0.5 * (spacing_s + self.spacing_s);
        let lag_s = rules.acceleration_filter_s + time_s;
        let slope: Joints =
            std::array::from_fn(|joint| (velocity[joint] - self.filtered[joint]) / lag_s);
        let filtered = std::array::from_fn(|joint| self.filtered[joint] + slope[joint] * time_s);
        (slope, filtered)
    }

    /// Second difference over unequal spacings: each velocity belongs to the middle of its interval.
    fn accelerations(&self, velocity: &Joints, spacing_s: f64) -> Joints {
        std::array::from_fn(|joint| {
            (velocity[joint] - self.velocity[joint]) * 2.0 / (spacing_s + self.spacing_s)
        })
    }
}

/// Checks the limits of velocity and acceleration, the latter with an allowance for rounding to binary32.
fn supervise(
    velocity: &Joints,
    acceleration: &Joints,
    spacing_s: f64,
    rules: &StreamRules,
) -> Result<(), StreamFault> {
    let scale = rules.scale;
    check(
        velocity,
        &rules.limits.velocity,
        scale,
        |joint, value, limit| StreamFault::Velocity {
            joint,
            value,
            limit,
        },
    )?;
    let rounding =
        ROUNDING_STEPS * f64::from(f32::EPSILON) * std::f64::consts::PI / spacing_s.powi(2);
    let allowed = rules
        .limits
        .acceleration
        .map(|limit| limit * scale + rounding);
    check(acceleration, &allowed, 1.0, |joint, value, limit| {
        StreamFault::Acceleration {
            joint,
            value,
            limit,
        }
    })?;
    Ok(())
}

fn check(
    values: &Joints,
    limits: &Joints,
    scale: f64,
    fault: impl Fn(usize, f64, f64) -> StreamFault,
) -> Result<(), StreamFault> {
    for (joint, (&value, &limit)) in values.iter().zip(limits).enumerate() {
        let limit = limit * scale;
        if value.abs() > limit {
            return Err(fault(joint, value, limit));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::lwr::settings::Settings;

    const T: f64 = 1e-3;
    /// Step of the velocity with which KUKA's first sample begins, degrees/s: 5 degrees × 0.2 π /s.
    const KUKA_STEP: f64 = std::f64::consts::PI;

    fn rules() -> StreamRules {
        Settings::default().stream_rules()
    }

    fn moving(velocity: f64) -> CommandStream {
        CommandStream {
            velocity: [velocity; JOINTS],
            filtered: [velocity; JOINTS],
            ..CommandStream::at_rest([0.0; JOINTS], T)
        }
    }

    #[test]
    fn a_velocity_above_the_limit_is_a_fault_that_names_joint_and_limit() {
        let mut stream = moving(2.05);
        let settings = rules();
        let fault = stream.accept(&[0.0025; JOINTS], &settings).unwrap_err();
        assert!(
            matches!(fault, StreamFault::Velocity { joint: 0, limit, .. } if (limit - 2.0944).abs() < 1e-4)
        );
    }

    #[test]
    fn a_jump_within_the_velocity_is_a_fault_of_acceleration() {
        let fault = moving(0.0).accept(&[1e-3; JOINTS], &rules()).unwrap_err();
        assert!(matches!(fault, StreamFault::Acceleration { joint: 0, .. }));
    }

    #[test]
    fn a_position_out_of_range_is_a_fault() {
        let mut command = [0.0; JOINTS];
        command[1] = 2.1;
        let fault = moving(0.0).accept(&command, &rules()).unwrap_err();
        assert!(matches!(fault, StreamFault::Position { joint: 1, .. }));
    }

    #[test]
    fn rounding_to_binary32_is_no_acceleration() {
        let mut stream = CommandStream::at_rest([1.9; JOINTS], T);
        let settings = StreamRules {
            limits: SupervisedLimits {
                acceleration: [0.2; JOINTS],
                ..rules().limits
            },
            acceleration_filter_s: 0.0,
            ..rules()
        };
        for i in 1..1900 {
            let q = 1.9 + 0.05 * (f64::from(i) * T).powi(2);
            stream
                .accept(&[f64::from(q as f32); JOINTS], &settings)
                .unwrap();
        }
    }

    /// Commands a sine that begins with `speed` (rad/s) at once, as KUKA's first sample does; one command in 50 is missed,
    /// and the client does not make up for it.
    fn begins_at_once(
        speed: f64,
        period_s: f64,
        settings: &StreamRules,
    ) -> Result<(), StreamFault> {
        let mut stream = CommandStream::at_rest([0.0; JOINTS], period_s);
        let settings = StreamRules {
            period_s,
            ..*settings
        };
        let mut time_s = 0.0;
        for cycle in 1..3000 {
            if cycle % 50 == 0 {
                stream.extrapolate(period_s);
                continue;
            }
            time_s += period_s;
            stream.accept(&[speed * f64::sin(time_s); JOINTS], &settings)?;
        }
        Ok(())
    }

    #[test]
    fn a_small_step_of_the_velocity_is_no_jolt_unless_the_second_difference_is_judged() {
        let raw = StreamRules {
            acceleration_filter_s: 0.0,
            ..rules()
        };
        // The step of KUKA's first sample, and the greatest that our choice of the filter lets pass.
        for speed in [KUKA_STEP, 12.0] {
            for period_s in [0.001, 0.002, 0.005] {
                let begun = begins_at_once(speed.to_radians(), period_s, &rules());
                assert_eq!(begun, Ok(()), "{speed} degrees/s at {period_s} s");
            }
        }
        let jolt = begins_at_once(KUKA_STEP.to_radians(), 0.001, &raw);
        assert!(matches!(
            jolt,
            Err(StreamFault::Acceleration { joint: 0, .. })
        ));
        let faster = begins_at_once(15_f64.to_radians(), 0.001, &rules());
        assert!(matches!(faster, Err(StreamFault::Acceleration { .. })));
    }

    #[test]
    fn a_lasting_acceleration_above_the_limit_is_a_fault_behind_the_filter_too() {
        let (mut stream, settings) = (moving(0.0), rules());
        let accelerated = |i: u32| 0.5 * 25.0 * (f64::from(i) * T).powi(2);
        let fault = (1..80).find_map(|i| stream.accept(&[accelerated(i); JOINTS], &settings).err());
        assert!(
            matches!(fault, Some(StreamFault::Acceleration { joint: 0, .. })),
            "{fault:?}"
        );
    }

    #[test]
    fn missed_commands_count_as_time() {
        let mut stream = moving(1.0);
        assert!((stream.extrapolate(T)[0] - 1e-3).abs() < 1e-12);
        assert!((stream.extrapolate(T)[0] - 2e-3).abs() < 1e-12);
        assert_eq!(stream.accept(&[3e-3; JOINTS], &rules()), Ok(()));
        assert!((stream.velocity()[0] - 1.0).abs() < 1e-9);
    }
}
