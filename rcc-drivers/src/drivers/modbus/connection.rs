//! The connection to one server: connecting, loss, back-off and reconnection. [`Server`] handles the requests on it.
//! Run by the host's thread; no call here blocks.

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::sync::Arc;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::poll::PollFlags;
use nix::sys::socket::{
    AddressFamily, SockFlag, SockProtocol, SockType, SockaddrStorage, connect, socket,
};

use super::counters::ServerCounters;
use super::fault::ServerFault;
use super::server::Server;
use super::settings::ServerSettings;

/// First pause between two connection attempts.
const BACK_OFF_FIRST: Duration = Duration::from_millis(50);
/// Time-out for connecting, or `timeout` if that is longer.
const CONNECT_MIN: Duration = Duration::from_secs(1);
/// Number of consecutive missing answers that close the connection: the other side may have forgotten it.
const TIMEOUTS_MAX: u32 = 2;
/// One round changes the quality by 1/this of its distance to 1000 or 0.
const QUALITY_SHARE: u32 = 16;

/// Most consecutive reads: a server that floods the driver must not delay the others.
const READS_MAX: usize = 8;

#[derive(Debug)]
enum ConnectionPhase {
    /// Not connected; the next attempt is due at this time.
    Away { until: Instant },
    /// Connecting, until this time at the latest.
    Connecting { stream: TcpStream, until: Instant },
    /// Connected.
    Open { stream: TcpStream },
    /// Connected, but nothing is requested until this time.
    Pausing { stream: TcpStream, until: Instant },
}

/// The connection to one server.
#[derive(Debug)]
pub struct Connection {
    /// The requests on this connection.
    pub server: Server,
    phase: ConnectionPhase,
    back_off: Duration,
    online_since: Option<Instant>,
    /// Reason why the server is not online; 0 = none.
    fault: u32,
    timeouts: u32,
    quality: u32,
    /// The server answered within the last period, so it is waited for.
    pub quick: bool,
    random: u64,
    /// The last connection attempt failed.
    connect_failed: bool,
    counters: Arc<ServerCounters>,
}

impl Connection {
    /// A connection whose first attempt is made at the next call of [`Connection::advance`].
    #[must_use]
    pub fn new(server: Server, seed: u64, now: Instant) -> Self {
        Self {
            counters: Arc::new(ServerCounters::new(server.settings())),
            server,
            phase: ConnectionPhase::Away { until: now },
            back_off: BACK_OFF_FIRST,
            online_since: None,
            fault: 0,
            timeouts: 0,
            quality: 1000,
            quick: true,
            random: seed | 1,
            connect_failed: false,
        }
    }

    /// Returns the counters.
    #[must_use]
    pub fn counters(&self) -> &Arc<ServerCounters> {
        &self.counters
    }

    /// Returns true if the server's inputs are known and its outputs are under our control.
    #[must_use]
    pub fn is_online(&self) -> bool {
        matches!(self.phase, ConnectionPhase::Open { .. }) && self.server.is_complete()
    }

    /// Returns why the server is not online; 0 = not known yet.
    #[must_use]
    pub fn fault(&self) -> u32 {
        self.fault
    }

    /// Returns the share of recent rounds that ended within a period, thousandths.
    #[must_use]
    pub fn quality(&self) -> u32 {
        self.quality
    }

    /// Starts a round; returns false without a connection, or if the last round has not ended.
    pub fn tick(&mut self, now: Instant) -> bool {
        matches!(self.phase, ConnectionPhase::Open { .. }) && self.server.tick(now)
    }

    /// Counts a round that has ended, in time or not.
    pub fn count_round(&mut self, in_time: bool) {
        let aim = if in_time { 1000 } else { 0 };
        // Rounded up, so that the target is reached.
        let step = |far: u32| far.div_ceil(QUALITY_SHARE);
        self.quality = if aim >= self.quality {
            self.quality + step(aim - self.quality)
        } else {
            self.quality - step(self.quality - aim)
        };
        self.counters.round(in_time);
        if let Some(time) = self.server.read_time() {
            self.counters.read(time);
        }
        let discarded = self.server.counts().discarded;
        let online = self.is_online();
        self.counters
            .now(online, self.fault, self.quality, discarded);
    }

    /// Does everything that is possible without blocking.
    pub fn advance(&mut self, now: Instant) {
        if let Err(fault) = self.drive(now) {
            self.handle_fault(&fault, now);
        }
        if self.is_online() {
            let since = *self.online_since.get_or_insert(now);
            // A connection that breaks again and again soon after its start does not reset the back-off.
            if now.saturating_duration_since(since) > self.back_off {
                self.back_off = BACK_OFF_FIRST;
            }
            self.timeouts = 0;
            if self.fault != 0 {
                tracing::info!("{} answers", self.label());
                self.fault = 0;
            }
        } else if let Some(fault) = self.server.standstill(now)
            && matches!(self.phase, ConnectionPhase::Open { .. })
        {
            self.report(&fault);
        }
    }

