//! The driver `fri-lwr`: a KUKA LWR 4+ over FRI 1.0 on UDP, in joint position, Cartesian impedance or joint impedance
//! control, with KRL Booleans and reals as I/O.
//! Run by the host's thread; [`fri_session::FriSession`] is the pure protocol state machine, this file adds the socket.
//!
//! The controller sends first, on its own clock; the driver answers to the address that the datagram came from.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rcc_config::DeviceConfig;
use rcc_core::impedance::ControlMode;
use rcc_os::clock::monotonic_ns;

use crate::driver::{
    Driver, DriverError, Exchange, Inputs, LinkDiagnosis, LinkError, Outputs, Settings,
};
use crate::fri_lwr::wire::{HeaderRule, MSR_SIZE, MeasurementDatagram, Quality};
use crate::host::reason::Reason;

pub mod counters;
pub mod fri_session;
pub mod handshake;
pub mod peer;
pub mod plausibility;
pub mod strategy;
pub mod variables;

use counters::FriCounters;
use fri_session::{FriSession, SessionSettings};
use handshake::KrlConvention;
use peer::Peer;

/// The controller is in monitor state.
pub const MONITORING: u32 = 100;
/// The drives have no power, or one of them reports an error.
pub const DRIVES_OFF: u32 = 101;
/// The controller's connection quality is below `quality_min`.
pub const QUALITY: u32 = 102;
/// The controller runs a control strategy that the device does not support.
pub const STRATEGY: u32 = 103;
/// Command mode has just begun.
pub const ENTERING: u32 = 104;
/// The UDP socket failed.
pub const SOCKET: u32 = 105;
/// The controller's commanded Cartesian pose is not a valid pose.
pub const POSE: u32 = 106;
/// Datagrams arrive, but none of FRI 1.0.
pub const OTHER_VERSION: u32 = 107;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[
    (
        MONITORING,
        "the controller is in monitor state: its KRL program has not started command mode (friStart)",
    ),
    (
        DRIVES_OFF,
        "the drives are off or report an error: acknowledge on the controller",
    ),
    (
        QUALITY,
        "the controller rates the connection below settings.quality_min",
    ),
    (
        STRATEGY,
        "the controller runs a control strategy that this device does not support: set $STIFFNESS.STRATEGY to 10 (position), or to 20 \
         or 30 (Cartesian or joint impedance), which need `impedance:` in the robot's file",
    ),
    (ENTERING, "command mode has just begun"),
    (SOCKET, "the network socket failed; see the driver's log"),
    (
        POSE,
        "the controller's commanded Cartesian pose is not a valid pose: check $TOOL and $BASE in its KRL program",
    ),
    (
        OTHER_VERSION,
        "datagrams arrive that are not of FRI 1.0: another version of FRI, or another program; `rcc-cli doctor fri DEVICE` says which",
    ),
];

/// After this silence, another controller, or the same one restarted, is accepted.
const CONTROLLER_TIMEOUT: Duration = Duration::from_millis(200);
/// For this time after a datagram that cannot be decoded, a device without a controller says so.
const UNREADABLE_KEPT: Duration = Duration::from_secs(1);
/// Most datagrams that are read at once after a stall of the driver; further ones are left for the next cycle.
const BURST_MAX: usize = 64;

/// The driver, with its socket and the FRI session.
#[derive(Debug)]
pub struct FriLwr {
    socket: UdpSocket,
    /// The only controller that is answered; `None`: any.
    peer: Option<Peer>,
    /// The controller that is answered at present.
    controller: Option<SocketAddr>,
    /// Time without a valid datagram, counted only while the driver was waiting: a stall of the driver is not silence
    /// of the controller.
    silence: Duration,
    read_timeout: Duration,
    /// Arrival of the newest datagram that cannot be decoded.
    unreadable_at: Option<Instant>,
    header: HeaderRule,
    session: FriSession,
    counters: Arc<FriCounters>,
}

impl Driver for FriLwr {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let mut settings = Settings::of(device);
        let listen = settings.address("listen", None)?;
        let peer = settings.read(
            "peer",
            "the controller's address, such as \"192.168.0.20\" (any port) or \"192.168.0.20:49938\", or leave it out",
            Some(None),
            |value| value.as_str()?.parse().ok().map(Some),
        )?;
        let dialogue = session_settings(&mut settings)?;
        settings.finish()?;
        let session = FriSession::new(device, dialogue)?;
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
            controller: None,
            silence: Duration::ZERO,
            read_timeout,
            unreadable_at: None,
            header: dialogue.header,
            session,
            counters: Arc::new(FriCounters::new(listen, peer, dialogue.header)),
        })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let deadline = Instant::now() + timeout;
        let mut looked = false;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            // Datagrams that arrived during a stall are already queued: read at least once.
            if left.is_zero() && looked {
                return Err(self.silent(timeout));
            }
            looked = true;
            match self.receive_one(left.max(Duration::from_micros(1))) {
                Ok(true) => break,
                Ok(false) => {}
                Err(error) if is_pause(&error) => return Err(self.silent(timeout)),
                Err(error) => return Err(lost(&error)),
            }
        }
        self.drain_socket().map_err(|error| lost(&error))?;
        self.silence = Duration::ZERO;
        Ok(self.session.exchange(inputs))
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        let Some(controller) = self.controller else {
            return Err(LinkError::Silent);
        };
        let bytes = self.session.answer(outputs);
        match self.socket.send_to(&bytes, controller) {
            Ok(_) => {
                self.counters.answered(monotonic_ns());
                Ok(())
            }
            Err(error) => Err(lost(&error)),
        }
    }

    fn release(&mut self) {
        self.session.release();
    }

    fn diagnosis(&self) -> Option<Arc<dyn LinkDiagnosis>> {
        Some(Arc::clone(&self.counters) as Arc<dyn LinkDiagnosis>)
    }
}

