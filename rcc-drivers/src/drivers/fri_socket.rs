//! The UDP socket of a robot that sends first: selects the robot that is answered, and distinguishes a stall of this
//! process from silence of the robot. Run by the host's thread.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use rcc_config::DeviceConfig;

use peer::Peer;
use rcc_driver_kit::driver::{DriverError, LinkError};

pub mod peer;

/// The UDP socket failed.
pub const SOCKET: u32 = 105;
/// Datagrams arrive, but none of the configured version.
pub const OTHER_VERSION: u32 = 107;

/// After this silence, another robot, or the same one restarted, is accepted.
pub const ROBOT_TIMEOUT: Duration = Duration::from_millis(200);
/// For this time after a datagram that cannot be decoded, a device without a robot says so.
const UNREADABLE_KEPT: Duration = Duration::from_secs(1);
/// Most datagrams that are read at once after a stall of the driver; further ones are left for the next cycle.
const BURST_MAX: usize = 64;
/// One byte more than a datagram has, so that a longer one is detected.
const BUFFER: usize = 1501;

/// Judgement of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is the robot's next one.
    Accepted,
    /// It can be read, but is not believed.
    Refused,
    /// It is of another version, or of another program.
    Unreadable,
}

/// Judges the datagrams of a socket.
pub trait Dialogue {
    /// Processes a datagram from the robot, or from one that may become it.
    fn accept(&mut self, bytes: &[u8], source: SocketAddr) -> Verdict;

    /// Counts a datagram from another address.
    fn foreign(&mut self, source: SocketAddr);

    /// Forgets the robot after a silence.
    fn forget(&mut self);
}

/// A bound socket and the robot at its other end.
#[derive(Debug)]
pub struct FriSocket {
    socket: UdpSocket,
    /// The only robot that is answered; `None`: any.
    peer: Option<Peer>,
    /// The robot that is answered at present.
    robot: Option<SocketAddr>,
    /// Time without a valid datagram, counted only while the driver was waiting: a stall of the driver is not silence
    /// of the robot.
    silence: Duration,
    read_timeout: Duration,
    /// Arrival of the newest datagram that cannot be decoded.
    unreadable_at: Option<Instant>,
}

impl FriSocket {
    /// Binds the socket of a device to `listen`.
    ///
    /// # Errors
    /// Returns the error of the operating system with the setting that caused it.
    pub fn bind(
        device: &DeviceConfig,
        listen: SocketAddr,
        peer: Option<Peer>,
    ) -> Result<Self, DriverError> {
        let system = |source| DriverError::System {
            device: device.name.clone(),
            key: "listen",
            value: listen.to_string(),
            source,
        };
        let socket = UdpSocket::bind(listen).map_err(system)?;
        let read_timeout = Duration::from_millis(1);
        socket
            .set_read_timeout(Some(read_timeout))
            .map_err(system)?;
        Ok(Self {
            socket,
            peer,
            robot: None,
            silence: Duration::ZERO,
            read_timeout,
            unreadable_at: None,
        })
    }

    /// Returns the address that the robot must send to.
    ///
    /// # Errors
    /// Returns the error of the operating system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Waits until the dialogue accepts a datagram; after a stall of the driver it accepts all that queued up.
    ///
    /// # Errors
    /// Returns [`LinkError::Silent`] at the time-out, and [`LinkError::Lost`] if the socket fails or if only datagrams
    /// of another version arrive.
    pub fn receive(
        &mut self,
        timeout: Duration,
        dialogue: &mut impl Dialogue,
    ) -> Result<(), LinkError> {
        let deadline = Instant::now() + timeout;
        let mut looked = false;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            // Datagrams that arrived during a stall are already queued: read at least once.
            if left.is_zero() && looked {
                return Err(self.silent(timeout, dialogue));
            }
            looked = true;
            match self.receive_one(left.max(Duration::from_micros(1)), dialogue) {
                Ok(true) => break,
                Ok(false) => {}
                Err(error) if is_pause(&error) => return Err(self.silent(timeout, dialogue)),
                Err(error) => return Err(lost(&error)),
            }
        }
        self.drain(dialogue).map_err(|error| lost(&error))?;
        self.silence = Duration::ZERO;
        Ok(())
    }

    /// Sends to the robot that the last accepted datagram came from.
    ///
    /// # Errors
    /// Returns [`LinkError::Silent`] if there is none, [`LinkError::Lost`] if the socket fails.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        let robot = self.robot.ok_or(LinkError::Silent)?;
        match self.socket.send_to(bytes, robot) {
            Ok(_) => Ok(()),
            // As a lost datagram: the controller bridges one.
            Err(error) if is_pause(&error) => Ok(()),
            Err(error) => Err(lost(&error)),
        }
    }

    /// Waits for one datagram; returns true if it was accepted.
    fn receive_one(&mut self, timeout: Duration, dialogue: &mut impl Dialogue) -> io::Result<bool> {
        if self.read_timeout != timeout {
            self.socket.set_read_timeout(Some(timeout))?;
            self.read_timeout = timeout;
        }
        let mut bytes = [0; BUFFER];
        let (size, source) = self.socket.recv_from(&mut bytes)?;
        if !self.is_expected(source) {
            dialogue.foreign(source);
            return Ok(false);
        }
        let verdict = dialogue.accept(bytes.get(..size).unwrap_or_default(), source);
        match verdict {
            Verdict::Accepted => self.robot = Some(source),
            Verdict::Refused => {}
            Verdict::Unreadable => self.unreadable_at = Some(Instant::now()),
        }
        Ok(verdict == Verdict::Accepted)
    }

    /// Returns true if a datagram from this address is from the robot, or may be from a new one.
    fn is_expected(&self, source: SocketAddr) -> bool {
        match (self.robot, self.peer) {
            (Some(robot), _) => source == robot,
            (None, Some(peer)) => peer.accepts(source),
            (None, None) => true,
        }
    }

    /// Reads the datagrams that queued up during a stall of the driver: only the newest one is answered.
    fn drain(&mut self, dialogue: &mut impl Dialogue) -> io::Result<()> {
        self.socket.set_nonblocking(true)?;
        let timeout = self.read_timeout;
        let mut result = Ok(());
        for _ in 0..BURST_MAX {
            match self.receive_one(timeout, dialogue) {
                Ok(_) => {}
                Err(error) if is_pause(&error) => break,
                Err(error) => {
                    result = Err(error);
                    break;
                }
            }
        }
        self.socket.set_nonblocking(false)?;
        result
    }

    fn silent(&mut self, waited: Duration, dialogue: &mut impl Dialogue) -> LinkError {
        self.silence = self.silence.saturating_add(waited);
        if self.silence > ROBOT_TIMEOUT {
            self.robot = None;
            dialogue.forget();
        }
        // Beside a robot that is answered, such a datagram means nothing: its silence may be only a pause.
        let unreadable = self.unreadable_at.filter(|_| self.robot.is_none());
        match unreadable.is_some_and(|at| at.elapsed() < UNREADABLE_KEPT) {
            true => LinkError::Lost {
                reason: OTHER_VERSION,
            },
            false => LinkError::Silent,
        }
    }
}

fn is_pause(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
    )
}

fn lost(error: &io::Error) -> LinkError {
    tracing::warn!(%error, "the socket failed");
    LinkError::Lost { reason: SOCKET }
}
