//! Reads files that may be anything: a pipe without a writer, an endless device, a folder, ten gigabytes. Nothing here
//! waits for another process, except [`read_given`] on a pipe, and nothing reads more than its limit. Replaces small files whole.

use std::fmt;
use std::fs::{self, File, FileType, Metadata, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

const MEGABYTE: u64 = 1 << 20;

/// Reason to refuse a file that the system would let us read; wrapped in the [`io::Error`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileRefused {
    /// The path is a folder, a pipe, a socket or a device.
    NotRegular {
        /// Kind of the file, with its article.
        kind: &'static str,
    },
    /// The file is larger than the limit.
    TooLarge {
        /// The limit, bytes.
        max: u64,
    },
}

impl fmt::Display for FileRefused {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FileRefused::NotRegular { kind } => {
                write!(formatter, "it is {kind}, not a regular file")
            }
            FileRefused::TooLarge { max } if *max >= MEGABYTE => {
                write!(formatter, "it is larger than {} MB", max / MEGABYTE)
            }
            FileRefused::TooLarge { max } => write!(formatter, "it is larger than {max} bytes"),
        }
    }
}

impl std::error::Error for FileRefused {}

impl From<FileRefused> for io::Error {
    fn from(refused: FileRefused) -> io::Error {
        let kind = match refused {
            FileRefused::NotRegular { .. } => io::ErrorKind::InvalidInput,
            FileRefused::TooLarge { .. } => io::ErrorKind::FileTooLarge,
        };
        io::Error::new(kind, refused)
    }
}

/// Opens a regular file for reading. Refuses a pipe, a socket, a device or a folder without waiting for it and without
/// opening it (opening a device may have side effects), unless it replaces a regular file at this very moment.
///
/// # Errors
/// Returns [`FileRefused::NotRegular`], or the error from the system.
pub fn open(path: &Path) -> io::Result<File> {
    regular(&std::fs::metadata(path)?)?;
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(libc::O_NONBLOCK | libc::O_NOCTTY)
        .open(path)?;
    regular(&file.metadata()?)?;
    Ok(file)
}

/// Reads a regular file of at most `max` bytes.
///
/// # Errors
/// Returns [`FileRefused::TooLarge`], or an error as [`open`].
pub fn read(path: &Path, max: u64) -> io::Result<Vec<u8>> {
    let file = open(path)?;
    // Only a hint, since the length may change meanwhile; `take` below enforces the limit.
    let length = file.metadata()?.len();
    if length > max {
        return Err(FileRefused::TooLarge { max }.into());
    }
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    take(file, max, &mut bytes)?;
    Ok(bytes)
}

/// Reads a regular file of at most `max` bytes as text.
///
/// # Errors
/// Returns [`io::ErrorKind::InvalidData`] if it is not UTF-8, or an error as [`read`].
pub fn read_text(path: &Path, max: u64) -> io::Result<String> {
    text(read(path, max)?)
}

/// Reads a text of at most `max` bytes that a person names on the command line. A file that is longer is not read. Waits
/// for a pipe, because `<(…)` is one.
///
/// # Errors
/// Returns [`FileRefused::TooLarge`], [`io::ErrorKind::InvalidData`] if it is not UTF-8, or the error from the system.
pub fn read_given(path: &Path, max: u64) -> io::Result<String> {
    let file = File::open(path)?;
    let found = file.metadata()?;
    if found.is_file() && found.len() > max {
        return Err(FileRefused::TooLarge { max }.into());
    }
    read_stream(file, max)
}

/// Reads a text of at most `max` bytes from a stream.
///
/// # Errors
/// As [`read_given`].
pub fn read_stream(source: impl Read, max: u64) -> io::Result<String> {
    let mut bytes = Vec::new();
    take(source, max, &mut bytes)?;
    text(bytes)
}

/// Read permission of a new file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Readers {
    /// The owner.
    Owner,
    /// As the umask of the process permits.
    Anybody,
}

