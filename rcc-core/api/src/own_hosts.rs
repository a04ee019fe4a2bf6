//! Which requests of browsers were meant for a server of this machine, shared by the programs that listen for viewers: the
//! header `host` against DNS rebinding (a foreign name that resolves to this address), `origin` against pages of others.

use std::net::{IpAddr, SocketAddr};

/// Values of `host` that mean a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OwnHosts {
    /// Names with the port.
    names: Vec<String>,
    /// Every address with this port, too: a page cannot be rebound to an address, only to a name.
    any_address: Option<u16>,
}

impl OwnHosts {
    /// Creates the rule of a server at this loopback port: `127.0.0.1` and `localhost`.
    #[must_use]
    pub fn loopback(port: u16) -> OwnHosts {
        OwnHosts {
            names: ["127.0.0.1", "localhost"]
                .map(|host| format!("{host}:{port}"))
                .into(),
            any_address: None,
        }
    }

    /// Creates the rule of a server that other machines reach: every address of the port, and these names.
    #[must_use]
    pub fn reachable(port: u16, names: &[String]) -> OwnHosts {
        let mut own = OwnHosts::loopback(port);
        let names = names.iter().map(|name| format!("{name}:{port}"));
        own.names.extend(names);
        own.any_address = Some(port);
        own
    }

    /// Returns the address to be told to people.
    #[must_use]
    pub fn told(&self) -> &str {
        self.names.first().map_or("", String::as_str)
    }

    /// Returns the value of the header `host` if it means this server.
    #[must_use]
    pub fn find<'a>(&self, host: Option<&'a [u8]>) -> Option<&'a str> {
        let host = std::str::from_utf8(host?).ok()?;
        let is_address = |port: u16| match host.parse::<SocketAddr>() {
            Ok(address) => address.port() == port,
            // The default port of HTTP is not written.
            Err(_) => port == 80 && host.trim_matches(['[', ']']).parse::<IpAddr>().is_ok(),
        };
        let is_own =
            self.names.iter().any(|name| name == host) || self.any_address.is_some_and(is_address);
        is_own.then_some(host)
    }
}

/// Returns true if the origin is the page that the server itself serves at this host.
#[must_use]
pub fn is_own_page(host: &str, origin: &[u8]) -> bool {
    origin.strip_prefix(b"http://") == Some(host.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finds(own: &OwnHosts, host: &str) -> bool {
        own.find(Some(host.as_bytes())).is_some()
    }

    #[test]
    fn a_name_that_is_not_ours_is_not_found() {
        let own = OwnHosts::loopback(8765);
        assert_eq!(own.told(), "127.0.0.1:8765");
        for host in ["127.0.0.1:8765", "localhost:8765"] {
            assert!(finds(&own, host), "{host}");
        }
        for host in [
            "",
            "127.0.0.1",
            "127.0.0.1:80",
            "evil.example:8765",
            "localhost.evil:8765",
            "192.0.2.7:8765",
        ] {
            assert!(!finds(&own, host), "{host}");
        }
        assert_eq!(own.find(None), None);
    }

    #[test]
    fn other_machines_use_an_address_or_a_name_that_was_given() {
        let own = OwnHosts::reachable(8765, &["robot".to_owned()]);
        for host in ["192.0.2.7:8765", "[2001:db8::1]:8765", "robot:8765"] {
            assert!(finds(&own, host), "{host}");
        }
        for host in ["192.0.2.7:80", "192.0.2.7", "evil.example:8765", "robot"] {
            assert!(!finds(&own, host), "{host}");
        }
    }

    #[test]
    fn only_the_page_of_the_same_host_is_our_own() {
        assert!(is_own_page("localhost:1", b"http://localhost:1"));
        for origin in [
            "",
            "null",
            "http://localhost:2",
            "https://localhost:1",
            "http://127.0.0.1:1",
        ] {
            assert!(!is_own_page("localhost:1", origin.as_bytes()), "{origin}");
        }
    }
}
