//! The driver `ethercat`: the process data of a line of EtherCAT terminals as digital and analog channels, and drives (CiA 402)
//! as the joints of a robot, see docs/ethercat.md.
//! Run by the host's thread, which waits in [`Driver::receive`] for the exchanges of the line's thread ([`line`]).
//!
//! The values of a cycle are sent with the next exchange. A lost exchange gives no values; after `lost_after` of them in a row
//! the device is lost, and the line gets the safe values. With drives a lost exchange is a pause: the host gives the next
//! exchange the set-points of the time that has passed. If their way is too long for one period, `axes` stops the drives.

use std::sync::Arc;
use std::time::{Duration, Instant};

use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkDiagnosis, LinkError, Outputs,
};
use rcc_driver_kit::rcc_config::DeviceConfig;
use rcc_driver_kit::rcc_core::impedance::ControlMode;

pub mod address;
pub mod axes;
pub mod axis_settings;
pub mod counters;
pub mod line;
pub mod points;
pub mod power_state;
pub mod reasons;
pub mod settings;
pub mod terminal_settings;

pub use reasons::REASONS;

use crate::session::{Cycle, ExpectedTerminal, Loss, ObjectValue, SessionOptions};
use axes::Axes;
use counters::LineCounters;
use line::{LineState, LineThread};
use points::Points;
use settings::EthercatSettings;
use terminal_settings::TerminalSettings;

/// Name of the driver in a cell's configuration.
pub const NAME: &str = "ethercat";
/// Length of the history that gives the quality, exchanges.
const HISTORY: u32 = u64::BITS;

/// The driver of one line.
#[derive(Debug)]
pub struct Ethercat {
    settings: EthercatSettings,
    points: Points,
    axes: Axes,
    counters: Arc<LineCounters>,
    silence_max: Duration,
    /// Present from the first exchange on: it inherits the priority of the host's thread.
    line: Option<LineThread>,
    /// Number of the last exchange that the host got, and its time.
    seen: u64,
    seen_at: Option<Instant>,
    /// Time of the last complete exchange.
    complete_at: Instant,
    /// Lost exchanges in a row.
    lost: u32,
    /// Bit 0: the last exchange was complete; bit 1: the one before; and so on.
    history: u64,
    /// Outputs that a net has commanded since the terminals last switched off: bits of the digital and the analog ones.
    commanded: [u64; 2],
    /// The reason of the loss that the host knows.
    told: u32,
    /// Periods of exchanges without values since the last one with values; with drives only.
    skipped: u64,
    late: u64,
}

impl Driver for Ethercat {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let settings = EthercatSettings::new(device)?;
        let points = Points::new(device, &settings)?;
        let unlike: Vec<&str> = points.unlike_watchdog().collect();
        if !unlike.is_empty() {
            tracing::warn!(
                "without communication the terminals switch off what has another `on_release`: {}",
                unlike.join(", ")
            );
        }
        let period_s = settings.period.as_secs_f64();
        let way_max = device.model().limits.velocity_max.map(|v| v * period_s);
        let command_timeout = Duration::from_nanos(device.command_timeout_ns);
        Ok(Ethercat {
            counters: Arc::new(LineCounters::new(&settings)),
            silence_max: command_timeout.max(5 * settings.period),
            axes: Axes::new(settings.axes.clone(), way_max, points.enable()),
            settings,
            points,
            line: None,
            seen: 0,
            seen_at: None,
            complete_at: Instant::now(),
            lost: 0,
            history: u64::MAX,
            commanded: [0; 2],
            told: 0,
            skipped: 0,
            late: 0,
        })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let deadline = Instant::now() + timeout;
        let shared = match &self.line {
            Some(line) => Arc::clone(&line.shared),
            None => self.start(deadline)?,
        };
        let mut state = shared.lock();
        let mut waits = true;
        loop {
            if state.number != self.seen {
                return self.take(&mut state, inputs);
            }
            if !waits || state.reason != 0 && state.reason != self.told {
                break;
            }
            (state, waits) = shared.wait(state, deadline);
        }
        self.told = state.reason;
        match state.reason {
            0 => Err(LinkError::Silent),
            reason => {
                // The values of before are no longer those of the line.
                self.history = 0;
                Err(LinkError::Lost { reason })
            }
        }
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        if let Some(line) = &self.line {
            let mut state = line.shared.lock();
            let state = &mut *state;
            if !state.driven {
                // The terminals have switched off since the last outputs.
                self.commanded = [0; 2];
            }
            self.commanded[0] |= outputs.digital_commanded;
            self.commanded[1] |= outputs.analog_commanded;
            let outputs = self.points.without_old(outputs, self.commanded);
            self.points.put(&outputs, &mut state.image);
            self.axes.write(&outputs, &mut state.image);
            for (released, sent) in state.released.iter_mut().zip(&state.image) {
                released.outputs.copy_from_slice(&sent.outputs);
            }
            self.points.release(&mut state.released);
            state.driven = true;
            state.sent = Instant::now();
        }
        Ok(())
    }

    fn release(&mut self) {
        self.axes.release();
    }

    fn diagnosis(&self) -> Option<Arc<dyn LinkDiagnosis>> {
        Some(Arc::<LineCounters>::clone(&self.counters))
    }
}

