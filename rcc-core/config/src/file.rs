//! A configuration file: its text and its diagnostics. Read at start-up by programs that read a configuration; nothing
//! here is real-time.

use std::io::{self, Read};
use std::path::Path;

use crate::codes;
use crate::diagnostic::{Diagnostic, Faults, Severity, Span};
use crate::reader::ConfigReader;
use crate::yaml::{self, Node};

/// A text with its file name.
pub(crate) struct SourceFile {
    pub name: String,
    pub text: String,
}

impl SourceFile {
    /// Returns the diagnostics as an error if one of them is an error.
    pub fn faults(&self, reader: ConfigReader) -> Result<(), Faults> {
        let refused = reader
            .faults
            .iter()
            .any(|fault| fault.severity == Severity::Error);
        if refused {
            Err(Faults::new(&*self.name, &*self.text, reader.faults))
        } else {
            Ok(())
        }
    }
}

/// Reads a file.
pub(crate) fn read(path: &Path) -> Result<SourceFile, Faults> {
    let name = path.display().to_string();
    match text(path) {
        Ok(text) => Ok(SourceFile { name, text }),
        Err(cause) => Err(Faults::new(name, "", vec![unreadable(path, &cause)])),
    }
}

/// Parses a text; returns its tree and a reader that holds the faults from which the parser could recover (duplicate
/// keys).
pub(crate) fn tree(file: &SourceFile) -> Result<(Node, ConfigReader), Faults> {
    match yaml::read(&file.text) {
        (Some(root), faults) => Ok((root, ConfigReader { faults })),
        (None, faults) => Err(Faults::new(&*file.name, &*file.text, faults)),
    }
}

/// Reads at most one byte more than the parser accepts, which then reports that the text is too long. Every process of
/// a cell reads the configuration again, so it must be a regular file; reading a pipe would block.
pub(crate) fn text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    let most = yaml::BYTES_MAX as u64 + 1;
    rcc_os::file::open(path)?
        .take(most)
        .read_to_string(&mut text)?;
    Ok(text)
}

/// Returns the diagnostic for a file that cannot be read, without a position.
pub(crate) fn unreadable(path: &Path, cause: &io::Error) -> Diagnostic {
    let message = format!("{} cannot be read: {cause}", path.display());
    let help = match cause.kind() {
        io::ErrorKind::NotFound => "check the path; in a cell's file it is relative to that file",
        io::ErrorKind::PermissionDenied => "check its permissions",
        io::ErrorKind::InvalidData => "save it as UTF-8 text",
        io::ErrorKind::InvalidInput => "name a regular file",
        _ => "check the file",
    };
    let fault = Diagnostic::error(codes::UNREADABLE.code, Span::default(), message);
    fault.anywhere().help(help)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn a_special_file_is_refused_with_a_remedy_and_not_waited_for() -> io::Result<()> {
        let folder = rcc_testing::folder();
        let pipe = folder.path().join("pipe");
        let made = Command::new("mkfifo").arg(&pipe).status()?;
        assert!(made.success());
        for (path, kind) in [
            (pipe.as_path(), "a named pipe"),
            (Path::new("/dev/zero"), "a device"),
            (folder.path(), "a folder"),
        ] {
            let words = read(path).err().map(|faults| faults.to_string());
            let words = words.unwrap_or_default();
            assert!(words.contains("RCC2001") && words.contains(kind), "{words}");
            assert!(words.contains("name a regular file"), "{words}");
        }
        Ok(())
    }
}
