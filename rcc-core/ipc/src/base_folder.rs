//! The folder in which this user's cells are, unless they are told otherwise. Runs on any thread that is not real-time.

use std::path::PathBuf;

/// Returns the default base folder, in which each cell has its own; see [`Cell::new`](crate::Cell::new). It need not exist.
#[must_use]
pub fn base_dir() -> PathBuf {
    let variable = |name| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let uid = nix::unistd::getuid();
    if let Some(base) = variable("RCC_RUNTIME_DIR") {
        base
    } else if uid.is_root() {
        PathBuf::from("/run/rcc")
    } else if let Some(session) = variable("XDG_RUNTIME_DIR") {
        session.join("rcc")
    } else {
        PathBuf::from(format!("/tmp/rcc-{uid}"))
    }
}
