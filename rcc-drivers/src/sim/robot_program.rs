//! Sockets, clock and threads of a simulated robot controller; [`Controller`] is its model in virtual time.
//! The clock thread sleeps until an absolute deadline, takes the datagrams that have arrived, ticks and sends. The
//! receiver thread takes datagrams with the kernel's stamp of their arrival. If a busy machine kept the receiver from
//! running, the clock thread reads the datagrams from the socket itself: only an answer that did not arrive counts as
//! missed.
//!
//! After a stall of the machine the clock continues at the next deadline that is at least half a period away: ticks are
//! skipped, never sent in a burst, and the sequence numbers show the length of the stall, as those of a real controller
//! would.

use super::control_socket::{self, ControlFolder, ControlSocket};
use super::line_server;
use super::network::Network;
use super::requests::{ControlAnswer, RequestError, TraceRequest, to_line};
use super::trace::{TraceError, TraceRecord, TraceSink};
use nix::errno::Errno;
use nix::sys::socket::sockopt::ReceiveTimestampns;
use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrStorage, recvmsg, setsockopt};
use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};
use rcc_driver_kit::priority::set_realtime_priority;
use rcc_process::signals::{SignalError, Stop, StopsAtPanic, request_stop};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::error::Error;
use std::fmt::Display;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::AsRawFd;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

/// Size of the buffer for a datagram; longer ones are truncated, and no protocol here has a datagram of this size.
const BUFFER: usize = 2048;
/// Capacity of the queue from the receiver to the clock thread, datagrams.
const ARRIVALS: usize = 64;
/// Most commands that the clock thread executes per tick.
const REQUESTS_PER_TICK: usize = 4;
/// Greatest age of a datagram that is believed, ns: an older one shows that CLOCK_REALTIME has been set meanwhile.
const AGE_MAX_NS: i64 = 1_000_000_000;

/// A robot controller in virtual time: it sends first, and moves a simulated arm.
pub trait Controller: Send + 'static {
    /// Request at the control port.
    type Request: DeserializeOwned + Send + 'static;
    /// Why a request is refused.
    type Refusal: From<RequestError> + Display + Send + 'static;
    /// The whole state, for the control port.
    type State: Serialize + Send + 'static;
    /// A datagram to the PC.
    type Datagram: AsRef<[u8]>;
    /// Why a datagram of the PC is not taken.
    type NotTaken: Display;

    /// Period of its datagrams, s.
    fn period_s(&self) -> f64;

    /// Returns what a request asks of the trace, which the clock thread knows nothing about.
    fn trace_request(request: &Self::Request) -> Option<TraceRequest>;

    /// Executes a request.
    ///
    /// # Errors
    /// Returns why it is refused; nothing has changed then.
    fn execute(
        &mut self,
        request: Self::Request,
    ) -> Result<ControlAnswer<Self::State>, Self::Refusal>;

    /// Ends the cycle and starts the next, `periods` after the last one; returns the next datagram, or `None` if none is
    /// sent.
    fn tick(&mut self, periods: u64) -> Option<Self::Datagram>;

    /// Processes a datagram that arrived `delay_s` seconds after the last one was sent.
    ///
    /// # Errors
    /// Returns why it is not taken; it has been counted then.
    fn receive(&mut self, bytes: &[u8], delay_s: f64) -> Result<(), Self::NotTaken>;

    /// Counts a datagram from another address.
    fn receive_foreign(&mut self);

    /// Returns the simulated faults of the network.
    fn network(&mut self) -> &mut Network;

    /// Returns the datagrams of the cycle that the last tick has ended.
    fn exchanged(&self) -> Option<&TraceRecord>;

    /// Returns true once it has ended its program, and the simulator with it.
    fn is_closed(&self) -> bool;
}

/// The options that every simulated robot has.
#[derive(Clone, Copy, Debug)]
pub struct Common<'a> {
    /// Name of the program.
    pub program: &'static str,
    /// Where the PC listens.
    pub driver: SocketAddr,
    /// Address to send from.
    pub bind: SocketAddr,
    /// Control port.
    pub control: Option<&'a std::path::Path>,
    /// File of the trace.
    pub trace: Option<&'a std::path::Path>,
    /// SCHED_FIFO priority of the clock thread.
    pub priority: Option<u8>,
    /// Ends when the thread that started it ends.
    pub parent_death: bool,
}