    /// At the end of the driver: returns true if the safe values have been sent, or the server cannot be reached at
    /// all.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        match self.phase {
            ConnectionPhase::Away { .. } => {
                self.connect_failed || !self.server.has_unsent_safe_values()
            }
            ConnectionPhase::Connecting { .. } => false,
            ConnectionPhase::Open { .. } | ConnectionPhase::Pausing { .. } => {
                self.server.is_released()
            }
        }
    }

    /// Returns true if there is a connection on which requests are sent.
    #[must_use]
    pub fn is_open(&self) -> bool {
        matches!(self.phase, ConnectionPhase::Open { .. })
    }

    /// At the end of the driver: skips the pause if safe values are still to be sent.
    pub fn skip_pause(&mut self, now: Instant) {
        if let ConnectionPhase::Away { until } | ConnectionPhase::Pausing { until, .. } =
            &mut self.phase
            && self.server.has_unsent_safe_values()
        {
            *until = now;
        }
    }

    /// Returns the time at which [`Connection::advance`] has work to do even if nothing is received.
    #[must_use]
    pub fn wake(&self, now: Instant) -> Option<Instant> {
        match &self.phase {
            ConnectionPhase::Away { until }
            | ConnectionPhase::Connecting { until, .. }
            | ConnectionPhase::Pausing { until, .. } => Some(*until),
            ConnectionPhase::Open { .. } => self.server.wake(now),
        }
    }

    /// Returns the socket and the events to wait for.
    #[must_use]
    pub fn events(&self, now: Instant) -> Option<(BorrowedFd<'_>, PollFlags)> {
        let (stream, flags) = match &self.phase {
            ConnectionPhase::Away { .. } => return None,
            ConnectionPhase::Connecting { stream, .. } => (stream, PollFlags::POLLOUT),
            ConnectionPhase::Pausing { stream, .. } => (stream, PollFlags::POLLIN),
            ConnectionPhase::Open { stream } if self.server.to_send(now).is_empty() => {
                (stream, PollFlags::POLLIN)
            }
            ConnectionPhase::Open { stream } => (stream, PollFlags::POLLIN | PollFlags::POLLOUT),
        };
        Some((stream.as_fd(), flags))
    }

    /// Returns a description of the server for log messages.
    #[must_use]
    pub fn label(&self) -> String {
        let ServerSettings {
            name,
            address,
            unit,
            ..
        } = self.server.settings();
        match name {
            Some(name) => format!("the Modbus server '{name}' ({address}, unit {unit})"),
            None => format!("the Modbus server {address}, unit {unit},"),
        }
    }

    fn drive(&mut self, now: Instant) -> Result<(), ServerFault> {
        match &mut self.phase {
            ConnectionPhase::Away { until } if now >= *until => {
                let timeout = self.server.settings().timeout.max(CONNECT_MIN);
                let stream =
                    begin_connect(self.server.settings().address).map_err(ServerFault::Connect)?;
                self.phase = ConnectionPhase::Connecting {
                    stream,
                    until: now + timeout,
                };
                self.finish_connecting(now)
            }
            ConnectionPhase::Away { .. } => Ok(()),
            ConnectionPhase::Connecting { .. } => self.finish_connecting(now),
            ConnectionPhase::Pausing { stream, until } => {
                // Answers received now are late.
                let read = receive(stream, &mut [0; 256]);
                let over = now >= *until;
                read.map_err(ServerFault::Transport)?;
                if over {
                    self.open(|server| server.prepare(now));
                    return self.exchange(now);
                }
                Ok(())
            }
            ConnectionPhase::Open { .. } => self.exchange(now),
        }
    }

    fn finish_connecting(&mut self, now: Instant) -> Result<(), ServerFault> {
        let ConnectionPhase::Connecting { stream, until } = &self.phase else {
            return Ok(());
        };
        if let Some(error) = stream.take_error().map_err(ServerFault::Connect)? {
            return Err(ServerFault::Connect(error));
        }
        let Ok(peer) = stream.peer_addr() else {
            return match now >= *until {
                true => Err(ServerFault::Connect(io::ErrorKind::TimedOut.into())),
                false => Ok(()),
            };
        };
        // If nothing listens there, TCP may connect a local port to itself.
        if stream.local_addr().ok() == Some(peer) {
            return Err(ServerFault::Connect(
                io::ErrorKind::ConnectionRefused.into(),
            ));
        }
        stream.set_nodelay(true).map_err(ServerFault::Connect)?;
        self.counters.connected();
        self.connect_failed = false;
        self.open(|server| server.connected(now));
        self.exchange(now)
    }

    fn open(&mut self, begin: impl FnOnce(&mut Server)) {
        let none = ConnectionPhase::Away {
            until: Instant::now(),
        };
        self.phase = match std::mem::replace(&mut self.phase, none) {
            ConnectionPhase::Connecting { stream, .. }
            | ConnectionPhase::Pausing { stream, .. } => {
                begin(&mut self.server);
                ConnectionPhase::Open { stream }
            }
            other => other,
        };
    }

    fn exchange(&mut self, now: Instant) -> Result<(), ServerFault> {
        let ConnectionPhase::Open { stream } = &mut self.phase else {
            return Ok(());
        };
        for _ in 0..READS_MAX {
            let count = receive(stream, self.server.room()).map_err(ServerFault::Transport)?;
            if let Some(count) = count {
                self.server.received(count, now)?;
            }
            self.server.advance(now)?;
            let bytes = self.server.to_send(now);
            let sent = if bytes.is_empty() {
                0
            } else {
                send(stream, bytes).map_err(ServerFault::Transport)?
            };
            self.server.sent(sent);
            if count.is_none() {
                break;
            }
        }
        Ok(())
    }

    /// Takes the connection offline until a pause is over; logs each new fault once.
    fn handle_fault(&mut self, fault: &ServerFault, now: Instant) {
        self.report(fault);
        self.counters.lost(fault);
        self.connect_failed = !matches!(
            self.phase,
            ConnectionPhase::Open { .. } | ConnectionPhase::Pausing { .. }
        );
        self.quality = 0;
        self.quick = false;
        self.online_since = None;
        let timeout = matches!(
            fault,
            ServerFault::Timeout { .. } | ServerFault::OtherUnit { .. }
        );
        if timeout {
            self.timeouts += 1;
            if self.timeouts < TIMEOUTS_MAX && matches!(self.phase, ConnectionPhase::Open { .. }) {
                // A late answer is recognised by its transaction number.
                self.server.prepare(now);
                return;
            }
        }
        self.timeouts = 0;
        let was_open = matches!(self.phase, ConnectionPhase::Open { .. });
        // A server that closes the connection after each request gets its safe values without growing pauses, since
        // each attempt delivers some.
        let pause = match was_open && self.server.has_unsent_safe_values() {
            true => BACK_OFF_FIRST,
            false => self.pause(),
        };
        let until = now + pause;
        let none = ConnectionPhase::Away { until };
        let keeps = !timeout && !fault.ends_connection();
        self.phase = match std::mem::replace(&mut self.phase, none) {
            ConnectionPhase::Open { stream } if keeps => ConnectionPhase::Pausing { stream, until },
            _ => ConnectionPhase::Away { until },
        };
        self.server.prepare(now);
    }

    fn report(&mut self, fault: &ServerFault) {
        if self.fault != fault.reason() {
            tracing::warn!("{} is lost: {fault}; trying again", self.label());
            self.fault = fault.reason();
        }
    }

    /// Returns the next pause: 75 % to 125 % of the back-off, at random, so that many drivers do not reconnect at once.
    fn pause(&mut self) -> Duration {
        let pause = self.back_off;
        let most = self.server.settings().back_off;
        self.back_off = (2 * self.back_off).min(most);
        // Marsaglia's xorshift.
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        let share = 750 + u32::try_from(self.random % 501).unwrap_or(0);
        (pause * share / 1000).min(most)
    }
}

