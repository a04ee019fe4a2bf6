//! The table of codes other than those of the language (RCC1xxx) and the configuration (RCC2xxx): the HTTP status and
//! the exit code of each. Used by the server's threads and by the command line.

use rcc_core::message::EndReason;

/// Exit codes of the command line.
pub mod exit {
    /// Success.
    pub const OK: u8 = 0;
    /// The operation failed, or the net ended with a fault or an abort.
    pub const FAILED: u8 = 1;
    /// Wrong arguments.
    pub const USAGE: u8 = 2;
    /// A net or a configuration is not valid.
    pub const INVALID: u8 = 3;
    /// Loader or executor cannot be reached.
    pub const UNREACHABLE: u8 = 4;
    /// A resource is busy, or the command is in a state that does not allow it.
    pub const CONFLICT: u8 = 5;
    /// No answer within the time limit.
    pub const TIMEOUT: u8 = 6;
    /// Not permitted.
    pub const PERMISSION: u8 = 7;
    /// The net was canceled.
    pub const CANCELED: u8 = 8;
    /// Ended by Ctrl-C, SIGTERM or SIGHUP.
    pub const INTERRUPTED: u8 = 130;
    /// The reader of the output is gone: the code that a shell shows for a program ended by SIGPIPE.
    pub const READER_GONE: u8 = 141;
}

/// Exit codes by the way a net ended, for every verb that waits for its end.
pub const OUTCOMES: [(EndReason, u8); 4] = [
    (EndReason::Finished, exit::OK),
    (EndReason::Canceled, exit::CANCELED),
    (EndReason::Aborted, exit::FAILED),
    (EndReason::Fault, exit::FAILED),
];

/// The end that a caller requested of a net that it waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestedEnd {
    /// Regular end: only `finished` is a success.
    Finish,
    /// End by a CANCEL that is part of a simulated scenario: `canceled` is a success, and so is `finished` if the net
    /// finished first.
    Cancel,
}

/// Returns the exit code for a net that ended for `reason`, as its state names it; without a reason it counts as
/// failed.
#[must_use]
pub fn outcome(asked: RequestedEnd, reason: Option<&str>) -> u8 {
    let row = OUTCOMES.iter().find(|(end, _)| Some(end.name()) == reason);
    match row {
        Some((EndReason::Canceled, _)) if asked == RequestedEnd::Cancel => exit::OK,
        Some((_, code)) => *code,
        None => exit::FAILED,
    }
}

/// One row of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorCode {
    /// The code as shown to users.
    pub code: &'static str,
    /// HTTP status.
    pub status: u16,
    /// Exit code of the command line.
    pub exit: u8,
    /// Meaning, in a short sentence.
    pub title: &'static str,
}

