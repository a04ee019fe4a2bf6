//! Creates the Unix socket of a cell's loader, with mode 0600, or 0660 for a group. The socket of a dead loader is
//! replaced, that of a living one is not. Used once by the main thread.

use std::io;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};

/// The reason why the socket cannot be created.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Another process accepts connections there.
    #[error("{path} is served by another loader: stop it, or use another cell")]
    InUse {
        /// Path of the socket.
        path: PathBuf,
    },
    /// The system refused an operation on the file.
    #[error("{path}: {source}")]
    File {
        /// Path of the socket.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}

/// Listens at `path`, for our user and the members of `group`. Call it while holding the loader's announcement, so that
/// two loaders never race for the socket.
///
/// # Errors
/// Returns [`SocketError::InUse`] if a living loader serves the socket, and [`SocketError::File`] if the system refuses
/// an operation.
pub fn listen(path: &Path, group: Option<u32>) -> Result<UnixListener, SocketError> {
    let listener = rcc_os::socket::listen(path, group);
    let listener = listener.and_then(|listener| {
        listener.set_nonblocking(true)?;
        Ok(listener)
    });
    listener.map_err(|source| {
        let path = path.to_owned();
        match source.kind() {
            io::ErrorKind::AddrInUse => SocketError::InUse { path },
            _ => SocketError::File { path, source },
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_stale_socket_is_replaced() -> Result<(), SocketError> {
        let folder = rcc_testing::folder();
        let path = folder.path().join("loader.sock");
        drop(listen(&path, None)?);
        assert!(path.exists());
        listen(&path, None).map(|_| ())
    }

    #[test]
    fn the_socket_of_a_living_loader_is_not_replaced() -> Result<(), SocketError> {
        let folder = rcc_testing::folder();
        let path = folder.path().join("loader.sock");
        let _first = listen(&path, None)?;
        assert!(matches!(
            listen(&path, None),
            Err(SocketError::InUse { .. })
        ));
        Ok(())
    }

    #[test]
    fn only_its_user_and_the_named_group_may_use_it() -> Result<(), Box<dyn std::error::Error>> {
        use std::os::unix::fs::MetadataExt;
        let folder = rcc_testing::folder();
        let path = folder.path().join("loader.sock");
        drop(listen(&path, None)?);
        assert_eq!(fs::metadata(&path)?.mode() & 0o777, 0o600);
        // Any group that this process is in.
        let group = nix::unistd::getgid().as_raw();
        drop(listen(&path, Some(group))?);
        let found = fs::metadata(&path)?;
        assert_eq!((found.mode() & 0o777, found.gid()), (0o660, group));
        Ok(())
    }
}
