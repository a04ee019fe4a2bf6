//! One session of a MainDevice (`ethercrab`) with a line: found, compared with what is expected, brought to OP, and exchanged
//! with once a period, until an exchange shows that the line is no longer the same.
//! Runs in the thread that calls [`run`], with everything it needs; the next session begins anew.

use std::ops::ControlFlow;
use std::pin::pin;
use std::time::Duration;

use ethercrab::{MainDevice, MainDeviceConfig, PduStorage, SubDeviceState, Timeouts};
use futures_lite::future;

use crate::wire::{Interface, Socket};

mod exchange;
mod frames;
mod start;

pub use frames::FrameCounts;

/// Most terminals of a line.
pub const TERMINALS_MAX: usize = 64;
/// Largest process image, inputs and outputs, bytes.
pub const IMAGE_MAX: usize = 1024;
/// Frames in flight; a session sends one after the other, and a few during the start.
const FRAMES: usize = 16;
/// Largest data of a datagram, bytes.
const DATA_MAX: usize = PduStorage::element_size(1100);
/// Limit of EEPROM and mailbox answers; `ethercrab`'s 10 ms is too short on a machine that others use.
const START_STEP: Duration = Duration::from_millis(500);
/// Limit of the answer to one frame of the start.
const START_FRAME: Duration = Duration::from_millis(100);
/// Frames by which the clocks find each other at the start; those of the exchanges follow.
const CLOCK_FRAMES: u32 = 500;
/// Limit of a change of state (ETG.1020 allows 10 s for the slowest).
const STATE_CHANGE: Duration = Duration::from_secs(10);

/// A terminal that must be at its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExpectedTerminal {
    /// Order number, for messages.
    pub name: String,
    /// Vendor number.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Time without outputs after which the terminal switches them off; `None`: as the terminal has it.
    pub watchdog: Option<Duration>,
    /// Objects that are written before the terminal exchanges inputs.
    pub objects: Vec<ObjectValue>,
    /// Its SYNC0 is switched on, with the period of the exchanges; with [`SessionOptions::clocks`] only.
    pub sync0: bool,
}

/// An object and its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectValue {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub_index: u8,
    /// Value.
    pub value: ObjectData,
}

/// A value of an object, with its type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectData {
    /// INTEGER8.
    I8(i8),
    /// UNSIGNED8.
    U8(u8),
    /// INTEGER16.
    I16(i16),
    /// UNSIGNED16.
    U16(u16),
    /// UNSIGNED32.
    U32(u32),
}

/// Settings of a session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SessionOptions {
    /// Where the line is connected.
    pub interface: Interface,
    /// The terminals in their order.
    pub line: Vec<ExpectedTerminal>,
    /// Period of the exchanges.
    pub period: Duration,
    /// Limit of the answer to one exchange; shorter than the watchdogs of the terminals.
    pub timeout: Duration,
    /// Distributed clocks: the exchanges follow the clock of the first terminal that has one.
    pub clocks: Option<ClockOptions>,
}

/// How the exchanges follow the reference clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockOptions {
    /// Time from SYNC0 to an exchange; shorter than the period.
    pub shift: Duration,
}

/// Process data of one terminal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TerminalImage {
    /// As read in the last complete exchange.
    pub inputs: Vec<u8>,
    /// Sent in the next exchange.
    pub outputs: Vec<u8>,
}

/// The result of one exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cycle {
    /// The line is in SAFEOP, and no frame has been exchanged: the first outputs are wanted.
    First,
    /// The line is in SAFEOP, by wish: all terminals gave their inputs and drive no outputs.
    InputsOnly,
    /// All terminals took their outputs and gave their inputs.
    Complete,
    /// The inputs are those of an older exchange.
    Lost(Loss),
}

/// Why an exchange does not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// No answer in time.
    Silent,
    /// Fewer terminals than expected took part.
    WorkingCounter {
        /// Counter of the answer.
        have: u16,
        /// Counter of a complete line.
        want: u16,
    },
    /// Not all terminals are in OP yet.
    Starting,
    /// A terminal seems to have left OP, but says otherwise when it is asked again.
    Unconfirmed,
}

/// Error counters of the ports of one terminal (registers 0x0300 to 0x0313), one entry per port; they stop at 255.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PortErrors {
    /// Frames with a wrong checksum.
    pub invalid_frames: [u8; 4],
    /// Symbols that the physical layer could not read.
    pub receive_errors: [u8; 4],
    /// Errors that a terminal before has already counted.
    pub forwarded: [u8; 4],
    /// Times that the cable was pulled or the neighbour lost its power.
    pub lost_links: [u8; 4],
}

impl PortErrors {
    /// First register.
    const FIRST: u16 = 0x0300;
    /// Size of the registers, bytes.
    const SIZE: usize = 20;

    fn read(bytes: [u8; PortErrors::SIZE]) -> PortErrors {
        let at = |first: usize, step: usize| {
            std::array::from_fn(|port| bytes.get(first + port * step).copied().unwrap_or(0))
        };
        PortErrors {
            invalid_frames: at(0, 2),
            receive_errors: at(1, 2),
            forwarded: at(8, 1),
            lost_links: at(16, 1),
        }
    }
}

/// The user of a session's process data.
pub trait Application {
    /// Returns true if the session must end: asked all the time while it starts, and after each exchange.
    fn must_end(&self) -> bool {
        false
    }