macro_rules! codes {
    ($($name:ident = $code:literal, $status:literal, $exit:ident, $title:literal;)*) => {
        $(#[doc = $title] pub const $name: ErrorCode = ErrorCode { code: $code, status: $status, exit: exit::$exit, title: $title };)*
        /// Every row, sorted by code.
        pub const TABLE: &[ErrorCode] = &[$($name),*];
    };
}

codes! {
    UNKNOWN_COMMAND = "RCC3001", 404, FAILED, "The command does not exist.";
    TABLE_FULL = "RCC3002", 409, CONFLICT, "The executor's command table is full.";
    WRONG_STATE = "RCC3003", 409, CONFLICT, "The command's state does not allow it.";
    BUSY = "RCC3004", 409, CONFLICT, "Another command holds a resource.";
    NOT_CANCELABLE = "RCC3007", 409, CONFLICT, "The net has no Cancel primitive.";
    DEVICE_NOT_READY = "RCC3008", 409, CONFLICT, "A device cannot be commanded now.";
    FIRST_SET_POINT = "RCC3011", 409, CONFLICT, "The first set-point is not where the device is held.";
    FIRST_CYCLE = "RCC3012", 409, CONFLICT, "The first cycle ended with a fault.";
    PLAN_REFUSED = "RCC3013", 422, INVALID, "The executor refused the plan.";
    NOT_PREPARED = "RCC3014", 409, CONFLICT, "The start values could not be computed.";
    OVERLOADED = "RCC3015", 503, CONFLICT, "The executor is overloaded.";
    STOPPING = "RCC3016", 503, UNREACHABLE, "The executor is stopping.";
    LOADER_DIED = "RCC3017", 409, FAILED, "The loader died while it loaded the command.";
    DISCONTINUOUS = "RCC3018", 409, CONFLICT, "The first set-point does not continue the motion.";
    LETS_GO = "RCC3019", 409, CONFLICT, "A hand-over would release an arm.";
    NAMED_TWICE = "RCC3020", 400, USAGE, "A hand-over names a command twice, or too many.";
    NOT_TOGETHER = "RCC3021", 409, CONFLICT, "Nets of a hand-over have no common cycle.";
    OVER_BUDGET = "RCC3022", 409, CONFLICT, "The nets would exceed the cell's time budget of a cycle.";
    FORESEEN = "RCC3023", 409, CONFLICT, "The net would violate a limit of an arm.";
    OTHER_TOPIC = "RCC3024", 409, CONFLICT, "Two nets use different types for a topic.";
    NO_RECORDER = "RCC3030", 409, CONFLICT, "The flight recorder is switched off.";
    INPUT_REFUSED = "RCC3040", 422, INVALID, "A value cannot be set.";
    UNKNOWN_PORT = "RCC3041", 404, FAILED, "The net has no such port.";
    TOO_MANY_PORTS = "RCC3042", 409, CONFLICT, "More ports or watchers than the executor can serve.";
    RULE_REFUSED = "RCC3050", 409, CONFLICT, "A rule cannot be installed.";
    BAD_CONDITION = "RCC3051", 422, INVALID, "A condition of a rule is not valid.";
    UNKNOWN_RULE = "RCC3052", 404, FAILED, "The rule does not exist.";
    UNKNOWN_LEASE = "RCC3053", 404, FAILED, "The lease does not exist, or has expired.";
    LEASE_REFUSED = "RCC3054", 409, CONFLICT, "A lease cannot be granted.";
    NO_EXECUTOR = "RCC4001", 503, UNREACHABLE, "The executor cannot be reached.";
    EXECUTOR_SILENT = "RCC4002", 504, TIMEOUT, "The executor did not answer in time.";
    OTHER_BUILD = "RCC4003", 502, UNREACHABLE, "Loader and executor are of different builds.";
    NO_LOADER = "RCC4004", 503, UNREACHABLE, "The loader cannot be reached.";
    LOADER_SILENT = "RCC4005", 504, TIMEOUT, "The loader did not answer in time.";
    TOO_LARGE = "RCC4006", 413, USAGE, "The text is too large.";
    NO_ROUTE = "RCC4007", 404, USAGE, "The address does not exist.";
    NOT_STORED = "RCC4008", 500, FAILED, "A file could not be written.";
    NOT_PERMITTED = "RCC4009", 403, PERMISSION, "Not permitted.";
    TOO_MANY = "RCC4010", 429, CONFLICT, "Too many concurrent requests.";
    BAD_REQUEST = "RCC4011", 400, USAGE, "The request is malformed.";
    CELL_LIVES = "RCC4012", 409, CONFLICT, "The cell is in use.";
    PROCESS_FAILED = "RCC4013", 500, FAILED, "A process of the cell failed.";
    NO_SPACE = "RCC4014", 507, FAILED, "There is not enough shared memory.";
    NO_TOKEN = "RCC4015", 401, PERMISSION, "The token is missing or wrong.";
    HEAD_TOO_LARGE = "RCC4016", 431, USAGE, "The head of the request is too large.";
    TOO_SLOW = "RCC4017", 408, TIMEOUT, "The request arrived too slowly.";
    NO_METHOD = "RCC4018", 405, USAGE, "The address does not take this method.";
    OTHER_CONFIGURATION = "RCC4020", 409, CONFLICT, "Processes were started with different configurations.";
    NOT_KEPT = "RCC4021", 507, FAILED, "The loader's storage limit is reached.";
    GIVEN_UP = "RCC4022", 504, TIMEOUT, "The client stopped waiting.";
    UNKNOWN_INCIDENT = "RCC4029", 404, FAILED, "The incident file does not exist.";
    NO_INCIDENT = "RCC4030", 422, INVALID, "The file is not an incident that this build can replay.";
    REPLAY_DIFFERS = "RCC4031", 500, FAILED, "A replay differs from what was recorded.";
    NOT_COMPARED = "RCC4032", 422, FAILED, "The incident contains nothing that can be compared.";
}

/// HTTP status for an invalid text.
pub const INVALID_STATUS: u16 = 422;

/// Returns the exit code for a code, including those of the language and the configuration.
#[must_use]
pub fn exit_code(code: &str) -> u8 {
    match TABLE.iter().find(|row| row.code == code) {
        Some(row) => row.exit,
        None if code.starts_with("RCC1") || code.starts_with("RCC2") => exit::INVALID,
        None => exit::FAILED,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_sorted_and_every_row_is_a_sentence() {
        assert!(TABLE.windows(2).all(|pair| pair[0].code < pair[1].code));
        assert!(
            TABLE
                .iter()
                .all(|row| row.title.ends_with('.') && row.code.len() == 7)
        );
    }

    #[test]
    fn every_code_has_an_error_status_and_an_exit_code() {
        for row in TABLE {
            assert!((400..600).contains(&row.status), "{}", row.code);
            assert!(row.exit != exit::OK, "{}", row.code);
            assert_eq!(exit_code(row.code), row.exit);
        }
    }

    #[test]
    fn only_a_net_that_finished_is_a_success_unless_its_cancel_was_asked_for() {
        for (reason, finish, cancel) in [
            (Some("finished"), 0, 0),
            (Some("canceled"), 8, 0),
            (Some("aborted"), 1, 1),
            (Some("fault"), 1, 1),
            (Some("none"), 1, 1),
            (Some("another"), 1, 1),
            (None, 1, 1),
        ] {
            assert_eq!(outcome(RequestedEnd::Finish, reason), finish, "{reason:?}");
            assert_eq!(outcome(RequestedEnd::Cancel, reason), cancel, "{reason:?}");
        }
        let ends = EndReason::ALL.iter().map(|(end, _)| *end);
        let mut ends = ends.filter(|end| *end != EndReason::None);
        assert_eq!(ends.clone().count(), OUTCOMES.len());
        assert!(ends.all(|end| OUTCOMES.iter().any(|(row, _)| *row == end)));
    }

    #[test]
    fn codes_of_texts_mean_an_invalid_text() {
        assert_eq!(exit_code("RCC1203"), exit::INVALID);
        assert_eq!(exit_code("RCC2001"), exit::INVALID);
        assert_eq!(exit_code("RCC9999"), exit::FAILED);
    }
}