/// Why the simulator could not start or continue.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// An option is invalid.
    #[error(transparent)]
    Option(Box<dyn Error + Send + Sync>),
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
    /// The control port cannot be bound.
    #[error("--control {path}: {source}")]
    Control {
        /// Path of the socket.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The operating system refuses a thread or a socket option.
    #[error("system error: {0}")]
    System(#[from] io::Error),
    /// The operating system refuses access to the clock.
    #[error("system error: {0}")]
    Clock(#[from] Errno),
    /// Signals cannot be handled.
    #[error(transparent)]
    Signals(#[from] SignalError),
    /// The trace cannot be written.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// A thread has panicked.
    #[error("the simulator's {0} thread has died")]
    Thread(&'static str),
}

/// A datagram with its time of arrival.
struct ReceivedDatagram {
    bytes: [u8; BUFFER],
    length: usize,
    foreign: bool,
    /// CLOCK_MONOTONIC of the arrival, ns.
    time_ns: i64,
}

type Answer<C> = Result<ControlAnswer<<C as Controller>::State>, <C as Controller>::Refusal>;
type Request<C> = (<C as Controller>::Request, SyncSender<Answer<C>>);

/// Runs the simulator until SIGTERM, SIGINT, `quit` or, if requested, the end of its parent.
///
/// `ready` receives the line with the address that it sends from and that of its control port.
///
/// # Errors
/// Returns an error if the simulator could not start, or if a thread has died.
pub fn run<C: Controller>(
    controller: C,
    options: &Common<'_>,
    ready: impl FnOnce(&str),
) -> Result<(), RunError> {
    let stop = Stop::prepare(options.parent_death)?;
    let socket = UdpSocket::bind(options.bind).map_err(|source| RunError::Address {
        what: "--bind",
        address: options.bind,
        source,
    })?;
    setsockopt(&socket, ReceiveTimestampns, &true)?;
    let trace = TraceSink::start()?;
    if let Some(path) = options.trace {
        trace.open(path.to_owned())?;
    }
    let (requests, commands) = sync_channel(16);
    let control = options.control.map(|path| {
        let (listener, socket) = ControlSocket::bind(path)?;
        let answer = answer_with::<C>(requests, trace.clone(), socket.folder().clone());
        line_server::serve(listener, answer)?;
        Ok(socket)
    });
    let control = control.transpose().map_err(|source| RunError::Control {
        path: options.control.map(PathBuf::from).unwrap_or_default(),
        source,
    })?;
    let ending = Arc::new(AtomicBool::new(false));
    let (arrived, arrivals) = sync_channel(ARRIVALS);
    let receiver = {
        let (socket, driver, ending) = (socket.try_clone()?, options.driver, ending.clone());
        socket.set_read_timeout(Some(Duration::from_millis(100)))?;
        thread::Builder::new()
            .name("receive".into())
            .spawn(move || {
                let _stops = StopsAtPanic;
                receive(&socket, driver, &arrived, &ending);
            })?
    };
    let address = socket.local_addr()?;
    let clock = {
        let ending = ending.clone();
        let mut clock = ClockThread {
            controller,
            socket,
            driver: options.driver,
            arrivals,
            commands,
            trace: trace.clone(),
            sent_ns: 0,
            not_taken: 0,
        };
        let priority = options.priority;
        thread::Builder::new().name("clock".into()).spawn(move || {
            let _stops = StopsAtPanic;
            if let Some(priority) = priority {
                set_realtime_priority(priority);
            }
            let result = clock.run(&ending);
            request_stop();
            result
        })?
    };
    let place = control_socket::display_path(control.as_ref());
    let (program, driver) = (options.program, options.driver);
    ready(&format!(
        "{program} ready fri={address} driver={driver} control={place}"
    ));
    stop.wait();
    // Release pairs with the Acquire loads of the clock and receiver threads; it publishes no other data.
    ending.store(true, Ordering::Release);
    clock.join().map_err(|_| RunError::Thread("clock"))??;
    receiver.join().map_err(|_| RunError::Thread("receive"))?;
    Ok(trace.close()?)
}

/// Handles requests at the control port: trace commands here, all others on the clock thread.
fn answer_with<C: Controller>(
    requests: SyncSender<Request<C>>,
    trace: TraceSink,
    folder: ControlFolder,
) -> line_server::LineHandler {
    Arc::new(move |line| {
        let command =
            serde_json::from_str(line).map_err(|error| C::Refusal::from(RequestError::from(error)));
        let answer =
            command.and_then(|command| answer_command::<C>(command, &requests, &trace, &folder));
        // `quit` ends the clock thread after its closing cycles, and that ends the process.
        line_server::LineReply {
            line: to_line(answer),
            stop: false,
        }
    })
}

fn answer_command<C: Controller>(
    command: C::Request,
    requests: &SyncSender<Request<C>>,
    trace: &TraceSink,
    folder: &ControlFolder,
) -> Answer<C> {
    if let Some(request) = C::trace_request(&command) {
        carry_out(request, trace, folder)?;
        return Ok(ControlAnswer::Done);
    }
    let no_answer = || C::Refusal::from(RequestError::NoAnswer);
    let (answer, answered) = sync_channel(1);
    let sent = requests.send((command, answer));
    sent.map_err(|_| no_answer())?;
    let waited = answered.recv_timeout(Duration::from_secs(5));
    waited.map_err(|_| no_answer())?
}

fn carry_out(
    request: TraceRequest,
    trace: &TraceSink,
    folder: &ControlFolder,
) -> Result<(), RequestError> {
    match request {
        TraceRequest::Open(path) => trace.open(folder.below(&path)?)?,
        TraceRequest::Close => trace.close()?,
        TraceRequest::Flush => trace.flush()?,
    }
    Ok(())
}

fn receive(
    socket: &UdpSocket,
    driver: SocketAddr,
    arrived: &SyncSender<ReceivedDatagram>,
    ending: &AtomicBool,
) {
    while !ending.load(Ordering::Acquire) {
        let arrival = match received(socket, driver, MsgFlags::empty()) {
            Ok(arrival) => arrival,
            Err(Errno::EAGAIN | Errno::EINTR) => continue,
            Err(error) => {
                tracing::warn!(%error, "cannot receive datagrams");
                continue;
            }
        };
        // A full queue means that the clock thread is far behind; dropping a datagram then resembles a real wire.
        let _ = arrived.try_send(arrival);
    }
}

/// Receives one datagram with the time at which the kernel took it from the wire: a thread that is woken late does not make
/// the PC's answer late.
fn received(
    socket: &UdpSocket,
    driver: SocketAddr,
    flags: MsgFlags,
) -> Result<ReceivedDatagram, Errno> {
    let mut bytes = [0; BUFFER];
    let mut parts = [io::IoSliceMut::new(&mut bytes)];
    let mut space = nix::cmsg_space!(TimeSpec);
    let message =
        recvmsg::<SockaddrStorage>(socket.as_raw_fd(), &mut parts, Some(&mut space), flags)?;
    let mut stamps = message.cmsgs()?;
    let stamp = stamps.find_map(|control| match control {
        ControlMessageOwned::ScmTimestampns(stamp) => Some(stamp),
        _ => None,
    });
    let (length, source) = (message.bytes, message.address);
    let source = source.and_then(|address| match address.as_sockaddr_in() {
        Some(v4) => Some(SocketAddr::V4((*v4).into())),
        None => Some(SocketAddr::V6((*address.as_sockaddr_in6()?).into())),
    });
    // The kernel stamps with CLOCK_REALTIME, which may be set at any time: only the age of the datagram is taken from it.
    let age_ns = match stamp {
        Some(stamp) => clock_ns(ClockId::CLOCK_REALTIME)? - nanoseconds(stamp),
        None => 0,
    };
    Ok(ReceivedDatagram {
        bytes,
        length,
        foreign: source != Some(driver),
        time_ns: now_ns()? - age_ns.clamp(0, AGE_MAX_NS),
    })
}

struct ClockThread<C: Controller> {
    controller: C,
    socket: UdpSocket,
    driver: SocketAddr,
    arrivals: Receiver<ReceivedDatagram>,
    commands: Receiver<Request<C>>,
    trace: TraceSink,
    /// CLOCK_MONOTONIC at which the last datagram was handed to the socket, ns.
    sent_ns: i64,
    /// Number of answers that the controller did not take.
    not_taken: u64,
}

impl<C: Controller> ClockThread<C> {
    fn run(&mut self, ending: &AtomicBool) -> Result<(), RunError> {
        let period_ns = (self.controller.period_s() * 1e9).round() as i64;
        let start_ns = now_ns()?;
        let (mut index, mut unrecorded) = (0, 0_u64);
        self.send(1)?;
        while !ending.load(Ordering::Acquire) && !self.controller.is_closed() {
            let earliest = now_ns()? - start_ns + period_ns / 2;
            let next = (index + 1)
                .max(earliest.div_euclid(period_ns) + i64::from(earliest % period_ns != 0));
            sleep_until(start_ns + next * period_ns)?;
            while let Ok(arrival) = self.arrivals.try_recv() {
                self.take(&arrival);
            }
            while let Some(arrival) = self.unreceived() {
                self.take(&arrival);
            }
            for (command, answer) in self.commands.try_iter().take(REQUESTS_PER_TICK) {
                // The client may be gone by now.
                let _ = answer.send(self.controller.execute(command));
            }
            let present = (now_ns()? - start_ns).div_euclid(period_ns).max(next);
            self.send(present.abs_diff(index))?;
            index = present;
            if let Some(&record) = self.controller.exchanged() {
                unrecorded += u64::from(!self.trace.record(record));
            }
        }
        if unrecorded > 0 {
            tracing::warn!(
                unrecorded,
                "the trace has gaps: its file is slower than the wire"
            );
        }
        Ok(())
    }

    fn take(&mut self, arrival: &ReceivedDatagram) {
        if arrival.foreign {
            return self.controller.receive_foreign();
        }
        let delay_s = (arrival.time_ns - self.sent_ns).max(0) as f64 * 1e-9;
        let datagram = &arrival.bytes[..arrival.length];
        if self.controller.network().is_clear() {
            return self.hand_over(datagram, delay_s);
        }
        for datagram in self.controller.network().from_pc(datagram) {
            self.hand_over(&datagram, delay_s);
        }
    }

    /// Passes a datagram to the controller; the 1st, 2nd, 4th, 8th … refusal is logged.
    fn hand_over(&mut self, datagram: &[u8], delay_s: f64) {
        if let Err(refusal) = self.controller.receive(datagram, delay_s) {
            self.not_taken += 1;
            if self.not_taken.is_power_of_two() {
                tracing::warn!(count = self.not_taken, "answer not taken: {refusal}");
            }
        }
    }

    /// Returns a datagram that the receiver thread has not read yet; that thread reports errors.
    fn unreceived(&self) -> Option<ReceivedDatagram> {
        received(&self.socket, self.driver, MsgFlags::MSG_DONTWAIT).ok()
    }

    /// Ends the cycle and sends the next datagram. The delay of its answer counts from when it is sent: the time that the
    /// model takes before belongs to the simulator, not to the PC.
    fn send(&mut self, periods_max: u64) -> Result<(), Errno> {
        let Some(datagram) = self.controller.tick(periods_max) else {
            return Ok(());
        };
        self.controller.network().step();
        self.sent_ns = now_ns()?;
        if self.controller.network().is_clear() {
            self.send_one(datagram.as_ref());
            return Ok(());
        }
        for datagram in self.controller.network().to_pc(datagram.as_ref()) {
            self.send_one(&datagram);
        }
        Ok(())
    }

    fn send_one(&self, datagram: &[u8]) {
        if let Err(error) = self.socket.send_to(datagram, self.driver) {
            tracing::warn!(%error, driver = %self.driver, "cannot send a datagram");
        }
    }
}

fn now_ns() -> Result<i64, Errno> {
    clock_ns(ClockId::CLOCK_MONOTONIC)
}

fn clock_ns(clock: ClockId) -> Result<i64, Errno> {
    clock_gettime(clock).map(nanoseconds)
}

fn nanoseconds(time: TimeSpec) -> i64 {
    time.tv_sec() * 1_000_000_000 + time.tv_nsec()
}

fn sleep_until(deadline_ns: i64) -> Result<(), Errno> {
    let deadline = TimeSpec::new(deadline_ns / 1_000_000_000, deadline_ns % 1_000_000_000);
    loop {
        match clock_nanosleep(
            ClockId::CLOCK_MONOTONIC,
            ClockNanosleepFlags::TIMER_ABSTIME,
            &deadline,
        ) {
            Err(Errno::EINTR) => {}
            result => return result.map(|_| ()),
        }
    }
}
