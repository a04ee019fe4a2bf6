//! A file of a configuration: its text, and where its faults go.
//! Read at start-up by whoever reads a configuration; nothing here is real-time.

use std::io::{self, Read};
use std::path::Path;

use crate::codes;
use crate::diagnostic::{Diagnostic, Faults, Severity, Span};
use crate::reader::ConfigReader;
use crate::yaml::{self, Node};

/// A text with the name that people know it by.
pub(crate) struct SourceFile {
    pub name: String,
    pub text: String,
}

impl SourceFile {
    /// Nothing if there are no faults.
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

/// The text of a file.
pub(crate) fn read(path: &Path) -> Result<SourceFile, Faults> {
    let name = path.display().to_string();
    match text(path) {
        Ok(text) => Ok(SourceFile { name, text }),
        Err(cause) => Err(Faults::new(name, "", vec![unreadable(path, &cause)])),
    }
}

/// The tree of a text, and a reader that knows what the parser has found and could go on from (duplicate keys).
pub(crate) fn tree(file: &SourceFile) -> Result<(Node, ConfigReader), Faults> {
    match yaml::read(&file.text) {
        (Some(root), faults) => Ok((root, ConfigReader { faults })),
        (None, faults) => Err(Faults::new(&*file.name, &*file.text, faults)),
    }
}

/// At most one byte more than the parser takes: it then says that it is too much. A configuration is read again by every
/// process of its cell, so it is a regular file; a pipe would be waited for.
pub(crate) fn text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    let most = yaml::BYTES_MAX as u64 + 1;
    rcc_os::file::open(path)?
        .take(most)
        .read_to_string(&mut text)?;
    Ok(text)
}

/// A file that cannot be read; it has no place yet.
pub(crate) fn unreadable(path: &Path, cause: &io::Error) -> Diagnostic {
    let message = format!("{} cannot be read: {cause}", path.display());
    let help = match cause.kind() {
        io::ErrorKind::NotFound => "look at the path; in a cell's file it is relative to that file",
        io::ErrorKind::PermissionDenied => "look at its permissions",
        io::ErrorKind::InvalidData => "save it as UTF-8 text",
        io::ErrorKind::InvalidInput => "name a regular file",
        _ => "look at the file",
    };
    let fault = Diagnostic::error(codes::UNREADABLE.code, Span::default(), message);
    fault.anywhere().help(help)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn what_is_no_regular_file_is_refused_with_words_and_not_waited_for() -> io::Result<()> {
        let pipe = std::env::temp_dir().join(format!("rcc-config-pipe-{}", std::process::id()));
        let made = Command::new("mkfifo").arg(&pipe).status()?;
        assert!(made.success());
        let folder = std::env::temp_dir();
        for (path, kind) in [
            (pipe.as_path(), "a named pipe"),
            (Path::new("/dev/zero"), "a device"),
            (&folder, "a folder"),
        ] {
            let words = read(path).err().map(|faults| faults.to_string());
            let words = words.unwrap_or_default();
            assert!(words.contains("RCC2001") && words.contains(kind), "{words}");
            assert!(words.contains("name a regular file"), "{words}");
        }
        std::fs::remove_file(pipe)
    }
}
