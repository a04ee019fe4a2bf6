//! Locates RCC's programs and configurations. Used by the main thread before it starts anything.

use std::path::{Path, PathBuf};

use rcc_api::codes;

use crate::failure::Failure;

/// Configurations of an installed package.
const INSTALLED: &str = "/usr/share/rcc/configs";

/// Returns the path of a program: a path is taken as it is, a name is searched beside this program and one folder up
/// (where tests find it).
///
/// # Errors
/// Fails if it does not exist.
pub fn program(name: &str) -> Result<PathBuf, Failure> {
    if name.contains('/') {
        return Ok(PathBuf::from(name));
    }
    let here = std::env::current_exe().unwrap_or_default();
    let looked: Vec<PathBuf> = here
        .ancestors()
        .skip(1)
        .take(2)
        .map(|folder| folder.join(name))
        .collect();
    found(&looked).ok_or_else(|| {
        Failure::new(
            codes::PROCESS_FAILED,
            format!("program `{name}` not found at {}", listed(&looked)),
            "build all programs (`cargo build --release`) or install them in one folder",
        )
    })
}

/// Returns the path of a configuration file: below `$RCC_CONFIGS`, or else in the source tree of this program, or else
/// in the installed package.
///
/// # Errors
/// Fails if it does not exist.
pub fn config(relative: &str) -> Result<PathBuf, Failure> {
    let named = std::env::var_os("RCC_CONFIGS").filter(|value| !value.is_empty());
    let looked: Vec<PathBuf> = match named {
        Some(folder) => vec![PathBuf::from(folder).join(relative)],
        None => {
            let here = std::env::current_exe().unwrap_or_default();
            let above = here.ancestors().skip(2).take(3);
            let mut all: Vec<PathBuf> = above
                .map(|folder| folder.join("configs").join(relative))
                .collect();
            all.push(Path::new(INSTALLED).join(relative));
            all
        }
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
