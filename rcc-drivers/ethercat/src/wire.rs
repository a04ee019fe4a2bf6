//! How EtherCAT frames travel: as packets of a network interface, or as datagrams of EtherCAT over UDP, for which a simulated
//! line needs no rights.
//! Used by the thread that exchanges frames.

use std::cell::Cell;
use std::fmt;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use crate::raw_socket::{RawSocket, SocketError};

/// Largest Ethernet packet, without checksum, bytes.
pub const PACKET_MAX: usize = 1518;
/// Ethernet header in front of a frame that came over UDP: broadcast, from a MainDevice whose frame has been processed
/// (bit 1 of the first byte of the source), EtherType 0x88a4.
const HEADER: [u8; 14] = [
    0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x12, 0x10, 0x10, 0x10, 0x10, 0x10, 0x88, 0xa4,
];
/// Longest name of a network interface (`IFNAMSIZ` without its NUL), bytes.
const NAME_MAX: usize = 15;
/// Prefix of an address for EtherCAT over UDP.
const UDP: &str = "udp ";

/// Where a line is connected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Interface {
    /// Name of a network interface.
    Nic(String),
    /// Address of a simulated line.
    Udp(SocketAddr),
}

impl Interface {
    /// Valid forms, for messages.
    pub const EXPECTED: &'static str = "the name of a network interface such as \"eth1\", or \"udp ADDRESS:PORT\" of a simulated line";

    /// Reads `eth1` or `udp 127.0.0.1:34980`.
    #[must_use]
    pub fn read(text: &str) -> Option<Interface> {
        if let Some(address) = text.strip_prefix(UDP) {
            return address.parse().ok().map(Interface::Udp);
        }
        let plain = |letter: char| letter.is_ascii_graphic() && letter != '/';
        let fits = !text.is_empty() && text.len() <= NAME_MAX && text.chars().all(plain);
        fits.then(|| Interface::Nic(text.to_owned()))
    }
}

impl fmt::Display for Interface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Interface::Nic(name) => f.write_str(name),
            Interface::Udp(address) => write!(f, "{UDP}{address}"),
        }
    }
}

/// A socket for whole Ethernet packets, which never blocks.
#[derive(Debug)]
pub enum Socket {
    /// Packets of a network interface.
    Raw(RawSocket),
    /// Datagrams to and from one address.
    Client(UdpSocket),
    /// Datagrams from anybody; answers go to the sender of the last one.
    Server(UdpSocket, Cell<Option<SocketAddr>>),
}

impl Socket {
    /// Opens the socket of a MainDevice.
    ///
    /// # Errors
    /// Returns an error if the interface does not exist, or the operating system refuses.
    pub fn main_device(interface: &Interface) -> Result<Socket, SocketError> {
        match interface {
            Interface::Nic(name) => RawSocket::bind(name).map(Socket::Raw),
            Interface::Udp(address) => {
                let any: SocketAddr = match address {
                    SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
                    SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
                };
                let socket = udp(any, interface)?;
                socket
                    .connect(address)
                    .map_err(|source| system(interface, source))?;
                Ok(Socket::Client(socket))
            }
        }
    }

    /// Opens the socket of a simulated line.
    ///
    /// # Errors
    /// Returns an error if the interface does not exist, or the operating system refuses.
    pub fn line(interface: &Interface) -> Result<Socket, SocketError> {
        match interface {
            Interface::Nic(name) => RawSocket::bind(name).map(Socket::Raw),
            Interface::Udp(address) => {
                Ok(Socket::Server(udp(*address, interface)?, Cell::new(None)))
            }
        }
    }

    /// Returns the address of a datagram socket.
    #[must_use]
    pub fn address(&self) -> Option<SocketAddr> {
        match self {
            Socket::Raw(_) => None,
            Socket::Client(socket) | Socket::Server(socket, _) => socket.local_addr().ok(),
        }
    }

