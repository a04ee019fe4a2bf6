//! Model of an arm and its driver: follows set-points exactly after a fixed delay in cycles, within the robot's limits,
//! and stops by itself when they end. Runs in virtual time on the caller's thread.

use rcc_core::guard::{Guard, SLOW};
use rcc_core::message::{CommandImage, DeviceState, Joints, SetPoint};
use rcc_motion::{StopLimits, StopTrajectory};

/// State of following set-points.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FollowPhase {
    /// At rest.
    Holding,
    /// At rest; follows the set-points from `first` on after the delay.
    Waiting { first: u64 },
    /// Following; `entry` is the last set-point sent.
    Following { entry: u64 },
    /// Braking to rest.
    Stopping,
}

/// A simulated arm.
#[derive(Debug)]
pub struct FollowingArm {
    limits: StopLimits,
    guard: Guard,
    delay: u64,
    dt_s: f64,
    phase: FollowPhase,
    rest: Option<StopTrajectory>,
    /// Command that is not followed although it still commands; 0 for none.
    refused: u64,
    /// Newest cycle checked for the start of a command.
    cursor: u64,
    /// The last three positions, newest first, rad.
    positions: [Joints; 3],
    newest: SetPoint,
    outputs: SetPoint,
}

impl FollowingArm {
    /// Creates an arm at rest at `position` (rad); its driver waits `delay` cycles of `dt_s` (s).
    #[must_use]
    pub fn new(
        limits: StopLimits,
        guard: Guard,
        position: Joints,
        delay: u64,
        dt_s: f64,
    ) -> FollowingArm {
        FollowingArm {
            limits,
            guard,
            delay: delay.max(1),
            dt_s,
            phase: FollowPhase::Holding,
            rest: None,
            refused: 0,
            cursor: 0,
            positions: [position; 3],
            newest: SetPoint::NONE,
            outputs: SetPoint::NONE,
        }
    }

    /// Simulates one cycle of the device.
    pub fn exchange(&mut self, image: &CommandImage) {
        self.newest = image
            .at(image.head.sequence)
            .copied()
            .unwrap_or(SetPoint::NONE);
        let before = self.positions[0];
        match self.phase {
            FollowPhase::Following { entry } => self.follow(image, entry + 1),
            FollowPhase::Stopping => self.go_to_rest(),
            FollowPhase::Holding | FollowPhase::Waiting { .. } => {}
        }
        if self.positions[0] == before && !matches!(self.phase, FollowPhase::Following { .. }) {
            self.positions = [before; 3];
        }
        self.detect_start(image);
        if !matches!(
            self.phase,
            FollowPhase::Following { .. } | FollowPhase::Waiting { .. }
        ) {
            self.outputs = self.newest;
        }
    }

    /// Returns the position, which is also the hold position at rest, rad.
    #[must_use]
    pub fn position(&self) -> &Joints {
        &self.positions[0]
    }

    /// Returns the set-point whose outputs are in effect.
    #[must_use]
    pub fn outputs(&self) -> &SetPoint {
        &self.outputs
    }

    /// Returns the state reported by its driver.
    #[must_use]
    pub fn state(&self) -> DeviceState {
        match self.phase {
            FollowPhase::Stopping => DeviceState::Stopping,
            FollowPhase::Waiting { .. } | FollowPhase::Following { .. } => DeviceState::Commanded,
            FollowPhase::Holding if commands(&self.newest) => DeviceState::Online,
            FollowPhase::Holding => DeviceState::Ready,
        }
    }

    /// Returns the logical time up to which all set-points are played and the arm is at rest, ns; 0 if it is not.
    #[must_use]
    pub fn settled_ns(&self) -> u64 {
        match self.phase {
            FollowPhase::Holding if !commands(&self.newest) => self.newest.logical_ns,
            _ => 0,
        }
    }

    /// Returns the logical time of the last set-point sent, ns; 0 if none is followed.
    #[must_use]
    pub fn played_ns(&self) -> u64 {
        match self.phase {
            FollowPhase::Following { .. } => self.outputs.logical_ns,
            _ => 0,
        }
    }

