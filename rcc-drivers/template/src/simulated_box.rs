//! The simulated I/O box, with a thread of its own. Output 1 of each type is looped back to input 1.

use std::collections::BTreeMap;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::text_line::{LINE_MAX, parse, push, seal, unseal};

/// A running box; it ends when this is dropped.
#[derive(Debug)]
pub struct SimulatedBox {
    address: SocketAddr,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// State that the thread shares with its owner. The flags publish no other data: Relaxed.
#[derive(Debug, Default)]
struct Shared {
    outputs: Mutex<BTreeMap<String, f64>>,
    absent: AtomicBool,
    stop: AtomicBool,
}

impl SimulatedBox {
    /// Starts a box at this address.
    ///
    /// # Errors
    /// Returns an error if the operating system refuses the socket or the thread.
    pub fn start(at: SocketAddr) -> io::Result<Self> {
        let socket = UdpSocket::bind(at)?;
        socket.set_read_timeout(Some(Duration::from_millis(10)))?;
        let address = socket.local_addr()?;
        let shared = Arc::new(Shared::default());
        let own = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("box".to_owned())
            .spawn(move || live(&socket, &own))?;
        Ok(Self {
            address,
            shared,
            thread: Some(thread),
        })
    }

    /// Returns its address.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Makes the box disappear from the network, or return.
    pub fn set_present(&self, present: bool) {
        self.shared.absent.store(!present, Ordering::Relaxed);
    }

    /// Returns the newest outputs by their name on the wire, such as `d1` and `a1`, without those never received.
    #[must_use]
    pub fn outputs(&self) -> BTreeMap<String, f64> {
        let outputs = self.shared.outputs.lock();
        outputs.unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for SimulatedBox {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It has reported a panic by itself.
            drop(thread.join());
        }
    }
}

fn live(socket: &UdpSocket, shared: &Shared) {
    let mut bytes = [0; LINE_MAX];
    let mut newest = None;
    while !shared.stop.load(Ordering::Relaxed) {
        let Ok((size, from)) = socket.recv_from(&mut bytes) else {
            continue;
        };
        let line = bytes.get(..size).and_then(unseal);
        let Some((word, number, values)) = line.and_then(parse) else {
            continue;
        };
        if shared.absent.load(Ordering::Relaxed) {
            continue;
        }
        let outputs = shared.outputs.lock();
        let mut outputs = outputs.unwrap_or_else(PoisonError::into_inner);
        match word {
            "get" => {
                if number == 0 {
                    newest = None;
                }
                let mut line = format!("is {number}");
                for (kind, name) in [('d', "d1"), ('a', "a1")] {
                    push(&mut line, kind, 1, outputs.get(name).unwrap_or(&0.0));
                }
                // The sender may be gone.
                drop(socket.send_to(seal(&line).as_bytes(), from));
            }
            "set" if newest.is_none_or(|newest| number > newest) => {
                newest = Some(number);
                outputs.extend(values);
            }
            _ => {}
        }
    }
}
