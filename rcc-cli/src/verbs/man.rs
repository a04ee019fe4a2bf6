//! `man DIR`: writes the manual pages of `rcc-cli` and of each of its verbs.

use std::fs;
use std::path::PathBuf;

use rcc_api::codes;

use crate::context::Context;
use crate::failure::Failure;
use crate::output::print_line;

/// Arguments of `man`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Folder, created if it does not exist; `man` searches /usr/local/share/man/man1
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Runs the verb.
///
/// # Errors
/// Fails if a file cannot be written.
pub fn run(_: &Context, arguments: Arguments) -> Result<(), Failure> {
    let folder = arguments.folder;
    let refused = |error: std::io::Error| {
        Failure::new(
            codes::PROCESS_FAILED,
            format!("cannot write manual pages to {}: {error}", folder.display()),
            "name a folder that you may write to",
        )
    };
    fs::create_dir_all(&folder).map_err(refused)?;
    clap_mangen::generate_to(crate::arguments::command(), &folder).map_err(refused)?;
    print_line(&format!(
        "manual pages of rcc-cli written to {}",
        folder.display()
    ));
    Ok(())
}