    /// Returns true if the terminals may drive outputs; until then the session stays in SAFEOP and exchanges inputs.
    fn drives_outputs(&self) -> bool {
        true
    }

    /// Takes the inputs and sets the outputs of the next exchange: called before the first exchange and after each one.
    fn cycle(&mut self, image: &mut [TerminalImage], cycle: Cycle) -> ControlFlow<()>;

    /// Takes the states of all terminals, which come with each answer; `None` is a terminal that did not answer.
    fn states(&mut self, states: &[SubDeviceState]) {
        let _ = states;
    }

    /// Takes the difference of a terminal's clock from the reference clock, ns; `position` from 0.
    fn clock_difference(&mut self, position: usize, difference_ns: i64) {
        let _ = (position, difference_ns);
    }

    /// Takes the error counters of the terminal at `position`, from 0.
    fn port_errors(&mut self, position: usize, errors: PortErrors) {
        let _ = (position, errors);
    }
}

/// Why a session has ended, or did not begin.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SessionError {
    /// The interface cannot be opened.
    #[error("{0}")]
    Nic(String),
    /// No terminal answered.
    #[error("no terminal answers at `{interface}`: check the cable, and the supply of the line")]
    NoAnswer {
        /// Where the line should be connected.
        interface: String,
    },
    /// A step of the start failed.
    #[error("the line did not reach {state}: {cause}; check cable and power")]
    Start {
        /// State that was wanted.
        state: &'static str,
        /// Cause, as the MainDevice tells it.
        cause: String,
    },
    /// A terminal refused an object.
    #[error(
        "terminal {position} ({name}) does not take the object {index:#06x}:{sub_index:02x}: {cause}"
    )]
    Object {
        /// Position, from 1.
        position: usize,
        /// Its name.
        name: String,
        /// Index of the object.
        index: u16,
        /// Its sub-index.
        sub_index: u8,
        /// Cause, as the terminal tells it.
        cause: String,
    },
    /// Another number of terminals.
    #[error("the line has {have} terminals; the configuration names {want}")]
    Count {
        /// Number that was found.
        have: usize,
        /// Number that is configured.
        want: usize,
    },
    /// Another terminal.
    #[error(
        "terminal {position} is {have} (vendor {vendor:#x}, product {product:#010x}); the configuration names {want}"
    )]
    Terminal {
        /// Position, from 1.
        position: usize,
        /// Name of what was found.
        have: String,
        /// Its vendor.
        vendor: u32,
        /// Its product code.
        product: u32,
        /// Name that is configured.
        want: String,
    },
    /// No terminal has a clock.
    #[error("no terminal of the line has a distributed clock: remove settings.distributed_clocks")]
    NoClock,
    /// A terminal has no SYNC0.
    #[error(
        "terminal {position} ({name}) has no distributed clock, and no SYNC0: remove its `sync0`"
    )]
    NoSync {
        /// Position, from 1.
        position: usize,
        /// Its name.
        name: String,
    },
    /// The application cannot use the process data.
    #[error("{0}")]
    Image(String),
    /// A terminal has left OP, for example because its watchdog expired.
    #[error(
        "terminal {position} ({name}) is in {state}, not in OP{cause}: the line must be started again"
    )]
    Left {
        /// Position, from 1.
        position: usize,
        /// Its name.
        name: String,
        /// State that it showed.
        state: String,
        /// Its own reason, as `, because of …`; empty if it gave none.
        cause: String,
    },
    /// A terminal was without power.
    #[error("a terminal was without power: the line must be started again")]
    Restarted,
    /// The network interface failed while exchanging.
    #[error("frames cannot be exchanged: {0}")]
    Network(String),
}

/// Runs a session until the application ends it or the line fails.
///
/// # Errors
/// Returns why the line did not start, or is no longer usable. A lost exchange is not an error.
pub fn run(
    options: &SessionOptions,
    counts: &FrameCounts,
    application: &mut impl Application,
) -> Result<(), SessionError> {
    // On the heap: a storage can be divided only once, so each session has its own.
    let storage: Box<PduStorage<FRAMES, DATA_MAX>> = Box::new(PduStorage::new());
    let network = |cause: String| SessionError::Network(cause);
    let (sender, receiver, pdus) = storage
        .try_split()
        .map_err(|()| network("the frames' storage is in use".to_owned()))?;
    let socket = Socket::main_device(&options.interface)
        .map_err(|error| SessionError::Nic(error.to_string()))?;
    let frames = frames::Frames::new(socket, (sender, receiver), counts)
        .map_err(|error| network(error.to_string()))?;
    let timeouts = Timeouts {
        pdu: options.timeout.max(START_FRAME),
        eeprom: START_STEP,
        mailbox_echo: START_STEP,
        mailbox_response: START_STEP,
        state_transition: STATE_CHANGE,
        ..Timeouts::default()
    };
    let config = MainDeviceConfig {
        // Without distributed clocks no frames to synchronise them.
        dc_static_sync_iterations: options.clocks.map_or(0, |_| CLOCK_FRAMES),
        ..MainDeviceConfig::default()
    };
    let main = MainDevice::new(pdus, timeouts, config);
    async_io::block_on(async {
        let mut frames = pin!(frames);
        let failed = async { Err(network(frames.as_mut().await.to_string())) };
        future::or(exchange::run(&main, options, application), failed).await
    })
}
