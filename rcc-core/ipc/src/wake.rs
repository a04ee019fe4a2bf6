//! Wakes the thread that serves requests: a datagram socket beside iceoryx2's files. iceoryx2's own events end a timed
//! wait at the kernel's tick only (`SO_RCVTIMEO`: 1 to 10 ms). Used by threads that serve and call; never by a
//! real-time thread.

use std::fs::{self, Permissions};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::time::TimeSpec;

use rcc_os::process_instance::ProcessInstance;

use crate::spill_file;

/// Prefix of the file names.
const PREFIX: &str = "wake-";

/// The server's end; dropping it removes its file. The janitor removes the files of processes that died.
#[derive(Debug)]
pub(crate) struct WakeReceiver {
    socket: UnixDatagram,
    path: PathBuf,
}

impl WakeReceiver {
    /// Binds the socket of this server in `folder`, which is private to this user.
    pub(crate) fn bind(folder: &Path, service: &str) -> io::Result<WakeReceiver> {
        let path = path(folder, service)?;
        let socket = UnixDatagram::bind(&path)?;
        let receiver = WakeReceiver { socket, path };
        fs::set_permissions(&receiver.path, Permissions::from_mode(0o600))?;
        receiver.socket.set_nonblocking(true)?;
        Ok(receiver)
    }

    /// Waits until a client has sent a request since the last call, at most `timeout`; may return early.
    pub(crate) fn wait(&self, timeout: Duration) {
        let mut readable = [PollFd::new(self.socket.as_fd(), PollFlags::POLLIN)];
        // An error (a signal) only ends the wait early.
        let _ = ppoll(&mut readable, Some(TimeSpec::from_duration(timeout)), None);
        let mut ignored = [0; 1];
        while self.socket.recv(&mut ignored).is_ok() {}
    }
}

impl Drop for WakeReceiver {
    fn drop(&mut self) {
        // The file is already gone if somebody wiped the cell.
        let _ = fs::remove_file(&self.path);
    }
}

/// A client's end.
#[derive(Debug)]
pub struct WakeSender(UnixDatagram);

impl WakeSender {
    /// Connects to the socket of this server.
    pub(crate) fn connect(folder: &Path, service: &str) -> io::Result<WakeSender> {
        let socket = UnixDatagram::unbound()?;
        socket.connect(path(folder, service)?)?;
        socket.set_nonblocking(true)?;
        Ok(WakeSender(socket))
    }

    /// Wakes the server, or lets its next wait end at once; never waits.
    pub fn wake(&self) {
        // If the queue is full the server is about to wake; if it is gone, the caller finds out by itself.
        let _ = self.0.send(&[0]);
    }
}

/// Returns the process instance that bound the socket with this file name, or `None` for any other file name.
pub(crate) fn owner_of(file_name: &str) -> Option<ProcessInstance> {
    spill_file::owner_after(PREFIX, file_name)
}

/// Returns the path for a service `ROLE-LABEL/INCARNATION.SERIAL/NAME`.
fn path(folder: &Path, service: &str) -> io::Result<PathBuf> {
    let mut parts = service.splitn(3, '/').skip(1);
    match (parts.next(), parts.next()) {
        (Some(session), Some(name)) => {
            let (incarnation, serial) = session.split_once('.').unwrap_or((session, "0"));
            let name = name.replace('/', "_");
            Ok(folder.join(format!("{PREFIX}{incarnation}-{serial}-{name}")))
        }
        _ => Err(io::ErrorKind::InvalidInput.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    const SERVICE: &str = "exec-executor/00000000000000ff.3/control";
    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn a_wait_ends_when_a_client_wakes_and_each_wake_ends_one_wait()
    -> Result<(), Box<dyn std::error::Error>> {
        let folder = rcc_testing::folder();
        let receiver = WakeReceiver::bind(folder.path(), SERVICE)?;
        let sender = WakeSender::connect(folder.path(), SERVICE)?;
        let begun = Instant::now();
        // Sent before the wait begins, more often than the queue is long.
        (0..1000).for_each(|_| sender.wake());
        receiver.wait(LONG);
        let waiting = std::thread::spawn(move || {
            receiver.wait(LONG);
            receiver
        });
        sender.wake();
        let receiver = waiting.join().map_err(|_| "the thread panicked")?;
        assert!(begun.elapsed() < LONG, "woken, not timed out");
        receiver.wait(Duration::from_micros(100));
        Ok(())
    }

    #[test]
    fn the_file_is_private_names_its_owner_and_goes_with_its_server() -> io::Result<()> {
        let folder = rcc_testing::folder();
        let receiver = WakeReceiver::bind(folder.path(), SERVICE)?;
        let files: Vec<_> = fs::read_dir(folder.path())?.collect::<Result<_, _>>()?;
        let [file] = files.as_slice() else {
            panic!("{files:?}");
        };
        assert_eq!(file.metadata()?.permissions().mode() & 0o777, 0o600);
        let name = file.file_name().to_string_lossy().into_owned();
        let owner = owner_of(&name).map(|owner| owner.incarnation());
        assert_eq!(owner, Some(0xff));
        let sender = WakeSender::connect(folder.path(), SERVICE)?;
        drop(receiver);
        sender.wake();
        assert!(WakeSender::connect(folder.path(), SERVICE).is_err());
        assert_eq!(fs::read_dir(folder.path())?.count(), 0);
        Ok(())
    }
}
