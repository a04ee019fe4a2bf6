//! The workspace's programs, built once per test binary in the profile of the tests.
//! Run by the threads of the test harness.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The repository's root.
pub fn repository() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// The path of a program of the workspace. `cargo test` does not build other packages' programs, so this does, unless
/// `RCC_PROGRAMS` names a folder in which they are installed.
pub fn program(name: &str) -> PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(build).join(name)
}

fn build() -> PathBuf {
    if let Some(folder) = std::env::var_os("RCC_PROGRAMS").filter(|folder| !folder.is_empty()) {
        return folder.into();
    }
    let this = std::env::current_exe().expect("a program has a path");
    // A test lies in target/PROFILE/deps, an example in target/PROFILE/examples, a program in target/PROFILE.
    let folder = this.parent().expect("a program is in a folder");
    let folder = match folder.parent() {
        Some(profile) if folder.ends_with("deps") || folder.ends_with("examples") => {
            profile.to_owned()
        }
        _ => folder.to_owned(),
    };
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .args(["build", "--quiet", "--workspace", "--bins"])
        .current_dir(repository());
    // `cargo test` tells a test its package. Build scripts of others (ring) run again when these change, and all that needs
    // them is built again.
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy();
        if name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_") {
            cargo.env_remove(&*name);
        }
    }
    // Its name is that of the profile, except that `dev` is built in `debug`.
    let profile = folder.file_name().expect("the folder of a profile");
    if profile != "debug" {
        cargo.arg("--profile").arg(profile);
    }
    let status = cargo.status().expect("cargo runs");
    assert!(status.success(), "the programs do not build");
    folder
}
