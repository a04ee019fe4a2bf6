//! Messages about impedance set-points: a violated rule, and how to switch a controller to another strategy. Pure; any
//! thread.

use rcc_core::guard::{Violation, ViolationKind};
use rcc_core::impedance::ControlMode;

/// Remedy for a violated rule of impedance.
pub(super) const STAY_WITHIN: &str = "stay within the limits of `impedance:` in the robot's file; set-points are never clamped silently";

/// Describes a violation with its axis or joint (from 1), value, limit and unit.
pub(super) fn rule(kind: ViolationKind, joint: u32, value: f64, limit: f64) -> String {
    let joint = u8::try_from(joint.saturating_sub(1)).unwrap_or(u8::MAX);
    let violation = Violation {
        kind,
        joint,
        value,
        limit,
    };
    violation.to_string()
}

/// Returns how to switch a controller to the strategy that a net commands.
pub(super) fn switch(wanted: Option<ControlMode>) -> &'static str {
    match wanted {
        Some(ControlMode::CartesianImpedance) => {
            "switch the controller to Cartesian impedance control before its program begins command mode (KUKA LWR: \
             $STIFFNESS.STRATEGY = 20; lwr-sim: --strategy=cartesian-impedance), or command the arm with the primitive for \
             the strategy that it runs"
        }
        Some(ControlMode::JointImpedance) => {
            "switch the controller to joint impedance control before its program begins command mode (KUKA LWR: \
             $STIFFNESS.STRATEGY = 30; lwr-sim: --strategy=joint-impedance), or command the arm with the primitive for the \
             strategy that it runs"
        }
        _ => {
            "switch the controller to position control before its program begins command mode (KUKA LWR: \
             $STIFFNESS.STRATEGY = 10; lwr-sim: --strategy=position), or command the arm with CartesianImpedanceCommand or \
             JointImpedanceCommand, whichever it runs"
        }
    }
}
