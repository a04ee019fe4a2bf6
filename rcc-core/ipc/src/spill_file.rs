//! Encoding of a request as a message: either its bytes, or, for a long request, the name of the spill file that holds
//! them. The file is in iceoryx2's folder, in memory, and is read, never mapped, so truncating it harms nobody. Used by
//! the threads that call and serve; never by a real-time thread.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rcc_os::process_instance::ProcessInstance;
use rcc_protocol::control::REQUEST_MAX;

/// First byte of a message whose remaining bytes are the request.
const INLINE: u8 = 0;
/// First byte of a message that names a file by the two numbers that follow (`u64`, little-endian).
const NAMED: u8 = 1;
/// Length of a message that names a file, bytes.
const NAMED_SIZE: usize = 17;
/// Prefix of the file names.
const PREFIX: &str = "request-";

/// The message is not a valid request, or a long request could not be written to a file.
#[derive(Debug, thiserror::Error)]
pub enum SpillError {
    /// The request is longer than allowed.
    #[error("request too long: {size} bytes, the limit is {max}")]
    TooLarge {
        /// Length that was claimed or found, bytes.
        size: u64,
        /// The limit, bytes.
        max: u64,
    },
    /// The message has an unknown format.
    #[error("malformed request of {size} bytes: are both programs of the same build?")]
    Malformed {
        /// Its length, bytes.
        size: usize,
    },
    /// The file cannot be written or read.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// Error from the system.
        source: io::Error,
    },
}

/// Returns true if a request of `size` bytes fits into a message of `message_max` bytes.
pub(crate) fn fits(size: usize, message_max: usize) -> bool {
    size < message_max
}

/// Encodes a short request as a message.
pub(crate) fn message(request: &[u8]) -> Vec<u8> {
    let mut message = Vec::with_capacity(request.len() + 1);
    message.push(INLINE);
    message.extend_from_slice(request);
    message
}

/// The file of a long request; dropping it removes the file. The janitor removes the files of processes that died.
pub(crate) struct SpillFile {
    path: PathBuf,
}

impl SpillFile {
    /// Writes the file into `folder`; returns the message that names it.
    pub(crate) fn create(
        folder: &Path,
        request: &[u8],
    ) -> Result<(Vec<u8>, SpillFile), SpillError> {
        static NUMBER: AtomicU64 = AtomicU64::new(0);
        let instance = ProcessInstance::current().map_err(|source| SpillError::File {
            path: folder.to_owned(),
            source,
        })?;
        let incarnation = instance.incarnation();
        // Relaxed: the numbers only need to differ.
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let path = folder.join(name(incarnation, number));
        let mut options = OpenOptions::new();
        options.write(true).create_new(true).mode(0o600);
        let failed = |source| SpillError::File {
            path: path.clone(),
            source,
        };
        let mut file = options.open(&path).map_err(failed)?;
        let spill = SpillFile { path: path.clone() };
        file.write_all(request).map_err(failed)?;
        let mut message = vec![NAMED];
        message.extend(incarnation.to_le_bytes());
        message.extend(number.to_le_bytes());
        Ok((message, spill))
    }
}

impl Drop for SpillFile {
    fn drop(&mut self) {
        // The file is already gone if somebody wiped the cell.
        let _ = fs::remove_file(&self.path);
    }
}

/// Returns the request that a message carries or names.
pub(crate) fn open(folder: &Path, message: &[u8]) -> Result<Vec<u8>, SpillError> {
    let size = message.len();
    match message.split_first() {
        Some((&INLINE, bytes)) => Ok(bytes.to_vec()),
        Some((&NAMED, numbers)) if size == NAMED_SIZE => {
            let number = |bytes: &[u8]| bytes.try_into().map(u64::from_le_bytes).ok();
            let (incarnation, count) = numbers.split_at(8);
            let numbers = number(incarnation).zip(number(count));
            let (incarnation, count) = numbers.ok_or(SpillError::Malformed { size })?;
            read(&folder.join(name(incarnation, count)))
        }
        _ => Err(SpillError::Malformed { size }),
    }
}

