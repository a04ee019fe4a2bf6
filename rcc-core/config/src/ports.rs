//! Network ports of a cell: fixed numbers, or numbers that are chosen when the cell is started.
//! Used by the program that starts a cell and by every process that reads the cell's file; never real-time.

use std::io;
use std::net::{Ipv4Addr, TcpListener, UdpSocket};

/// What a port is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Protocol {
    /// Datagrams.
    Udp,
    /// Streams.
    Tcp,
}

/// A port of 127.0.0.1 that was free a moment ago, chosen by the system from its ephemeral range. Another process can
/// take it before ours does: then ours says so when it binds, and the cell is started again.
///
/// # Errors
/// The system has no port left or forbids sockets.
pub fn free_port(protocol: Protocol) -> io::Result<u16> {
    let any = (Ipv4Addr::LOCALHOST, 0);
    let address = match protocol {
        Protocol::Udp => UdpSocket::bind(any)?.local_addr()?,
        Protocol::Tcp => TcpListener::bind(any)?.local_addr()?,
    };
    Ok(address.port())
}