/// Replaces or creates a file that one process at a time writes: writes [`temporary`] and renames it, so that a reader sees either
/// the old file or the new one. Not synced: after a power failure it may be the old one.
///
/// # Errors
/// Returns the error from the system; the file is unchanged.
pub fn replace(path: &Path, bytes: &[u8], readers: Readers) -> io::Result<()> {
    replace_through(&temporary(path), path, bytes, readers)
}

/// As [`replace`], for a file that several processes may replace at the same time.
///
/// # Errors
/// As [`replace`].
pub fn replace_shared(path: &Path, bytes: &[u8], readers: Readers) -> io::Result<()> {
    let temporary = path.with_extension(format!("new-{}", std::process::id()));
    replace_through(&temporary, path, bytes, readers)
}

/// Returns the temporary file of [`replace`], which a process that is killed meanwhile leaves behind.
#[must_use]
pub fn temporary(path: &Path) -> PathBuf {
    path.with_extension("new")
}

fn replace_through(
    temporary: &Path,
    path: &Path,
    bytes: &[u8],
    readers: Readers,
) -> io::Result<()> {
    let mode = match readers {
        Readers::Owner => 0o600,
        Readers::Anybody => 0o666,
    };
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(true).mode(mode);
    let written = options
        .open(temporary)
        .and_then(|mut file| file.write_all(bytes))
        .and_then(|()| fs::rename(temporary, path));
    if written.is_err() {
        // Incomplete; the error that is returned matters more than one of this.
        let _ = fs::remove_file(temporary);
    }
    written
}

fn take(source: impl Read, max: u64, bytes: &mut Vec<u8>) -> io::Result<()> {
    source.take(max.saturating_add(1)).read_to_end(bytes)?;
    if bytes.len() as u64 > max {
        return Err(FileRefused::TooLarge { max }.into());
    }
    Ok(())
}

fn text(bytes: Vec<u8>) -> io::Result<String> {
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        io::Error::new(
            io::ErrorKind::InvalidData,
            format!("it is not UTF-8 text (invalid byte at offset {at})"),
        )
    })
}

fn regular(found: &Metadata) -> io::Result<()> {
    match kind(found.file_type()) {
        None => Ok(()),
        Some(kind) => Err(FileRefused::NotRegular { kind }.into()),
    }
}

