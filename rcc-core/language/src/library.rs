//! The libraries that a net uses: files of fragments, each read once, wherever it is named. Who compiles a net says where
//! libraries come from; a text that came without files has none. The loader's threads and the command line.

use std::collections::{HashSet, VecDeque};
use std::io::{self, Read as _};
use std::path::Path;

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::{self, Key};

use crate::fault;
use crate::sources::Sources;
use crate::syntax::fragment::{Fragment, read_library};

/// Most libraries of a net.
pub const LIBRARIES_MAX: usize = 64;
/// Most bytes of all libraries of a net.
pub const BYTES_MAX: usize = 4 * yaml::BYTES_MAX;

/// Where libraries come from.
pub trait Libraries {
    /// The text of a library. `path` is what the net names, relative to the folder of the file that names it: with the
    /// net `nets/line.yaml`, `use: [library/filters.yaml]` asks for `nets/library/filters.yaml`.
    ///
    /// # Errors
    /// Why it cannot be read.
    fn read(&self, path: &str) -> Result<String, Unreadable>;
}

/// Why a library cannot be read.
#[derive(Debug)]
pub enum Unreadable {
    /// The text came without files.
    NoFiles,
    /// The system says so.
    Io(io::Error),
}

/// Libraries are files; paths are relative to the working folder, as the name of the net's file is.
#[derive(Clone, Copy, Debug)]
pub struct Files;

/// There are no libraries.
#[derive(Clone, Copy, Debug)]
pub struct NoFiles;

impl Libraries for Files {
    fn read(&self, path: &str) -> Result<String, Unreadable> {
        let file = rcc_os::file::open(Path::new(path)).map_err(Unreadable::Io)?;
        let mut text = String::new();
        // One byte more than is allowed is enough to be refused.
        let mut file = file.take(yaml::BYTES_MAX as u64 + 1);
        file.read_to_string(&mut text).map_err(Unreadable::Io)?;
        Ok(text)
    }
}

impl Libraries for NoFiles {
    fn read(&self, _path: &str) -> Result<String, Unreadable> {
        Err(Unreadable::NoFiles)
    }
}

/// Libraries by path.
impl Libraries for std::collections::BTreeMap<String, String> {
    fn read(&self, path: &str) -> Result<String, Unreadable> {
        let text = self.get(path).cloned();
        text.ok_or_else(|| Unreadable::Io(io::Error::from(io::ErrorKind::NotFound)))
    }
}

/// Reads all libraries that a net uses, and those that they use: their fragments in the order of the files. `file` is
/// the name of the net's own.
pub fn read_all(
    uses: &[Key],
    file: &str,
    libraries: &dyn Libraries,
    sources: &mut Sources,
    faults: &mut Vec<Diagnostic>,
) -> Vec<Fragment> {
    let mut fragments = Vec::new();
    let mut known = HashSet::from([joined("", file)]);
    let mut bytes = 0;
    let mut queue: VecDeque<(Key, String)> = uses
        .iter()
        .map(|key| (key.clone(), file.to_owned()))
        .collect();
    while let Some((key, user)) = queue.pop_front() {
        let path = joined(&user, &key.name);
        if !known.insert(path.clone()) {
            continue;
        }
        let text = match read_one(&key, &path, libraries, known.len(), &mut bytes) {
            Ok(text) => text,
            Err(fault) => {
                faults.push(*fault);
                continue;
            }
        };
        let (root, mut found) = yaml::read(&text);
        let shift = sources.add(&path, text);
        for fault in &mut found {
            fault.place = fault.place.map(|span| shift.span(span));
            fault.file = sources.file_of(shift.span(Span::default()));
        }
        faults.append(&mut found);
        let library = root.and_then(|mut root| {
            shift.node(&mut root);
            read_library(&root, faults)
        });
        if let Some(library) = library {
            fragments.extend(library.fragments);
            queue.extend(library.uses.into_iter().map(|key| (key, path.clone())));
        }
    }
    fragments
}

fn read_one(
    key: &Key,
    path: &str,
    libraries: &dyn Libraries,
    count: usize,
    bytes: &mut usize,
) -> Result<String, Box<Diagnostic>> {
    let refuse = |message: String, help: &str| {
        let fault = Diagnostic::error(fault::NO_LIBRARY, key.span, message);
        Box::new(fault.help(help))
    };
    let name = &key.name;
    if name.is_empty() || name.starts_with('/') {
        let message = format!("`{name}` is no path of a library");
        let help = "write it relative to this file: `library/filters.yaml`";
        return Err(refuse(message, help));
    }
    // The net's own file is among those counted.
    if count > LIBRARIES_MAX + 1 {
        let message = format!("the net uses more than {LIBRARIES_MAX} libraries");
        return Err(refuse(message, "join some of them"));
    }
    let text = libraries.read(path).map_err(|error| match error {
        Unreadable::NoFiles => refuse(
            format!("this text came alone, and the library `{name}` is a file"),
            "put the fragments that the net needs into its own `fragments:`",
        ),
        Unreadable::Io(error) => refuse(
            format!("the library `{path}` cannot be read: {error}"),
            "the path is relative to the file that names it",
        ),
    })?;
    *bytes += text.len();
    if *bytes > BYTES_MAX {
        let message = format!("the libraries of the net have more than {BYTES_MAX} bytes");
        return Err(refuse(message, "use smaller ones"));
    }
    Ok(text)
}

/// The path of a library that the file `user` names, without `.` and, as far as possible, `..`.
#[must_use]
pub fn joined(user: &str, path: &str) -> String {
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
    fn a_library_that_is_no_regular_file_is_refused_and_not_waited_for() -> io::Result<()> {
        let pipe = std::env::temp_dir().join(format!("rcc-library-pipe-{}", std::process::id()));
        assert!(Command::new("mkfifo").arg(&pipe).status()?.success());
        let pipe = pipe.to_string_lossy().into_owned();
        for (path, kind) in [
            (&*pipe, "a named pipe"),
            ("/dev/zero", "a device"),
            ("/", "a folder"),
        ] {
            match Files.read(path) {
                Err(Unreadable::Io(error)) => {
                    assert!(error.to_string().contains(kind), "{path}: {error}");
                }
                other => panic!("{path}: {other:?}"),
            }
        }
        std::fs::remove_file(pipe)
    }

    #[test]
    fn a_library_is_looked_for_beside_the_file_that_names_it() {
        for (user, path, want) in [
            ("net.yaml", "filters.yaml", "filters.yaml"),
            ("nets/net.yaml", "./library/../a.yaml", "nets/a.yaml"),
            ("nets/net.yaml", "../a.yaml", "a.yaml"),
            ("net.yaml", "../a.yaml", "../a.yaml"),
            ("../net.yaml", "../a.yaml", "../../a.yaml"),
            ("/etc/rcc/net.yaml", "a.yaml", "/etc/rcc/a.yaml"),
            ("", "a//b.yaml", "a/b.yaml"),
        ] {
            assert_eq!(joined(user, path), want, "{user} {path}");
        }
    }
}