/// Returns the process instance that wrote the file with this name, or `None` if it is not a spill file.
pub(crate) fn owner_of(file_name: &str) -> Option<ProcessInstance> {
    owner_after(PREFIX, file_name)
}

/// Returns the process instance whose incarnation follows this prefix in a file name.
pub(crate) fn owner_after(prefix: &str, file_name: &str) -> Option<ProcessInstance> {
    let digits = file_name.strip_prefix(prefix)?.split('-').next()?;
    u64::from_str_radix(digits, 16)
        .ok()
        .map(ProcessInstance::from_incarnation)
}

fn name(incarnation: u64, number: u64) -> String {
    format!("{PREFIX}{incarnation:016x}-{number:x}")
}

/// Reads the file, at most [`REQUEST_MAX`] bytes: its length may change meanwhile.
fn read(path: &Path) -> Result<Vec<u8>, SpillError> {
    let failed = |source| SpillError::File {
        path: path.to_owned(),
        source,
    };
    let mut options = OpenOptions::new();
    // Follow no symbolic link, and do not block on a pipe.
    let flags = nix::fcntl::OFlag::O_NOFOLLOW | nix::fcntl::OFlag::O_NONBLOCK;
    options.read(true).custom_flags(flags.bits());
    let file: File = options.open(path).map_err(failed)?;
    let found = file.metadata().map_err(failed)?;
    if !found.is_file() {
        return Err(failed(io::Error::other("not a regular file")));
    }
    let too_large = |size| SpillError::TooLarge {
        size,
        max: REQUEST_MAX as u64,
    };
    if found.len() > REQUEST_MAX as u64 {
        return Err(too_large(found.len()));
    }
    let mut bytes = Vec::with_capacity(found.len() as usize);
    let mut limited = file.take(REQUEST_MAX as u64 + 1);
    limited.read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() > REQUEST_MAX {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use rcc_testing::folder;

    use super::*;

    #[test]
    fn a_long_request_is_read_back_and_its_file_removed() -> Result<(), SpillError> {
        let folder = folder();
        let request = vec![7; REQUEST_MAX];
        let (message, spill) = SpillFile::create(folder.path(), &request)?;
        assert_eq!(message.len(), NAMED_SIZE);
        assert_eq!(open(folder.path(), &message)?, request);
        let name = spill
            .path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        assert_eq!(owner_of(&name), ProcessInstance::current().ok());
        drop(spill);
        assert!(matches!(
            open(folder.path(), &message),
            Err(SpillError::File { .. })
        ));
        assert_eq!(open(folder.path(), &message_of(b"short"))?, b"short");
        Ok(())
    }

    fn message_of(bytes: &[u8]) -> Vec<u8> {
        message(bytes)
    }

    #[test]
    fn a_malformed_message_is_refused() {
        let folder = folder();
        for message in [&[][..], &[2, 0, 0], &[NAMED], &[NAMED; 16], &[NAMED; 18]] {
            let refused = open(folder.path(), message);
            assert!(
                matches!(refused, Err(SpillError::Malformed { .. })),
                "{message:?}"
            );
        }
    }

    #[test]
    fn a_file_that_is_too_long_or_not_regular_is_refused() -> io::Result<()> {
        let folder = folder();
        let named = |number: u64| {
            let message: Vec<u8> =
                [vec![NAMED], vec![0; 8], number.to_le_bytes().to_vec()].concat();
            (folder.path().join(name(0, number)), message)
        };
        let (long, message) = named(1);
        File::create(long)?.set_len(REQUEST_MAX as u64 + 1)?;
        assert!(matches!(
            open(folder.path(), &message),
            Err(SpillError::TooLarge { .. })
        ));
        let (link, message) = named(2);
        std::os::unix::fs::symlink("/etc/hostname", link)?;
        assert!(matches!(
            open(folder.path(), &message),
            Err(SpillError::File { .. })
        ));
        let (directory, message) = named(3);
        fs::create_dir(directory)?;
        assert!(matches!(
            open(folder.path(), &message),
            Err(SpillError::File { .. })
        ));
        let (pipe, message) = named(4);
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRUSR)?;
        assert!(matches!(
            open(folder.path(), &message),
            Err(SpillError::File { .. })
        ));
        Ok(())
    }
}
