//! A fault proxy for streams: the bytes of one read count as a packet; loss and truncation close the connection.
//! One thread accepts; each connection has one thread per direction.
//!
//! TCP itself never delivers other bytes than were sent: duplicated, reordered and corrupted chunks simulate a broken
//! gateway or device.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::faulty_link::{FaultCounts, FaultRates, FaultyLink, PacketFate};
use super::{Direction, lines};

/// Largest chunk.
const CHUNK_MAX: usize = 4096;
/// Length of a time step: how long a thread waits for bytes before it checks for due packets and for its end.
const STEP: Duration = Duration::from_millis(2);
/// Time-out for connecting to the target.
const CONNECT_MAX: Duration = Duration::from_secs(1);

/// Recorded packets, in order.
type RecordedPackets = Vec<(Direction, Vec<u8>)>;

#[derive(Debug)]
struct Shared {
    target: Mutex<SocketAddr>,
    lines: Mutex<[FaultyLink; 2]>,
    recording: Mutex<Option<RecordedPackets>>,
    stop: AtomicBool,
    /// Counts connections closed on request.
    broken: std::sync::atomic::AtomicU64,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The proxy. Dropping it ends its threads and connections.
#[derive(Debug)]
pub struct TcpProxy {
    address: SocketAddr,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl TcpProxy {
    /// Starts a proxy in front of `target`, on loopback.
    ///
    /// # Errors
    /// Returns an error if the operating system refuses a socket or a thread.
    pub fn start(target: SocketAddr, rates: FaultRates, seed: u64) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            target: Mutex::new(target),
            lines: Mutex::new(lines(rates, seed)),
            recording: Mutex::new(None),
            stop: AtomicBool::new(false),
            broken: Default::default(),
        });
        let own = Arc::clone(&shared);
        let thread = thread::Builder::new()
            .name("tcp-proxy".into())
            .spawn(move || accept(&listener, &own))?;
        Ok(Self {
            address,
            shared,
            thread: Some(thread),
        })
    }

    /// Returns the address to connect to instead of the target's.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sets the target of further connections, for example after its restart.
    pub fn set_target(&self, target: SocketAddr) {
        *lock(&self.shared.target) = target;
    }

    /// Sets the fault rates of one direction, from now on.
    pub fn set_rates(&self, direction: Direction, rates: FaultRates) {
        lock(&self.shared.lines)[direction as usize].set_rates(rates);
    }

    /// Returns the counters of one direction.
    #[must_use]
    pub fn counts(&self, direction: Direction) -> FaultCounts {
        lock(&self.shared.lines)[direction as usize].counts()
    }

    /// Closes all present connections.
    pub fn break_all(&self) {
        // Relaxed: the counter publishes no other data.
        self.shared.broken.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns the packets since the last call, as they arrived, before any fault; recording starts with the first
    /// call.
    pub fn take_recording(&self) -> RecordedPackets {
        lock(&self.shared.recording)
            .replace(Vec::new())
            .unwrap_or_default()
    }
}

impl Drop for TcpProxy {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has already been reported.
            drop(thread.join());
        }
    }
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    let mut copying: Vec<JoinHandle<()>> = Vec::new();
    while !shared.stop.load(Ordering::Relaxed) {
        match listener.accept() {
            Ok((stream, _)) => {
                copying.retain(|thread| !thread.is_finished());
                match connect(stream, shared) {
                    Ok(both) => copying.extend(both),
                    Err(error) => tracing::debug!(%error, "the proxy cannot reach its target"),
                }
            }
            Err(_) => thread::sleep(STEP),
        }
    }
    for thread in copying {
        // A panic of the thread has already been reported.
        drop(thread.join());
    }
}

fn connect(near: TcpStream, shared: &Arc<Shared>) -> io::Result<[JoinHandle<()>; 2]> {
    let target = *lock(&shared.target);
    let far = TcpStream::connect_timeout(&target, CONNECT_MAX)?;
    for stream in [&near, &far] {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(STEP))?;
        // A peer that stops reading must not block a thread for ever.
        stream.set_write_timeout(Some(CONNECT_MAX))?;
    }
    let copy = |from: &TcpStream, to: &TcpStream, direction| -> io::Result<JoinHandle<()>> {
        let (from, to, shared) = (from.try_clone()?, to.try_clone()?, Arc::clone(shared));
        thread::Builder::new()
            .name("tcp-proxy-line".into())
            .spawn(move || {
                // Whatever ended it, both ends see a closed connection.
                drop(pass(&from, &to, direction, &shared));
                drop(from.shutdown(Shutdown::Both));
                drop(to.shutdown(Shutdown::Both));
            })
    };
    Ok([
        copy(&near, &far, Direction::Forth)?,
        copy(&far, &near, Direction::Back)?,
    ])
}

/// Forwards chunks until the connection ends.
fn pass(
    mut from: &TcpStream,
    mut to: &TcpStream,
    direction: Direction,
    shared: &Shared,
) -> io::Result<()> {
    let broken = shared.broken.load(Ordering::Relaxed);
    let mut chunk = [0; CHUNK_MAX];
    // The random numbers continue across connections, but packets queued for one connection are not sent on another.
    lock(&shared.lines)[direction as usize].forget();
    while !shared.stop.load(Ordering::Relaxed) && shared.broken.load(Ordering::Relaxed) == broken {
        let mut fate = PacketFate::Passed;
        match from.read(&mut chunk) {
            Ok(0) => return Ok(()),
            Ok(size) => {
                let bytes = chunk.get(..size).unwrap_or_default();
                if let Some(recording) = &mut *lock(&shared.recording) {
                    recording.push((direction, bytes.to_vec()));
                }
                fate = lock(&shared.lines)[direction as usize].push(bytes);
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                lock(&shared.lines)[direction as usize].step();
            }
            Err(error) => return Err(error),
        }
        loop {
            let due = lock(&shared.lines)[direction as usize].pop();
            let Some(bytes) = due else { break };
            to.write_all(&bytes)?;
        }
        if matches!(fate, PacketFate::Lost | PacketFate::Truncated) {
            return Ok(());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn echo() -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").expect("loopback");
        let address = listener.local_addr().expect("an address");
        // Ends with its last connection; the test makes two.
        thread::spawn(move || {
            for stream in listener.incoming().take(2) {
                let mut stream = stream.expect("a connection");
                let mut bytes = [0; 64];
                while let Ok(size @ 1..) = stream.read(&mut bytes) {
                    if stream.write_all(&bytes[..size]).is_err() {
                        break;
                    }
                }
            }
        });
        address
    }

    #[test]
    fn passes_bytes_and_breaks_the_connection_on_loss() {
        let proxy = TcpProxy::start(echo(), FaultRates::NONE, 1).expect("loopback");
        let mut stream = TcpStream::connect(proxy.address()).expect("the proxy");
        stream.write_all(b"there and back").expect("a connection");
        let mut bytes = [0; 14];
        stream.read_exact(&mut bytes).expect("the echo");
        assert_eq!(&bytes, b"there and back");
        proxy.set_rates(
            Direction::Back,
            FaultRates {
                lost: 1.0,
                ..FaultRates::NONE
            },
        );
        stream.write_all(b"lost").expect("a connection");
        let end = stream.read(&mut bytes);
        assert!(matches!(end, Ok(0) | Err(_)), "{end:?}");
        assert_eq!(proxy.counts(Direction::Back).lost, 1);
    }
}