    fn follow(&mut self, image: &CommandImage, entry: u64) {
        let point = image.at(entry).copied().filter(commands);
        let allowed = point.filter(|point| self.guard.check(&point.position, self.dt_s).is_ok());
        match allowed {
            Some(point) => {
                self.move_to(point.position);
                (self.phase, self.outputs) = (FollowPhase::Following { entry }, point);
            }
            // The set-points ended: a later command may be followed. Or a limit is broken: that command is no longer
            // followed.
            None => {
                self.cursor = entry;
                self.refused = point.map_or(self.refused, |point| point.owner);
                self.stop();
            }
        }
    }

    fn stop(&mut self) {
        let [now, last, before] = &self.positions;
        let mut velocity = [0.0; 8];
        let mut acceleration = [0.0; 8];
        for joint in 0..self.limits.joints.min(velocity.len()) {
            let (step, step_before) = (now[joint] - last[joint], last[joint] - before[joint]);
            velocity[joint] = step / self.dt_s;
            acceleration[joint] = (step - step_before) / (self.dt_s * self.dt_s);
        }
        let bounds = self
            .limits
            .velocity_max
            .iter()
            .zip(&self.limits.acceleration_max);
        let slow = velocity
            .iter()
            .zip(bounds)
            .take(self.limits.joints)
            .all(|(v, (v_max, a_max))| v.abs() <= (SLOW * v_max).min(a_max * self.dt_s));
        if slow {
            self.phase = FollowPhase::Holding;
            return;
        }
        // A command that is active while the arm brakes is not followed.
        if commands(&self.newest) {
            self.refused = self.newest.owner;
        }
        let rest = StopTrajectory::new(self.limits, self.dt_s).ok();
        self.rest = rest.and_then(|mut rest| {
            let stopping = rest.begin(&self.positions[0], &velocity, &acceleration);
            stopping.ok().map(|()| rest)
        });
        self.phase = FollowPhase::Stopping;
        self.go_to_rest();
    }

    fn go_to_rest(&mut self) {
        let Some(rest) = &mut self.rest else {
            self.phase = FollowPhase::Holding;
            return;
        };
        let (position, resting) = rest.step();
        self.move_to(position);
        if resting {
            (self.rest, self.phase) = (None, FollowPhase::Holding);
        }
    }

    fn move_to(&mut self, position: Joints) {
        let [now, last, _] = self.positions;
        self.positions = [position, now, last];
    }

    fn detect_start(&mut self, image: &CommandImage) {
        while self.cursor < image.head.sequence
            && matches!(self.phase, FollowPhase::Holding | FollowPhase::Stopping)
        {
            self.cursor += 1;
            let Some(point) = image.at(self.cursor).filter(|point| commands(point)) else {
                continue;
            };
            match self.phase {
                FollowPhase::Holding if point.owner != self.refused => {
                    self.phase = FollowPhase::Waiting { first: self.cursor };
                }
                _ => self.refused = point.owner,
            }
        }
        let FollowPhase::Waiting { first } = self.phase else {
            return;
        };
        if image.head.sequence - first < self.delay {
            return;
        }
        let hold = self.positions[0];
        let point = image.at(first).copied().filter(commands);
        let allowed = point.filter(|point| self.guard.first(&point.position, &hold).is_ok());
        match allowed {
            Some(point) => {
                self.move_to(point.position);
                (self.phase, self.outputs) = (FollowPhase::Following { entry: first }, point);
            }
            None => {
                self.refused = point.map_or(0, |point| point.owner);
                (self.phase, self.cursor) = (FollowPhase::Holding, image.head.sequence);
            }
        }
    }
}

/// Returns true if the set-point commands the joints.
fn commands(point: &SetPoint) -> bool {
    point.has_position == 1 && point.owner != 0
}

#[cfg(test)]
mod tests {
    use rcc_core::guard::JointLimits;

    use super::*;

    const DELAY: u64 = 5;

    struct ArmFixture {
        arm: FollowingArm,
        image: CommandImage,
        played: Vec<f64>,
    }

