//! The driver `modbus`: digital and analog I/O of one or several Modbus TCP servers, exchanged once per period.
//! Run by the host's thread alone, which waits for all servers at once; see docs/modbus.md.
//!
//! An unreachable server is not a configuration error: the device is offline, and the driver tries again. The device is
//! only as good as its worst server: while one is lost, the others get the values of `on_release`.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nix::poll::{PollFd, ppoll};
use nix::sys::time::TimeSpec;
use rcc_config::DeviceConfig;
use rcc_core::impedance::ControlMode;
use rcc_core::message::JOINTS_MAX;

use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkDiagnosis, LinkError, Outputs,
};
use rcc_driver_kit::host::reason::Reason;

pub mod address;
pub mod connection;
pub mod counters;
pub mod fault;
pub mod frame;
pub mod points;
pub mod server;
pub mod settings;
pub mod value;

pub use fault::REASONS;

use address::Address;
use connection::Connection;
use counters::{ModbusCounters, RoundDelay};
use fault::NAMED;
use points::Points;
use server::Server;
use settings::{ModbusSettings, SERVERS_MAX, ServerSettings};

/// At the end, time for one more connection attempt to a server that is not connected.
const FINAL_CONNECT: Duration = Duration::from_secs(1);
/// Longest wait for lost servers at the end, unless a time-out is longer: the supervisor kills the driver after 2 s.
const FINAL_WAIT_MAX: Duration = Duration::from_millis(1500);

/// A poll round in which all servers have been asked.
#[derive(Clone, Copy, Debug)]
struct PollRound {
    /// Servers that are late are not waited for after this time.
    collect_by: Instant,
    /// Bit i: server i has been asked in this round.
    asked: u32,
    /// The exchange of this round has been returned to the host.
    collected: bool,
}

/// The driver with the connections to all its servers.
#[derive(Debug)]
pub struct Modbus {
    connections: Vec<Connection>,
    period: Duration,
    /// Values of the outputs without a command.
    released: Outputs,
    outputs: Outputs,
    /// Start of the next round.
    next: Instant,
    round: Option<PollRound>,
    ticks: u64,
    late: u64,
    lost: bool,
    report: Arc<ModbusCounters>,
}

impl Driver for Modbus {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let settings = ModbusSettings::new(device)?;
        if device.robot.is_some() {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "Modbus does not support robots: remove `robot`, or choose another driver",
            });
        }
        let points = Points::new(device, &settings.servers)?;
        for (server, points) in settings.servers.iter().zip(&points) {
            check_watchdog(device, server, points)?;
        }
        let now = Instant::now();
        let released = points::released(device);
        let servers = settings.servers.into_iter().zip(points).zip(1..);
        let connections = servers.map(|((settings, points), place)| {
            let seed = u64::from(std::process::id()) << 8 | place;
            Connection::new(Server::new(settings, points, released, now), seed, now)
        });
        let connections: Vec<Connection> = connections.collect();
        let servers = connections.iter().map(|one| Arc::clone(one.counters()));
        let report = ModbusCounters {
            servers: servers.collect(),
            begun_late: RoundDelay::default(),
        };
        Ok(Self {
            report: Arc::new(report),
            connections,
            period: settings.period,
            released,
            outputs: released,
            next: now,
            round: None,
            ticks: 0,
            late: 0,
            lost: false,
        })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let deadline = Instant::now() + timeout;
        loop {
            let now = Instant::now();
            self.drive(now);
            let online = self.connections.iter().all(Connection::is_online);
            if online {
                self.lost = false;
                if let Some(exchange) = self.collect(now, inputs) {
                    return Ok(exchange);
                }
            } else {
                self.release_all(now);
                let reason = self.reason();
                // A loss is returned at once, and then at each deadline.
                if reason != 0 && (now >= deadline || !self.lost) {
                    self.lost = true;
                    return Err(LinkError::Lost { reason });
                }
            }
            if now >= deadline {
                return Err(LinkError::Silent);
            }
            self.wait(now, deadline);
        }
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        let now = Instant::now();
        self.outputs = *outputs;
        for connection in &mut self.connections {
            connection.server.command(outputs, now);
            connection.advance(now);
        }
        match self.reason() {
            0 => Ok(()),
            reason => Err(LinkError::Lost { reason }),
        }
    }

    fn release(&mut self) {}

    fn diagnosis(&self) -> Option<Arc<dyn LinkDiagnosis>> {
        Some(Arc::<ModbusCounters>::clone(&self.report))
    }

    fn reasons(&self) -> Option<&'static [Reason]> {
        let names = self.connections.iter().zip(1..).filter_map(|(one, place)| {
            let name = one.server.settings().name.as_deref()?;
            Some((name, place))
        });
        let reasons: Vec<Reason> = names
            .flat_map(|(name, place)| {
                REASONS.iter().map(move |(number, words)| {
                    // Leaked: called once, and used for the rest of the process's life.
                    let words: &'static str = format!("server '{name}': {words}").leak();
                    (number + place * NAMED, words)
                })
            })
            .collect();
        (!reasons.is_empty()).then(|| &*reasons.leak())
    }
}

