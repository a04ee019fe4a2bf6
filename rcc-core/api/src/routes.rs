//! Limits, headers and path patterns of the REST routes, shared by server and clients. Pure functions.

/// Maximum size of a net's text, bytes.
pub const TEXT_MAX: usize = 4 << 20;

/// The request header that gives the time for which the client waits, ms.
pub const TIMEOUT_HEADER: &str = "rcc-timeout-ms";

/// Returns true for requests whose body or answer lasts as long as the client wishes: a set-point channel, and a stream
/// of values, states and events.
#[must_use]
pub fn is_stream(method: &str, path: &str) -> bool {
    let path = path.split('?').next().unwrap_or_default();
    let inputs = path
        .strip_prefix("/commands/")
        .and_then(|rest| rest.split_once('/'));
    match method {
        "GET" => path == "/stream",
        "POST" => inputs.is_some_and(|(_, what)| what == "inputs/stream"),
        _ => false,
    }
}

/// Returns true for the paths of CANCEL and ABORT.
#[must_use]
pub fn is_stop(path: &str) -> bool {
    let path = path.split('?').next().unwrap_or_default();
    let name = path
        .strip_prefix("/commands/")
        .and_then(|rest| rest.split_once('/'));
    name.is_some_and(|(_, what)| matches!(what, "cancel" | "abort"))
}
