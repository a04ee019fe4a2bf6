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
use super::line::{Line, LineWire};
use super::options::Options;
use crate::raw_socket::SocketError;
use crate::wire::{Interface, PACKET_MAX, Socket};

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
    /// An end of a wire does not exist.
    #[error("--wire: output {} of terminal {} or input {} of terminal {} does not exist", .0.from.channel + 1, .0.from.position + 1, .0.to.channel + 1, .0.to.position + 1)]
    Wire(LineWire),
    /// The interface cannot be used.
    #[error("{0}")]
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
    let mut line = Line::new(&options.terminals);
    line.wires.clone_from(&options.wire);
    if let Some(wire) = line.loose_wire() {
        return Err(RunError::Wire(wire));
    }
    let simulated = Arc::new(SimulatedLine {
        line: Mutex::new(line),
        started: Instant::now(),
    });
    let interface = options.interface();
    let socket = Socket::line(&interface)?;
    // The number that the system has chosen, if it was 0.
    let interface = socket.address().map_or(interface, Interface::Udp);
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
        "ethercat-sim ready interface={interface} terminals={} control={place}",
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
fn serve(socket: &Socket, simulated: &SimulatedLine) -> io::Result<()> {
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

fn answer_all(
    socket: &Socket,
    simulated: &SimulatedLine,
    packet: &mut [u8; PACKET_MAX],
) -> io::Result<()> {
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