    /// Waits until a packet is there, or for `timeout`; `None` waits without a limit.
    ///
    /// # Errors
    /// Returns an error of the operating system.
    pub fn wait(&self, timeout: Option<Duration>) -> io::Result<()> {
        // Rounded up: a wait that ends too early would be repeated at once.
        let millis = timeout.map(|left| left.as_nanos().div_ceil(1_000_000));
        let timeout = millis.map_or(PollTimeout::NONE, |millis| {
            PollTimeout::try_from(millis).unwrap_or(PollTimeout::MAX)
        });
        let mut one = [PollFd::new(self.as_fd(), PollFlags::POLLIN)];
        match poll(&mut one, timeout) {
            Ok(_) | Err(Errno::EINTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    /// Stores the next packet of the other side; returns its size, or `None` if none is there.
    ///
    /// # Errors
    /// Returns an error of the operating system, for example that the interface is down.
    pub fn receive(&self, packet: &mut [u8; PACKET_MAX]) -> io::Result<Option<usize>> {
        let (head, body) = packet.split_at_mut(HEADER.len());
        let result = match self {
            Socket::Raw(socket) => return socket.receive(packet),
            Socket::Client(socket) => socket.recv(body),
            Socket::Server(socket, peer) => socket.recv_from(body).map(|(size, from)| {
                peer.set(Some(from));
                size
            }),
        };
        match result {
            Ok(size) => {
                head.copy_from_slice(&HEADER);
                Ok(Some(HEADER.len() + size))
            }
            Err(error) if is_pause(&error) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Sends a packet.
    ///
    /// # Errors
    /// Returns an error of the operating system, for example that the interface is down.
    pub fn send(&self, packet: &[u8]) -> io::Result<()> {
        let body = packet.get(HEADER.len()..).unwrap_or_default();
        match self {
            Socket::Raw(socket) => socket.send(packet),
            Socket::Client(socket) => socket.send(body).map(drop),
            Socket::Server(socket, peer) => match peer.get() {
                Some(peer) => socket.send_to(body, peer).map(drop),
                None => Ok(()),
            },
        }
    }
}

impl AsFd for Socket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Socket::Raw(socket) => socket.as_fd(),
            Socket::Client(socket) | Socket::Server(socket, _) => socket.as_fd(),
        }
    }
}

/// Returns true if the interface itself is gone, so that the socket can never be used again.
#[must_use]
pub fn is_gone(error: &io::Error) -> bool {
    let gone = [Errno::ENODEV, Errno::ENXIO].map(|errno| errno as i32);
    error
        .raw_os_error()
        .is_some_and(|code| gone.contains(&code))
}

fn is_pause(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

fn udp(address: SocketAddr, interface: &Interface) -> Result<UdpSocket, SocketError> {
    let socket = UdpSocket::bind(address).map_err(|source| system(interface, source))?;
    socket
        .set_nonblocking(true)
        .map_err(|source| system(interface, source))?;
    Ok(socket)
}

fn system(interface: &Interface, source: io::Error) -> SocketError {
    SocketError::System {
        name: interface.to_string(),
        source,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interface_is_a_name_or_an_address() {
        for text in ["eth1", "enp3s0.5", "udp 127.0.0.1:34980"] {
            let read = Interface::read(text).map(|interface| interface.to_string());
            assert_eq!(read.as_deref(), Some(text));
        }
        for wrong in [
            "",
            "a b",
            "eth/1",
            "name-of-16-bytes",
            "udp 127.0.0.1",
            "udp ",
        ] {
            assert_eq!(Interface::read(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_packet_keeps_all_but_its_ethernet_header_over_udp() {
        let any = Interface::read("udp 127.0.0.1:0").unwrap();
        let line = Socket::line(&any).unwrap();
        let interface = Interface::Udp(line.address().unwrap());
        let main = Socket::main_device(&interface).unwrap();
        let mut packet = [0; PACKET_MAX];
        assert_eq!(line.receive(&mut packet).unwrap(), None);
        let sent = [&[7; 14][..], b"datagrams"].concat();
        main.send(&sent).unwrap();
        line.wait(None).unwrap();
        let size = line.receive(&mut packet).unwrap().unwrap();
        assert_eq!(packet[..size], *[&HEADER[..], b"datagrams"].concat());
        line.send(&packet[..size]).unwrap();
        main.wait(None).unwrap();
        assert_eq!(main.receive(&mut packet).unwrap(), Some(size));
    }
}
