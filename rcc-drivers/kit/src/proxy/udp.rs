//! A fault proxy for datagrams: the first sender sends to the proxy, which exchanges with the target on its behalf.
//! Pumped step by step by its owner, or by a thread of its own once it is started.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::faulty_link::{FaultCounts, FaultRates, FaultyLink};
use super::{Direction, lines};

/// Largest datagram on loopback or Ethernet; a longer one is truncated.
const DATAGRAM_MAX: usize = 65536;
/// Length of a time step of a proxy with its own thread.
const STEP: Duration = Duration::from_millis(1);

#[derive(Debug)]
struct Inner {
    front: UdpSocket,
    back: UdpSocket,
    target: SocketAddr,
    /// Address of the last sender on the front side.
    first: Option<SocketAddr>,
    lines: [FaultyLink; 2],
    /// Packets since the last [`UdpProxy::take_recording`], if recording has started.
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
    /// A proxy in front of `target`, on loopback; forwards nothing until it is pumped or started.
    ///
    /// # Errors
    /// Returns an error if the operating system refuses a socket.
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

    /// Returns the address to send to instead of the target's.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.front
    }

    /// Sets another target, for example after its restart.
    pub fn set_target(&self, target: SocketAddr) {
        lock(&self.inner).target = target;
    }

    /// Sets the fault rates of one direction, from now on.
    pub fn set_rates(&self, direction: Direction, rates: FaultRates) {
        lock(&self.inner).lines[direction as usize].set_rates(rates);
    }

    /// Returns the counters of one direction.
    #[must_use]
    pub fn counts(&self, direction: Direction) -> FaultCounts {
        lock(&self.inner).lines[direction as usize].counts()
    }

    /// Forwards the packets that have arrived or are due; does not advance the time, see [`UdpProxy::step`].
    pub fn pump(&self) {
        lock(&self.inner).pump();
    }

    /// Advances the time by one step.
    pub fn step(&self) {
        lock(&self.inner)
            .lines
            .iter_mut()
            .for_each(FaultyLink::step);
    }

    /// Returns the packets since the last call, as they arrived, before any fault; recording starts with the first
    /// call.
    pub fn take_recording(&self) -> Vec<(Direction, Vec<u8>)> {
        let mut inner = lock(&self.inner);
        inner.recording.replace(Vec::new()).unwrap_or_default()
    }

    /// Starts a thread that pumps the proxy in steps of one millisecond.
    ///
    /// # Errors
    /// Returns an error if the operating system refuses to create a thread.
    pub fn start(&mut self) -> io::Result<()> {
        let (inner, stop) = (Arc::clone(&self.inner), Arc::clone(&self.stop));
        let run = move || {
            // Relaxed: the flag publishes no other data.
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
            // A panic of the thread has already been reported.
            drop(thread.join());
        }
    }
}

impl Inner {
    fn pump(&mut self) {
        // An error is a pause, or means that nobody listens at that address: lost, as on a real wire.
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
    fn forwards_in_both_directions_and_records() {
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
