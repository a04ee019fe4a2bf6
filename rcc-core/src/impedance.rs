//! Impedance set-points: stiffness and damping with which an arm holds its position, and the force that it applies in
//! addition. Plain data that is part of a set-point, and the limits from a robot's configuration; used by any thread.

use bytemuck::{Pod, Zeroable};

use crate::joints::{JOINTS_MAX, Joints};

/// Axes of a Cartesian impedance in element order: along and about x, y, z.
pub const AXES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

/// The control strategy with which a controller executes set-points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum ControlMode {
    /// Position control: the joints follow the commanded position.
    Position = 0,
    /// Cartesian impedance control: the tool behaves as a mass on springs along and about the axes of the task frame,
    /// around the commanded pose.
    CartesianImpedance = 1,
    /// Joint impedance control: each joint behaves as a mass on a spring around its commanded position.
    JointImpedance = 2,
}

impl ControlMode {
    /// All strategies in order of their numbers, with their display names.
    pub const ALL: [(ControlMode, &'static str); 3] = [
        (ControlMode::Position, "position control"),
        (
            ControlMode::CartesianImpedance,
            "Cartesian impedance control",
        ),
        (ControlMode::JointImpedance, "joint impedance control"),
    ];

    /// Returns the strategy of a number that came from another process; `None` if the number is unknown.
    #[must_use]
    pub fn from_number(number: u64) -> Option<ControlMode> {
        let row = Self::ALL.iter().find(|row| row.0 as u64 == number);
        row.map(|row| row.0)
    }

    /// Returns the display name of a strategy number; an unknown number is "another control strategy".
    #[must_use]
    pub fn label(number: u64) -> &'static str {
        let row = Self::ALL.iter().find(|row| row.0 as u64 == number);
        row.map_or("another control strategy", |row| row.1)
    }
}

/// The impedance part of a set-point. Joint impedance uses one element per joint, Cartesian impedance six elements in
/// the order of [`AXES`]; unused elements are 0.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Impedance {
    /// [`ControlMode`] that the set-point is for, as a number.
    pub strategy: u64,
    /// Stiffness: N/m along an axis, N·m/rad about an axis or of a joint.
    pub stiffness: Joints,
    /// Damping ratio.
    pub damping: Joints,
    /// Additional force or torque: N along an axis, N·m about an axis or of a joint.
    pub added: Joints,
}

impl Impedance {
    /// Position control without impedance.
    pub const NONE: Impedance = Impedance {
        strategy: ControlMode::Position as u64,
        stiffness: [0.0; JOINTS_MAX],
        damping: [0.0; JOINTS_MAX],
        added: [0.0; JOINTS_MAX],
    };
}

/// Impedance limits of a robot's configuration; ranges are `[least, greatest]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImpedanceLimits {
    /// Stiffness along an axis, N/m.
    pub translation: [f64; 2],
    /// Stiffness about an axis, N·m/rad.
    pub rotation: [f64; 2],
    /// Stiffness of a joint, N·m/rad.
    pub joint: [f64; 2],
    /// Damping ratio.
    pub damping: [f64; 2],
    /// Largest rate of change of a stiffness, as a fraction of the greatest stiffness per second, 1/s.
    pub rate: f64,
    /// Largest additional |force| along an axis, N.
    pub force: f64,
    /// Largest additional |torque| about an axis, N·m.
    pub torque: f64,
    /// Largest additional |torque| of a joint, N·m.
    pub joint_torque: f64,
}

/// The limits of one element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementLimits {
    /// `[least, greatest]` stiffness.
    pub stiffness: [f64; 2],
    /// `[least, greatest]` damping ratio.
    pub damping: [f64; 2],
    /// Largest |rate of change| of the stiffness, per second.
    pub rate: f64,
    /// Largest additional |force| or |torque|.
    pub added: f64,
}

/// Stiffness along an axis, about an axis and of a joint, and damping ratio, with which an arm is held before a net has
/// commanded an impedance: the defaults of KUKA's controllers, see `$STIFFNESS`.
const DEFAULT_HOLD: ([f64; 3], f64) = ([2000.0, 200.0, 1000.0], 0.7);

impl ImpedanceLimits {
    /// Number of reals in [`ImpedanceLimits::to_slots`].
    pub const SLOTS: usize = 12;

    /// Returns the limits as reals, for files and fingerprints.
    #[must_use]
    pub fn to_slots(&self) -> [f64; Self::SLOTS] {
        let [t0, t1] = self.translation;
        let [r0, r1] = self.rotation;
        let [j0, j1] = self.joint;
        let [d0, d1] = self.damping;
        let (rate, force, torque, joint) = (self.rate, self.force, self.torque, self.joint_torque);
        [t0, t1, r0, r1, j0, j1, d0, d1, rate, force, torque, joint]
    }

