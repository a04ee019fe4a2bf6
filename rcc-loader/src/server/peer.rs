//! The origin of a connection, by which requests are counted. Plain data.

use std::fmt;
use std::net::IpAddr;

/// The origin of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ClientPeer {
    /// A process on the Unix socket.
    Process(i32),
    /// An address on TCP.
    Address(IpAddr),
}

impl fmt::Display for ClientPeer {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ClientPeer::Process(pid) => write!(formatter, "process {pid}"),
            ClientPeer::Address(address) => address.fmt(formatter),
        }
    }
}
