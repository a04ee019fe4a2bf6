//! The Modbus TCP server and the control port of the simulated I/O station.
//! One thread runs the server and all its connections; the control port has its own; the main thread waits for the end.

use super::control::{ControlError, IoCommand};
use super::options::Options;
use super::process_image::ProcessImage;
use crate::sim::control_socket::{self, ControlSocket};
use crate::sim::line_server;
use rcc_driver_kit::priority::set_realtime_priority;
use rcc_process::signals::{SignalError, Stop, StopsAtPanic, request_stop};
use std::future::Future;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use tokio::net::TcpStream;
use tokio_modbus::server::{Service, tcp::Server};
use tokio_modbus::{ExceptionCode, Request, Response};

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
    /// An address is in use or does not exist.
    #[error("{what} {address}: {source}")]
    Address {
        /// Option that gives the address.
        what: &'static str,
        /// The address.
        address: SocketAddr,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The operating system refuses a thread or a socket.
    #[error("system error: {0}")]
    System(#[from] io::Error),
    /// Signals cannot be handled.
    #[error(transparent)]
    Signals(#[from] SignalError),
}

/// State of the station, shared by server and control port.
#[derive(Debug)]
struct SimulatedIo {
    image: Mutex<ProcessImage>,
    faults: Mutex<InjectedFaults>,
}

/// Faults that were requested through the control port.
#[derive(Clone, Copy, Debug, Default)]
struct InjectedFaults {
    frozen_until: Option<Instant>,
    exception: Option<ExceptionCode>,
    delay: Duration,
    /// Number of further requests that get no answer.
    drop: u64,
}

/// Locks a mutex even after a panic: points are written completely or not at all.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs the simulator until SIGTERM, SIGINT, `quit` or, if requested, the end of its parent.
///
/// `ready` receives the line with the addresses of the Modbus server and the control port.
///
/// # Errors
/// Returns an error if the simulator could not start.
pub fn run(options: &Options, ready: impl FnOnce(&str)) -> Result<(), RunError> {
    let stop = Stop::prepare(options.parent_death)?;
    let io = Arc::new(SimulatedIo {
        image: Mutex::new(ProcessImage::new(options.wire.clone())),
        faults: Mutex::default(),
    });
    let listener = TcpListener::bind(options.bind).map_err(|source| RunError::Address {
        what: "--bind",
        address: options.bind,
        source,
    })?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let control = options.control.as_deref().map(|path| {
        let (listener, socket) = ControlSocket::bind(path)?;
        line_server::serve(listener, answer_with(io.clone()))?;
        Ok(socket)
    });
    let control = control.transpose().map_err(|source| RunError::Control {
        path: options.control.clone().unwrap_or_default(),
        source,
    })?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let priority = options.priority;
    thread::Builder::new()
        .name("modbus".into())
        .spawn(move || {
            let _stops = StopsAtPanic;
            if let Some(priority) = priority {
                set_realtime_priority(priority);
            }
            if let Err(error) = runtime.block_on(serve(listener, io)) {
                tracing::error!(%error, "the Modbus server has ended");
                request_stop();
            }
        })?;
    let place = control_socket::display_path(control.as_ref());
    ready(&format!("io-sim ready modbus={address} control={place}"));
    stop.wait();
    Ok(())
}

fn answer_with(io: Arc<SimulatedIo>) -> line_server::LineHandler {
    Arc::new(move |line| {
        let command: Result<IoCommand, _> = serde_json::from_str(line);
        let stop = matches!(command, Ok(IoCommand::Quit));
        let answer = command
            .map_err(ControlError::from)
            .and_then(|command| execute(&io, command));
        let line = answer.unwrap_or_else(|error| serde_json::json!({ "error": error.to_string() }));
        line_server::LineReply {
            line: line.to_string(),
            stop,
        }
    })
}

fn execute(io: &SimulatedIo, command: IoCommand) -> Result<serde_json::Value, ControlError> {
    match command {
        IoCommand::State => return Ok(serde_json::to_value(&*lock(&io.image))?),
        IoCommand::Set(input) => lock(&io.image).set(&input)?,
        IoCommand::FreezeMs(time_ms) => {
            lock(&io.faults).frozen_until =
                Instant::now().checked_add(Duration::from_millis(time_ms));
        }
        IoCommand::Exception(code) => lock(&io.faults).exception = exception(code)?,
        IoCommand::DelayMs(time_ms) => {
            lock(&io.faults).delay = Duration::from_millis(time_ms);
        }
        IoCommand::Drop(count) => lock(&io.faults).drop = count,
        IoCommand::Clear => *lock(&io.faults) = InjectedFaults::default(),
        IoCommand::Quit => {}
    }
    Ok(serde_json::json!({ "ok": true }))
}

fn exception(code: u8) -> Result<Option<ExceptionCode>, ControlError> {
    Ok(Some(match code {
        0 => return Ok(None),
        1 => ExceptionCode::IllegalFunction,
        2 => ExceptionCode::IllegalDataAddress,
        3 => ExceptionCode::IllegalDataValue,
        4 => ExceptionCode::ServerDeviceFailure,
        5 => ExceptionCode::Acknowledge,
        6 => ExceptionCode::ServerDeviceBusy,
        8 => ExceptionCode::MemoryParityError,
        10 => ExceptionCode::GatewayPathUnavailable,
        11 => ExceptionCode::GatewayTargetDevice,
        _ => return Err(ControlError::Exception(code)),
    }))
}

/// Serves the requests of one connection.
#[derive(Clone)]
struct Connection(Arc<SimulatedIo>);

impl Service for Connection {
    type Request = Request<'static>;
    type Response = Option<Response>;
    type Exception = ExceptionCode;
    type Future = Pin<Box<dyn Future<Output = Result<Option<Response>, ExceptionCode>> + Send>>;

    fn call(&self, request: Request<'static>) -> Self::Future {
        let io = self.0.clone();
        Box::pin(async move {
            // Copied first, so that no lock is held while waiting.
            let InjectedFaults {
                frozen_until,
                delay,
                ..
            } = *lock(&io.faults);
            if let Some(until) = frozen_until {
                tokio::time::sleep_until(until.into()).await;
            }
            if !delay.is_zero() {
                tokio::time::sleep(delay).await;
            }
            let exception = {
                let mut faults = lock(&io.faults);
                if faults.drop > 0 {
                    faults.drop -= 1;
                    return Ok(None);
                }
                faults.exception
            };
            match exception {
                Some(code) => Err(code),
                None => lock(&io.image).answer(&request).map(Some),
            }
        })
    }
}

async fn serve(listener: TcpListener, io: Arc<SimulatedIo>) -> io::Result<()> {
    let server = Server::new(tokio::net::TcpListener::from_std(listener)?);
    let connected = |stream: TcpStream, _peer: SocketAddr| {
        let connection = Connection(io.clone());
        async move {
            // A client that is already gone ends only its own connection, not the server.
            let _ = stream.set_nodelay(true);
            Ok(Some((connection, stream)))
        }
    };
    let failed = |error: io::Error| tracing::debug!(%error, "a connection has ended");
    server.serve(&connected, failed).await
}
