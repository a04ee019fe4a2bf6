//! The proxy path a subject and its driver, whatever the wire is.
//! Test code only.

use std::net::{SocketAddr, UdpSocket};

use super::capture::PacketSource;
use super::{Subject, Transport};
use crate::proxy::{Direction, FaultCounts, FaultRates, TcpProxy, UdpProxy};

/// The proxy.
pub enum FaultPath {
    /// Pumped by the test.
    Pumped(UdpProxy),
    /// With a thread of its own.
    Threaded(UdpProxy),
    /// With threads of its own.
    Stream(TcpProxy),
}

impl FaultPath {
    /// Puts a proxy path a subject and the driver that will be opened for the address that is returned.
    pub fn of<S: Subject>(subject: &mut S, seed: u64) -> (Self, SocketAddr) {
        match S::TRANSPORT {
            Transport::UdpFromDevice => {
                let driver = free_udp();
                let proxy = UdpProxy::new(driver, FaultRates::NONE, seed).expect("loopback");
                proxy.take_recording();
                subject.aim(proxy.address());
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

    /// One step of time, if the test counts it.
    pub fn step(&self) {
        if let Self::Pumped(proxy) = self {
            proxy.step();
            proxy.pump();
        }
    }

    /// Passes on what the driver has sent; returns that, as it left the driver, if the test pumps.
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

    /// What both ends have sent since the last time, as it left them; kept from the first call on.
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

    /// From now on, towards the driver and towards the device.
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

    /// What has been done in both directions.
    pub fn counts(&self) -> [FaultCounts; 2] {
        [Direction::Forth, Direction::Back].map(|direction| match self {
            Self::Pumped(proxy) | Self::Threaded(proxy) => proxy.counts(direction),
            Self::Stream(proxy) => proxy.counts(direction),
        })
    }
}

/// A port that was free a moment ago.
pub fn free_udp() -> SocketAddr {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback");
    socket.local_addr().expect("an address")
}
