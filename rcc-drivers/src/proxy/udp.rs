//! A fault proxy for datagrams: who sends first sends here, and the proxy speaks with the target for it.
//! Pumped step by step by its owner, or by a thread of its own once it is started.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::faulty_link::{FaultCounts, FaultRates, FaultyLink};
use super::{Direction, lines};

/// Largest datagram on a loopback or an Ethernet; a longer one is cut.
const DATAGRAM_MAX: usize = 65536;
/// One step of a proxy that runs by itself.
const STEP: Duration = Duration::from_millis(1);

#[derive(Debug)]
struct Inner {
    front: UdpSocket,
    back: UdpSocket,
    target: SocketAddr,
    /// Who has sent first, last.
    first: Option<SocketAddr>,
    lines: [FaultyLink; 2],
    /// What came since the last [`UdpProxy::take_recording`], if that is asked for.
    recording: Option<Vec<(Direction, Vec<u8>)>>,
    buffer: Vec<u8>,
}

/// The proxy. Dropping it ends its thread.
#[derive(Debug)]
pub struct UdpProxy {
    inner: Arc<Mutex<Inner>>,
    front: SocketAddr,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

fn lock(inner: &Mutex<Inner>) -> MutexGuard<'_, Inner> {
    inner.lock().unwrap_or_else(PoisonError::into_inner)
}

impl UdpProxy {
    /// A proxy in front of `target`, on loopback; nothing passes before it is pumped or started.
    ///
    /// # Errors
    /// The system refuses a socket.
    pub fn new(target: SocketAddr, rates: FaultRates, seed: u64) -> io::Result<Self> {
        let socket = || -> io::Result<UdpSocket> {
            let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        };
        let (front, back) = (socket()?, socket()?);
        let address = front.local_addr()?;
        let inner = Inner {
            front,
            back,
            target,
            first: None,
            lines: lines(rates, seed),
            recording: None,
            buffer: vec![0; DATAGRAM_MAX],
        };
        Ok(Self {
            inner: Arc::new(Mutex::new(inner)),
            front: address,
            stop: Arc::default(),
            thread: None,
        })
    }

    /// Where to send instead of to the target.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.front
    }

    /// From now on another target, as after its restart.
    pub fn set_target(&self, target: SocketAddr) {
        lock(&self.inner).target = target;
    }

    /// From now on, in this direction.
    pub fn set_rates(&self, direction: Direction, rates: FaultRates) {
        lock(&self.inner).lines[direction as usize].set_rates(rates);
    }

    /// What has been done in this direction.
    #[must_use]
    pub fn counts(&self, direction: Direction) -> FaultCounts {
        lock(&self.inner).lines[direction as usize].counts()
    }

    /// Passes on what came, and what is due: one step of time with [`UdpProxy::step`], none without.
    pub fn pump(&self) {
        lock(&self.inner).pump();
    }

    /// Time goes on by one step.
    pub fn step(&self) {
        lock(&self.inner)
            .lines
            .iter_mut()
            .for_each(FaultyLink::step);
    }

    /// What came since the last time, as it came, before any fault; kept from the first call on.
    pub fn take_recording(&self) -> Vec<(Direction, Vec<u8>)> {
        let mut inner = lock(&self.inner);
        inner.recording.replace(Vec::new()).unwrap_or_default()
    }

    /// From now on a thread pumps; its steps are milliseconds.
    ///
    /// # Errors
    /// The system refuses a thread.
    pub fn start(&mut self) -> io::Result<()> {
        let (inner, stop) = (Arc::clone(&self.inner), Arc::clone(&self.stop));
        let run = move || {
            // Relaxed: nothing else is told with it.
            while !stop.load(Ordering::Relaxed) {
                {
                    let mut inner = lock(&inner);
                    inner.lines.iter_mut().for_each(FaultyLink::step);
                    inner.pump();
                }
                std::thread::sleep(STEP / 4);
            }
        };
        self.thread = Some(
            std::thread::Builder::new()
                .name("udp-proxy".into())
                .spawn(run)?,
        );
        Ok(())
    }
}

impl Drop for UdpProxy {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in it has been reported by itself.
            drop(thread.join());
        }
    }
}

impl Inner {
    fn pump(&mut self) {
        // An error is a pause, or that nobody listens there: as lost as on a wire.
        while let Ok((size, from)) = self.front.recv_from(&mut self.buffer) {
            self.first = Some(from);
            self.take_in(Direction::Forth, size);
        }
        while let Ok((size, from)) = self.back.recv_from(&mut self.buffer) {
            if from == self.target {
                self.take_in(Direction::Back, size);
            }
        }
        let [forth, back] = &mut self.lines;
        while let Some(bytes) = forth.pop() {
            drop(self.back.send_to(&bytes, self.target));
        }
        while let Some(bytes) = back.pop() {
            if let Some(first) = self.first {
                drop(self.front.send_to(&bytes, first));
            }
        }
    }

    fn take_in(&mut self, direction: Direction, size: usize) {
        let bytes = self.buffer.get(..size).unwrap_or_default();
        if let Some(recording) = &mut self.recording {
            recording.push((direction, bytes.to_vec()));
        }
        self.lines[direction as usize].push(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_there_and_back_and_tells_what_it_heard() {
        let socket = || UdpSocket::bind("127.0.0.1:0").expect("loopback");
        let (first, target) = (socket(), socket());
        let at = target.local_addr().expect("an address");
        let proxy = UdpProxy::new(at, FaultRates::NONE, 1).expect("sockets");
        assert!(proxy.take_recording().is_empty());
        first.send_to(b"ping", proxy.address()).expect("loopback");
        proxy.pump();
        let mut bytes = [0; 8];
        let (size, from) = target.recv_from(&mut bytes).expect("it passed");
        assert_eq!(&bytes[..size], b"ping");
        target.send_to(b"pong!", from).expect("loopback");
        proxy.pump();
        let (size, from) = first.recv_from(&mut bytes).expect("it came back");
        assert_eq!((&bytes[..size], from), (&b"pong!"[..], proxy.address()));
        let recording = proxy.take_recording();
        assert_eq!(recording[0], (Direction::Forth, b"ping".to_vec()));
        assert_eq!(recording[1], (Direction::Back, b"pong!".to_vec()));
    }
}
