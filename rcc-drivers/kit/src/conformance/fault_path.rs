//! The fault proxy between a subject and its driver, for any transport.
//! Test code only.

use std::net::{SocketAddr, UdpSocket};

use super::{Subject, Transport};
use crate::proxy::{Direction, FaultCounts, FaultRates, TcpProxy, UdpProxy};

/// Sender of captured bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketSource {
    /// From the driver to the device.
    Driver,
    /// From the device to the driver.
    Device,
}

/// The proxy of a transport.
pub enum FaultPath {
    /// A UDP proxy that the test pumps.
    Pumped(UdpProxy),
    /// A UDP proxy with its own thread.
    Threaded(UdpProxy),
    /// A TCP proxy with its own threads.
    Stream(TcpProxy),
}

impl FaultPath {
    /// Puts a proxy between a subject and its driver; returns the address with which to open the driver.
    pub fn of<S: Subject>(subject: &mut S, seed: u64) -> (Self, SocketAddr) {
        match S::TRANSPORT {
            Transport::UdpFromDevice => {
                let driver = free_udp();
                let proxy = UdpProxy::new(driver, FaultRates::NONE, seed).expect("loopback");
                proxy.take_recording();
                subject.set_driver_address(proxy.address());
                (Self::Pumped(proxy), driver)
            }
            Transport::UdpFromDriver => {
                let mut proxy =
                    UdpProxy::new(subject.address(), FaultRates::NONE, seed).expect("loopback");
                proxy.start().expect("a thread");
                let address = proxy.address();
                (Self::Threaded(proxy), address)
            }
            Transport::TcpFromDriver => {
                let proxy =
                    TcpProxy::start(subject.address(), FaultRates::NONE, seed).expect("loopback");
                let address = proxy.address();
                (Self::Stream(proxy), address)
            }
        }
    }

    /// Advances the time by one step, if the test pumps the proxy.
    pub fn step(&self) {
        if let Self::Pumped(proxy) = self {
            proxy.step();
            proxy.pump();
        }
    }

    /// Forwards the driver's packets and returns them as they left the driver, if the test pumps the proxy.
    pub fn answers(&self) -> Vec<Vec<u8>> {
        if !matches!(self, Self::Pumped(_)) {
            return Vec::new();
        }
        let heard = self.take_recording().into_iter();
        heard
            .filter(|(from, _)| *from == PacketSource::Driver)
            .map(|(_, bytes)| bytes)
            .collect()
    }

    /// Returns the packets of both ends since the last call, as they were sent; recording starts with the first call.
    pub fn take_recording(&self) -> Vec<(PacketSource, Vec<u8>)> {
        let (heard, device) = match self {
            Self::Pumped(proxy) => {
                proxy.pump();
                (proxy.take_recording(), Direction::Forth)
            }
            Self::Threaded(proxy) => (proxy.take_recording(), Direction::Back),
            Self::Stream(proxy) => (proxy.take_recording(), Direction::Back),
        };
        let from = |direction| {
            if direction == device {
                PacketSource::Device
            } else {
                PacketSource::Driver
            }
        };
        heard
            .into_iter()
            .map(|(direction, bytes)| (from(direction), bytes))
            .collect()
    }

    /// Sets the fault rates towards the driver and towards the device, from now on.
    pub fn set_rates(&self, to_driver: FaultRates, to_device: FaultRates) {
        let [forth, back] = match self {
            Self::Pumped(_) => [to_driver, to_device],
            Self::Threaded(_) | Self::Stream(_) => [to_device, to_driver],
        };
        match self {
            Self::Pumped(proxy) | Self::Threaded(proxy) => {
                proxy.set_rates(Direction::Forth, forth);
                proxy.set_rates(Direction::Back, back);
            }
            Self::Stream(proxy) => {
                proxy.set_rates(Direction::Forth, forth);
                proxy.set_rates(Direction::Back, back);
            }
        }
    }

    /// Returns the counters of both directions.
    pub fn counts(&self) -> [FaultCounts; 2] {
        [Direction::Forth, Direction::Back].map(|direction| match self {
            Self::Pumped(proxy) | Self::Threaded(proxy) => proxy.counts(direction),
            Self::Stream(proxy) => proxy.counts(direction),
        })
    }
}

/// Returns an address whose port was free a moment ago.
pub fn free_udp() -> SocketAddr {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback");
    socket.local_addr().expect("an address")
}
