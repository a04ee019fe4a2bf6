//! Files that a verb writes its result to. Run by the main thread.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use rcc_api::codes;

use crate::failure::Failure;
use crate::plot::{Plot, PlotError};

/// Creates a file, or empties an existing one.
///
/// # Errors
/// Fails if the system refuses it.
pub fn create(path: &Path) -> Result<BufWriter<File>, Failure> {
    let file = File::create(path).map_err(|error| not_written(path, &error))?;
    Ok(BufWriter::new(file))
}

/// Returns the failure of a file that cannot be written.
#[must_use]
pub fn not_written(path: &Path, error: &io::Error) -> Failure {
    let message = format!("cannot write {}: {error}", path.display());
    Failure::new(codes::NOT_STORED, message, "name another file")
}

/// Writes a plot in the format given by the file's extension.
///
/// # Errors
/// Fails if the extension is unknown, or if the plot cannot be drawn or written.
pub fn write_plot(path: &Path, picture: &Plot) -> Result<(), Failure> {
    let name = path.extension().and_then(|extension| extension.to_str());
    let failed = |error: PlotError| {
        let message = format!("{}: {error}", path.display());
        Failure::new(
            codes::PROCESS_FAILED,
            message,
            "check the free disk space; otherwise report it as a bug",
        )
    };
    match name {
        Some("png") => picture.png(create(path)?).map_err(failed),
        Some("svg") => {
            let svg = picture.svg().map_err(failed)?;
            let written = create(path)?.write_all(svg.as_bytes());
            written.map_err(|error| not_written(path, &error))
        }
        _ => {
            let message = format!("unsupported plot format: {}", path.display());
            Err(Failure::new(
                codes::BAD_REQUEST,
                message,
                "use a file name that ends in .svg or .png",
            ))
        }
    }
}