    /// Creates limits from the reals of [`ImpedanceLimits::to_slots`].
    #[must_use]
    pub fn from_slots(slots: [f64; Self::SLOTS]) -> ImpedanceLimits {
        let [t0, t1, r0, r1, j0, j1, d0, d1, rate, force, torque, joint] = slots;
        ImpedanceLimits {
            translation: [t0, t1],
            rotation: [r0, r1],
            joint: [j0, j1],
            damping: [d0, d1],
            rate,
            force,
            torque,
            joint_torque: joint,
        }
    }

    /// Returns the number of elements that a strategy uses, for an arm with `joints` joints.
    #[must_use]
    pub fn elements(strategy: ControlMode, joints: usize) -> usize {
        match strategy {
            ControlMode::Position => 0,
            ControlMode::CartesianImpedance => AXES.len(),
            ControlMode::JointImpedance => joints.min(JOINTS_MAX),
        }
    }

    /// Returns the limits of an element.
    #[must_use]
    pub fn of(&self, strategy: ControlMode, element: usize) -> ElementLimits {
        let (stiffness, added) = match (strategy, element) {
            (ControlMode::CartesianImpedance, 0..3) => (self.translation, self.force),
            (ControlMode::CartesianImpedance, _) => (self.rotation, self.torque),
            _ => (self.joint, self.joint_torque),
        };
        let [_, greatest] = stiffness;
        ElementLimits {
            stiffness,
            damping: self.damping,
            rate: self.rate * greatest,
            added,
        }
    }

    /// Returns the impedance with which an arm is held before a net has commanded one: KUKA's defaults (2000 N/m, 200
    /// N·m/rad, 1000 N·m/rad for a joint, damping 0.7), limited to the allowed range, and no additional force.
    #[must_use]
    pub fn default_hold(&self, strategy: ControlMode, joints: usize) -> Impedance {
        let ([along, about, joint], ratio) = DEFAULT_HOLD;
        let within = |value: f64, [least, greatest]: [f64; 2]| value.max(least).min(greatest);
        let mut held = Impedance {
            strategy: strategy as u64,
            ..Impedance::NONE
        };
        let places = held.stiffness.iter_mut().zip(&mut held.damping);
        for (element, (stiffness, damping)) in
            places.enumerate().take(Self::elements(strategy, joints))
        {
            let limits = self.of(strategy, element);
            let usual = match (strategy, element) {
                (ControlMode::CartesianImpedance, 0..3) => along,
                (ControlMode::CartesianImpedance, _) => about,
                _ => joint,
            };
            *stiffness = within(usual, limits.stiffness);
            *damping = within(ratio, limits.damping);
        }
        held
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::IMPEDANCE;

    #[test]
    fn an_unknown_number_is_not_a_strategy() {
        for (strategy, _) in ControlMode::ALL {
            assert_eq!(ControlMode::from_number(strategy as u64), Some(strategy));
        }
        assert_eq!(ControlMode::from_number(3), None);
        assert_eq!(ControlMode::label(3), "another control strategy");
    }

    #[test]
    fn limits_round_trip_through_slots() {
        let mut slots = [0.0; ImpedanceLimits::SLOTS];
        for (place, value) in slots.iter_mut().zip(1..) {
            *place = f64::from(value);
        }
        assert_eq!(ImpedanceLimits::from_slots(slots).to_slots(), slots);
        assert_eq!(ImpedanceLimits::from_slots(IMPEDANCE.to_slots()), IMPEDANCE);
    }

    #[test]
    fn the_default_hold_is_within_the_allowed_range() {
        let held = IMPEDANCE.default_hold(ControlMode::CartesianImpedance, 7);
        assert_eq!(
            held.stiffness,
            [2000.0, 2000.0, 2000.0, 200.0, 200.0, 200.0, 0.0, 0.0]
        );
        assert_eq!((held.damping[5], held.damping[6]), (0.7, 0.0));
        let weak = ImpedanceLimits {
            joint: [0.01, 300.0],
            ..IMPEDANCE
        };
        let held = weak.default_hold(ControlMode::JointImpedance, 7);
        assert_eq!((held.stiffness[6], held.stiffness[7]), (300.0, 0.0));
        assert_eq!(weak.default_hold(ControlMode::Position, 7), Impedance::NONE);
    }
}
