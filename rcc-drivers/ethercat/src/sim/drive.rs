//! The axis of a simulated servo drive: the state machine of CiA 402 (IEC 61800-7-201, section 6.2), cyclic synchronous
//! position, the supervision of the following error, and a motor of bounded speed.
//! Pure, in the line's time; called by the thread of the socket.

use std::time::Duration;

use serde::Serialize;

/// Error codes (object 0x603F; IEC 61800-7-201, table of error codes).
pub mod error {
    /// The position has left the window of the following error.
    pub const FOLLOWING: u16 = 0x8611;
    /// Process data stopped while the axis was enabled.
    pub const COMMUNICATION: u16 = 0x7500;
}

/// Bits of the controlword (object 0x6040).
mod control {
    pub const SWITCH_ON: u16 = 0x01;
    pub const ENABLE_VOLTAGE: u16 = 0x02;
    /// 0 = quick stop.
    pub const NO_QUICK_STOP: u16 = 0x04;
    pub const ENABLE_OPERATION: u16 = 0x08;
    pub const FAULT_RESET: u16 = 0x80;
}

/// Mode of operation: cyclic synchronous position.
pub const CYCLIC_POSITION: i8 = 8;
/// Longest step of the motion, ns.
const STEP_NS: u64 = 1_000_000;
/// Most steps at once: a line that nobody asks stands still afterwards.
const STEPS_MAX: u64 = 10_000;

/// A state of CiA 402.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DriveState {
    /// No torque; waits for the command `shutdown`.
    SwitchOnDisabled,
    /// No torque; the power may be switched on.
    ReadyToSwitchOn,
    /// The power is on; no torque.
    SwitchedOn,
    /// The axis follows its target.
    OperationEnabled,
    /// The axis brakes, as commanded.
    QuickStopActive,
    /// The axis brakes because of a fault.
    FaultReactionActive,
    /// No torque until the fault is reset.
    Fault,
}

impl DriveState {
    /// Returns its bits in the statusword (object 0x6041), with `voltage enabled`.
    fn bits(self) -> u16 {
        0x10 | match self {
            DriveState::SwitchOnDisabled => 0x40,
            DriveState::ReadyToSwitchOn => 0x21,
            DriveState::SwitchedOn => 0x23,
            DriveState::OperationEnabled => 0x27,
            DriveState::QuickStopActive => 0x07,
            DriveState::FaultReactionActive => 0x0f,
            DriveState::Fault => 0x08,
        }
    }
}

/// The settings that concern the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveSettings {
    /// Mode of operation.
    pub mode: i8,
    /// Window of the following error, counts.
    pub following_window: u32,
    /// Longest time outside of the window.
    pub following_timeout: Duration,
    /// Deceleration of a quick stop, counts/s².
    pub quick_stop_deceleration: u32,
    /// Largest speed, counts/s.
    pub speed_max: u32,
    /// Time in which a target is reached, s: the interval between two of them.
    pub interpolation_s: f64,
}

/// The axis.
#[derive(Clone, Debug)]
pub struct Drive {
    state: DriveState,
    /// Actual position, counts.
    actual: f64,
    /// Speed, counts/s.
    speed: f64,
    /// Target position, counts.
    target: i32,
    /// Speed with which the axis moves to its target, counts/s.
    approach: f64,
    /// Last controlword.
    control: u16,
    error: u16,
    now: Duration,
    /// Time for which the position has been outside of its window.
    outside: Duration,
    /// The motor is blocked: it does not move.
    pub blocked: bool,
    /// Safe torque off: the axis cannot be switched on.
    pub torque_off: bool,
}

impl Drive {
    /// An axis after power-on, at this position, counts.
    #[must_use]
    pub fn new(actual: i32) -> Drive {
        Drive {
            state: DriveState::SwitchOnDisabled,
            actual: f64::from(actual),
            speed: 0.0,
            target: actual,
            approach: 0.0,
            control: 0,
            error: 0,
            now: Duration::ZERO,
            outside: Duration::ZERO,
            blocked: false,
            torque_off: false,
        }
    }

    /// Returns the axis after a loss of power: its encoder is absolute.
    #[must_use]
    pub fn restarted(&self) -> Drive {
        Drive {
            now: self.now,
            blocked: self.blocked,
            torque_off: self.torque_off,
            ..Drive::new(self.position())
        }
    }

    /// Returns the state.
    #[must_use]
    pub fn state(&self) -> DriveState {
        self.state
    }

    /// Returns the actual position, counts.
    #[must_use]
    pub fn position(&self) -> i32 {
        self.actual.round() as i32
    }

    /// Returns the target position, counts.
    #[must_use]
    pub fn target(&self) -> i32 {
        self.target
    }

    /// Returns the last controlword.
    #[must_use]
    pub fn controlword(&self) -> u16 {
        self.control
    }

    /// Returns the error code; 0 = none.
    #[must_use]
    pub fn error(&self) -> u16 {
        self.error
    }

    /// Returns the statusword.
    #[must_use]
    pub fn statusword(&self) -> u16 {
        let follows = self.state == DriveState::OperationEnabled;
        // Remote; the axis follows its target; following error.
        self.state.bits()
            | 0x0200
            | if follows { 0x1000 } else { 0 }
            | u16::from(self.error == error::FOLLOWING) << 13
    }

