//! Notifications of a process over `NOTIFY_SOCKET`, as to systemd: ready, status, heartbeat. Read by the supervisor's
//! thread without blocking.

use std::io;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::time::{Duration, Instant};

/// Longest datagram, bytes; longer ones are truncated.
const DATAGRAM_MAX: usize = 4096;
/// Datagrams read per poll; the rest is read in the next one.
const DATAGRAMS_PER_POLL: usize = 64;

/// Notification socket for one incarnation of a process.
#[derive(Debug)]
pub struct NotifySocket {
    socket: UnixDatagram,
    started: Instant,
    last_heartbeat: Instant,
    ready: bool,
    stopping: bool,
    status: String,
}

impl NotifySocket {
    /// Opens the socket at `path`; replaces the socket of an earlier incarnation.
    ///
    /// # Errors
    /// Fails if the socket cannot be created.
    pub fn listen(path: &Path) -> io::Result<NotifySocket> {
        match std::fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let socket = UnixDatagram::bind(path)?;
        socket.set_nonblocking(true)?;
        let now = Instant::now();
        Ok(NotifySocket {
            socket,
            started: now,
            last_heartbeat: now,
            ready: false,
            stopping: false,
            status: String::new(),
        })
    }

    /// Reads the waiting notifications.
    pub fn read(&mut self) {
        let mut buffer = [0; DATAGRAM_MAX];
        for _ in 0..DATAGRAMS_PER_POLL {
            let Ok(size) = self.socket.recv(&mut buffer) else {
                return;
            };
            let message = String::from_utf8_lossy(buffer.get(..size).unwrap_or_default());
            for word in message.lines() {
                self.handle_word(word);
            }
        }
    }

    fn handle_word(&mut self, word: &str) {
        match word.split_once('=') {
            Some(("READY", "1")) => {
                self.ready = true;
                self.last_heartbeat = Instant::now();
            }
            Some(("WATCHDOG", "1")) => self.last_heartbeat = Instant::now(),
            Some(("STOPPING", "1")) => self.stopping = true,
            Some(("STATUS", status)) => status.clone_into(&mut self.status),
            _ => {}
        }
    }

    /// Returns true once the process has reported that it is ready.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.ready
    }

    /// Returns the last reported status.
    #[must_use]
    pub fn status(&self) -> &str {
        &self.status
    }

    /// Returns the time without progress if it exceeds the limit: `watchdog` once the process is ready, `start` before.
    #[must_use]
    pub fn silence_beyond(&self, start: Duration, watchdog: Duration) -> Option<Duration> {
        let (since, limit) = match self.ready {
            true => (self.last_heartbeat, watchdog),
            false => (self.started, start),
        };
        // A stopping process has another limit, which is watched where it is stopped.
        Some(since.elapsed()).filter(|silence| *silence > limit && !self.stopping)
    }

    /// Restarts the watchdog after a time in which nobody could read the socket.
    pub fn reset_watchdog(&mut self) {
        self.last_heartbeat = Instant::now();
    }
}

#[cfg(test)]
mod tests {
    use rcc_testing::TempDir;

    use super::*;

    const NEVER: Duration = Duration::from_secs(3600);

    fn connected() -> (NotifySocket, UnixDatagram, TempDir) {
        let folder = rcc_testing::folder();
        let path = folder.path().join("notify");
        let notifications = NotifySocket::listen(&path).unwrap();
        let sender = UnixDatagram::unbound().unwrap();
        sender.connect(&path).unwrap();
        (notifications, sender, folder)
    }

    #[test]
    fn notifications_are_read_in_any_combination() {
        let (mut notifications, sender, _folder) = connected();
        sender
            .send(b"READY=1\nSTATUS=1000 Hz, a=b\nWATCHDOG=1\nMAINPID=7\n\xff")
            .unwrap();
        notifications.read();
        assert!(notifications.is_ready());
        assert_eq!(notifications.status(), "1000 Hz, a=b");
    }

    #[test]
    fn silence_is_a_hang_only_beyond_its_limit() {
        let (mut notifications, sender, _folder) = connected();
        assert!(
            notifications
                .silence_beyond(Duration::ZERO, NEVER)
                .is_some(),
            "not ready in time"
        );
        assert!(
            notifications
                .silence_beyond(NEVER, Duration::ZERO)
                .is_none()
        );
        sender.send(b"READY=1").unwrap();
        notifications.read();
        assert!(
            notifications
                .silence_beyond(Duration::ZERO, NEVER)
                .is_none()
        );
        assert!(
            notifications
                .silence_beyond(NEVER, Duration::ZERO)
                .is_some(),
            "no heartbeat"
        );
        sender.send(b"STOPPING=1").unwrap();
        notifications.read();
        assert!(
            notifications
                .silence_beyond(NEVER, Duration::ZERO)
                .is_none(),
            "it stops"
        );
    }
}
