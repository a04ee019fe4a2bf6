//! One session of a MainDevice (`ethercrab`) with a line: found, compared with what is expected, brought to OP, and exchanged
//! with once a period, until an exchange shows that the line is no longer the same.
//! Runs in the thread that calls [`run`], with everything it needs; the next session begins anew.

use std::ops::ControlFlow;
use std::pin::pin;
use std::time::{Duration, Instant};

use async_io::Timer;
use ethercrab::std::{ethercat_now, tx_rx_task};
use ethercrab::subdevice_group::Op;
use ethercrab::{
    DefaultLock, MainDevice, MainDeviceConfig, PduStorage, SubDeviceGroup, SubDeviceState, Timeouts,
};
use futures_lite::future;

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
/// Limit of a change of state (ETG.1020 allows 10 s for the slowest).
const STATE_CHANGE: Duration = Duration::from_secs(10);

type Group = SubDeviceGroup<TERMINALS_MAX, IMAGE_MAX, DefaultLock, Op>;

/// A terminal that must be at its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExpectedTerminal {
    /// Order number, for messages.
    pub name: String,
    /// Vendor number.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
}

/// How a session exchanges.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SessionOptions {
    /// Network interface.
    pub nic: String,
    /// The terminals in their order.
    pub line: Vec<ExpectedTerminal>,
    /// Period of the exchanges.
    pub period: Duration,
    /// Limit of the answer to one frame; shorter than the watchdogs of the terminals.
    pub timeout: Duration,
}

/// Process data of one terminal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TerminalImage {
    /// As read in the last complete exchange.
    pub inputs: Vec<u8>,
    /// Sent in the next exchange.
    pub outputs: Vec<u8>,
}

/// What one exchange gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cycle {
    /// The line is in SAFEOP, and no frame has been exchanged: the first outputs are wanted.
    First,
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
}

/// Why a session has ended, or did not begin.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SessionError {
    /// The interface cannot be opened.
    #[error("network interface `{nic}`: {cause}; raw Ethernet packets need CAP_NET_RAW")]
    Nic {
        /// Name of the interface.
        nic: String,
        /// Error of the operating system.
        cause: String,
    },
    /// A step of the start failed.
    #[error("the line did not reach {state}: {cause}; check cable and power")]
    Start {
        /// State that was wanted.
        state: &'static str,
        /// Cause, as the MainDevice tells it.
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
    /// A terminal has left OP, for example because its watchdog expired.
    #[error(
        "terminal {position} ({name}) is in {state}, not in OP: the line must be started again"
    )]
    Left {
        /// Position, from 1.
        position: usize,
        /// Its name.
        name: String,
        /// State that it showed.
        state: String,
    },
    /// The network interface failed while exchanging.
    #[error("frames cannot be exchanged: {0}")]
    Network(String),
}

/// Runs a session until `cycle` breaks it or the line fails. `cycle` is called with the process image before the first
/// exchange and after each one, and sets the outputs of the next.
///
/// # Errors
/// Returns why the line did not start, or is no longer usable. A lost exchange is not an error.
pub fn run(
    options: &SessionOptions,
    cycle: impl FnMut(&mut [TerminalImage], Cycle) -> ControlFlow<()>,
) -> Result<(), SessionError> {
    // On the heap: a storage can be divided only once, so each session has its own.
    let storage: Box<PduStorage<FRAMES, DATA_MAX>> = Box::new(PduStorage::new());
    let network = |cause: String| SessionError::Network(cause);
    let (sender, receiver, pdus) = storage
        .try_split()
        .map_err(|()| network("the frames' storage is in use".to_owned()))?;
    let frames = tx_rx_task(&options.nic, sender, receiver).map_err(|error| SessionError::Nic {
        nic: options.nic.clone(),
        cause: error.to_string(),
    })?;
    let timeouts = Timeouts {
        pdu: options.timeout,
        eeprom: START_STEP,
        mailbox_echo: START_STEP,
        mailbox_response: START_STEP,
        state_transition: STATE_CHANGE,
        ..Timeouts::default()
    };
    let main = MainDevice::new(pdus, timeouts, MainDeviceConfig::default());
    async_io::block_on(async {
        let mut frames = pin!(frames);
        let failed = async {
            match frames.as_mut().await {
                Ok(_) => Err(network("the socket was closed".to_owned())),
                Err(error) => Err(network(error.to_string())),
            }
        };
        future::or(hold(&main, options, cycle), failed).await
    })
}

