//! The axes of the device: enables their drives one state at a time while that is permitted, and gives them the set-points of
//! the host once all of them follow.
//! Pure; called by the host's thread, once per exchange, without allocation.
//!
//! A drive is enabled only with permission, which a net gives by the edge of the output `axes enable`, and which ends with that
//! output, with any drive that leaves `operation enabled`, and with a loss of the line. Without such an output the start of the
//! line permits it, and a fault is never reset. All drives are enabled together, or none.

use rcc_driver_kit::driver::{Inputs, Outputs};
use rcc_driver_kit::rcc_core::message::{JOINTS_MAX, Joints};

use super::axis_settings::AxisSettings;
use super::power_state::{PowerState, command, follows_target};
use super::reasons;
use crate::session::TerminalImage;

/// Longest time from the permission until all drives follow, ns.
const ENABLE_MAX_NS: u64 = 5_000_000_000;
/// Longest time for the reset of a fault, ns.
const RESET_MAX_NS: u64 = 1_000_000_000;

/// Largest change of a target with one set-point, in periods at the velocity limit. 0x60C2 tells the drive to make it in one
/// period. Up to two are usual: two set-points between two frames, or a period that this machine has left out.
const STEP_PERIODS: f64 = 3.0;

/// A drive as the last exchange showed it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DriveStatus {
    /// Statusword.
    pub word: u16,
    /// Actual position, counts.
    pub actual: i32,
    /// Error code; 0 = none, or not exchanged.
    pub error: u16,
    /// Target from the moment on at which the drive is enabled, counts.
    target: Option<i32>,
}

impl DriveStatus {
    fn state(&self) -> PowerState {
        PowerState::of(self.word)
    }
}

/// Permission to enable the drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Permission {
    /// None, and why: one of the driver's reasons.
    Denied { reason: u32 },
    /// Since this time, ns.
    Enabling { for_ns: u64 },
    /// All drives follow.
    Enabled,
}

/// The drives of all joints.
#[derive(Clone, Debug)]
pub struct Axes {
    settings: Vec<AxisSettings>,
    /// Largest change of a target with one set-point, rad (m for a linear axis).
    step_max: Joints,
    /// Index of the digital output that permits enabling.
    enable: Option<u32>,
    drives: [DriveStatus; JOINTS_MAX],
    permission: Permission,
    /// The output `axes enable` was on in the last exchange, or its edge would be that of an earlier line: it must be off
    /// before it permits anything.
    was_on: bool,
    /// A set-point has been followed with this permission.
    followed: bool,
    released: bool,
}

impl Axes {
    /// Returns axes without permission; `way_max` is the way of each in one period at its velocity limit, rad (m for a linear
    /// axis).
    #[must_use]
    pub fn new(settings: Vec<AxisSettings>, way_max: Joints, enable: Option<u32>) -> Axes {
        Axes {
            settings,
            step_max: way_max.map(|way| STEP_PERIODS * way),
            enable,
            drives: [DriveStatus::default(); JOINTS_MAX],
            permission: Permission::Denied {
                reason: reasons::DRIVES_OFF,
            },
            was_on: true,
            followed: false,
            released: false,
        }
    }

