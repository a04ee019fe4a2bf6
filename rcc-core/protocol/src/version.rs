//! The version that every program prints: of the package, its commit, and what must agree between the programs of a cell.
//! Made once, by the main thread.

use std::sync::LazyLock;

use rcc_core::primitives;

use crate::build::Build;

/// Version, commit (`development` in builds without a release profile, `unknown` without git), fingerprint of the catalogue
/// of primitives, fingerprint of the layout of shared memory.
///
/// `0.1.0 (commit 0123456789ab, catalogue 0123456789abcdef, layout 0123456789abcdef)`
#[must_use]
pub fn version() -> &'static str {
    static VERSION: LazyLock<String> = LazyLock::new(|| {
        let Build { version, layout } = Build::own();
        let commit = env!("RCC_COMMIT");
        let catalogue = primitives::fingerprint();
        format!("{version} (commit {commit}, catalogue {catalogue:016x}, layout {layout:016x})")
    });
    &VERSION
}