/// Starts the line and exchanges.
async fn hold(
    main: &MainDevice<'_>,
    options: &SessionOptions,
    mut cycle: impl FnMut(&mut [TerminalImage], Cycle) -> ControlFlow<()>,
) -> Result<(), SessionError> {
    let fault = |state| {
        move |error: ethercrab::error::Error| SessionError::Start {
            state,
            cause: error.to_string(),
        }
    };
    let group = main
        .init_single_group::<TERMINALS_MAX, IMAGE_MAX>(ethercat_now)
        .await
        .map_err(fault("PREOP"))?;
    let found = group.iter(main).map(|terminal| {
        let identity = terminal.identity();
        let name = terminal.name().to_owned();
        (name, identity.vendor_id, identity.product_id)
    });
    compare(&options.line, &found.collect::<Vec<_>>())?;
    let group = group.into_safe_op(main).await.map_err(fault("SAFEOP"))?;
    let mut image: Vec<TerminalImage> = group
        .iter(main)
        .map(|terminal| TerminalImage {
            inputs: vec![0; terminal.inputs_raw().len()],
            outputs: vec![0; terminal.outputs_raw().len()],
        })
        .collect();
    if cycle(&mut image, Cycle::First).is_break() {
        return Ok(());
    }
    // Not waited for here: the outputs must flow meanwhile, or their watchdogs expire.
    let group = group.request_into_op(main).await.map_err(fault("OP"))?;
    let started = Instant::now();
    let mut next = started;
    let mut running = false;
    loop {
        let result = exchange(main, &group, &mut image, running, options).await?;
        running |= result == Cycle::Complete;
        if !running && started.elapsed() > STATE_CHANGE {
            return Err(SessionError::Start {
                state: "OP",
                cause: "the terminals did not follow in 10 s".to_owned(),
            });
        }
        if cycle(&mut image, result).is_break() {
            return Ok(());
        }
        next = following(next, Instant::now(), options.period);
        Timer::at(next).await;
    }
}

/// Returns the first start of a period after `now`: late periods are left out.
fn following(last: Instant, now: Instant, period: Duration) -> Instant {
    let behind = now.saturating_duration_since(last).as_nanos() / period.as_nanos().max(1);
    last + period.saturating_mul(u32::try_from(behind).unwrap_or(u32::MAX - 1) + 1)
}

/// Exchanges once and judges the answer; the inputs of an incomplete exchange are not taken.
async fn exchange(
    main: &MainDevice<'_>,
    group: &Group,
    image: &mut [TerminalImage],
    running: bool,
    options: &SessionOptions,
) -> Result<Cycle, SessionError> {
    for (terminal, image) in group.iter(main).zip(&*image) {
        terminal.outputs_raw_mut().copy_from_slice(&image.outputs);
    }
    let Ok(answer) = group.tx_rx(main).await else {
        return Ok(Cycle::Lost(Loss::Silent));
    };
    let (have, want) = (answer.working_counter, expected_counter(image));
    if have != want {
        return Ok(Cycle::Lost(Loss::WorkingCounter { have, want }));
    }
    let states = answer.subdevice_states.iter().zip(&options.line).zip(1..);
    for ((state, terminal), position) in states {
        match state {
            SubDeviceState::Op => {}
            _ if !running => return Ok(Cycle::Lost(Loss::Starting)),
            state => {
                return Err(SessionError::Left {
                    position,
                    name: terminal.name.clone(),
                    state: state.to_string(),
                });
            }
        }
    }
    for (terminal, image) in group.iter(main).zip(image) {
        image.inputs.copy_from_slice(&terminal.inputs_raw());
    }
    Ok(Cycle::Complete)
}

/// Returns the working counter of a complete exchange by LRW: 1 for inputs and 2 for outputs of each terminal.
fn expected_counter(image: &[TerminalImage]) -> u16 {
    let of = |one: &TerminalImage| {
        u16::from(!one.inputs.is_empty()) + 2 * u16::from(!one.outputs.is_empty())
    };
    image.iter().map(of).sum()
}

/// Compares the line that was found, `(name, vendor, product)`, with the configured one.
fn compare(want: &[ExpectedTerminal], found: &[(String, u32, u32)]) -> Result<(), SessionError> {
    for ((want, (name, vendor, product)), position) in want.iter().zip(found).zip(1..) {
        if (want.vendor, want.product) != (*vendor, *product) {
            return Err(SessionError::Terminal {
                position,
                have: name.clone(),
                vendor: *vendor,
                product: *product,
                want: want.name.clone(),
            });
        }
    }
    if want.len() != found.len() {
        return Err(SessionError::Count {
            have: found.len(),
            want: want.len(),
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_periods_are_left_out() {
        let start = Instant::now();
        let ms = Duration::from_millis;
        let next = |late| following(start, start + late, ms(2)) - start;
        assert_eq!(next(ms(0)), ms(2));
        assert_eq!(next(ms(1)), ms(2));
        assert_eq!(next(ms(7)), ms(8));
    }

    #[test]
    fn a_difference_is_told_by_its_position() {
        let want = |product| ExpectedTerminal {
            name: "EL1008".into(),
            vendor: 2,
            product,
        };
        let found = [("EL1008".to_owned(), 2, 7), ("EL2008".to_owned(), 2, 8)];
        let error = compare(&[want(7), want(7)], &found).unwrap_err();
        assert_eq!(
            error.to_string(),
            "terminal 2 is EL2008 (vendor 0x2, product 0x00000008); the configuration names EL1008"
        );
        let error = compare(&[want(7)], &found).unwrap_err();
        assert_eq!(error, SessionError::Count { have: 2, want: 1 });
    }
}
