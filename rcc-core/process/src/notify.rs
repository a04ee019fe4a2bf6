//! What a program tells its supervisor, systemd or `rcc-cli up`: that it is ready, how it does, that it makes progress,
//! that it stops. A thread of its own does it, because a supervisor that does not listen may make it wait.
//!
//! The socket is connected once and kept: a program that has no free file descriptor any more still tells that it lives.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use crate::helpers::{Helper, Helpers};

/// Name of the thread.
pub const HELPER: &str = "notify";
/// How long it may take for a turn: it waits for a supervisor that does not read.
const TURN_MAX: Duration = Duration::from_secs(10);
/// How often it is looked, without a watchdog.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Within the time of the watchdog it is looked so often: two looks may be late, or may find nothing new.
const LOOKS: u32 = 4;
/// At most one change of status in this time.
const STATUS_EVERY: Duration = Duration::from_secs(1);
/// How long a supervisor may take to be told that we stop.
const FAREWELL: Duration = Duration::from_millis(100);
/// How long a message may wait for a supervisor that does not read.
const SEND_WAIT: Duration = Duration::from_secs(1);
/// At most one line about messages that were not delivered in this time.
const COMPLAIN_EVERY: Duration = Duration::from_secs(10);

/// How a program does, in one look.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HealthReport {
    /// Changes while the program does its work: cycles, exchanges, turns of a loop. No change, no heartbeat.
    pub progress: u64,
    /// One line for people.
    pub status: String,
}

/// The connection to the supervisor; without one (no `NOTIFY_SOCKET`) it looks and tells nobody.
#[derive(Debug)]
pub struct Notifier {
    farewell: SyncSender<SyncSender<()>>,
}

impl Notifier {
    /// Makes socket and thread. When `helpers` begin to work it tells that the program is ready, and from then on what
    /// `look` finds.
    ///
    /// # Errors
    /// The system refuses a socket or a thread.
    pub fn start(
        helpers: &Helpers,
        look: impl FnMut() -> HealthReport + Send + 'static,
    ) -> io::Result<Notifier> {
        let line = SupervisorSocket::from_environment()?;
        let (farewell, farewells) = sync_channel(1);
        let voice = NotifyThread {
            look: Box::new(look),
            heart: HeartbeatGate::default(),
            said: String::new(),
            said_at: None,
            line,
        };
        helpers.spawn(HELPER, TURN_MAX, move |helper| {
            voice.run(&farewells, helper)
        })?;
        Ok(Notifier { farewell })
    }

    /// Tells that the program stops: no more heartbeats are sent.
    pub fn stopping(&self) {
        let (done, told) = sync_channel(1);
        // A supervisor that does not listen will find out.
        if self.farewell.try_send(done).is_ok() {
            let _ = told.recv_timeout(FAREWELL);
        }
    }
}

/// A heartbeat is owed to whoever made progress since the last one.
#[derive(Debug, Default)]
pub struct HeartbeatGate {
    last: Option<u64>,
}

impl HeartbeatGate {
    /// True if there is progress, which is always true for the first time.
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
    /// Messages that were not delivered since the last line about it.
    lost: u64,
    complained_at: Option<Instant>,
}

impl SupervisorSocket {
    /// The one that `NOTIFY_SOCKET` names: a path, or `@name` for a name outside of the file system.
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
            complained_at: None,
        }))
    }

    /// Sends a message. The same socket is connected anew where the supervisor has made its own anew.
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
            self.complain(&error);
        }
    }

    fn complain(&mut self, error: &io::Error) {
        self.lost += 1;
        let soon = |at: Instant| at.elapsed() < COMPLAIN_EVERY;
        if self.complained_at.is_some_and(soon) {
            return;
        }
        self.complained_at = Some(Instant::now());
        let lost = std::mem::take(&mut self.lost);
        tracing::warn!(
            "{lost} messages to the supervisor were not delivered ({error}): it may take this process for hung"
        );
    }
}

struct NotifyThread {
    look: Box<dyn FnMut() -> HealthReport + Send>,
    heart: HeartbeatGate,
    said: String,
    said_at: Option<Instant>,
    line: Option<SupervisorSocket>,
}

impl NotifyThread {
    fn run(mut self, farewells: &Receiver<SyncSender<()>>, helper: &Helper) {
        let every = watchdog().map_or(LOOK_EVERY, |time| (time / LOOKS).min(LOOK_EVERY));
        self.tell("READY=1\n");
        while !helper.is_over() {
            helper.turn();
            match farewells.recv_timeout(every) {
                Err(RecvTimeoutError::Timeout) => self.tell(""),
                Ok(done) => {
                    self.part(&done);
                    break;
                }
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        // Asked to end before it came to it, on a busy machine.
        if let Ok(done) = farewells.try_recv() {
            self.part(&done);
        }
        // Nothing more is told, but the thread is one of the program's until all are asked to end.
        while !helper.rest(LOOK_EVERY) {}
    }

    fn part(&mut self, done: &SyncSender<()>) {
        self.send("STOPPING=1\nSTATUS=stopping\n");
        // Whoever waited may have given up.
        let _ = done.try_send(());
    }

    fn send(&mut self, words: &str) {
        if let Some(line) = &mut self.line {
            line.send(words);
        }
    }

    fn tell(&mut self, first: &str) {
        let HealthReport { progress, status } = (self.look)();
        let status = status.replace('\n', " ");
        let mut words = first.to_owned();
        if self.heart.is_due(progress) {
            words.push_str("WATCHDOG=1\n");
        }
        let due = self.said_at.is_none_or(|at| at.elapsed() >= STATUS_EVERY);
        let news = due && status != self.said;
        if news {
            words.push_str("STATUS=");
            words.push_str(&status);
            words.push('\n');
        }
        if !words.is_empty() {
            self.send(&words);
        }
        if news {
            self.said = status;
            self.said_at = Some(Instant::now());
        }
    }
}

/// Within which time the supervisor wants a heartbeat, if it wants any from this process (sd_watchdog_enabled(3)).
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
    fn no_progress_no_heartbeat() {
        let mut heart = HeartbeatGate::default();
        let beats: Vec<bool> = [0, 1, 1, 1, 7, 7, 8].map(|now| heart.is_due(now)).to_vec();
        assert_eq!(beats, [true, true, false, false, true, false, true]);
    }

    #[test]
    fn a_supervisor_that_makes_its_socket_anew_is_told_over_the_same_descriptor() {
        let name = format!("rcc-notify-anew-{}", std::process::id());
        let path = std::env::temp_dir().join(name);
        let address = SocketAddr::from_pathname(&path).unwrap();
        let mut line = SupervisorSocket {
            address,
            socket: UnixDatagram::unbound().unwrap(),
            connected: false,
            lost: 0,
            complained_at: None,
        };
        let mut heard = [0; 64];
        for turn in 0..3 {
            let ear = UnixDatagram::bind(&path).unwrap();
            ear.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
            for word in ["one", "two"] {
                line.send(word);
                let size = ear.recv(&mut heard).unwrap();
                assert_eq!(&heard[..size], word.as_bytes(), "turn {turn}");
            }
            std::fs::remove_file(&path).unwrap();
            drop(ear);
            line.send("nobody listens");
            assert!(!line.connected);
        }
    }
}
