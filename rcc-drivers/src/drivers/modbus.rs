//! The driver `modbus`: digital and analog I/O of a Modbus TCP server, read and written once a period.
//! Run by the host's thread, which waits inside for each transaction (a current-thread tokio runtime).
//!
//! A server that is not reached is no fault of the configuration: the device is offline, and the driver tries again.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use rcc_config::DeviceConfig;
use rcc_core::message::JOINTS_MAX;

use crate::driver::{Driver, DriverError, Exchange, Inputs, LinkError, Outputs, Settings};
use crate::host::reason::Reason;

mod link;
pub mod points;

use link::{Link, LinkFault};
use points::Points;

/// No connection.
pub const UNREACHABLE: u32 = 100;
/// No answer in time.
pub const TIMEOUT: u32 = 101;
/// The server answers with an exception.
pub const REFUSED: u32 = 102;

/// What the numbers mean.
pub const REASONS: &[Reason] = &[
    (
        UNREACHABLE,
        "the Modbus server is not reached at settings.server",
    ),
    (
        TIMEOUT,
        "the Modbus server does not answer within settings.timeout",
    ),
    (
        REFUSED,
        "the Modbus server refuses an address or a value; see the driver's log",
    ),
];

/// First and longest pause between two attempts to connect.
const BACK_OFF: [Duration; 2] = [Duration::from_millis(50), Duration::from_secs(2)];

/// The driver.
#[derive(Debug)]
pub struct Modbus {
    runtime: tokio::runtime::Runtime,
    server: SocketAddr,
    unit: u8,
    period: Duration,
    timeout: Duration,
    points: Points,
    link: Option<Link>,
    back_off: Duration,
    /// The next cycle, or the next attempt to connect.
    next: Instant,
    fault: u32,
    late: u64,
}

impl Driver for Modbus {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let mut settings = Settings::of(device);
        let server = settings.address("server", None)?;
        let unit = settings.read("unit", "a unit number, 0 to 255", Some(255), |value| {
            u8::try_from(value.as_u64()?).ok()
        })?;
        let period = settings.duration("period", Duration::from_millis(10))?;
        let timeout = settings.duration("timeout", Duration::from_millis(100))?;
        settings.finish()?;
        if device.robot.is_some() {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "Modbus moves no robot: leave it out, or name another driver",
            });
        }
        let points = Points::new(device)?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|source| DriverError::System {
                device: device.name.clone(),
                key: "server",
                value: server.to_string(),
                source,
            })?;
        Ok(Self {
            runtime,
            server,
            unit,
            period,
            timeout,
            points,
            link: None,
            back_off: BACK_OFF[0],
            next: Instant::now(),
            fault: 0,
            late: 0,
        })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let left = self.next.saturating_duration_since(Instant::now());
        std::thread::sleep(left.min(timeout));
        if left > timeout {
            return Err(match self.fault {
                0 => LinkError::Silent,
                reason => LinkError::Lost { reason },
            });
        }
        if self.link.is_none() {
            self.connect()?;
        }
        let ticks = self.schedule();
        let Some(link) = &mut self.link else {
            return Err(LinkError::Lost {
                reason: UNREACHABLE,
            });
        };
        let read = self
            .runtime
            .block_on(link.read(&self.points, self.timeout, inputs));
        read.map_err(|fault| self.lose(&fault))?;
        if self.fault != 0 {
            tracing::info!(server = %self.server, "the Modbus server answers");
            self.fault = 0;
        }
        self.back_off = BACK_OFF[0];
        Ok(Exchange {
            commandable: true,
            startable: true,
            mirror: [0.0; JOINTS_MAX],
            ticks,
            period_ns: u64::try_from(self.period.as_nanos()).unwrap_or(u64::MAX),
            quality_permille: 1000,
            reason: 0,
            late: self.late,
            refused: 0,
        })
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        let Some(link) = &mut self.link else {
            return Err(LinkError::Lost {
                reason: UNREACHABLE,
            });
        };
        let written = self
            .runtime
            .block_on(link.write(&self.points, self.timeout, outputs));
        written.map_err(|fault| self.lose(&fault))
    }

    fn release(&mut self) {}
}

impl Modbus {
    /// A new connection; every output is written on it, as nobody knows what the server has done meanwhile.
    fn connect(&mut self) -> Result<(), LinkError> {
        let attempt = Link::connect(self.server, self.unit, self.timeout);
        match self.runtime.block_on(attempt) {
            Ok(link) => {
                self.link = Some(link);
                self.next = Instant::now();
                Ok(())
            }
            Err(fault) => Err(self.lose(&fault)),
        }
    }

    /// Sets the next cycle; says how many periods lie between the last one and this one.
    fn schedule(&mut self) -> u64 {
        let behind = Instant::now().saturating_duration_since(self.next);
        let skipped = behind.as_nanos() / self.period.as_nanos().max(1);
        let skipped = u32::try_from(skipped).unwrap_or(u32::MAX - 1);
        self.next += self.period.saturating_mul(skipped + 1);
        self.late += u64::from(skipped);
        u64::from(skipped) + 1
    }

    /// Without a connection until the pause is over; what is wrong is said once.
    fn lose(&mut self, fault: &LinkFault) -> LinkError {
        let reason = match fault {
            LinkFault::Connect(_) | LinkFault::Transport(_) => UNREACHABLE,
            LinkFault::Timeout { .. } => TIMEOUT,
            LinkFault::Exception { .. } => REFUSED,
        };
        if self.fault != reason {
            tracing::warn!(server = %self.server, "{fault}; trying again");
            self.fault = reason;
        }
        self.link = None;
        self.next = Instant::now() + self.back_off;
        self.back_off = (2 * self.back_off).min(BACK_OFF[1]);
        LinkError::Lost { reason }
    }
}

#[cfg(test)]
mod tests;
