//! Shared by tests and benchmarks of several packages: arms, random numbers, temporary folders, network
//! namespaces, quantiles, and the growth of work with the size of an input. Any thread.

pub mod arms;
pub mod formulas;
pub mod http;
pub mod namespace;
mod quantile;
pub mod random;
pub mod work;

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;

pub use quantile::quantile;
pub use random::{Random, Rng};
pub use tempfile::TempDir;

/// Returns a new folder of mode 0700, removed when dropped. Its path is short, because the path of a Unix socket is
/// limited to 107 bytes.
///
/// # Panics
/// Panics if the temporary folder of the system cannot be written to.
#[must_use]
pub fn folder() -> TempDir {
    tempfile::Builder::new()
        .prefix("rcc-")
        .permissions(Permissions::from_mode(0o700))
        .tempdir()
        .expect("a temporary folder")
}
