//! Measurements of an arm besides its channels, by name: `fz`, `torque[3]`. Pure.

use rcc_core::message::Measurement;
use rcc_core::unit::Unit;

/// Elements of a wrench, in order.
const WRENCH: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];

/// One measured value of an arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Element of the wrench at the flange.
    Wrench(usize),
    /// Position of a joint.
    Position(usize),
    /// Torque of a joint.
    Torque(usize),
    /// External torque of a joint.
    ExternalTorque(usize),
}

/// Makes a reading from the index of a joint.
type OfJoint = fn(usize) -> Reading;

const OF_JOINTS: [(&str, OfJoint); 3] = [
    ("position", Reading::Position),
    ("torque", Reading::Torque),
    ("external_torque", Reading::ExternalTorque),
];

impl Reading {
    /// Returns the reading with this name of an arm with so many joints: `fz`, `wrench[2]`, `torque[3]`; joints count
    /// from 0.
    #[must_use]
    pub fn named(name: &str, joints: usize) -> Option<Reading> {
        if let Some(element) = WRENCH.iter().position(|known| *known == name) {
            return Some(Reading::Wrench(element));
        }
        let (list, index) = name.strip_suffix(']')?.split_once('[')?;
        let index: usize = index.parse().ok()?;
        if list == "wrench" {
            return (index < WRENCH.len()).then_some(Reading::Wrench(index));
        }
        let (_, make) = OF_JOINTS.iter().find(|(known, _)| *known == list)?;
        (index < joints).then(|| make(index))
    }

    /// Returns the names of the readings of an arm with so many joints.
    pub fn names(joints: usize) -> impl Iterator<Item = String> {
        let last = joints.saturating_sub(1);
        let of_joints = OF_JOINTS.map(|(list, _)| format!("{list}[0] to {list}[{last}]"));
        WRENCH.into_iter().map(str::to_owned).chain(of_joints)
    }

    /// Returns its unit; `linear`: the joints are linear axes.
    #[must_use]
    pub fn unit(self, linear: bool) -> Unit {
        match self {
            Reading::Wrench(0..3) => Unit::NEWTON,
            Reading::Position(_) => Unit::of_joints(linear, 0),
            Reading::Wrench(_) | Reading::Torque(_) | Reading::ExternalTorque(_) => {
                Unit::NEWTON_METRE
            }
        }
    }

    /// Returns its place in a measurement.
    pub fn place(self, m: &mut Measurement) -> Option<&mut f64> {
        match self {
            Reading::Wrench(element) => m.wrench.get_mut(element),
            Reading::Position(joint) => m.position.get_mut(joint),
            Reading::Torque(joint) => m.torque.get_mut(joint),
            Reading::ExternalTorque(joint) => m.external_torque.get_mut(joint),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_have_names_and_units() {
        for (name, expected) in [
            ("fz", Some(Reading::Wrench(2))),
            ("wrench[5]", Some(Reading::Wrench(5))),
            ("wrench[6]", None),
            ("torque[6]", Some(Reading::Torque(6))),
            ("torque[7]", None),
            ("position", None),
            ("hold[0]", None),
        ] {
            assert_eq!(Reading::named(name, 7), expected, "{name}");
        }
        assert_eq!(Reading::Wrench(3).unit(false), Unit::NEWTON_METRE);
    }
}
