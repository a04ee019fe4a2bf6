//! Impedance set-points: how softly an arm holds its position, and what it presses with on top of that.
//! Plain data that travels in a set-point, and what a robot's configuration allows of it; any thread.

use bytemuck::{Pod, Zeroable};

use crate::message::{JOINTS_MAX, Joints};

/// Axes of a Cartesian impedance, in order of their elements: along and about x, y, z.
pub const AXES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

/// What a controller makes of a set-point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Strategy {
    /// The joints are where they are commanded to.
    Position = 0,
    /// The tool is a mass on springs along and about the axes of the task frame, at the commanded pose.
    CartesianImpedance = 1,
    /// Each joint is a mass on a spring at its commanded position.
    JointImpedance = 2,
}

impl Strategy {
    /// All strategies, in order of their numbers, as people call them.
    pub const ALL: [(Strategy, &'static str); 3] = [
        (Strategy::Position, "position control"),
        (Strategy::CartesianImpedance, "Cartesian impedance control"),
        (Strategy::JointImpedance, "joint impedance control"),
    ];

    /// From a number that came from another process; `None`: there is none such.
    #[must_use]
    pub fn from_number(number: u64) -> Option<Strategy> {
        let row = Self::ALL.iter().find(|row| row.0 as u64 == number);
        row.map(|row| row.0)
    }

    /// As printed; a number that means nothing is another strategy.
    #[must_use]
    pub fn words(number: u64) -> &'static str {
        let row = Self::ALL.iter().find(|row| row.0 as u64 == number);
        row.map_or("another control strategy", |row| row.1)
    }
}

/// What is commanded besides the position. In joint impedance an element a joint, in Cartesian impedance six elements in
/// the order of [`AXES`]; the others are 0.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Impedance {
    /// [`Strategy`] as a number: the one that the set-point is for.
    pub strategy: u64,
    /// N/m along an axis, N·m/rad about an axis or in a joint.
    pub stiffness: Joints,
    /// Damping ratio.
    pub damping: Joints,
    /// What the arm presses with on top: N along an axis, N·m about an axis or in a joint.
    pub added: Joints,
}

impl Impedance {
    /// None: position control.
    pub const NONE: Impedance = Impedance {
        strategy: Strategy::Position as u64,
        stiffness: [0.0; JOINTS_MAX],
        damping: [0.0; JOINTS_MAX],
        added: [0.0; JOINTS_MAX],
    };
}

/// What a robot's configuration allows; ranges are `[least, greatest]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImpedanceLimits {
    /// Stiffness along an axis, N/m.
    pub translation: [f64; 2],
    /// Stiffness about an axis, N·m/rad.
    pub rotation: [f64; 2],
    /// Stiffness of a joint, N·m/rad.
    pub joint: [f64; 2],
    /// Damping ratio of each.
    pub damping: [f64; 2],
    /// Largest rate of a stiffness, in parts of the greatest stiffness a second, 1/s.
    pub rate: f64,
    /// Largest |force| that is added along an axis, N.
    pub force: f64,
    /// Largest |torque| that is added about an axis, N·m.
    pub torque: f64,
    /// Largest |torque| that is added in a joint, N·m.
    pub joint_torque: f64,
}

/// What is allowed of one element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementLimits {
    /// `[least, greatest]` stiffness.
    pub stiffness: [f64; 2],
    /// `[least, greatest]` damping ratio.
    pub damping: [f64; 2],
    /// Largest |change of stiffness| a second.
    pub rate: f64,
    /// Largest |force| or |torque| on top.
    pub added: f64,
}

/// Stiffness along and about an axis and of a joint with which an arm is held before a net has commanded any, and the
/// damping ratio: what KUKA's controllers begin with, see `$STIFFNESS`.
const HELD: ([f64; 3], f64) = ([2000.0, 200.0, 1000.0], 0.7);

impl ImpedanceLimits {
    /// Number of reals in [`ImpedanceLimits::to_slots`].
    pub const SLOTS: usize = 12;

    /// As reals, for files and fingerprints.
    #[must_use]
    pub fn to_slots(&self) -> [f64; Self::SLOTS] {
        let [t0, t1] = self.translation;
        let [r0, r1] = self.rotation;
        let [j0, j1] = self.joint;
        let [d0, d1] = self.damping;
        let (rate, force, torque, joint) = (self.rate, self.force, self.torque, self.joint_torque);
        [t0, t1, r0, r1, j0, j1, d0, d1, rate, force, torque, joint]
    }

    /// The contrary of [`ImpedanceLimits::to_slots`].
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

    /// Number of elements of a strategy, for an arm of so many joints.
    #[must_use]
    pub fn elements(strategy: Strategy, joints: usize) -> usize {
        match strategy {
            Strategy::Position => 0,
            Strategy::CartesianImpedance => AXES.len(),
            Strategy::JointImpedance => joints.min(JOINTS_MAX),
        }
    }

    /// What is allowed of an element.
    #[must_use]
    pub fn of(&self, strategy: Strategy, element: usize) -> ElementLimits {
        let (stiffness, added) = match (strategy, element) {
            (Strategy::CartesianImpedance, 0..3) => (self.translation, self.force),
            (Strategy::CartesianImpedance, _) => (self.rotation, self.torque),
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

    /// How an arm is held before a net has commanded anything: with KUKA's usual stiffness (2000 N/m, 200 N·m/rad, 1000
    /// N·m/rad in a joint) and damping (0.7), or what is allowed nearest to it, and nothing on top.
    #[must_use]
    pub fn held(&self, strategy: Strategy, joints: usize) -> Impedance {
        let ([along, about, joint], ratio) = HELD;
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
                (Strategy::CartesianImpedance, 0..3) => along,
                (Strategy::CartesianImpedance, _) => about,
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
    fn a_number_without_a_meaning_is_no_strategy() {
        for (strategy, _) in Strategy::ALL {
            assert_eq!(Strategy::from_number(strategy as u64), Some(strategy));
        }
        assert_eq!(Strategy::from_number(3), None);
        assert_eq!(Strategy::words(3), "another control strategy");
    }

    #[test]
    fn limits_are_the_same_after_a_way_through_a_file() {
        let mut slots = [0.0; ImpedanceLimits::SLOTS];
        for (place, value) in slots.iter_mut().zip(1..) {
            *place = f64::from(value);
        }
        assert_eq!(ImpedanceLimits::from_slots(slots).to_slots(), slots);
        assert_eq!(ImpedanceLimits::from_slots(IMPEDANCE.to_slots()), IMPEDANCE);
    }

    #[test]
    fn an_arm_is_held_with_what_is_allowed() {
        let held = IMPEDANCE.held(Strategy::CartesianImpedance, 7);
        assert_eq!(
            held.stiffness,
            [2000.0, 2000.0, 2000.0, 200.0, 200.0, 200.0, 0.0, 0.0]
        );
        assert_eq!((held.damping[5], held.damping[6]), (0.7, 0.0));
        let weak = ImpedanceLimits {
            joint: [0.01, 300.0],
            ..IMPEDANCE
        };
        let held = weak.held(Strategy::JointImpedance, 7);
        assert_eq!((held.stiffness[6], held.stiffness[7]), (300.0, 0.0));
        assert_eq!(weak.held(Strategy::Position, 7), Impedance::NONE);
    }
}
