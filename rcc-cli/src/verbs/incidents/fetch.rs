//! `incidents fetch`: downloads an incident file from the cell's loader, for `replay` on this machine.

use std::io::Write;
use std::path::{Path, PathBuf};

use rcc_api::codes;

use crate::client::segment;
use crate::context::Context;
use crate::failure::Failure;
use crate::result_file::{WrittenFile, create, not_written};

/// Arguments of `incidents fetch`.
#[derive(clap::Args, Debug)]
pub struct FetchArguments {
    /// Name of the file, or its path on the cell's machine, as `incidents` lists it
    file: String,
    /// Write to this file instead of one of that name in the current folder, and say so
    #[arg(short = 'o', long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Downloads the file; a part of one never has its name.
///
/// # Errors
/// Fails if the loader cannot be reached or has no such file, or if it cannot be written here.
pub fn run(context: &Context, arguments: FetchArguments) -> Result<(), Failure> {
    let name = Path::new(&arguments.file).file_name();
    let name = name.map(|name| name.to_string_lossy().into_owned());
    let name = name.ok_or_else(|| {
        let message = format!("`{}` does not name a file", arguments.file);
        Failure::new(
            codes::BAD_REQUEST,
            message,
            "`rcc-cli incidents` lists the files",
        )
    })?;
    let file = arguments.out.unwrap_or_else(|| PathBuf::from(&name));
    let mut partial = file.clone().into_os_string();
    partial.push(".part");
    let partial = PathBuf::from(partial);
    let client = context.client()?;
    let mut out = create(&partial)?;
    let path = format!("/incidents/{}", segment(&name));
    let fetched = client
        .download(&path, &mut out, |error| not_written(&partial, error))
        .and_then(|bytes| {
            out.flush().map_err(|error| not_written(&partial, &error))?;
            std::fs::rename(&partial, &file).map_err(|error| not_written(&file, &error))?;
            Ok(bytes)
        });
    if fetched.is_err() {
        // An incomplete file is useless; the failure is reported in any case.
        let _ = std::fs::remove_file(&partial);
    }
    fetched?;
    context.print(&WrittenFile::of(&file)?, |written| {
        format!(
            "{}; next: rcc-cli replay {}",
            written.describe(),
            file.display()
        )
    });
    Ok(())
}