fn begin_connect(address: SocketAddr) -> io::Result<TcpStream> {
    let family = match address {
        SocketAddr::V4(_) => AddressFamily::Inet,
        SocketAddr::V6(_) => AddressFamily::Inet6,
    };
    let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
    let descriptor = socket(family, SockType::Stream, flags, SockProtocol::Tcp)?;
    match connect(descriptor.as_raw_fd(), &SockaddrStorage::from(address)) {
        Ok(()) | Err(Errno::EINPROGRESS | Errno::EINTR) => Ok(TcpStream::from(descriptor)),
        Err(error) => Err(error.into()),
    }
}

/// Reads received bytes; returns `None` if there are none.
fn receive(stream: &mut TcpStream, room: &mut [u8]) -> io::Result<Option<usize>> {
    match stream.read(room) {
        Ok(0) => Err(io::Error::new(
            io::ErrorKind::UnexpectedEof,
            "the server closed it",
        )),
        Ok(count) => Ok(Some(count)),
        Err(error) if is_passing(&error) => Ok(None),
        Err(error) => Err(error),
    }
}

fn send(stream: &mut TcpStream, bytes: &[u8]) -> io::Result<usize> {
    match stream.write(bytes) {
        Err(error) if is_passing(&error) => Ok(0),
        result => result,
    }
}

fn is_passing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted
    )
}
