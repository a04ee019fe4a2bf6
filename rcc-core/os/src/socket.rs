//! Listening sockets: Unix sockets that no other user can connect to at any moment, and TCP. Created by main threads at start.

use std::fs;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{FileTypeExt, PermissionsExt, chown};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;

use nix::errno::Errno;
use nix::sys::socket::{AddressFamily, Backlog, SockFlag, SockType, UnixAddr, bind, socket};
use nix::sys::stat::{Mode, fchmod};

/// Listens at `path`, for this user (mode 0600) and the members of `group` (mode 0660). The file of a dead process is
/// replaced, that of a living one is not. Only one process at a time may do this at one path: the caller holds a lock.
///
/// # Errors
/// Returns [`io::ErrorKind::AddrInUse`] if a process listens there, and an error if the file is not a socket or the
/// system refuses an operation.
pub fn listen(path: &Path, group: Option<u32>) -> io::Result<UnixListener> {
    let listener = match bind_private(path) {
        Err(Errno::EADDRINUSE) => {
            remove_dead(path)?;
            bind_private(path)
        }
        result => result,
    }?;
    let mode = match group {
        Some(_) => {
            chown(path, None, group)?;
            0o660
        }
        None => 0o600,
    };
    fs::set_permissions(path, fs::Permissions::from_mode(mode))?;
    Ok(listener)
}

/// Listens at a TCP address, with the longest queue of connections that the system allows: the kernel drops the
/// connection request of a client that finds the queue full, and the client repeats it only after 1 s.
///
/// # Errors
/// Returns an error if the address cannot be used.
pub fn listen_tcp(address: SocketAddr) -> io::Result<TcpListener> {
    let listener = TcpListener::bind(address)?;
    // The standard library asks for a queue of 128; listening again replaces its length.
    nix::sys::socket::listen(&listener, Backlog::MAXALLOWABLE)?;
    Ok(listener)
}

/// Binds with mode 0600: on Linux a socket's file gets the mode of the socket, so nobody else can connect at any
/// moment.
fn bind_private(path: &Path) -> Result<UnixListener, Errno> {
    let flags = SockFlag::SOCK_CLOEXEC;
    let socket = socket(AddressFamily::Unix, SockType::Stream, flags, None)?;
    fchmod(&socket, Mode::S_IRUSR | Mode::S_IWUSR)?;
    bind(socket.as_raw_fd(), &UnixAddr::new(path)?)?;
    nix::sys::socket::listen(&socket, Backlog::MAXALLOWABLE)?;
    Ok(UnixListener::from(socket))
}

/// Removes a socket on which nobody listens.
fn remove_dead(path: &Path) -> io::Result<()> {
    let is_socket = fs::symlink_metadata(path)?.file_type().is_socket();
    if !is_socket {
        return Err(io::Error::other(
            "the file is not a socket: choose another path, or remove the file",
        ));
    }
    match UnixStream::connect(path) {
        Ok(_) => Err(io::ErrorKind::AddrInUse.into()),
        Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => fs::remove_file(path),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::MetadataExt;

    #[test]
    fn a_socket_is_private_from_the_start() -> io::Result<()> {
        let folder = rcc_testing::folder();
        let path = folder.path().join("born.sock");
        let _listener = bind_private(&path)?;
        let mode = fs::metadata(&path)?.mode();
        assert_eq!(mode & 0o077, 0);
        Ok(())
    }
}
