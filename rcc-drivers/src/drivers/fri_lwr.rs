//! The driver `fri-lwr`: a KUKA LWR 4+ over FRI 1.0 on UDP, in joint position, Cartesian impedance or joint impedance
//! control, with KRL Booleans and reals as I/O.
//! Run by the host's thread; [`fri_session::FriSession`] is the pure protocol state machine, this file adds the socket.
//!
//! The controller sends first, on its own clock; the driver answers to the address that the datagram came from.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use rcc_config::DeviceConfig;
use rcc_core::impedance::ControlMode;
use rcc_os::clock::monotonic_ns;

use super::fri_socket::{Dialogue, FriSocket, Verdict};
use crate::fri_lwr::wire::{HeaderRule, MeasurementDatagram, Quality};
use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkDiagnosis, LinkError, Outputs, Settings,
};
use rcc_driver_kit::host::reason::Reason;

pub mod counters;
pub mod fri_session;
pub mod handshake;
pub mod plausibility;
pub mod strategy;
pub mod variables;

use counters::FriCounters;
use fri_session::{FriSession, SessionSettings};
use handshake::KrlConvention;

pub use super::fri_socket::{OTHER_VERSION, SOCKET};

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
/// The controller's commanded Cartesian pose is not a valid pose.
pub const POSE: u32 = 106;

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

/// The driver, with its socket and the FRI session.
#[derive(Debug)]
pub struct FriLwr {
    socket: FriSocket,
    dialogue: LwrDialogue,
}

/// The session and the counters of its datagrams.
#[derive(Debug)]
struct LwrDialogue {
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
        let socket = FriSocket::bind(device, listen, peer)?;
        let dialogue = LwrDialogue {
            header: dialogue.header,
            session,
            counters: Arc::new(FriCounters::new(listen, peer, dialogue.header)),
        };
        Ok(Self { socket, dialogue })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        self.socket.receive(timeout, &mut self.dialogue)?;
        Ok(self.dialogue.session.exchange(inputs))
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        let bytes = self.dialogue.session.answer(outputs);
        self.socket.send(&bytes)?;
        self.dialogue.counters.answered(monotonic_ns());
        Ok(())
    }

    fn release(&mut self) {
        self.dialogue.session.release();
    }

    fn diagnosis(&self) -> Option<Arc<dyn LinkDiagnosis>> {
        Some(Arc::clone(&self.dialogue.counters) as Arc<dyn LinkDiagnosis>)
    }
}

impl FriLwr {
    /// Returns the address that the controller must send to.
    ///
    /// # Errors
    /// Returns the error of the operating system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.address()
    }
}

impl Dialogue for LwrDialogue {
    fn accept(&mut self, bytes: &[u8], source: SocketAddr) -> Verdict {
        if self.session.accept(bytes) {
            let measured = self.session.measured();
            self.counters.accepted(monotonic_ns(), source, measured);
            return Verdict::Accepted;
        }
        self.counters
            .refused(bytes, source, self.session.implausibility());
        match MeasurementDatagram::decode_as(bytes, self.header) {
            Ok(_) => Verdict::Refused,
            Err(_) => Verdict::Unreadable,
        }
    }

    fn foreign(&mut self, source: SocketAddr) {
        self.session.refuse();
        self.counters.foreign(source);
    }

    fn forget(&mut self) {
        self.session.reset();
        self.counters.forget();
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

#[cfg(test)]
mod conforms;
#[cfg(test)]
mod tests;