impl Modbus {
    /// Starts a round when it is due, and does everything on the connections that does not block.
    fn drive(&mut self, now: Instant) {
        if now >= self.next {
            let behind = now.saturating_duration_since(self.next);
            let skipped = behind.as_nanos() / self.period.as_nanos().max(1);
            let skipped = u32::try_from(skipped).unwrap_or(u32::MAX - 1);
            self.end_round();
            self.report.begun_late.count(behind);
            self.next += self.period.saturating_mul(skipped + 1);
            self.ticks += u64::from(skipped) + 1;
            self.late += u64::from(skipped);
            let mut asked = 0;
            for (connection, place) in self.connections.iter_mut().zip(0..) {
                asked |= u32::from(connection.tick(now)) << place;
            }
            self.round = Some(PollRound {
                collect_by: now + self.period / 2,
                asked,
                collected: false,
            });
        }
        for connection in &mut self.connections {
            connection.advance(now);
        }
    }

    /// Returns the exchange of a round once all servers have been read, or no server is waited for any longer.
    fn collect(&mut self, now: Instant, inputs: &mut Inputs) -> Option<Exchange> {
        let round = self.round.as_mut().filter(|round| !round.collected)?;
        let mut asked = self.connections.iter().zip(0..);
        let awaited = asked.any(|(connection, place)| {
            round.asked >> place & 1 == 1 && connection.quick && !connection.server.has_read()
        });
        let fresh = self.connections.iter().any(|one| one.server.is_fresh());
        // Without any new inputs there is no exchange.
        if (awaited && now < round.collect_by) || !fresh {
            return None;
        }
        round.collected = true;
        for connection in &mut self.connections {
            connection.server.take_inputs(inputs);
        }
        let counts = self.connections.iter().map(|one| one.server.counts());
        let quality = self.connections.iter().map(Connection::quality).min();
        Some(Exchange {
            strategy: ControlMode::Position,
            commandable: true,
            startable: true,
            mirror: [0.0; JOINTS_MAX],
            ticks: std::mem::take(&mut self.ticks).max(1),
            period_ns: u64::try_from(self.period.as_nanos()).unwrap_or(u64::MAX),
            quality_permille: quality.unwrap_or(0),
            reason: 0,
            late: self.late + counts.clone().map(|counts| counts.late).sum::<u64>(),
            refused: counts.map(|counts| counts.discarded).sum(),
        })
    }

    /// Ends a round: servers that have been read by now were in time.
    fn end_round(&mut self) {
        let Some(round) = self.round.take() else {
            return;
        };
        for (connection, place) in self.connections.iter_mut().zip(0..) {
            let in_time = round.asked >> place & 1 == 1 && connection.server.has_read();
            connection.quick = in_time;
            connection.count_round(in_time);
        }
    }

    /// Writes the values of `on_release` to the reachable servers, since a device with a lost server is not commanded.
    fn release_all(&mut self, now: Instant) {
        self.outputs = self.released;
        for connection in &mut self.connections {
            let waits = connection.server.is_waiting();
            connection.server.command(&self.released, now);
            if waits {
                connection.advance(now);
            }
        }
    }