    /// Returns true if there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.settings.is_empty()
    }

    /// Returns the settings of the axes.
    #[must_use]
    pub fn settings(&self) -> &[AxisSettings] {
        &self.settings
    }

    /// Returns the drives, in the order of the joints.
    pub fn drives(&self) -> impl Iterator<Item = &DriveStatus> {
        self.drives.iter().take(self.settings.len())
    }

    /// The line has been started, is lost, or got the safe values: the drives have no permission any more. Without an output
    /// `axes enable`, the line itself gives it.
    pub fn lose(&mut self) {
        self.permission = match self.enable {
            Some(_) => Permission::Denied {
                reason: reasons::DRIVES_OFF,
            },
            None => Permission::Enabling { for_ns: 0 },
        };
        self.was_on = true;
        self.drives = self.drives.map(|drive| DriveStatus {
            target: None,
            ..drive
        });
    }

    /// The set-points of several periods came at once.
    fn lose_late(&mut self) {
        self.lose();
        if let Permission::Denied { reason } = &mut self.permission {
            *reason = reasons::LATE;
        }
    }

    /// The driver ends: the drives are switched off.
    pub fn release(&mut self) {
        self.released = true;
    }

    /// Takes the inputs of a complete exchange, and the time since the one before, ns. In SAFEOP (`drives_outputs` is false)
    /// nothing follows from them.
    pub fn read(&mut self, image: &[TerminalImage], passed_ns: u64, drives_outputs: bool) {
        for (settings, drive) in self.settings.iter().zip(&mut self.drives) {
            let place = settings.place;
            let inputs = image.get(place.terminal).map(|one| one.inputs.as_slice());
            let inputs = inputs.unwrap_or_default();
            drive.word = word(inputs, place.status);
            drive.actual = i32::from_le_bytes(bytes(inputs, place.position));
            drive.error = place.error.map_or(0, |at| word(inputs, at));
        }
        if !drives_outputs {
            return self.lose();
        }
        let all_follow = self.drives().all(|drive| follows_target(drive.word));
        let held = self.drives().all(|drive| drive.target.is_some());
        self.permission = match self.permission {
            Permission::Enabling { .. } if all_follow && held => {
                self.followed = false;
                Permission::Enabled
            }
            Permission::Enabling { for_ns } => self.enabling(for_ns.saturating_add(passed_ns)),
            Permission::Enabled if !all_follow => Permission::Denied {
                reason: reasons::DRIVE_LEFT,
            },
            other => other,
        };
    }

    fn is_fault(&self) -> bool {
        self.drives().any(|drive| drive.state().is_fault())
    }

    /// Judges drives that are being enabled.
    fn enabling(&self, for_ns: u64) -> Permission {
        let resets = self.enable.is_some() && for_ns <= RESET_MAX_NS;
        let reason = match () {
            () if self.is_fault() && !resets => reasons::DRIVE_FAULT,
            () if for_ns > ENABLE_MAX_NS => reasons::DRIVE_START,
            () => return Permission::Enabling { for_ns },
        };
        Permission::Denied { reason }
    }

    /// Returns why no net may command the joints; 0 = all drives follow.
    #[must_use]
    pub fn reason(&self) -> u32 {
        match self.permission {
            _ if self.released => reasons::RELEASED,
            Permission::Denied { .. } if self.is_fault() => reasons::DRIVE_FAULT,
            Permission::Denied { reason } => reason,
            Permission::Enabling { .. } => reasons::DRIVES_ENABLING,
            Permission::Enabled => 0,
        }
    }

    /// Returns where the drives hold the joints, rad: their targets once these are given, otherwise where they are.
    #[must_use]
    pub fn hold(&self) -> Joints {
        self.joints(|drive| drive.target.unwrap_or(drive.actual))
    }

    /// Stores where the joints are, rad; torques are unknown.
    pub fn inputs(&self, inputs: &mut Inputs) {
        inputs.position = self.joints(|drive| drive.actual);
        inputs.torque = [f64::NAN; JOINTS_MAX];
        inputs.external_torque = [f64::NAN; JOINTS_MAX];
    }

    fn joints(&self, of: impl Fn(&DriveStatus) -> i32) -> Joints {
        let mut joints = [0.0; JOINTS_MAX];
        let rows = self.settings.iter().zip(&self.drives);
        for (place, (settings, drive)) in joints.iter_mut().zip(rows) {
            *place = settings.to_position(of(drive));
        }
        joints
    }

    /// Writes controlwords and targets of the next exchange.
    pub fn write(&mut self, outputs: &Outputs, image: &mut [TerminalImage]) {
        self.permit(outputs);
        if self.permission == Permission::Enabled && !self.released {
            self.follow(&outputs.position);
        }
        for (settings, drive) in self.settings.iter().zip(&mut self.drives) {
            let word = controlword(drive, self.permission, self.released, self.enable.is_some());
            match (word, drive.target) {
                // The target is where the drive is at the moment at which it is enabled.
                (command::ENABLE_OPERATION, None) => drive.target = Some(drive.actual),
                (command::ENABLE_OPERATION, Some(_)) => {}
                _ => drive.target = None,
            }
            let place = settings.place;
            if let Some(image) = image.get_mut(place.terminal) {
                let target = drive.target.unwrap_or(drive.actual);
                put(&mut image.outputs, place.control, &word.to_le_bytes());
                put(&mut image.outputs, place.target, &target.to_le_bytes());
            }
        }
    }

    /// The edge of the output `axes enable` gives permission, its end takes it.
    fn permit(&mut self, outputs: &Outputs) {
        let Some(bit) = self.enable else {
            return;
        };
        let is_on = outputs.digital_set & outputs.digital & 1 << bit != 0;
        match (self.was_on, is_on) {
            (false, true) => self.permission = Permission::Enabling { for_ns: 0 },
            // Why the drives were stopped before stays told.
            (true, false) if !matches!(self.permission, Permission::Denied { .. }) => {
                self.permission = Permission::Denied {
                    reason: reasons::DRIVES_OFF,
                };
            }
            _ => {}
        }
        self.was_on = is_on;
    }

    /// Takes set-points, rad. The first ones must be where the drives hold the joints, within the windows of their following
    /// errors; the way between the others is that of a few periods at most. The host plays the time of lost exchanges, and of
    /// its own absence, in one step: the drives would make it in one period. Anything else ends the permission.
    fn follow(&mut self, position: &Joints) {
        let (mut fits, mut are_numbers) = (true, true);
        let rows = self.settings.iter().zip(&self.drives);
        for ((settings, drive), (position, step_max)) in
            rows.zip(position.iter().zip(self.step_max))
        {
            let hold = settings.to_position(drive.target.unwrap_or(drive.actual));
            let most = match self.followed {
                // A target is rounded to counts.
                true => step_max + settings.counts_per_unit.abs().recip(),
                false => settings.following_window,
            };
            fits &= (position - hold).abs() <= most;
            are_numbers &= position.is_finite();
        }
        if !fits {
            match self.followed && are_numbers {
                true => self.lose_late(),
                false => {
                    self.permission = Permission::Denied {
                        reason: reasons::JUMP,
                    };
                }
            }
            return;
        }
        self.followed = true;
        let rows = self.settings.iter().zip(&mut self.drives).zip(position);
        for ((settings, drive), position) in rows {
            // Within 32 bits: the whole range of the joint is.
            drive.target = Some(settings.to_counts(*position) as i32);
        }
    }
}

/// Returns the controlword of a drive. One that is enabled without having been given a target is switched off first: it was
/// enabled by somebody else.
fn controlword(drive: &DriveStatus, permission: Permission, released: bool, resets: bool) -> u16 {
    let state = drive.state();
    match permission {
        _ if released => state.towards_disabled(),
        Permission::Denied { .. } => state.towards_disabled(),
        _ if state == PowerState::Fault && resets => command::FAULT_RESET,
        _ if state == PowerState::OperationEnabled && drive.target.is_none() => {
            state.towards_disabled()
        }
        _ => state.towards_enabled(),
    }
}

fn bytes<const N: usize>(inputs: &[u8], at: usize) -> [u8; N] {
    let found = inputs
        .get(at..at + N)
        .and_then(|found| found.try_into().ok());
    found.unwrap_or([0; N])
}

fn word(inputs: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(bytes(inputs, at))
}

fn put(outputs: &mut [u8], at: usize, value: &[u8]) {
    if let Some(place) = outputs.get_mut(at..at + value.len()) {
        place.copy_from_slice(value);
    }
}

#[cfg(test)]
mod tests;
