//! The classes of requests, each with quotas of its own. Used by the thread that serves connections.

/// The class that a request is counted in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RequestClass {
    /// Any other request.
    Usual,
    /// A CANCEL or ABORT.
    Stop,
    /// A set-point channel, or a stream of values, states and events.
    Stream,
    /// A request without the right token.
    Unauthenticated,
}
