//! The driver `fri-iiwa`: a KUKA LBR iiwa or LBR Med over FRI 1.11 to 2.7 on UDP, with overlays of joint positions,
//! torques, wrenches and poses, and the station's inputs and outputs as channels.
//! Run by the host's thread; [`session::IiwaSession`] is the pure protocol state machine, this file adds the socket.
//!
//! The robot sends first, on its own clock; the driver answers to the address that the datagram came from.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use rcc_config::DeviceConfig;

use super::fri_socket::{Dialogue, FriSocket, Verdict};
use crate::fri_iiwa::wire::{Quality, Version};
use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkDiagnosis, LinkError, Outputs, Settings,
};
use rcc_driver_kit::host::reason::Reason;

pub mod counters;
pub mod overlay;
pub mod robot_state;
pub mod robot_values;
pub mod session;
pub mod station_io;

pub use super::fri_socket::{OTHER_VERSION, SOCKET};
use counters::IiwaCounters;
use session::{IiwaSession, SessionSettings};

/// The session is open, and no motion with an overlay runs.
pub const MONITORING: u32 = 100;
/// A drive is not active, or the safety controller stops the robot.
pub const DRIVES_OFF: u32 = 101;
/// The robot's connection quality is below `quality_min`.
pub const QUALITY: u32 = 102;
/// The motion's overlay cannot be commanded.
pub const COMMAND_MODE: u32 = 103;
/// Commanding has just begun.
pub const ENTERING: u32 = 104;
/// The robot's application has closed the session.
pub const IDLE: u32 = 106;
/// The station does not list an input or output of the device.
pub const STATION_IO: u32 = 108;
/// The robot executes a motion that another session began.
pub const REJOINED: u32 = 109;
/// The overlay is of forces, and the robot's file does not say which springs hold the arm.
pub const SPRINGS: u32 = 110;

/// Meaning of the reason numbers.
pub const REASONS: &[Reason] = &[
    (
        MONITORING,
        "the robot's application runs no motion with an FRI overlay: start it on the controller",
    ),
    (
        DRIVES_OFF,
        "a drive is not active, or the safety controller stops the robot: release the stop and enable the drives",
    ),
    (
        QUALITY,
        "the robot rates the connection below settings.quality_min",
    ),
    (
        COMMAND_MODE,
        "the motion's overlay cannot be commanded: use ClientCommandMode.POSITION (1.x), JOINT_POSITION (2.x), TORQUE, WRENCH or \
         CARTESIAN_POSE in the robot's application",
    ),
    (ENTERING, "commanding has just begun"),
    (SOCKET, "the network socket failed; see the driver's log"),
    (
        IDLE,
        "the robot's application has closed the FRI session: start it again",
    ),
    (
        OTHER_VERSION,
        "datagrams arrive that are not of settings.version: another version of FRI, or another program; the driver's log \
         says which",
    ),
    (
        REJOINED,
        "the robot is in the middle of a motion that this driver did not begin: it gets no answer and brakes; start the motion \
         again",
    ),
    (
        SPRINGS,
        "the overlay is of torques or wrenches, but FRI does not command the springs: write those of the robot's application \
         under `impedance:` in the robot's file, as ranges of one value",
    ),
    (
        STATION_IO,
        "the robot does not list an input or output of this device with this direction and type: compare the channels' \
         addresses with the I/O configuration of the station; the driver's log names it",
    ),
];

/// The driver, with its socket and the FRI session.
#[derive(Debug)]
pub struct FriIiwa {
    socket: FriSocket,
    dialogue: IiwaDialogue,
}

/// The session and the counters of its datagrams.
#[derive(Debug)]
struct IiwaDialogue {
    session: IiwaSession,
    counters: Arc<IiwaCounters>,
}

impl Driver for FriIiwa {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let mut settings = Settings::of(device);
        let listen = settings.address("listen", None)?;
        let peer = settings.read(
            "peer",
            "the robot's address, such as \"192.170.10.2\" (any port) or \"192.170.10.2:30200\", or leave it out",
            Some(None),
            |value| value.as_str()?.parse().ok().map(Some),
        )?;
        let dialogue = session_settings(&mut settings)?;
        settings.finish()?;
        let session = IiwaSession::new(device, dialogue)?;
        let socket = FriSocket::bind(device, listen, peer)?;
        let counters = Arc::new(IiwaCounters::new(listen, peer, dialogue.version));
        let dialogue = IiwaDialogue { session, counters };
        Ok(Self { socket, dialogue })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        self.socket.receive(timeout, &mut self.dialogue)?;
        Ok(self.dialogue.session.exchange(inputs))
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        let Some(bytes) = self.dialogue.session.answer(outputs) else {
            return Ok(());
        };
        self.socket.send(&bytes)?;
        self.dialogue.counters.answered();
        Ok(())
    }

    fn release(&mut self) {
        self.dialogue.session.release();
    }

    fn diagnosis(&self) -> Option<Arc<dyn LinkDiagnosis>> {
        Some(Arc::clone(&self.dialogue.counters) as Arc<dyn LinkDiagnosis>)
    }
}

impl FriIiwa {
    /// Returns the address that the robot must send to.
    ///
    /// # Errors
    /// Returns the error of the operating system.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.socket.address()
    }
}

impl Dialogue for IiwaDialogue {
    fn accept(&mut self, bytes: &[u8], source: SocketAddr) -> Verdict {
        match self.session.accept(bytes) {
            Ok(()) => {
                if let Some(state) = self.session.state() {
                    self.counters
                        .accepted(source, state, self.session.missing_io());
                }
                Verdict::Accepted
            }
            Err(refusal) => {
                self.counters.refused(source, &refusal);
                match refusal.wire {
                    None => Verdict::Refused,
                    Some(_) => Verdict::Unreadable,
                }
            }
        }
    }

    fn foreign(&mut self, source: SocketAddr) {
        self.session.refuse();
        self.counters.foreign(source);
    }

    fn forget(&mut self) {
        self.session.reset();
    }
}

/// Reads what the settings say about the dialogue.
fn session_settings(settings: &mut Settings<'_>) -> Result<SessionSettings, DriverError> {
    Ok(SessionSettings {
        version: settings.read(
            "version",
            "the version of FRI on the controller: \"1.11\", \"1.14\", \"1.15\", \"1.16\", \"2.5\" or \"2.7\"",
            None,
            |value| value.as_str()?.parse::<Version>().ok(),
        )?,
        quality_min: settings.word(
            "quality_min",
            "good or excellent",
            Quality::Good,
            &[("good", Quality::Good), ("excellent", Quality::Excellent)],
        )?,
    })
}

#[cfg(test)]
mod conforms;
#[cfg(test)]
mod tests;
