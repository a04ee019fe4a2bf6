//! The setting `peer`: the only controller that is answered.
//! Plain data; read at start, asked by the host's thread for each datagram.

use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;

/// The only controller that is answered: an address with any port, or one port of an address.
///
/// A KRC whose local port is 0 (the second number of `FRISOCK`) sends from another port after each `friOpen`, so the
/// address alone is what can be configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peer {
    address: IpAddr,
    /// `None`: any port.
    port: Option<u16>,
}

/// The text is neither an address nor an address with a port from 1 to 65535.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("write an address such as 192.168.0.20, or with its port, 192.168.0.20:49938")]
pub struct PeerError;

impl Peer {
    /// Returns true for a datagram from this peer.
    #[must_use]
    pub fn accepts(&self, source: SocketAddr) -> bool {
        source.ip() == self.address && self.port.is_none_or(|port| port == source.port())
    }
}

impl FromStr for Peer {
    type Err = PeerError;

    fn from_str(text: &str) -> Result<Self, PeerError> {
        if let Ok(address) = text.parse() {
            return Ok(Self {
                address,
                port: None,
            });
        }
        let socket: SocketAddr = text.parse().map_err(|_| PeerError)?;
        if socket.port() == 0 {
            return Err(PeerError);
        }
        Ok(Self {
            address: socket.ip(),
            port: Some(socket.port()),
        })
    }
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.port {
            Some(port) => SocketAddr::new(self.address, port).fmt(f),
            None => self.address.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_alone_stands_for_all_of_its_ports() {
        let at = |text: &str| text.parse::<SocketAddr>().expect("an address");
        let any: Peer = "192.168.0.20".parse().expect("an address");
        assert!(any.accepts(at("192.168.0.20:1")) && any.accepts(at("192.168.0.20:49938")));
        assert!(!any.accepts(at("192.168.0.21:49938")));
        let one: Peer = "192.168.0.20:49938".parse().expect("a socket address");
        assert!(one.accepts(at("192.168.0.20:49938")) && !one.accepts(at("192.168.0.20:49939")));
        assert_eq!(
            (any.to_string(), one.to_string()),
            ("192.168.0.20".to_owned(), "192.168.0.20:49938".to_owned())
        );
    }

    #[test]
    fn a_name_and_port_0_are_refused() {
        for text in ["", "krc", "192.168.0.20:0", "192.168.0.20:", "192.168.0"] {
            assert_eq!(text.parse::<Peer>(), Err(PeerError), "{text}");
        }
    }
}
