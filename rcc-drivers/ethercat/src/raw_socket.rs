//! A raw Ethernet socket (`AF_PACKET`) on one network interface, for packets with any EtherType.
//! Used by the thread that exchanges frames.

use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};

use nix::errno::Errno;
use nix::ifaddrs::getifaddrs;
use nix::sys::socket::{
    AddressFamily, LinkAddr, MsgFlags, SockFlag, SockProtocol, SockType, bind, recvfrom, send,
    socket,
};

/// Packet type of a packet that this host has sent itself (`PACKET_OUTGOING`, packet(7)).
const OUTGOING: u8 = 4;

/// Why there is no socket.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// There is no such interface in this network namespace.
    #[error("network interface `{name}` not found; available interfaces: {known}")]
    Interface {
        /// Its name.
        name: String,
        /// Names of all interfaces.
        known: String,
    },
    /// The process must not send packets of its own.
    #[error(
        "raw Ethernet packets need CAP_NET_RAW: run as root, or `setcap cap_net_raw=ep` the program"
    )]
    Permission,
    /// Another error of the operating system.
    #[error("network interface `{name}`: {source}")]
    System {
        /// Name of the interface.
        name: String,
        /// Error of the operating system.
        source: io::Error,
    },
}

/// The socket.
#[derive(Debug)]
pub struct RawSocket(OwnedFd);

impl RawSocket {
    /// Binds a socket to the interface with this name.
    ///
    /// # Errors
    /// Returns an error if the interface does not exist, or the operating system refuses.
    pub fn bind(name: &str) -> Result<RawSocket, SocketError> {
        let system = |error: Errno| match error {
            Errno::EPERM | Errno::EACCES => SocketError::Permission,
            error => SocketError::System {
                name: name.to_owned(),
                source: error.into(),
            },
        };
        let address = link_address(name)?;
        let socket = socket(
            AddressFamily::Packet,
            SockType::Raw,
            SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK,
            // Before it is bound the socket receives from every interface; `receive` looks at the interface, too.
            SockProtocol::EthAll,
        )
        .map_err(system)?;
        bind(socket.as_raw_fd(), &address).map_err(system)?;
        Ok(RawSocket(socket))
    }

    /// Stores the next packet that another host has sent; returns its size, or `None` if none is there.
    ///
    /// # Errors
    /// Returns an error of the operating system, for example that the interface is down.
    pub fn receive(&self, packet: &mut [u8]) -> io::Result<Option<usize>> {
        loop {
            match recvfrom::<LinkAddr>(self.0.as_raw_fd(), packet) {
                Ok((_, Some(from))) if from.pkttype() == OUTGOING => {}
                Ok((size, _)) => return Ok(Some(size)),
                Err(Errno::EAGAIN | Errno::EINTR) => return Ok(None),
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Sends a packet.
    ///
    /// # Errors
    /// Returns an error of the operating system, for example that the interface is down.
    pub fn send(&self, packet: &[u8]) -> io::Result<()> {
        send(self.0.as_raw_fd(), packet, MsgFlags::empty())?;
        Ok(())
    }
}

impl AsFd for RawSocket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// Returns the address of an interface, with its number, for `bind`.
fn link_address(name: &str) -> Result<LinkAddr, SocketError> {
    let all = getifaddrs().map_err(|error| SocketError::System {
        name: name.to_owned(),
        source: error.into(),
    })?;
    let links: Vec<(String, LinkAddr)> = all
        .filter_map(|one| Some((one.interface_name, *one.address?.as_link_addr()?)))
        .collect();
    let found = links.iter().find(|(found, _)| found == name);
    found
        .map(|(_, address)| *address)
        .ok_or_else(|| SocketError::Interface {
            name: name.to_owned(),
            known: links
                .iter()
                .map(|(name, _)| name.as_str())
                .collect::<Vec<_>>()
                .join(", "),
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_interface_is_told_with_those_that_exist() {
        let error = RawSocket::bind("nowhere9").unwrap_err().to_string();
        assert!(
            error.starts_with("network interface `nowhere9` not found; available interfaces: ")
        );
        assert!(error.contains("lo"), "{error}");
    }
}
