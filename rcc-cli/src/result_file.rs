//! Files that a verb writes its result to. Run by the main thread.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use rcc_api::codes;
use serde::Serialize;

use crate::context::Context;
use crate::failure::Failure;
use crate::output::print_file;
use crate::plot::{Plot, PlotError};
use crate::table::grouped;

/// The option `-o` of every verb whose result is a text.
#[derive(clap::Args, Debug)]
pub struct ResultTarget {
    /// Write to this file instead of standard output, and say so; - is standard output
    #[arg(short = 'o', long = "out", aliases = ["into", "file"], value_name = "FILE")]
    out: Option<PathBuf>,
}

impl ResultTarget {
    /// Returns the file; `None` for standard output.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        self.out.as_deref().filter(|path| *path != Path::new("-"))
    }

    /// Writes the result to the file and reports it, or prints it.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn write(&self, context: &Context, text: &str) -> Result<(), Failure> {
        match self.path() {
            None => print_file(text),
            Some(path) => {
                std::fs::write(path, text).map_err(|error| not_written(path, &error))?;
                context.print(&WrittenFile::of(path)?, WrittenFile::describe);
            }
        }
        Ok(())
    }
}

/// A file that a verb has written.
#[derive(Clone, Debug, Serialize)]
pub struct WrittenFile {
    file: String,
    bytes: u64,
}

impl WrittenFile {
    /// Looks at a file that has just been written.
    ///
    /// # Errors
    /// Fails if it is gone.
    pub fn of(path: &Path) -> Result<WrittenFile, Failure> {
        let about = std::fs::metadata(path).map_err(|error| not_written(path, &error))?;
        Ok(WrittenFile {
            file: path.display().to_string(),
            bytes: about.len(),
        })
    }

    /// Formats it for people.
    #[must_use]
    pub fn describe(&self) -> String {
        format!("wrote {} ({} bytes)", self.file, grouped(self.bytes))
    }
}

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

fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    let mut file = create(path)?;
    let written = file.write_all(text.as_bytes()).and_then(|()| file.flush());
    written.map_err(|error| not_written(path, &error))
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
        Some("svg") => write_text(path, &picture.svg()),
        Some("html") => write_text(path, &picture.html()),
        _ => {
            let message = format!("unsupported plot format: {}", path.display());
            Err(Failure::new(
                codes::BAD_REQUEST,
                message,
                "use a file name that ends in .svg, .html or .png",
            ))
        }
    }
}