    /// Takes the outputs of an exchange: controlword and target position, counts.
    pub fn command(&mut self, word: u16, target: i32, settings: &DriveSettings) {
        let risen = word & !self.control;
        self.control = word;
        self.target = target;
        // At its last speed the axis would begin a quick stop, so it must be that of the motion and not of a step.
        let way = (f64::from(target) - self.actual).abs();
        self.approach = (way / settings.interpolation_s).min(f64::from(settings.speed_max));
        let on = |bit: u16| word & bit != 0;
        let voltage = on(control::ENABLE_VOLTAGE);
        let quick_stop = voltage && !on(control::NO_QUICK_STOP);
        let switch_on = voltage && !quick_stop && on(control::SWITCH_ON);
        let enable = switch_on && on(control::ENABLE_OPERATION);
        use DriveState::{
            Fault, FaultReactionActive, OperationEnabled, QuickStopActive, ReadyToSwitchOn,
            SwitchOnDisabled, SwitchedOn,
        };
        self.state = match self.state {
            Fault if risen & control::FAULT_RESET != 0 => {
                self.error = 0;
                SwitchOnDisabled
            }
            state @ (Fault | FaultReactionActive) => state,
            QuickStopActive if voltage => QuickStopActive,
            OperationEnabled if quick_stop => QuickStopActive,
            // Without voltage, or after a quick stop at rest.
            _ if !voltage || quick_stop => SwitchOnDisabled,
            SwitchOnDisabled if !switch_on && !self.torque_off => ReadyToSwitchOn,
            SwitchOnDisabled => SwitchOnDisabled,
            _ if !switch_on => ReadyToSwitchOn,
            ReadyToSwitchOn => SwitchedOn,
            SwitchedOn if enable && settings.mode == CYCLIC_POSITION => {
                self.outside = Duration::ZERO;
                OperationEnabled
            }
            SwitchedOn => SwitchedOn,
            OperationEnabled if !enable => SwitchedOn,
            state @ (OperationEnabled | QuickStopActive) => state,
        };
        if !self.is_moved() {
            self.speed = 0.0;
        }
    }

    /// Process data have stopped without a request: a fault of an enabled axis, which brakes.
    pub fn lose_communication(&mut self) {
        match self.state {
            DriveState::OperationEnabled | DriveState::QuickStopActive => {
                self.fail(error::COMMUNICATION);
            }
            _ => self.leave_op(),
        }
    }

    /// The MainDevice has requested a state without outputs: an enabled axis brakes (abort connection option code 3).
    pub fn leave_op(&mut self) {
        self.control = 0;
        self.state = match self.state {
            DriveState::OperationEnabled => DriveState::QuickStopActive,
            DriveState::ReadyToSwitchOn | DriveState::SwitchedOn => DriveState::SwitchOnDisabled,
            state => state,
        };
    }

    /// Raises a fault with this error code.
    pub fn fail(&mut self, code: u16) {
        self.error = code;
        self.state = match self.is_moved() {
            true => DriveState::FaultReactionActive,
            false => DriveState::Fault,
        };
    }

    /// Switches safe torque off on or off.
    pub fn set_torque_off(&mut self, off: bool) {
        self.torque_off = off;
        if off && !matches!(self.state, DriveState::Fault) {
            (self.state, self.speed) = (DriveState::SwitchOnDisabled, 0.0);
        }
    }

    fn is_moved(&self) -> bool {
        matches!(
            self.state,
            DriveState::OperationEnabled
                | DriveState::QuickStopActive
                | DriveState::FaultReactionActive
        )
    }

    /// Lets the time pass until `now`.
    pub fn advance(&mut self, now: Duration, settings: &DriveSettings) {
        let passed = now.saturating_sub(self.now);
        self.now = now;
        let nanos = u64::try_from(passed.as_nanos()).unwrap_or(u64::MAX);
        let steps = nanos.div_ceil(STEP_NS).min(STEPS_MAX);
        for step in 0..steps {
            let left = nanos - step * STEP_NS;
            self.step(Duration::from_nanos(left.min(STEP_NS)), settings);
        }
    }

    fn step(&mut self, passed: Duration, settings: &DriveSettings) {
        let dt_s = passed.as_secs_f64();
        match self.state {
            DriveState::OperationEnabled => {
                let most = self.approach * dt_s;
                let way = f64::from(self.target) - self.actual;
                self.move_by(way.clamp(-most, most), dt_s);
                self.supervise(passed, settings);
            }
            DriveState::QuickStopActive | DriveState::FaultReactionActive => {
                let less = f64::from(settings.quick_stop_deceleration) * dt_s;
                let speed = (self.speed.abs() - less).max(0.0) * self.speed.signum();
                self.move_by(0.5 * (self.speed + speed) * dt_s, dt_s);
                self.speed = speed;
                if speed == 0.0 || self.blocked {
                    self.state = match self.state {
                        DriveState::QuickStopActive => DriveState::SwitchOnDisabled,
                        _ => DriveState::Fault,
                    };
                    self.speed = 0.0;
                }
            }
            _ => {}
        }
    }

    fn move_by(&mut self, way: f64, dt_s: f64) {
        if !self.blocked && dt_s > 0.0 {
            self.actual += way;
            self.speed = way / dt_s;
        }
    }

    /// A position that is outside of its window for too long is a fault.
    fn supervise(&mut self, passed: Duration, settings: &DriveSettings) {
        let distance = (f64::from(self.target) - self.actual).abs();
        match distance > f64::from(settings.following_window) {
            false => self.outside = Duration::ZERO,
            true => self.outside += passed,
        }
        if self.outside > settings.following_timeout {
            self.fail(error::FOLLOWING);
        }
    }
}

#[cfg(test)]
mod tests;