impl FriLwr {
    /// Returns the address that the controller must send to.
    ///
    /// # Errors
    /// Returns the error of the operating system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Waits for one datagram; returns true if it was accepted.
    fn receive_one(&mut self, timeout: Duration) -> io::Result<bool> {
        if self.read_timeout != timeout {
            self.socket.set_read_timeout(Some(timeout))?;
            self.read_timeout = timeout;
        }
        // One byte more than a datagram has, so that a longer one is detected.
        let mut bytes = [0; MSR_SIZE + 1];
        let (size, source) = self.socket.recv_from(&mut bytes)?;
        if !self.is_expected(source) {
            self.session.refuse();
            self.counters.foreign(source);
            return Ok(false);
        }
        let bytes = bytes.get(..size).unwrap_or_default();
        let counts = self.session.accept(bytes);
        if counts {
            self.controller = Some(source);
            let measured = self.session.measured();
            self.counters.accepted(monotonic_ns(), source, measured);
        } else {
            self.counters.refused(bytes, source, self.session.doubt());
            if MeasurementDatagram::decode_as(bytes, self.header).is_err() {
                self.unreadable_at = Some(Instant::now());
            }
        }
        Ok(counts)
    }

    /// Returns true if a datagram from this address is from the controller, or may be from a new one.
    fn is_expected(&self, source: SocketAddr) -> bool {
        match (self.controller, self.peer) {
            (Some(controller), _) => source == controller,
            (None, Some(peer)) => peer.accepts(source),
            (None, None) => true,
        }
    }

    /// Reads the datagrams that queued up during a stall of the driver: only the newest one is answered.
    fn drain_socket(&mut self) -> io::Result<()> {
        self.socket.set_nonblocking(true)?;
        let timeout = self.read_timeout;
        let mut result = Ok(());
        for _ in 0..BURST_MAX {
            match self.receive_one(timeout) {
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

    fn silent(&mut self, waited: Duration) -> LinkError {
        self.silence = self.silence.saturating_add(waited);
        if self.silence > CONTROLLER_TIMEOUT {
            self.controller = None;
            self.session.reset();
            self.counters.forget();
        }
        // Beside a controller that is answered, such a datagram means nothing: its silence may be only a pause.
        let unreadable = self.unreadable_at.filter(|_| self.controller.is_none());
        match unreadable.is_some_and(|at| at.elapsed() < UNREADABLE_KEPT) {
            true => LinkError::Lost {
                reason: OTHER_VERSION,
            },
            false => LinkError::Silent,
        }
    }
}

/// Reads what the settings say about the dialogue.
fn session_settings(settings: &mut Settings<'_>) -> Result<SessionSettings, DriverError> {
    let usual = SessionSettings::default();
    Ok(SessionSettings {
        krl: settings.word(
            "krl",
            "first-app ($FRI_FRM_INT[1] asks for command mode), stanford ($FRI_FRM_INT[16]), centro ($FRI_FRM_INT[2]) or auto \
             (the KRL program decides)",
            usual.krl,
            &[
                ("first-app", KrlConvention::FirstApp),
                ("stanford", KrlConvention::Stanford),
                ("centro", KrlConvention::Centro),
                ("auto", KrlConvention::Auto),
            ],
        )?,
        strategy: settings.word(
            "strategy",
            "position, cartesian-impedance or joint-impedance, which is asked for in monitor mode, or leave it out",
            usual.strategy,
            &[
                ("position", Some(ControlMode::Position)),
                ("cartesian-impedance", Some(ControlMode::CartesianImpedance)),
                ("joint-impedance", Some(ControlMode::JointImpedance)),
            ],
        )?,
        quality_min: settings.word(
            "quality_min",
            "bad, ok or perfect",
            usual.quality_min,
            &[
                ("bad", Quality::Bad),
                ("ok", Quality::Ok),
                ("perfect", Quality::Perfect),
            ],
        )?,
        header: settings.word(
            "header",
            "exact, or sparse for a controller that leaves datagramId and packetSize 0",
            usual.header,
            &[("exact", HeaderRule::Exact), ("sparse", HeaderRule::Sparse)],
        )?,
        period_tolerance: settings.read(
            "period_tolerance",
            "the greatest deviation of the controller's sample time from its mean, from 0 to 0.9, such as 0.2",
            Some(usual.period_tolerance),
            |value| value.as_f64().filter(|part| (0.0..=0.9).contains(part)),
        )?,
    })
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

#[cfg(test)]
mod conforms;
#[cfg(test)]
mod tests;
