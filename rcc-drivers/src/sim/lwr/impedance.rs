//! Which springs, dampers and forces a command of FRI 1.0 asks for, and the numbers of KRL for the control laws.
//! Pure; run by the clock thread.

use super::JOINTS;
use super::fault::KrcFault;
use crate::fri_lwr::wire::{CommandDatagram, flags};
use crate::sim::arm::impedance::{ControlLaw, ImpedanceSettings, RATIO, STIFFNESS, count, kind};

/// Relative tolerance of the ranges for binary32.
const ROUNDING: f64 = 1e-6;

/// One value per axis (six) or per joint (seven), depending on the strategy.
type Elements = [f64; JOINTS];

impl ImpedanceSettings {
    /// Returns the settings of a command for this strategy: those fields that its flags select, and `$STIFFNESS` for the
    /// others.
    ///
    /// # Errors
    /// Returns a fault for the first element out of range.
    pub fn of(command: &CommandDatagram, strategy: ControlLaw) -> Result<Self, KrcFault> {
        // KUKA's order is x y z A B C: A rotates about z, C about x.
        let six = |values: &[f32; 6]| -> Elements {
            let [x, y, z, a, b, c] = values.map(f64::from);
            [x, y, z, c, b, a, 0.0]
        };
        let (stiffness, damping, added) = match strategy {
            ControlLaw::JointImpedance => (
                command.joint_stiffness.map(f64::from),
                command.joint_damping.map(f64::from),
                command.additional_joint_torque.map(f64::from),
            ),
            _ => (
                six(&command.cartesian_stiffness),
                six(&command.cartesian_damping),
                six(&command.additional_tcp_wrench),
            ),
        };
        let usual = Self::default_for(strategy);
        let (of_joints, selected) = (strategy == ControlLaw::JointImpedance, |flag: u32| {
            command.flags & flag != 0
        });
        let picked = |joint: u32, cartesian: u32, commanded: Elements, usual: Elements| {
            let flag = if of_joints { joint } else { cartesian };
            if selected(flag) { commanded } else { usual }
        };
        let stiffness = picked(
            flags::JOINT_STIFFNESS,
            flags::CARTESIAN_STIFFNESS,
            stiffness,
            usual.stiffness,
        );
        let damping = picked(
            flags::JOINT_DAMPING,
            flags::CARTESIAN_DAMPING,
            damping,
            usual.damping,
        );
        let added = picked(flags::JOINT_TORQUE, flags::TCP_WRENCH, added, usual.added);
        for element in 0..count(strategy) {
            let rows = [
                (
                    "stiffness",
                    stiffness[element],
                    STIFFNESS[kind(strategy, element)],
                ),
                ("damping", damping[element], RATIO),
                (
                    "added force or torque",
                    added[element],
                    [-f64::MAX, f64::MAX],
                ),
            ];
            for (what, value, [least, greatest]) in rows {
                let room = 1.0 + ROUNDING;
                if !(value >= least / room && value <= greatest.min(f64::MAX / 2.0) * room) {
                    return Err(KrcFault::Impedance {
                        what,
                        element,
                        value,
                        least,
                        greatest,
                    });
                }
            }
        }
        Ok(Self {
            stiffness,
            damping,
            added,
        })
    }
}

impl ControlLaw {
    /// Returns the strategy of a value of `$STIFFNESS.STRATEGY`.
    pub fn from_krl(number: i32) -> Option<Self> {
        match number {
            10 => Some(ControlLaw::Position),
            20 => Some(ControlLaw::CartesianImpedance),
            30 => Some(ControlLaw::JointImpedance),
            _ => None,
        }
    }

    /// Returns all command flags that a controller reads in this strategy.
    pub fn flags(self) -> u32 {
        match self {
            ControlLaw::Position => flags::JOINT_POSITION,
            ControlLaw::CartesianImpedance => {
                flags::JOINT_POSITION
                    | flags::CARTESIAN_POSITION
                    | flags::TCP_WRENCH
                    | flags::CARTESIAN_STIFFNESS
                    | flags::CARTESIAN_DAMPING
            }
            ControlLaw::JointImpedance => {
                flags::JOINT_POSITION
                    | flags::JOINT_TORQUE
                    | flags::JOINT_STIFFNESS
                    | flags::JOINT_DAMPING
            }
        }
    }
}
