//! Why a device whose driver is written in C is not ready, as far as this package finds it. Read by every thread.

use rcc_driver_kit::host::reason::Reason;

/// A function returned an error.
pub const FAILED: u32 = 100;
/// A function gave a value that cannot be passed on.
pub const INVALID: u32 = 101;
/// Numbers up to this one belong to this package.
pub const OWN_REASON_MAX: u32 = 199;
/// Meaning of this package's reason numbers; a driver's begin at 200.
pub const OWN_REASONS: &[Reason] = &[
    (
        FAILED,
        "the driver's C code reports an error: the driver's log and `rcc-cli doctor device` have its words",
    ),
    (
        INVALID,
        "the driver's C code gave a value that is not finite or out of range, which was not passed on: the driver's log and \
         `rcc-cli doctor device` name it",
    ),
];
