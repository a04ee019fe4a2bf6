//! The power state machine of a drive (CiA 402; IEC 61800-7-201, section 6.2): what a statusword says, and the controlword
//! that leads one step on.
//! Pure; called by the host's thread.

/// Bit 12 of the statusword: in cyclic synchronous position the drive follows its target.
const FOLLOWS_TARGET: u16 = 0x1000;

/// Commands of the controlword (object 0x6040).
pub mod command {
    /// No voltage: no torque.
    pub const DISABLE_VOLTAGE: u16 = 0x00;
    /// Brakes by the quick stop ramp, then no torque.
    pub const QUICK_STOP: u16 = 0x02;
    /// To `ready to switch on`.
    pub const SHUTDOWN: u16 = 0x06;
    /// To `switched on`.
    pub const SWITCH_ON: u16 = 0x07;
    /// To `operation enabled`.
    pub const ENABLE_OPERATION: u16 = 0x0f;
    /// Its edge resets a fault.
    pub const FAULT_RESET: u16 = 0x80;
}

/// A state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PowerState {
    /// Starts, or the statusword is not one of CiA 402.
    #[default]
    NotReady,
    /// No torque.
    SwitchOnDisabled,
    /// No torque; may be switched on.
    ReadyToSwitchOn,
    /// Switched on, no torque.
    SwitchedOn,
    /// Follows its target.
    OperationEnabled,
    /// Brakes, as commanded.
    QuickStopActive,
    /// Brakes because of a fault.
    FaultReactionActive,
    /// No torque until the fault is reset.
    Fault,
}

impl PowerState {
    /// Returns the state that a statusword (object 0x6041) shows.
    #[must_use]
    pub fn of(statusword: u16) -> PowerState {
        match (statusword & 0x4f, statusword & 0x6f) {
            (0x40, _) => PowerState::SwitchOnDisabled,
            (0x0f, _) => PowerState::FaultReactionActive,
            (0x08, _) => PowerState::Fault,
            (_, 0x21) => PowerState::ReadyToSwitchOn,
            (_, 0x23) => PowerState::SwitchedOn,
            (_, 0x27) => PowerState::OperationEnabled,
            (_, 0x07) => PowerState::QuickStopActive,
            _ => PowerState::NotReady,
        }
    }

    /// Returns its name in words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            PowerState::NotReady => "not ready to switch on",
            PowerState::SwitchOnDisabled => "switch on disabled",
            PowerState::ReadyToSwitchOn => "ready to switch on",
            PowerState::SwitchedOn => "switched on",
            PowerState::OperationEnabled => "operation enabled",
            PowerState::QuickStopActive => "quick stop active",
            PowerState::FaultReactionActive => "fault reaction active",
            PowerState::Fault => "fault",
        }
    }

    /// Returns true if there is a fault.
    #[must_use]
    pub fn is_fault(self) -> bool {
        matches!(self, PowerState::FaultReactionActive | PowerState::Fault)
    }

    /// Returns the controlword that leads to `operation enabled`, one state at a time; a fault is not reset by it.
    #[must_use]
    pub fn towards_enabled(self) -> u16 {
        match self {
            PowerState::SwitchOnDisabled => command::SHUTDOWN,
            PowerState::ReadyToSwitchOn => command::SWITCH_ON,
            PowerState::SwitchedOn | PowerState::OperationEnabled => command::ENABLE_OPERATION,
            _ => self.towards_disabled(),
        }
    }

    /// Returns the controlword that leads to `switch on disabled`: a quick stop if the drive is enabled.
    #[must_use]
    pub fn towards_disabled(self) -> u16 {
        match self {
            PowerState::OperationEnabled | PowerState::QuickStopActive => command::QUICK_STOP,
            _ => command::DISABLE_VOLTAGE,
        }
    }
}

/// Returns true if a drive is enabled and follows its target in cyclic synchronous position.
#[must_use]
pub fn follows_target(statusword: u16) -> bool {
    PowerState::of(statusword) == PowerState::OperationEnabled && statusword & FOLLOWS_TARGET != 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_other_bits_of_a_statusword_do_not_change_its_state() {
        for (bits, state) in [
            (0x00, PowerState::NotReady),
            (0x40, PowerState::SwitchOnDisabled),
            (0x21, PowerState::ReadyToSwitchOn),
            (0x23, PowerState::SwitchedOn),
            (0x27, PowerState::OperationEnabled),
            (0x07, PowerState::QuickStopActive),
            (0x0f, PowerState::FaultReactionActive),
            (0x08, PowerState::Fault),
        ] {
            for other in [0x0000, 0x0010, 0x0200, 0x1290, 0xff90] {
                assert_eq!(PowerState::of(bits | other), state, "{bits:#x} {other:#x}");
            }
        }
        // Bit 5 belongs to the enabled states only.
        assert_eq!(PowerState::of(0x60), PowerState::SwitchOnDisabled);
        assert_eq!(PowerState::of(0x28), PowerState::Fault);
    }

    #[test]
    fn only_bit_12_of_an_enabled_drive_follows() {
        assert!(follows_target(0x1237));
        assert!(!follows_target(0x0237));
        assert!(!follows_target(0x1233));
    }
}
