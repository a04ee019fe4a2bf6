//! The EtherCAT state machine of a SubDevice (ETG.1000.6, section 6.4.1): which requests it follows, and with which code
//! it refuses the others.
//! Pure; called by the thread of the socket.

use serde::Serialize;

/// Bit of AL control that acknowledges an error, and bit of AL status that shows one.
pub const ERROR: u16 = 0x10;

/// A state; the number is that of AL control and AL status.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum State {
    /// No communication.
    Init = 1,
    /// Mailboxes.
    PreOp = 2,
    /// Mailboxes and inputs.
    SafeOp = 4,
    /// Mailboxes, inputs and outputs.
    Op = 8,
}

/// Reasons for the error flag (ETG.1000.6, table 11).
pub mod code {
    /// The request is not a step that is allowed from the present state.
    pub const INVALID_STEP: u16 = 0x0011;
    /// The requested state does not exist.
    pub const UNKNOWN_STATE: u16 = 0x0012;
    /// There is no bootstrap state.
    pub const BOOTSTRAP: u16 = 0x0013;
    /// The sync managers of the mailboxes are wrong.
    pub const MAILBOX: u16 = 0x0016;
    /// No valid outputs arrived in time.
    pub const WATCHDOG: u16 = 0x001b;
    /// The sync manager of the outputs is wrong.
    pub const OUTPUTS: u16 = 0x001d;
    /// The sync manager of the inputs is wrong.
    pub const INPUTS: u16 = 0x001e;
    /// SYNC0 is on, and its period is 0.
    pub const SYNC_CONFIGURATION: u16 = 0x0030;
}

/// State, error flag and code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Present state.
    pub state: State,
    /// Reason of the error flag; 0 = no error.
    pub code: u16,
}

impl Status {
    /// After power-on.
    pub const POWER_ON: Status = Status {
        state: State::Init,
        code: 0,
    };

    /// Returns the contents of the register AL status.
    #[must_use]
    pub fn register(&self) -> u16 {
        self.state as u16 | if self.code == 0 { 0 } else { ERROR }
    }

    /// Returns the status after a request. `check` judges the registers before the step up into a state, and returns the
    /// code of what is wrong.
    #[must_use]
    pub fn request(self, control: u16, check: impl Fn(State) -> Option<u16>) -> Status {
        let refuse = |code| Status {
            state: self.state,
            code,
        };
        let wanted = match control & 0x0f {
            1 => State::Init,
            2 => State::PreOp,
            3 => return refuse(code::BOOTSTRAP),
            4 => State::SafeOp,
            8 => State::Op,
            _ => return refuse(code::UNKNOWN_STATE),
        };
        // An error that is not acknowledged blocks the way up, and stays shown.
        if self.code != 0 && control & ERROR == 0 && wanted >= self.state {
            return self;
        }
        let next = match self.state {
            State::Init => State::PreOp,
            State::PreOp => State::SafeOp,
            State::SafeOp | State::Op => State::Op,
        };
        if wanted > next {
            return refuse(code::INVALID_STEP);
        }
        let up = wanted > self.state;
        match up.then(|| check(wanted)).flatten() {
            Some(code) => refuse(code),
            None => Status {
                state: wanted,
                code: 0,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [State; 4] = [State::Init, State::PreOp, State::SafeOp, State::Op];

    fn at(state: State, code: u16) -> Status {
        Status { state, code }
    }

    #[test]
    fn up_goes_one_step_and_down_goes_any() {
        for (from, state) in ALL.into_iter().enumerate() {
            for (to, wanted) in ALL.into_iter().enumerate() {
                let after = at(state, 0).request(wanted as u16, |_| None);
                if to <= from + 1 {
                    assert_eq!(after, at(wanted, 0), "{state:?} to {wanted:?}");
                } else {
                    assert_eq!(after, at(state, code::INVALID_STEP));
                }
            }
        }
    }

    #[test]
    fn an_error_must_be_acknowledged_before_the_next_step_up() {
        let tripped = at(State::SafeOp, code::WATCHDOG);
        assert_eq!(tripped.register(), 0x14);
        assert_eq!(tripped.request(8, |_| None), tripped);
        assert_eq!(tripped.request(4, |_| None), tripped);
        let acknowledged = tripped.request(0x14, |_| None);
        assert_eq!(acknowledged, at(State::SafeOp, 0));
        assert_eq!(acknowledged.request(8, |_| None), at(State::Op, 0));
        assert_eq!(tripped.request(1, |_| None), at(State::Init, 0));
    }

    #[test]
    fn wrong_registers_are_told_with_their_code() {
        let wrong = |state| (state == State::SafeOp).then_some(code::INPUTS);
        assert_eq!(
            at(State::PreOp, 0).request(4, wrong),
            at(State::PreOp, code::INPUTS)
        );
        assert_eq!(at(State::Op, 0).request(4, wrong), at(State::SafeOp, 0));
    }

    #[test]
    fn states_that_do_not_exist_are_refused() {
        let start = Status::POWER_ON;
        assert_eq!(start.request(3, |_| None).code, code::BOOTSTRAP);
        assert_eq!(start.request(6, |_| None).code, code::UNKNOWN_STATE);
    }
}
