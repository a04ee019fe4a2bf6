//! `rcc-cli` as it was built, run in the repository, without a cell and without colours.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Returns the root of the repository.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Returns the path of an example, below `configs/`.
pub fn config(name: &str) -> String {
    repository()
        .join("configs")
        .join(name)
        .display()
        .to_string()
}

/// Returns `rcc-cli` with these arguments. No cell on this machine has the name that it is given.
pub fn rcc_cli(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rcc-cli"));
    command
        .args(arguments)
        .current_dir(repository())
        .env("RCC_CELL", "no-cell-of-these-tests")
        .env("RCC_CONFIGS", repository().join("configs"))
        .env("NO_COLOR", "1")
        .env_remove("RCC_OUTPUT")
        .env_remove("RCC_URL");
    command
}

/// Runs `rcc-cli`; returns its exit code and what it wrote to both streams.
pub fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    texts(rcc_cli(arguments).output().expect("rcc-cli runs"))
}

/// Returns the exit code, and the texts of both streams.
pub fn texts(output: Output) -> (Option<i32>, String, String) {
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    (
        output.status.code(),
        text(output.stdout),
        text(output.stderr),
    )
}

/// Runs `rcc-cli`, which must end with this exit code; returns what it wrote to both streams.
pub fn run_to(exit: i32, arguments: &[&str]) -> (String, String) {
    let (code, out, errors) = run(arguments);
    assert_eq!(code, Some(exit), "{arguments:?}: {out}{errors}");
    (out, errors)
}
