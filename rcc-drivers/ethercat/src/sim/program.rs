//! The socket, the clock and the control port of the simulated line.
//! One thread answers frames; the control port has its own; the main thread waits for the end.

use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Instant;

use rcc_driver_kit::priority::set_realtime_priority;
use rcc_drivers::sim::control_socket::{self, ControlSocket};
use rcc_drivers::sim::line_server::{self, LineHandler, LineReply};
use rcc_process::log_throttle::LogThrottle;
use rcc_process::signals::{SignalError, Stop, StopsAtPanic, request_stop};

use super::control::{ControlError, LineCommand};
use super::line::Line;
use super::options::Options;
use super::raw_socket::{RawSocket, SocketError};

/// Largest Ethernet packet, without checksum, bytes.
const PACKET_MAX: usize = 1518;

/// Why the simulator could not start or continue.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The control port cannot be bound.
    #[error("--control {path}: {source}")]
    Control {
        /// Path of the socket.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The interface cannot be used.
    #[error("--nic: {0}")]
    Nic(#[from] SocketError),
    /// The operating system refuses a thread.
    #[error("system error: {0}")]
    System(#[from] io::Error),
    /// Signals cannot be handled.
    #[error(transparent)]
    Signals(#[from] SignalError),
}

/// The line and its clock.
#[derive(Debug)]
struct SimulatedLine {
    line: Mutex<Line>,
    started: Instant,
}

impl SimulatedLine {
    /// Locks the line even after a panic, which ends the process.
    fn lock(&self) -> MutexGuard<'_, Line> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Runs the simulator until SIGTERM, SIGINT, `quit` or, if requested, the end of its parent.
///
/// `ready` receives the line with the interface and the control port.
///
/// # Errors
/// Returns an error if the simulator could not start.
pub fn run(options: &Options, ready: impl FnOnce(&str)) -> Result<(), RunError> {
    let stop = Stop::prepare(options.parent_death)?;
    let simulated = Arc::new(SimulatedLine {
        line: Mutex::new(Line::new(&options.terminals)),
        started: Instant::now(),
    });
    let socket = RawSocket::bind(&options.nic)?;
    let control = options.control.as_deref().map(|path| {
        let (listener, socket) = ControlSocket::bind(path)?;
        line_server::serve(listener, answer_with(simulated.clone()))?;
        Ok(socket)
    });
    let control = control.transpose().map_err(|source| RunError::Control {
        path: options.control.clone().unwrap_or_default(),
        source,
    })?;
    let priority = options.priority;
    thread::Builder::new()
        .name("ethercat".into())
        .spawn(move || {
            let _stops = StopsAtPanic;
            if let Some(priority) = priority {
                set_realtime_priority(priority);
            }
            if let Err(error) = serve(&socket, &simulated) {
                tracing::error!(%error, "the line has ended");
                request_stop();
            }
        })?;
    let place = control_socket::display_path(control.as_ref());
    ready(&format!(
        "ethercat-sim ready nic={} terminals={} control={place}",
        options.nic,
        options.terminals.len()
    ));
    stop.wait();
    Ok(())
}

fn answer_with(simulated: Arc<SimulatedLine>) -> LineHandler {
    Arc::new(move |text| {
        let command: Result<LineCommand, _> = serde_json::from_str(text);
        let stop = matches!(command, Ok(LineCommand::Quit));
        let answer = command.map_err(ControlError::from).and_then(|command| {
            let mut line = simulated.lock();
            line.advance(simulated.started.elapsed());
            line.execute(&command)
        });
        let line = answer.unwrap_or_else(|error| serde_json::json!({ "error": error.to_string() }));
        LineReply {
            line: line.to_string(),
            stop,
        }
    })
}

/// Answers frames, and wakes up for watchdogs that expire.
fn serve(socket: &RawSocket, simulated: &SimulatedLine) -> io::Result<()> {
    let mut packet = [0; PACKET_MAX];
    let mut complaints = LogThrottle::default();
    loop {
        let deadline = simulated.lock().deadline();
        socket.wait(deadline.map(|at| at.saturating_sub(simulated.started.elapsed())))?;
        simulated.lock().advance(simulated.started.elapsed());
        if let Err(error) = answer_all(socket, simulated, &mut packet)
            && let Some(more) = complaints.admit(Instant::now())
        {
            // An interface that is down comes up again: a cable that was pulled.
            tracing::warn!(%error, more, "the network interface failed");
        }
    }
}

fn answer_all(socket: &RawSocket, simulated: &SimulatedLine, packet: &mut [u8]) -> io::Result<()> {
    while let Some(size) = socket.receive(packet)? {
        let Some(frame) = packet.get_mut(..size) else {
            continue;
        };
        let now = simulated.started.elapsed();
        // The lock is not held while sending.
        let returns = simulated.lock().exchange(frame, now);
        match returns {
            Ok(true) => socket.send(frame)?,
            Ok(false) => {}
            Err(reason) => tracing::trace!(%reason, "a packet was ignored"),
        }
    }
    Ok(())
}
