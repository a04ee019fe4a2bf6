//! Limits, headers and path patterns of the REST routes, shared by server and clients. Pure functions.

/// Maximum size of a net's text, bytes.
pub const TEXT_MAX: usize = 4 << 20;

/// The request header that gives the time for which the client waits, ms.
pub const TIMEOUT_HEADER: &str = "rcc-timeout-ms";

/// Returns true for the paths of CANCEL and ABORT.
#[must_use]
pub fn is_stop(path: &str) -> bool {
    let path = path.split('?').next().unwrap_or_default();
    let name = path
        .strip_prefix("/commands/")
        .and_then(|rest| rest.split_once('/'));
    name.is_some_and(|(_, what)| matches!(what, "cancel" | "abort"))
}