    impl ArmFixture {
        fn new() -> ArmFixture {
            let joints = JointLimits {
                lower: [-2.0; 8],
                upper: [2.0; 8],
                velocity_max: [2.0; 8],
                acceleration_max: [20.0; 8],
                jerk_max: [2000.0; 8],
                joints: 7,
            };
            let limits = StopLimits {
                velocity_max: joints.velocity_max,
                acceleration_max: joints.acceleration_max,
                jerk_max: [2000.0; 8],
                joints: 7,
            };
            let image = CommandImage::new(1, 1_000_000);
            let arm = FollowingArm::new(limits, Guard::new(joints, 1e-3), [0.0; 8], DELAY, 1e-3);
            ArmFixture {
                arm,
                image,
                played: Vec::new(),
            }
        }

        fn cycle(&mut self, owner: u64, joint: Option<f64>) {
            let mut point = SetPoint {
                owner,
                ..SetPoint::NONE
            };
            if let Some(joint) = joint {
                (point.has_position, point.position[0]) = (1, joint);
            }
            let next = self.image.head.sequence + 1;
            self.image.push(next, 0, point);
            self.arm.exchange(&self.image);
            self.played.push(self.arm.position()[0]);
        }
    }

    /// Returns a motion from rest to rest: 0.1 rad in 0.3 s.
    fn motion() -> Vec<f64> {
        let part = |x: f64| x * x * x * (10.0 - x * (15.0 - 6.0 * x));
        (0..=300)
            .map(|cycle| 0.1 * part(f64::from(cycle) / 300.0))
            .collect()
    }

    #[test]
    fn every_set_point_is_played_after_the_delay_and_the_arm_settles() {
        let mut bench = ArmFixture::new();
        for joint in motion() {
            bench.cycle(1, Some(joint));
            assert_eq!(bench.arm.state(), DeviceState::Commanded);
        }
        (0..DELAY).for_each(|_| bench.cycle(0, None));
        assert_eq!(bench.played[DELAY as usize..], motion());
        assert_eq!(bench.arm.settled_ns(), 0);
        bench.cycle(0, None);
        assert_eq!(bench.arm.state(), DeviceState::Ready);
        assert_eq!(
            bench.arm.settled_ns(),
            bench.image.head.sequence * 1_000_000
        );
    }

    #[test]
    fn set_points_that_end_in_motion_bring_it_to_rest_within_its_limits() {
        let mut bench = ArmFixture::new();
        motion()[..150]
            .iter()
            .for_each(|joint| bench.cycle(1, Some(*joint)));
        (0..DELAY + 2).for_each(|_| bench.cycle(0, None));
        assert_eq!(bench.arm.state(), DeviceState::Stopping);
        (0..500).for_each(|_| bench.cycle(0, None));
        assert_eq!(bench.arm.state(), DeviceState::Ready);
        let steps: Vec<f64> = bench
            .played
            .windows(2)
            .map(|pair| pair[1] - pair[0])
            .collect();
        assert!(
            steps
                .windows(2)
                .all(|pair| (pair[1] - pair[0]).abs() <= 20.0e-6 * 1.001)
        );
    }

    #[test]
    fn a_first_set_point_elsewhere_is_not_followed() {
        let mut bench = ArmFixture::new();
        (0..30).for_each(|_| bench.cycle(1, Some(0.5)));
        assert_eq!(bench.arm.state(), DeviceState::Online);
        assert_eq!(bench.arm.position()[0], 0.0);
        bench.cycle(0, None);
        assert_eq!(bench.arm.state(), DeviceState::Ready);
    }

    #[test]
    fn a_net_that_follows_another_one_after_a_gap_at_rest_is_followed() {
        let mut bench = ArmFixture::new();
        motion()
            .iter()
            .for_each(|joint| bench.cycle(1, Some(*joint)));
        bench.cycle(0, None);
        (0..20).for_each(|_| bench.cycle(2, Some(0.1)));
        assert_eq!(bench.arm.state(), DeviceState::Commanded);
        assert_eq!(
            bench.arm.played_ns(),
            (bench.image.head.sequence - DELAY) * 1_000_000
        );
    }
}
