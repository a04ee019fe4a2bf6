//! The library pass, paths of libraries → fragments: each file is read once however often it is named. The caller of the
//! compiler provides the [`LibrarySource`]; a text received without files has none. Runs on the loader's threads and in
//! the command line.

use std::collections::{HashSet, VecDeque};
use std::io::{self, Read as _};
use std::path::Path;

use rcc_config::diagnostic::{Diagnostic, Faults, Severity, Span};
use rcc_config::yaml::{self, Key};

use crate::codes;
use crate::parse::read_library;
use crate::source_map::SourceMap;
use crate::syntax::fragment::{Fragment, Library};

/// Most libraries of a net.
pub const LIBRARIES_MAX: usize = 64;
/// Most bytes of all libraries of a net together.
pub const BYTES_MAX: usize = 4 * yaml::BYTES_MAX;

/// Provides the texts of libraries.
pub trait LibrarySource {
    /// Returns the text of a library. `path` is the path that the net names, resolved against the folder of the file
    /// that names it: in the net `nets/line.yaml`, `use: [library/filters.yaml]` reads `nets/library/filters.yaml`.
    ///
    /// # Errors
    /// Returns the reason if the library cannot be read.
    fn read(&self, path: &str) -> Result<String, LibraryError>;
}

/// Reason why a library cannot be read.
#[derive(Debug)]
pub enum LibraryError {
    /// The text was received without files.
    NoLibraries,
    /// The system call failed.
    Io(io::Error),
}

/// Reads libraries from files; paths are relative to the working folder, like the name of the net's file.
#[derive(Clone, Copy, Debug)]
pub struct FileLibraries;

/// Has no libraries.
#[derive(Clone, Copy, Debug)]
pub struct NoLibraries;

impl LibrarySource for FileLibraries {
    fn read(&self, path: &str) -> Result<String, LibraryError> {
        let file = rcc_os::file::open(Path::new(path)).map_err(LibraryError::Io)?;
        let mut text = String::new();
        // One byte more than allowed suffices to detect a file that is too long.
        let mut file = file.take(yaml::BYTES_MAX as u64 + 1);
        file.read_to_string(&mut text).map_err(LibraryError::Io)?;
        Ok(text)
    }
}

impl LibrarySource for NoLibraries {
    fn read(&self, _path: &str) -> Result<String, LibraryError> {
        Err(LibraryError::NoLibraries)
    }
}

/// Libraries by path.
impl LibrarySource for std::collections::BTreeMap<String, String> {
    fn read(&self, path: &str) -> Result<String, LibraryError> {
        let text = self.get(path).cloned();
        text.ok_or_else(|| LibraryError::Io(io::Error::from(io::ErrorKind::NotFound)))
    }
}

/// Reads all libraries that a net uses, directly or through other libraries, and returns their fragments in the order
/// of the files. `file` is the name of the net's own file.
pub fn read_libraries(
    uses: &[Key],
    file: &str,
    libraries: &dyn LibrarySource,
    sources: &mut SourceMap,
    diagnostics: &mut Vec<Diagnostic>,
) -> Vec<Fragment> {
    let mut fragments = Vec::new();
    let mut known = HashSet::from([resolve_path("", file)]);
    let mut bytes = 0;
    let mut queue: VecDeque<(Key, String)> = uses
        .iter()
        .map(|key| (key.clone(), file.to_owned()))
        .collect();
    while let Some((key, user)) = queue.pop_front() {
        let path = resolve_path(&user, &key.name);
        if !known.insert(path.clone()) {
            continue;
        }
        let text = match read_one(&key, &path, libraries, known.len(), &mut bytes) {
            Ok(text) => text,
            Err(diagnostic) => {
                diagnostics.push(*diagnostic);
                continue;
            }
        };
        let (root, mut found) = yaml::read(&text);
        let shift = sources.add(&path, text);
        for diagnostic in &mut found {
            diagnostic.place = diagnostic.place.map(|span| shift.span(span));
            diagnostic.file = sources.file_of(shift.span(Span::default()));
        }
        diagnostics.append(&mut found);
        let library = root.and_then(|mut root| {
            shift.node(&mut root);
            read_library(&root, diagnostics)
        });
        if let Some(library) = library {
            fragments.extend(library.fragments);
            queue.extend(library.uses.into_iter().map(|key| (key, path.clone())));
        }
    }
    fragments
}

