//! Notifications to the supervisor, systemd or `rcc-cli up`: ready, status, progress, stopping (sd_notify(3)). Sent by
//! a thread of its own, because a supervisor that does not read may block it.
//!
//! The socket is connected once and kept, so that a program without a free file descriptor can still send its
//! heartbeat.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use crate::health::HealthReport;
use crate::helpers::{Helper, Helpers};

/// Name of the thread.
pub const HELPER: &str = "notify";
/// Maximum time of one iteration, which may wait for a supervisor that does not read.
const TURN_MAX: Duration = Duration::from_secs(10);
/// Interval between reports without a watchdog.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Number of reports within the time of the watchdog: two may be late or find no progress.
const LOOKS: u32 = 4;
/// Minimum time between two changes of the status.
const STATUS_EVERY: Duration = Duration::from_secs(1);
/// Maximum time to tell the supervisor that the program stops.
const STOP_TIMEOUT: Duration = Duration::from_millis(100);
/// Maximum time that a message waits for a supervisor that does not read.
const SEND_WAIT: Duration = Duration::from_secs(1);
/// Minimum time between two log lines about undelivered messages.
const LOG_EVERY: Duration = Duration::from_secs(10);

/// The connection to the supervisor; without one (no `NOTIFY_SOCKET`) it sends nothing.
#[derive(Debug)]
pub struct Notifier {
    stop_request: SyncSender<SyncSender<()>>,
}

impl Notifier {
    /// Creates socket and thread. When the `helpers` start, the thread reports that the program is ready, and then
    /// sends what `look` returns.
    ///
    /// # Errors
    /// Returns an error if the system refuses a socket or a thread.
    pub fn start(
        helpers: &Helpers,
        look: impl FnMut() -> HealthReport + Send + 'static,
    ) -> io::Result<Notifier> {
        let supervisor = SupervisorSocket::from_environment()?;
        let (stop_request, stop_requests) = sync_channel(1);
        let mut thread = NotifyThread {
            look: Box::new(look),
            heart: HeartbeatGate::default(),
            last_status: String::new(),
            status_at: None,
            supervisor,
        };
        helpers.spawn(HELPER, TURN_MAX, move |helper| {
            thread.run(&stop_requests, helper)
        })?;
        Ok(Notifier { stop_request })
    }

    /// Reports that the program stops and sends no further heartbeats.
    pub fn stopping(&self) {
        let (done, sent) = sync_channel(1);
        // A supervisor that does not read will notice by itself.
        if self.stop_request.try_send(done).is_ok() {
            let _ = sent.recv_timeout(STOP_TIMEOUT);
        }
    }
}

/// Decides when a heartbeat is due: after progress since the last one.
#[derive(Debug, Default)]
pub struct HeartbeatGate {
    last: Option<u64>,
}

impl HeartbeatGate {
    /// Returns true if there is progress; always true on the first call.
    pub fn is_due(&mut self, progress: u64) -> bool {
        self.last.replace(progress) != Some(progress)
    }
}

/// The socket to the supervisor.
#[derive(Debug)]
struct SupervisorSocket {
    address: SocketAddr,
    socket: UnixDatagram,
    connected: bool,
    /// Messages not delivered since the last log line about it.
    lost: u64,
    logged_at: Option<Instant>,
}

impl SupervisorSocket {
    /// Opens the socket of `NOTIFY_SOCKET`: a path, or `@name` for an abstract name.
    fn from_environment() -> io::Result<Option<SupervisorSocket>> {
        let Some(name) = std::env::var_os("NOTIFY_SOCKET").filter(|name| !name.is_empty()) else {
            return Ok(None);
        };
        let unusable = |error: io::Error| {
            let name = name.display();
            io::Error::new(error.kind(), format!("NOTIFY_SOCKET={name}: {error}"))
        };
        let address = match name.as_encoded_bytes() {
            [b'@', name @ ..] => SocketAddr::from_abstract_name(name),
            _ => SocketAddr::from_pathname(&name),
        };
        let address = address.map_err(unusable)?;
        let socket = UnixDatagram::unbound().map_err(unusable)?;
        socket
            .set_write_timeout(Some(SEND_WAIT))
            .map_err(unusable)?;
        Ok(Some(SupervisorSocket {
            address,
            socket,
            connected: false,
            lost: 0,
            logged_at: None,
        }))
    }

    /// Sends a message. Reconnects the same socket if the supervisor has recreated its own.
    fn send(&mut self, words: &str) {
        let sent = match self.connected {
            true => self.socket.send(words.as_bytes()),
            false => Err(io::ErrorKind::NotConnected.into()),
        };
        let sent = sent.or_else(|_| {
            self.connected = false;
            self.socket.connect_addr(&self.address)?;
            self.connected = true;
            self.socket.send(words.as_bytes())
        });
        if let Err(error) = sent {
            self.log_lost(&error);
        }
    }

