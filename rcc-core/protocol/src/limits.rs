//! Limits of requests to the executor.

/// Maximum number of commands that one [`crate::control::Call::Switch`] stops, and maximum that it starts.
pub const SWITCH_MAX: usize = 8;

/// Maximum number of values in one [`crate::control::Call::Set`].
pub const SET_MAX: usize = 64;
/// Maximum number of elements in one [`crate::control::Call::Set`].
pub const SET_ELEMENTS_MAX: usize = 1024;

/// Maximum number of values in one [`crate::control::Call::Read`].
pub const READ_MAX: usize = 1024;
/// Maximum number of elements in one [`crate::control::Call::Read`].
pub const READ_ELEMENTS_MAX: usize = 1536;