/// Returns the kind of the file, or `None` for a regular file.
fn kind(found: FileType) -> Option<&'static str> {
    if found.is_file() {
        None
    } else if found.is_dir() {
        Some("a folder")
    } else if found.is_fifo() {
        Some("a named pipe")
    } else if found.is_socket() {
        Some("a socket")
    } else {
        Some("a device")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_testing::folder;
    use std::os::unix::net::UnixListener;

    #[test]
    fn writers_of_a_shared_file_do_not_share_their_temporary_file() -> io::Result<()> {
        let folder = folder();
        let path = folder.path().join("costs");
        // Another process is in the middle of its own replacement.
        let other = temporary(&path);
        fs::write(&other, "half")?;
        replace_shared(&path, b"whole", Readers::Owner)?;
        assert_eq!(read_text(&path, 100)?, "whole");
        assert_eq!(read_text(&other, 100)?, "half");
        assert_eq!(fs::read_dir(folder.path())?.count(), 2);
        Ok(())
    }

    #[test]
    fn a_file_is_replaced_whole_or_not_at_all() -> io::Result<()> {
        use std::os::unix::fs::PermissionsExt;
        let folder = folder();
        let path = folder.path().join("state.json");
        replace(&path, b"old", Readers::Owner)?;
        // A reader that has opened the old file goes on reading it.
        let mut old = File::open(&path)?;
        replace(&path, b"new and longer", Readers::Owner)?;
        let mut text = String::new();
        old.read_to_string(&mut text)?;
        assert_eq!(text, "old");
        assert_eq!(read_text(&path, 100)?, "new and longer");
        assert_eq!(fs::metadata(&path)?.permissions().mode() & 0o777, 0o600);
        assert_eq!(fs::read_dir(folder.path())?.count(), 1);
        // A folder is in the file's place: refused, and no temporary file is left.
        let taken = folder.path().join("taken");
        fs::create_dir(&taken)?;
        fs::write(taken.join("file"), "")?;
        assert!(replace(&taken, b"text", Readers::Anybody).is_err());
        assert_eq!(fs::read_dir(folder.path())?.count(), 2);
        Ok(())
    }

    fn said(result: io::Result<impl fmt::Debug>) -> String {
        result.map_or_else(|error| error.to_string(), |read| format!("{read:?}"))
    }

    #[test]
    fn special_files_are_refused_without_waiting() -> io::Result<()> {
        let folder = folder();
        let pipe = folder.path().join("pipe");
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU)?;
        let socket = folder.path().join("socket");
        let _listener = UnixListener::bind(&socket)?;
        for (path, kind) in [
            (pipe.as_path(), "a named pipe"),
            (&socket, "a socket"),
            (folder.path(), "a folder"),
            (Path::new("/dev/zero"), "a device"),
            (Path::new("/dev/null"), "a device"),
        ] {
            let said = said(read(path, 10));
            assert!(said.contains(kind), "{}: {said}", path.display());
        }
        Ok(())
    }

    #[test]
    fn a_link_to_a_file_is_read_and_a_link_to_a_pipe_is_refused() -> io::Result<()> {
        let folder = folder();
        let (file, pipe) = (folder.path().join("file"), folder.path().join("pipe"));
        std::fs::write(&file, "text")?;
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU)?;
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&file, &link)?;
        assert_eq!(read_text(&link, 4)?, "text");
        std::fs::remove_file(&link)?;
        std::os::unix::fs::symlink(&pipe, &link)?;
        assert!(said(read_text(&link, 4)).contains("a named pipe"));
        Ok(())
    }

    #[test]
    fn a_file_beyond_its_limit_is_refused_and_not_read() -> io::Result<()> {
        let folder = folder();
        let path = folder.path().join("large");
        // Ten gigabytes, sparse.
        File::create(&path)?.set_len(10 << 30)?;
        assert_eq!(said(read(&path, 4)), "it is larger than 4 bytes");
        std::fs::write(&path, "12345")?;
        assert_eq!(said(read(&path, 4)), "it is larger than 4 bytes");
        assert_eq!(read(&path, 5)?, b"12345");
        Ok(())
    }

    #[test]
    fn a_file_that_misreports_its_length_is_read_to_its_limit() {
        // All files in /proc report a length of 0.
        let said = said(read(Path::new("/proc/self/status"), 4));
        assert_eq!(said, "it is larger than 4 bytes");
    }

    #[test]
    fn a_pipe_given_on_the_command_line_is_read_and_an_endless_device_is_not() -> io::Result<()> {
        let folder = folder();
        let pipe = folder.path().join("pipe");
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU)?;
        let writer = pipe.clone();
        let thread = std::thread::spawn(move || std::fs::write(writer, "net: x"));
        assert_eq!(read_given(&pipe, 100)?, "net: x");
        assert!(thread.join().is_ok_and(|written| written.is_ok()));
        let endless = said(read_given(Path::new("/dev/zero"), 100));
        assert_eq!(endless, "it is larger than 100 bytes");
        assert!(said(read_given(folder.path(), 100)).contains("directory"));
        Ok(())
    }

    #[test]
    fn a_file_given_on_the_command_line_is_refused_by_its_length_and_not_read() -> io::Result<()> {
        let folder = folder();
        let path = folder.path().join("large");
        // Sparse; to read as much as is allowed would take 64 GB of memory.
        File::create(&path)?.set_len(100 << 30)?;
        assert_eq!(
            said(read_given(&path, 64 << 30)),
            "it is larger than 65536 MB"
        );
        Ok(())
    }

    #[test]
    fn bytes_that_are_not_utf_8_are_reported_with_their_offset() -> io::Result<()> {
        let folder = folder();
        let path = folder.path().join("file");
        std::fs::write(&path, b"ab\xff")?;
        assert_eq!(
            said(read_text(&path, 10)),
            "it is not UTF-8 text (invalid byte at offset 2)"
        );
        Ok(())
    }
}