/// Reads a library and the libraries that it uses. Links are not checked: they depend on the nets that use the library.
///
/// # Errors
/// Returns the diagnostics if one of them has errors.
pub fn check_library(
    text: &str,
    file: &str,
    libraries: &dyn LibrarySource,
) -> Result<Library, Faults> {
    let mut sources = SourceMap::new(file, text);
    let (root, mut diagnostics) = yaml::read(text);
    let library = root.and_then(|root| read_library(&root, &mut diagnostics));
    if let Some(library) = &library {
        read_libraries(
            &library.uses,
            file,
            libraries,
            &mut sources,
            &mut diagnostics,
        );
    }
    let is_error = |diagnostic: &Diagnostic| diagnostic.severity == Severity::Error;
    match library.filter(|_| !diagnostics.iter().any(is_error)) {
        Some(library) => Ok(library),
        None => Err(sources.finish(diagnostics)),
    }
}

fn read_one(
    key: &Key,
    path: &str,
    libraries: &dyn LibrarySource,
    count: usize,
    bytes: &mut usize,
) -> Result<String, Box<Diagnostic>> {
    let refuse = |message: String, help: &str| {
        let diagnostic = Diagnostic::error(codes::NO_LIBRARY, key.span, message);
        Box::new(diagnostic.help(help))
    };
    let name = &key.name;
    if name.is_empty() || name.starts_with('/') {
        let message = format!("invalid library path `{name}`");
        let help = "write a path relative to this file: `library/filters.yaml`";
        return Err(refuse(message, help));
    }
    // The net's own file is counted as well.
    if count > LIBRARIES_MAX + 1 {
        let message = format!("the net uses more than {LIBRARIES_MAX} libraries");
        return Err(refuse(message, "merge some of them"));
    }
    let text = libraries.read(path).map_err(|error| match error {
        LibraryError::NoLibraries => refuse(
            format!("library `{name}` cannot be read: the net was received as text, without files"),
            "copy the fragments that the net needs to its own `fragments:`",
        ),
        LibraryError::Io(error) => refuse(
            format!("library `{path}` cannot be read: {error}"),
            "the path is relative to the file that names it",
        ),
    })?;
    *bytes += text.len();
    if *bytes > BYTES_MAX {
        let message = format!("the libraries of the net have more than {BYTES_MAX} bytes together");
        return Err(refuse(message, "use smaller ones"));
    }
    Ok(text)
}

/// Returns the path of a library that the file `user` names, without `.` and, as far as possible, without `..`.
#[must_use]
pub fn resolve_path(user: &str, path: &str) -> String {
    let folder = user.rsplit_once('/').map(|(folder, _)| folder);
    let mut parts: Vec<&str> = Vec::new();
    for part in folder
        .iter()
        .flat_map(|folder| folder.split('/'))
        .chain(path.split('/'))
    {
        match (part, parts.last()) {
            (".", _) => {}
            ("", Some(_)) => {}
            ("..", Some(&last)) if !matches!(last, ".." | "") => {
                parts.pop();
            }
            _ => parts.push(part),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn a_library_that_is_not_a_regular_file_is_refused_without_blocking() -> io::Result<()> {
        let folder = rcc_testing::folder();
        let pipe = folder.path().join("pipe");
        assert!(Command::new("mkfifo").arg(&pipe).status()?.success());
        let pipe = pipe.to_string_lossy().into_owned();
        for (path, kind) in [
            (&*pipe, "a named pipe"),
            ("/dev/zero", "a device"),
            ("/", "a folder"),
        ] {
            match FileLibraries.read(path) {
                Err(LibraryError::Io(error)) => {
                    assert!(error.to_string().contains(kind), "{path}: {error}");
                }
                other => panic!("{path}: {other:?}"),
            }
        }
        Ok(())
    }

    #[test]
    fn library_paths_are_relative_to_the_file_that_names_them() {
        for (user, path, want) in [
            ("net.yaml", "filters.yaml", "filters.yaml"),
            ("nets/net.yaml", "./library/../a.yaml", "nets/a.yaml"),
            ("nets/net.yaml", "../a.yaml", "a.yaml"),
            ("net.yaml", "../a.yaml", "../a.yaml"),
            ("../net.yaml", "../a.yaml", "../../a.yaml"),
            ("/etc/rcc/net.yaml", "a.yaml", "/etc/rcc/a.yaml"),
            ("", "a//b.yaml", "a/b.yaml"),
        ] {
            assert_eq!(resolve_path(user, path), want, "{user} {path}");
        }
    }
}