    /// Returns why the device is lost; 0 = not lost, or not known yet.
    fn reason(&self) -> u32 {
        let reasons = self.connections.iter().zip(1..).map(|(connection, place)| {
            match (connection.fault(), &connection.server.settings().name) {
                (0, _) => 0,
                (fault, None) => fault,
                (fault, Some(_)) => fault + place * NAMED,
            }
        });
        reasons.into_iter().find(|reason| *reason != 0).unwrap_or(0)
    }

    fn wait(&self, now: Instant, deadline: Instant) {
        let mut until = deadline.min(self.next);
        if let Some(round) = self.round.filter(|round| round.collect_by > now) {
            until = until.min(round.collect_by);
        }
        for wake in self.connections.iter().filter_map(|one| one.wake(now)) {
            until = until.min(wake);
        }
        let left = TimeSpec::from_duration(until.saturating_duration_since(now));
        // A signal or an error ends the wait early; the loop then checks everything again.
        let mut open = self.connections.iter().filter_map(|one| one.events(now));
        let _ = match open.next() {
            None => ppoll(&mut [], Some(left), None),
            Some((descriptor, flags)) => {
                let mut polled: [PollFd<'_>; SERVERS_MAX] =
                    std::array::from_fn(|_| PollFd::new(descriptor, flags));
                let mut count = 1;
                for ((descriptor, flags), place) in open.zip(&mut polled[1..]) {
                    *place = PollFd::new(descriptor, flags);
                    count += 1;
                }
                ppoll(&mut polled[..count], Some(left), None)
            }
        };
    }
}

impl Drop for Modbus {
    /// Sends the last outputs. A server that is lost, also meanwhile, is sent each safe value once if it can be
    /// reached.
    fn drop(&mut self) {
        let start = Instant::now();
        let longest = self
            .connections
            .iter()
            .map(|one| one.server.settings().timeout);
        let longest = longest.max().unwrap_or_default();
        let deadline = start + longest.max((3 * longest + FINAL_CONNECT).min(FINAL_WAIT_MAX));
        self.next = deadline;
        self.round = None;
        let mut finished = vec![false; self.connections.len()];
        self.connections
            .iter_mut()
            .for_each(|one| one.skip_pause(start));
        loop {
            let now = Instant::now();
            for (connection, finished) in self.connections.iter_mut().zip(&mut finished) {
                connection.advance(now);
                if connection.is_open() && !*finished && connection.server.may_finish() {
                    connection.server.finish(&self.outputs, now);
                    connection.advance(now);
                    *finished = true;
                }
            }
            let mut all = self.connections.iter().zip(&finished);
            let done = all.all(|(one, finished)| {
                (one.is_open() && *finished && one.server.is_idle()) || one.is_finished()
            });
            if now >= deadline || done {
                return;
            }
            let lost = self.connections.iter_mut().filter(|one| !one.is_finished());
            lost.for_each(|one| one.skip_pause(now));
            self.wait(now, deadline);
        }
    }
}

/// Checks that no channel writes to the address of the watchdog.
fn check_watchdog(
    device: &DeviceConfig,
    server: &ServerSettings,
    points: &Points,
) -> Result<(), DriverError> {
    let Some(watchdog) = &server.watchdog else {
        return Ok(());
    };
    let taken = points.outputs.iter().find(|output| {
        let end = u32::from(output.address) + u32::from(output.width());
        let Address { table, number, .. } = watchdog.address;
        output.table == table && (u32::from(output.address)..end).contains(&u32::from(number))
    });
    let Some(output) = taken else { return Ok(()) };
    let server = server.name.as_ref().map(|name| format!("servers.{name}."));
    Err(DriverError::Setting {
        device: device.name.clone(),
        key: format!("{}watchdog.address", server.unwrap_or_default()),
        cause: format!(
            "{} is written by the output {}",
            watchdog.address, output.name
        ),
        expected: "an address that no channel has",
    })
}

#[cfg(test)]
mod conforms;
#[cfg(test)]
mod tests;