    fn log_lost(&mut self, error: &io::Error) {
        self.lost += 1;
        let soon = |at: Instant| at.elapsed() < LOG_EVERY;
        if self.logged_at.is_some_and(soon) {
            return;
        }
        self.logged_at = Some(Instant::now());
        let lost = std::mem::take(&mut self.lost);
        tracing::warn!(
            "{lost} messages to the supervisor were not delivered ({error}): it may consider this process hung"
        );
    }
}

struct NotifyThread {
    look: Box<dyn FnMut() -> HealthReport + Send>,
    heart: HeartbeatGate,
    last_status: String,
    status_at: Option<Instant>,
    supervisor: Option<SupervisorSocket>,
}

impl NotifyThread {
    fn run(&mut self, stop_requests: &Receiver<SyncSender<()>>, helper: &Helper) {
        let every = watchdog().map_or(LOOK_EVERY, |time| (time / LOOKS).min(LOOK_EVERY));
        self.report("READY=1\n");
        while !helper.is_over() {
            helper.turn();
            match stop_requests.recv_timeout(every) {
                Err(RecvTimeoutError::Timeout) => self.report(""),
                Ok(done) => {
                    self.send_stopping(&done);
                    break;
                }
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        // On a busy machine the helpers may be asked to end before the request to stop was received.
        if let Ok(done) = stop_requests.try_recv() {
            self.send_stopping(&done);
        }
        // Nothing more is sent, but the thread must stay until all helpers are asked to end.
        while !helper.rest(LOOK_EVERY) {}
    }

    fn send_stopping(&mut self, done: &SyncSender<()>) {
        self.send("STOPPING=1\nSTATUS=stopping\n");
        // The caller may have stopped waiting.
        let _ = done.try_send(());
    }

    fn send(&mut self, words: &str) {
        if let Some(supervisor) = &mut self.supervisor {
            supervisor.send(words);
        }
    }

    fn report(&mut self, first: &str) {
        let HealthReport { progress, status } = (self.look)();
        let status = status.replace('\n', " ");
        let mut words = first.to_owned();
        if self.heart.is_due(progress) {
            words.push_str("WATCHDOG=1\n");
        }
        let due = self.status_at.is_none_or(|at| at.elapsed() >= STATUS_EVERY);
        let news = due && status != self.last_status;
        if news {
            words.push_str("STATUS=");
            words.push_str(&status);
            words.push('\n');
        }
        if !words.is_empty() {
            self.send(&words);
        }
        if news {
            self.last_status = status;
            self.status_at = Some(Instant::now());
        }
    }
}

/// Returns the watchdog time within which the supervisor expects a heartbeat from this process, if any
/// (sd_watchdog_enabled(3)).
fn watchdog() -> Option<Duration> {
    let number = |name: &str| std::env::var(name).ok()?.parse::<u64>().ok();
    let for_us = match std::env::var_os("WATCHDOG_PID") {
        Some(_) => number("WATCHDOG_PID") == Some(u64::from(std::process::id())),
        None => true,
    };
    let time = number("WATCHDOG_USEC").filter(|time| for_us && *time > 0)?;
    Some(Duration::from_micros(time))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_progress_there_is_no_heartbeat() {
        let mut heart = HeartbeatGate::default();
        let beats: Vec<bool> = [0, 1, 1, 1, 7, 7, 8].map(|now| heart.is_due(now)).to_vec();
        assert_eq!(beats, [true, true, false, false, true, false, true]);
    }

    #[test]
    fn a_recreated_supervisor_socket_is_reached_over_the_same_descriptor() {
        let folder = rcc_testing::folder();
        let path = folder.path().join("notify");
        let address = SocketAddr::from_pathname(&path).unwrap();
        let mut supervisor = SupervisorSocket {
            address,
            socket: UnixDatagram::unbound().unwrap(),
            connected: false,
            lost: 0,
            logged_at: None,
        };
        let mut buffer = [0; 64];
        for turn in 0..3 {
            let receiver = UnixDatagram::bind(&path).unwrap();
            receiver
                .set_read_timeout(Some(Duration::from_secs(60)))
                .unwrap();
            for word in ["one", "two"] {
                supervisor.send(word);
                let size = receiver.recv(&mut buffer).unwrap();
                assert_eq!(&buffer[..size], word.as_bytes(), "turn {turn}");
            }
            std::fs::remove_file(&path).unwrap();
            drop(receiver);
            supervisor.send("nobody listens");
            assert!(!supervisor.connected);
        }
    }
}
