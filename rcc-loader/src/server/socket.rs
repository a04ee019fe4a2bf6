//! The Unix socket of a cell's loader: of mode 0600, or 0660 for a group; replaced when its loader is dead, never taken
//! from a living one.
//! Used once by the main thread.

use std::fs;
use std::io;
use std::os::unix::fs::{PermissionsExt, chown};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Why there is no socket.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Somebody answers there.
    #[error("{path} is served by another loader: stop it, or use another cell")]
    InUse {
        /// The socket.
        path: PathBuf,
    },
    /// It cannot be made.
    #[error("{path}: {source}")]
    File {
        /// The socket.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// Listens at `path`, for us and for the members of `group`. Call it while holding the loader's announcement, so that
/// two loaders never race for it.
///
/// # Errors
/// A living loader, or what the system says.
pub fn listen(path: &Path, group: Option<u32>) -> Result<UnixListener, SocketError> {
    let failed = |source| SocketError::File {
        path: path.to_owned(),
        source,
    };
    if UnixStream::connect(path).is_ok() {
        return Err(SocketError::InUse {
            path: path.to_owned(),
        });
    }
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(failed(error)),
        _ => {}
    }
    // Nobody else may enter the folder, or only a group: and it may not write to a socket as it is made.
    let listener = UnixListener::bind(path).map_err(failed)?;
    if group.is_some() {
        chown(path, None, group).map_err(failed)?;
    }
    let mode = if group.is_some() { 0o660 } else { 0o600 };
    fs::set_permissions(path, fs::Permissions::from_mode(mode)).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    Ok(listener)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Removed(PathBuf);

    impl Drop for Removed {
        fn drop(&mut self) {
            let _ = fs::remove_file(&self.0);
        }
    }

    fn path(name: &str) -> Removed {
        Removed(std::env::temp_dir().join(format!("rcc-{}-{name}.sock", std::process::id())))
    }

    #[test]
    fn a_stale_socket_is_replaced() -> Result<(), SocketError> {
        let path = path("stale");
        drop(listen(&path.0, None)?);
        assert!(path.0.exists());
        listen(&path.0, None).map(|_| ())
    }

    #[test]
    fn a_living_loader_keeps_its_socket() -> Result<(), SocketError> {
        let path = path("living");
        let _first = listen(&path.0, None)?;
        assert!(matches!(
            listen(&path.0, None),
            Err(SocketError::InUse { .. })
        ));
        Ok(())
    }

    #[test]
    fn only_its_user_and_the_named_group_may_use_it() -> Result<(), Box<dyn std::error::Error>> {
        use std::os::unix::fs::MetadataExt;
        let path = path("mode");
        drop(listen(&path.0, None)?);
        assert_eq!(fs::metadata(&path.0)?.mode() & 0o777, 0o600);
        // A group that this process is in, whoever runs the test.
        let group = nix::unistd::getgid().as_raw();
        drop(listen(&path.0, Some(group))?);
        let found = fs::metadata(&path.0)?;
        assert_eq!((found.mode() & 0o777, found.gid()), (0o660, group));
        Ok(())
    }
}