impl Ethercat {
    /// Starts the line's thread.
    fn start(&mut self, deadline: Instant) -> Result<Arc<line::Shared>, LinkError> {
        let line = LineThread::start(
            self.options(),
            self.points.clone(),
            Arc::clone(&self.counters),
            self.silence_max,
        );
        match line {
            Ok(line) => Ok(Arc::clone(&self.line.insert(line).shared)),
            Err(error) => {
                tracing::warn!(%error, "no thread for the EtherCAT line");
                std::thread::sleep(deadline.saturating_duration_since(Instant::now()));
                Err(LinkError::Lost {
                    reason: reasons::THREAD,
                })
            }
        }
    }

    fn options(&self) -> SessionOptions {
        let terminals = self.settings.terminals.iter().zip(0..);
        let line = terminals.map(|(terminal, position)| ExpectedTerminal {
            name: format!("{}, {}", terminal.name, terminal.type_name()),
            vendor: terminal.vendor,
            product: terminal.product,
            watchdog: Some(self.settings.watchdog),
            objects: self.objects(position, terminal),
            sync0: terminal.sync0,
        });
        SessionOptions {
            interface: self.settings.interface.clone(),
            line: line.collect(),
            period: self.settings.period,
            timeout: self.settings.timeout,
            clocks: self.settings.clocks,
        }
    }

    /// Returns the objects that the terminal at `position` needs.
    fn objects(&self, position: usize, terminal: &TerminalSettings) -> Vec<ObjectValue> {
        let mut objects = self.points.default_outputs(position, terminal);
        let axes = self.settings.axes.iter();
        for axis in axes.filter(|axis| axis.place.terminal == position) {
            objects.extend(axis.objects(self.settings.period));
        }
        objects
    }

    /// Takes a new exchange.
    fn take(&mut self, state: &mut LineState, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let exchanges = state.number - self.seen;
        self.seen = state.number;
        let ticks = self.ticks(state.at, exchanges);
        self.late += ticks - 1;
        let (complete, reason) = match state.cycle {
            Cycle::Complete => (true, 0),
            Cycle::InputsOnly => (true, reasons::STARTING),
            Cycle::First | Cycle::Lost(Loss::Starting) => (false, reasons::STARTING),
            Cycle::Lost(loss) => {
                self.lost += 1;
                self.history <<= 1;
                // The host counts a device without exchanges for this time as lost; it must not come and go.
                let silent = self.complete_at.elapsed() >= self.silence_max;
                if self.lost >= self.settings.lost_after || silent {
                    return Err(self.lose(state, loss));
                }
                (false, 0)
            }
        };
        let period_ns = u64::try_from(self.settings.period.as_nanos()).unwrap_or(u64::MAX);
        if complete {
            self.lost = 0;
            self.complete_at = Instant::now();
            self.history = self.history << 1 | 1;
            self.points.inputs(&state.image, inputs);
        } else if self.axes.is_empty() {
            *inputs = Inputs::NONE;
        } else {
            // The next exchange has the time of this one.
            self.skipped += ticks;
            return Err(LinkError::Silent);
        }
        let ticks = ticks + std::mem::take(&mut self.skipped);
        self.told = reason;
        let (commandable, reason) = match self.axes.is_empty() {
            true => (true, reason),
            false => self.take_axes(state, inputs, (reason == 0, ticks * period_ns)),
        };
        Ok(Exchange {
            commandable,
            startable: reason == 0,
            strategy: ControlMode::Position,
            mirror: self.axes.hold(),
            ticks,
            period_ns,
            quality_permille: self.history.count_ones() * 1000 / HISTORY,
            reason,
            late: self.late + self.counters.lost(),
            refused: self.counters.refused(),
        })
    }

    /// Takes what the drives show in a complete exchange, in OP or not, and the time since the one before, ns. Returns whether
    /// they follow set-points, and the reason if not.
    fn take_axes(
        &mut self,
        state: &mut LineState,
        inputs: &mut Inputs,
        (in_op, passed_ns): (bool, u64),
    ) -> (bool, u32) {
        if std::mem::take(&mut state.silenced) {
            self.axes.lose();
        }
        self.axes.read(&state.image, passed_ns, in_op);
        self.axes.inputs(inputs);
        self.counters.drives(self.axes.drives());
        let reason = match in_op {
            true => self.axes.reason(),
            false => reasons::STARTING,
        };
        (reason == 0, reason)
    }

    /// The device is lost: the line gets the safe values, since the host sends nothing.
    fn lose(&mut self, state: &mut LineState, loss: Loss) -> LinkError {
        let reason = reasons::of_loss(loss);
        if self.told != reason {
            tracing::warn!(
                ?loss,
                "the EtherCAT line is lost after {} lost exchanges",
                self.lost
            );
        }
        self.told = reason;
        self.counters.set_reason(reason);
        self.points.release(&mut state.image);
        self.axes.lose();
        LinkError::Lost { reason }
    }

    /// Returns the number of periods since the exchange before, at least 1.
    fn ticks(&mut self, at: Instant, exchanges: u64) -> u64 {
        let before = self.seen_at.replace(at);
        let passed = before.map_or(Duration::ZERO, |before| {
            at.saturating_duration_since(before)
        });
        let period = self.settings.period.as_nanos().max(1);
        let periods = (passed.as_nanos() + period / 2) / period;
        u64::try_from(periods)
            .unwrap_or(u64::MAX)
            .max(exchanges)
            .max(1)
    }
}

#[cfg(test)]
mod conforms;
