//! Numbers that say why a device is not ready or has stopped.
//! One table for the host; a driver's announcement carries the host's and its own rows.

/// A reason number and its meaning.
pub type Reason = (u32, &'static str);

macro_rules! reasons {
    ($($name:ident = $number:literal, $text:literal;)*) => {
        $(#[doc = $text] pub const $name: u32 = $number;)*
        /// The host's reasons; a driver's start at 100.
        pub const HOST_REASONS: &[Reason] = &[$(($number, $text)),*];
    };
}

reasons! {
    NO_EXECUTOR = 1, "no executor commands this device, or its board is stale";
    SILENT = 2, "the device sends nothing";
    DEVICE_STOPPED = 3, "the device left command mode while a net commanded it";
    NOT_STARTABLE = 4, "a net started commanding the device while it was not startable";
    FIRST_SET_POINT = 5, "the first set-point of the net is not at the hold position of the device";
    LIMIT = 6, "a set-point violates a limit of the robot";
    STARVED = 7, "no more set-points arrived while the device moved";
    RELEASED_MOVING = 8, "the net stopped commanding the device while it moved";
    STALE = 9, "the executor stopped writing while the device was commanded";
    EXECUTOR_CHANGED = 10, "another executor took over while the device was commanded";
    SET_POINTS_LOST = 11, "the device fell behind the set-points by more than command_timeout";
    TERMINATING = 12, "the driver has been asked to stop";
    ALREADY_COMMANDED = 13, "a net was already commanding the device when the driver started";
    ANALOG_RANGE = 14, "an analog output was commanded outside its range and has been released";
    STRATEGY = 15, "the net commands another control strategy than the device runs";
    OTHER_CONFIGURATION = 16, "the executor is of another build, or was started with another configuration of this device: restart the cell";
    PERIOD_CHANGED = 17, "the device changed its period while a net commanded it";
    IMPOSSIBLE = 18, "the driver returned a value that no device can have: its log has the value";
}

/// Returns the meaning of a number among the host's reasons and those of `drivers`.
#[must_use]
pub fn meaning(number: u32, drivers: &[Reason]) -> &'static str {
    HOST_REASONS
        .iter()
        .chain(drivers)
        .find(|row| row.0 == number)
        .map_or("unknown reason", |row| row.1)
}

/// Returns the note of a driver's announcement: one line `NUMBER TEXT` per reason.
#[must_use]
pub fn note(drivers: &[Reason]) -> String {
    HOST_REASONS
        .iter()
        .chain(drivers)
        .map(|(number, text)| format!("{number} {text}\n"))
        .collect()
}
