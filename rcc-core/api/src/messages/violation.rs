//! Messages about set-points that break a rule of the guard, and about the fault that ended a net. Pure.

use rcc_core::guard::{ViolationKind, axis};
use rcc_core::impedance::ControlMode;
use rcc_core::message::{FaultCode, FaultRecord};

use super::{NameResolver, impedance};
use crate::bodies::FaultView;
use crate::codes::{self, ErrorCode};

impl NameResolver<'_> {
    pub(super) fn discontinuous(
        &self,
        net: &str,
        device: u32,
        joint: u32,
        value: f64,
        limit: f64,
        violation: u32,
    ) -> (ErrorCode, String, String) {
        let broken = match ViolationKind::from_number(violation) {
            Some(ViolationKind::Jump) => format!(
                "{} joint {}: the first set-point is {} away from the last one (allowed {})",
                self.device_name(device),
                self.joint_name(device, joint),
                self.joint_value(device, value, ""),
                self.joint_value(device, limit, "")
            ),
            _ => self.violation(device, joint, value, limit, violation),
        };
        (
            codes::DISCONTINUOUS,
            format!("{net} cannot take over: {broken}"),
            "start at the currently commanded position and velocity, or hand over while the arm is commanded to be at rest"
                .to_owned(),
        )
    }

    /// Formats a joint position of a device, or with `per` a rate: as an angle, or in m for linear axes.
    pub(super) fn joint_value(&self, device: u32, value: f64, per: &str) -> String {
        let robot = self.device(device).and_then(|device| device.robot.as_ref());
        match robot.is_some_and(|robot| robot.arm.is_linear()) {
            true => format!("{value:.6} m{per}"),
            false => angle(value, per),
        }
    }

    /// Describes a violation of a guard rule.
    pub(super) fn violation(
        &self,
        device: u32,
        joint: u32,
        value: f64,
        limit: f64,
        kind: u32,
    ) -> String {
        let name = self.device_name(device);
        let what = format!("{name} joint {}", self.joint_name(device, joint));
        let kind = ViolationKind::from_number(kind);
        match kind {
            Some(ViolationKind::Strategy) => format!(
                "{name} runs {}, but its set-points are for {}",
                ControlMode::label(limit as u64),
                ControlMode::label(value as u64)
            ),
            Some(
                kind @ (ViolationKind::Stiffness
                | ViolationKind::StiffnessRate
                | ViolationKind::Damping
                | ViolationKind::Added),
            ) => format!("{name} {}", impedance::rule(kind, joint, value, limit)),
            Some(ViolationKind::Workspace) => {
                let axis = axis((joint as usize).wrapping_sub(1)).unwrap_or("?");
                format!(
                    "{name} would leave its workspace: {axis} is {value:.4} m, the bound is {limit:.4} m"
                )
            }
            Some(ViolationKind::Singularity) => format!(
                "{name} would come too close to a singularity: {value:.4}, its `workspace:` requires {limit:.4}"
            ),
            Some(ViolationKind::NotFinite) => {
                format!("{what}: the set-point is not a finite number")
            }
            Some(ViolationKind::Range) => format!(
                "{what}: position {} is beyond the limit {}",
                self.joint_value(device, value, ""),
                self.joint_value(device, limit, "")
            ),
            Some(ViolationKind::Velocity) => format!(
                "{what}: velocity {} exceeds {}",
                self.joint_value(device, value, "/s"),
                self.joint_value(device, limit, "/s")
            ),
            Some(ViolationKind::Acceleration) => format!(
                "{what}: acceleration {} exceeds {}",
                self.joint_value(device, value, "/s²"),
                self.joint_value(device, limit, "/s²")
            ),
            Some(ViolationKind::Jump) | None => format!(
                "{what}: the set-point is {} away from where the device is held (allowed {})",
                self.joint_value(device, value, ""),
                self.joint_value(device, limit, "")
            ),
        }
    }

    /// Describes the fault that ended a net; `None` if it had no fault.
    #[must_use]
    pub fn fault(&self, fault: &FaultRecord) -> Option<FaultView> {
        let code = FaultCode::from_number(fault.code);
        if code == FaultCode::None {
            return None;
        }
        let device = (fault.device != u32::MAX).then(|| self.device_name(fault.device));
        let joint = (fault.joint != 0).then(|| match axis(fault.joint as usize - 1) {
            Some(axis) => format!("axis {axis}"),
            None => self.joint_name(fault.device, fault.joint),
        });
        let sentence = match (code, &device) {
            (FaultCode::DeviceLost, Some(device)) => {
                format!("device {device} was lost in cycle {}", fault.cycle)
            }
            (FaultCode::Jump | FaultCode::Limit, Some(_)) => self.violation(
                fault.device,
                fault.joint,
                fault.value,
                fault.limit,
                fault.violation,
            ),
            (FaultCode::Panic, _) => "a primitive panicked: report it with the net".to_owned(),
            (FaultCode::Motion, _) => "a motion could not be computed".to_owned(),
            (FaultCode::Overrun, _) => {
                format!(
                    "too many late cycles in a row, the last one was cycle {}",
                    fault.cycle
                )
            }
            _ => code.name().to_owned(),
        };
        Some(FaultView {
            fault: code.name().to_owned(),
            device,
            joint,
            value: fault.value,
            limit: fault.limit,
            cycle: fault.cycle,
            words: sentence,
        })
    }
}

pub(super) fn first_set_point(
    net: &str,
    violation: &str,
    kind: Option<ViolationKind>,
    value: f64,
) -> (ErrorCode, String, String) {
    let help = match kind {
        Some(ViolationKind::Strategy) => impedance::switch(ControlMode::from_number(value as u64)),
        Some(
            ViolationKind::Stiffness
            | ViolationKind::StiffnessRate
            | ViolationKind::Damping
            | ViolationKind::Added,
        ) => impedance::STAY_WITHIN,
        Some(ViolationKind::Range) => WITHIN_ITS_LIMITS,
        _ => START_AT_HOLD,
    };
    (
        codes::FIRST_SET_POINT,
        format!("{net} cannot start: {violation}"),
        help.to_owned(),
    )
}

const START_AT_HOLD: &str = "start where the device is held (a motion without `from` does so, wherever that is at START), or bring the device \
                to where the net starts; there is deliberately no flag to skip this check";

const WITHIN_ITS_LIMITS: &str = "move the arm within its joint limits at its own controller, start the net within them, or correct the limits in \
                the robot's file";

/// Formats an angle, or with `per` a rate: `30.000°/s (0.523599 rad/s)`.
pub(super) fn angle(rad: f64, per: &str) -> String {
    format!("{:.3}°{per} ({rad:.6} rad{per})", rad.to_degrees())
}
