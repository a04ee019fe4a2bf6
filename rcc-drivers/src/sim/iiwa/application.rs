//! The application that runs on the simulated cabinet: it starts position holds with an FRI overlay, handles faults, and
//! closes the session. The safety controller and the drives are here as well.
//! Pure; run by the clock thread once per tick.

use super::cabinet::Cabinet;
use super::fault::{CabinetFault, WaitReason};
use super::settings::{COMMAND_PERIOD_MAX_MS, MotionStart};
use crate::fri_iiwa::wire::{DriveState, Quality, SafetyState};

/// Time that the drives take to become active, s. The value is ours.
const DRIVE_START_S: f64 = 0.3;

impl Cabinet {
    /// Runs one pass: drives, end and start of motions.
    pub(super) fn run_application(&mut self) {
        self.run_drives();
        if self.has_motion() {
            if self.quality.quality() < Quality::Good {
                self.fail(CabinetFault::Quality {
                    answered: self.quality.figures().answered,
                });
            } else if !self.motion_wanted {
                self.stop();
            }
        }
        self.acknowledge_by_application();
        self.wait_reason = self.reason_to_wait();
        if self.wait_reason.is_none() && !self.has_motion() {
            self.start_motion();
            self.wait_reason = Some(WaitReason::Synchronising);
        }
    }

    /// Switches the drives as the safety controller allows it.
    fn run_drives(&mut self) {
        let allowed = matches!(self.safety, SafetyState::Normal | SafetyState::Stop2);
        // A stop 1 ends with a ramp; then the drives are switched off.
        let off = match self.safety {
            SafetyState::Stop0 => true,
            SafetyState::Stop1 => self.is_at_rest(),
            SafetyState::Normal | SafetyState::Stop2 => !self.robot.drives_wanted,
        };
        if off {
            self.drives = DriveState::Off;
            return;
        }
        if allowed && self.drives == DriveState::Off {
            self.drives = DriveState::Transitioning;
            self.drives_active_at_s = self.robot.time_s + DRIVE_START_S;
        }
        if self.drives == DriveState::Transitioning && self.robot.time_s >= self.drives_active_at_s
        {
            self.drives = DriveState::Active;
        }
    }

    fn acknowledge_by_application(&mut self) {
        if self.settings.motion == MotionStart::Auto
            && self.safety == SafetyState::Normal
            && self.robot.at_rest_for_s >= self.settings.robot.acknowledge_after_s
        {
            self.fault = None;
        }
    }

    fn reason_to_wait(&self) -> Option<WaitReason> {
        let quality = self.quality.quality();
        let answer_ms = self.settings.period_ms * self.settings.multiplier;
        match () {
            () if self.is_commanded() => None,
            () if self.has_motion() => Some(WaitReason::Synchronising),
            () if !self.session_open => Some(WaitReason::Closed),
            () if self.safety != SafetyState::Normal => Some(WaitReason::Safety),
            () if self.fault.is_some() => Some(WaitReason::Acknowledgement),
            () if self.drives != DriveState::Active => Some(WaitReason::Drives),
            () if !self.is_at_rest() => Some(WaitReason::Rest),
            () if self.quality.figures().answered == 0 => Some(WaitReason::Answer),
            () if quality < Quality::Good || self.aborted_for > 0 => {
                Some(WaitReason::Quality(quality))
            }
            () if answer_ms > COMMAND_PERIOD_MAX_MS => Some(WaitReason::Period(answer_ms)),
            () if !self.motion_wanted => Some(WaitReason::Motion),
            () => None,
        }
    }

    /// The safety controller stops the robot, or releases it. A stop ends a motion.
    pub(super) fn stop_safely(&mut self, safety: SafetyState) {
        self.safety = safety;
        if safety != SafetyState::Normal {
            self.fail(CabinetFault::Safety(safety));
        }
    }

    /// Presses the emergency stop, a stop 1; `ack` releases it.
    pub(super) fn press_emergency_stop(&mut self) {
        self.robot.emergency_stop = true;
        self.stop_safely(SafetyState::Stop1);
    }

    /// Switches the drives on or off.
    pub(super) fn switch_drives(&mut self, on: bool) {
        self.robot.drives_wanted = on;
        if !on && self.has_motion() {
            self.fail(CabinetFault::DrivesOff);
        }
    }

    /// If the arm is at rest, releases the emergency stop and every safety stop, and acknowledges the fault. Returns whether
    /// it is at rest.
    pub(super) fn acknowledge(&mut self) -> bool {
        if self.is_at_rest() {
            self.robot.emergency_stop = false;
            self.safety = SafetyState::Normal;
            self.fault = None;
        }
        self.is_at_rest()
    }
}
