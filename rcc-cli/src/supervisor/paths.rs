//! Locates RCC's programs and configurations. Used by the main thread before it starts anything.

use std::path::{Path, PathBuf};

use rcc_api::codes;
use rcc_config::{DeviceConfig, DriverConfig, OwnProgram};

use crate::failure::Failure;

/// The configurations of an installation, below its prefix (`packaging/install`, the Debian package).
const INSTALLED: &str = "share/rcc";

/// Returns the path of a program: a path is taken as it is, a name is searched beside this program and one folder up
/// (where tests find it).
///
/// # Errors
/// Fails if it does not exist.
pub fn program(name: &str) -> Result<PathBuf, Failure> {
    if name.contains('/') {
        return Ok(PathBuf::from(name));
    }
    beside(
        name,
        "build all programs (`cargo build --release`) or install them in one folder",
    )
}

/// Searches a program beside this one and one folder up; the error has this remedy.
///
/// # Errors
/// Fails if it does not exist.
pub fn beside(name: &str, remedy: &str) -> Result<PathBuf, Failure> {
    let here = std::env::current_exe().unwrap_or_default();
    let looked: Vec<PathBuf> = here
        .ancestors()
        .skip(1)
        .take(2)
        .map(|folder| folder.join(name))
        .collect();
    found(&looked).ok_or_else(|| {
        let message = format!("program `{name}` not found at {}", listed(&looked));
        Failure::new(codes::PROCESS_FAILED, message, remedy)
    })
}

/// Returns the path of the program that drives a device.
///
/// # Errors
/// Fails if it does not exist.
pub fn driver(device: &DeviceConfig) -> Result<PathBuf, Failure> {
    let own = match (&device.driver, device.driver.own_program()) {
        (DriverConfig::Program(own), _) => own,
        (DriverConfig::Name(_), None) => return program("rcc-driver"),
        (DriverConfig::Name(_), Some(own)) => return beside(own.program, &build(own)),
    };
    match own.path(&device.folder) {
        None => program(&own.program),
        Some(path) if path.is_file() => Ok(path),
        Some(path) => Err(Failure::new(
            codes::PROCESS_FAILED,
            format!("the driver's program is not there: {}", path.display()),
            "build it, or correct `driver: {program: …}`; a path is relative to the cell's file",
        )),
    }
}

/// How a program outside of the default build is built.
#[must_use]
pub fn build(own: &OwnProgram) -> String {
    format!(
        "the driver `{}` is outside of the default build: `cargo build --release -p {}`, then copy the program into this folder, if it is another one",
        own.driver, own.package
    )
}

/// Returns the path of a configuration file: below `$RCC_CONFIGS`, or else in the source tree of this program, or else
/// where this program is installed.
///
/// # Errors
/// Fails if it does not exist.
pub fn config(relative: &str) -> Result<PathBuf, Failure> {
    let named = std::env::var_os("RCC_CONFIGS").filter(|value| !value.is_empty());
    let looked: Vec<PathBuf> = match named {
        Some(folder) => vec![PathBuf::from(folder).join(relative)],
        None => candidates(&std::env::current_exe().unwrap_or_default(), relative),
    };
    found(&looked).ok_or_else(|| {
        Failure::new(
            codes::BAD_REQUEST,
            format!(
                "configuration `{relative}` not found at {}",
                listed(&looked)
            ),
            "set RCC_CONFIGS to RCC's `configs` folder",
        )
    })
}

/// The places of a configuration file for a program: `PREFIX/bin/rcc-cli` is installed, `target/release/rcc-cli` is in the
/// source tree.
fn candidates(program: &Path, relative: &str) -> Vec<PathBuf> {
    let above = || program.ancestors().skip(2);
    let sources = above().take(3).map(|folder| folder.join("configs"));
    let installed = above().take(1).map(|prefix| prefix.join(INSTALLED));
    let folders = sources.chain(installed);
    folders.map(|folder| folder.join(relative)).collect()
}

fn found(looked: &[PathBuf]) -> Option<PathBuf> {
    looked.iter().find(|path| path.is_file()).cloned()
}

fn listed(paths: &[PathBuf]) -> String {
    let texts: Vec<String> = paths
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    texts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_installed_program_finds_what_was_installed_with_it() {
        let prefix = rcc_testing::folder();
        let cells = prefix.path().join("share/rcc/cells");
        std::fs::create_dir_all(&cells).unwrap();
        std::fs::write(cells.join("demo.yaml"), "cell: demo\n").unwrap();
        let program = prefix.path().join("bin/rcc-cli");
        let looked = candidates(&program, "cells/demo.yaml");
        assert_eq!(found(&looked), Some(cells.join("demo.yaml")));
        assert_eq!(found(&candidates(&program, "cells/none.yaml")), None);
    }

    #[test]
    fn a_program_of_the_source_tree_finds_the_sources() {
        for profile in ["target/debug", "target/debug/deps", "target/release"] {
            let program = Path::new("/rcc").join(profile).join("rcc-cli");
            let looked = candidates(&program, "cells/demo.yaml");
            let sources = PathBuf::from("/rcc/configs/cells/demo.yaml");
            assert!(looked.contains(&sources), "{looked:?}");
        }
    }
}
