//! The control port's Unix socket, which only its user can access, and the folder in which requests may name files.
//! The main thread binds and removes the socket; the control port's threads call [`ControlFolder::below`].

use std::fs::{self, DirBuilder, File, TryLockError};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

/// Longest wait for the folder's lock, which other starting simulators hold only briefly.
const LOCK_LIMIT: Duration = Duration::from_secs(5);

/// Parses the value of `--control`.
///
/// # Errors
/// Returns an error if the value is empty, or an address with a port as in older versions.
pub fn path(text: &str) -> Result<PathBuf, String> {
    let port = text.rsplit_once(':').map(|(_, port)| port);
    let is_port = port.is_some_and(|port| port.parse::<u16>().is_ok());
    if is_port && !text.contains('/') {
        return Err(
            "the control port is a Unix socket: give the path of one, for example \
             --control=/run/user/1000/sim/lwr.sock, in a folder that only its user can write to"
                .to_owned(),
        );
    }
    match text {
        "" => Err("give the path of a Unix socket".to_owned()),
        _ => Ok(text.into()),
    }
}

/// The folder in which requests may name files.
#[derive(Clone, Debug)]
pub struct ControlFolder(PathBuf);

/// Why a request may not name a file.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// The file is not in the folder.
    #[error(
        "{path} is not below {folder}: requests can only name files there; relative paths start there"
    )]
    Outside {
        /// Path in the request.
        path: PathBuf,
        /// The folder.
        folder: PathBuf,
    },
    /// The file is a symbolic link.
    #[error(
        "{0} is a symbolic link, and links are not followed: name the file itself, or a new one"
    )]
    Link(PathBuf),
    /// The parent folder of the file is not accessible.
    #[error("the folder of {path}: {source}; name a file in an existing folder")]
    Folder {
        /// Path in the request.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
}

impl ControlFolder {
    /// Returns the file that a request names, if it is below this folder; relative paths start here. The file must be
    /// opened with `O_NOFOLLOW`: the check for a link here only gives a better message.
    ///
    /// # Errors
    /// Returns an error if the file is outside the folder, also through a symbolic link or `..`, or is itself a link.
    pub fn below(&self, asked: &Path) -> Result<PathBuf, PathError> {
        let outside = || PathError::Outside {
            path: asked.to_owned(),
            folder: self.0.clone(),
        };
        let whole = self.0.join(asked);
        let (Some(parent), Some(name)) = (whole.parent(), whole.file_name()) else {
            return Err(outside());
        };
        let parent = parent.canonicalize().map_err(|source| PathError::Folder {
            path: asked.to_owned(),
            source,
        })?;
        if !parent.starts_with(&self.0) {
            return Err(outside());
        }
        let path = parent.join(name);
        match fs::symlink_metadata(&path) {
            Ok(found) if found.is_symlink() => Err(PathError::Link(asked.to_owned())),
            _ => Ok(path),
        }
    }
}

/// A bound socket; dropping it removes its file.
#[derive(Debug)]
pub struct ControlSocket {
    path: PathBuf,
    folder: ControlFolder,
    /// The folder was created for the socket, and is removed with it.
    made: bool,
    /// Device and inode number of the file: another simulator may have replaced it.
    identity: (u64, u64),
}

impl ControlSocket {
    /// Binds `path` with mode 0600 from the start. The file of a dead simulator is replaced, that of a live one is not.
    /// A missing folder is created with mode 0700.
    ///
    /// # Errors
    /// Returns an error if another simulator listens there, the file is not a socket, others can write to the folder,
    /// or the operating system refuses.
    pub fn bind(path: &Path) -> io::Result<(UnixListener, ControlSocket)> {
        let path = std::path::absolute(path)?;
        let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
            return Err(io::Error::other("the path has no file name"));
        };
        let made = !folder.exists();
        let mut builder = DirBuilder::new();
        builder.recursive(true).mode(0o700).create(folder)?;
        let folder = folder.canonicalize()?;
        require_private(&folder)?;
        let path = folder.join(name);
        let _lock = lock(&folder)?;
        let listener = rcc_os::socket::listen(&path, None).map_err(|error| match error.kind() {
            io::ErrorKind::AddrInUse => io::Error::new(
                error.kind(),
                "another simulator listens there: choose another path, or stop it",
            ),
            _ => error,
        })?;
        let found = fs::symlink_metadata(&path)?;
        let socket = ControlSocket {
            path,
            folder: ControlFolder(folder),
            made,
            identity: (found.dev(), found.ino()),
        };
        Ok((listener, socket))
    }

    /// Returns the absolute path of the socket.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the folder in which requests may name files.
    #[must_use]
    pub fn folder(&self) -> &ControlFolder {
        &self.folder
    }
}

impl Drop for ControlSocket {
    fn drop(&mut self) {
        let found = fs::symlink_metadata(&self.path);
        if found.is_ok_and(|found| (found.dev(), found.ino()) == self.identity) {
            // A file that cannot be removed is replaced at the next start.
            let _ = fs::remove_file(&self.path);
        }
        if self.made {
            // Fails if the folder is not empty: others use it by now.
            let _ = fs::remove_dir(&self.folder.0);
        }
    }
}

/// Returns the text that a simulator's ready line shows for its control port.
#[must_use]
pub fn display_path(socket: Option<&ControlSocket>) -> String {
    socket.map_or("none".to_owned(), |socket| {
        socket.path.display().to_string()
    })
}

/// Checks that no other user can put a socket or a link into the folder.
fn require_private(folder: &Path) -> io::Result<()> {
    let found = fs::metadata(folder)?;
    let (owner, ours) = (found.uid(), nix::unistd::getuid().as_raw());
    let shown = folder.display();
    if owner != ours {
        return Err(io::Error::other(format!(
            "{shown} belongs to user {owner}, this is user {ours}: choose a folder of your own"
        )));
    }
    let mode = found.mode() & 0o7777;
    if mode & 0o022 != 0 {
        return Err(io::Error::other(format!(
            "{shown} can be written by others (mode {mode:04o}): choose another folder, or `chmod go-w {shown}`"
        )));
    }
    Ok(())
}

/// Locks the folder, so that only one simulator at a time checks whether a socket is dead. Closing the file releases
/// the lock.
fn lock(folder: &Path) -> io::Result<File> {
    let file = File::open(folder)?;
    let begun = Instant::now();
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(file),
            Err(TryLockError::Error(error)) => return Err(error),
            Err(TryLockError::WouldBlock) if begun.elapsed() > LOCK_LIMIT => {
                let shown = folder.display();
                let words = format!("{shown} has been locked (flock) by another process for 5 s");
                return Err(io::Error::other(words));
            }
            Err(TryLockError::WouldBlock) => thread::sleep(Duration::from_millis(5)),
        }
    }
}

#[cfg(test)]
mod tests;
