//! Access to the server: requests to this server's own address, of programs and of known viewers' pages, with the token.
//! Checked during the handshake, by the serving thread.
//!
//! WebSockets are not bound to the origin of a page: any page in any browser of this machine could connect to a port of
//! 127.0.0.1. So `host` is checked against DNS rebinding and `origin` against pages of others, as by the dashboard; and the
//! token, which other pages and other users of the machine do not know, is needed in any case.

use rcc_api::own_hosts::OwnHosts;
use rcc_api::token::Token;
use tokio_tungstenite::tungstenite::http::{HeaderMap, HeaderValue, Uri, header};

/// Origins of viewers: of applications that show pages of their own files, and of Foxglove in a browser.
pub const VIEWER_ORIGINS: [&str; 2] = ["file://", "https://app.foxglove.dev"];
/// Names of the protocol; both mean the same messages. Foxglove and newer Lichtblicks know both, older ones the first.
pub const SUBPROTOCOLS: [&str; 2] = ["foxglove.websocket.v1", "foxglove.sdk.v1"];

/// Access rules of one server.
#[derive(Debug)]
pub struct Access {
    /// Values of `host` that mean this server.
    pub hosts: OwnHosts,
    /// Origins besides [`VIEWER_ORIGINS`].
    pub origins: Vec<String>,
    /// The token.
    pub token: Token,
}

/// The reason why a connection is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// `host` is not an address of this server.
    #[error(
        "this server answers to its own address only: use the one that it printed, or name another with --host"
    )]
    Host,
    /// A page of another origin.
    #[error("pages of `{0}` are refused: allow them with `--origin {0}`")]
    Origin(String),
    /// No token.
    #[error(
        "no token: connect to the address that rcc-foxglove printed, or append `?token=` and the one of its --token-file"
    )]
    NoToken,
    /// Another token.
    #[error(
        "wrong token, perhaps of an earlier rcc-foxglove: connect to the address that this one printed"
    )]
    WrongToken,
    /// The client speaks another protocol.
    #[error("no known subprotocol: this server speaks foxglove.websocket.v1 and foxglove.sdk.v1")]
    Subprotocol,
}

impl Refusal {
    /// Returns the HTTP status.
    #[must_use]
    pub fn status(&self) -> u16 {
        match self {
            Refusal::Host => 421,
            Refusal::Origin(_) | Refusal::WrongToken => 403,
            Refusal::NoToken => 401,
            Refusal::Subprotocol => 400,
        }
    }
}

impl Access {
    /// Decides about a handshake and returns the subprotocol.
    ///
    /// # Errors
    /// Returns the reason for refusing it.
    pub fn check(&self, uri: &Uri, headers: &HeaderMap) -> Result<&'static str, Refusal> {
        let host = headers.get(header::HOST).map(HeaderValue::as_bytes);
        self.hosts.find(host).ok_or(Refusal::Host)?;
        // Programs send none.
        if let Some(origin) = headers.get(header::ORIGIN) {
            let origin = String::from_utf8_lossy(origin.as_bytes());
            let is_known = VIEWER_ORIGINS.contains(&&*origin)
                || self.origins.iter().any(|known| *known == origin);
            if !is_known {
                return Err(Refusal::Origin(origin.into_owned()));
            }
        }
        let query = uri.query().unwrap_or_default().split('&');
        let in_address = query
            .filter_map(|pair| pair.strip_prefix("token="))
            .map(str::as_bytes)
            .next();
        let in_head = headers
            .get(header::AUTHORIZATION)
            .and_then(|value| value.as_bytes().strip_prefix(b"Bearer "));
        let given = in_address.or(in_head).ok_or(Refusal::NoToken)?;
        if !self.token.is(given) {
            return Err(Refusal::WrongToken);
        }
        let offered = headers.get_all(header::SEC_WEBSOCKET_PROTOCOL).iter();
        let offered = offered
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split(','))
            .map(str::trim);
        let mut known =
            offered.filter_map(|name| SUBPROTOCOLS.into_iter().find(|known| *known == name));
        known.next().ok_or(Refusal::Subprotocol)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(
        access: &Access,
        uri: &str,
        headers: &[(&'static str, &str)],
    ) -> Result<&'static str, Refusal> {
        let headers = headers.iter().map(|(name, value)| {
            let value = HeaderValue::from_str(value).expect("a header");
            (header::HeaderName::from_static(name), value)
        });
        access.check(&uri.parse().expect("an address"), &headers.collect())
    }

    fn access() -> (Access, String) {
        let token = Token::random().expect("random bits");
        let address = format!("/?token={}", token.reveal());
        let access = Access {
            hosts: OwnHosts::loopback(8765),
            origins: vec!["http://localhost:8080".to_owned()],
            token,
        };
        (access, address)
    }

    const HOST: (&str, &str) = ("host", "127.0.0.1:8765");
    const PROTOCOL: (&str, &str) = ("sec-websocket-protocol", "foxglove.sdk.v1");

    #[test]
    fn a_client_needs_the_token_in_the_address_or_in_the_head() {
        let (access, address) = access();
        let lines = [HOST, PROTOCOL];
        assert_eq!(checked(&access, &address, &lines), Ok("foxglove.sdk.v1"));
        assert_eq!(checked(&access, "/", &lines), Err(Refusal::NoToken));
        for wrong in [
            "/?token=",
            &format!("{address}0"),
            &address.to_uppercase().replace("TOKEN", "token"),
        ] {
            assert_eq!(
                checked(&access, wrong, &lines),
                Err(Refusal::WrongToken),
                "{wrong}"
            );
        }
        let bearer = address.replace("/?token=", "Bearer ");
        let with_head = [HOST, PROTOCOL, ("authorization", &*bearer)];
        assert!(checked(&access, "/", &with_head).is_ok());
    }

    #[test]
    fn pages_of_others_and_foreign_names_are_refused() {
        let (access, address) = access();
        for origin in [
            "file://",
            "https://app.foxglove.dev",
            "http://localhost:8080",
        ] {
            let lines = [HOST, PROTOCOL, ("origin", origin)];
            assert!(checked(&access, &address, &lines).is_ok(), "{origin}");
        }
        for origin in [
            "null",
            "https://evil.example",
            "http://localhost:8081",
            "https://app.foxglove.dev.evil",
        ] {
            let lines = [HOST, PROTOCOL, ("origin", origin)];
            let refused = checked(&access, &address, &lines);
            assert_eq!(refused, Err(Refusal::Origin(origin.to_owned())));
        }
        let lines = [("host", "evil.example:8765"), PROTOCOL];
        assert_eq!(checked(&access, &address, &lines), Err(Refusal::Host));
    }

    #[test]
    fn the_first_name_of_the_protocol_that_both_know_is_taken() {
        let (access, address) = access();
        let offers = [
            (
                "x, foxglove.websocket.v1,foxglove.sdk.v1",
                Ok("foxglove.websocket.v1"),
            ),
            ("foxglove.sdk.v1", Ok("foxglove.sdk.v1")),
            ("rosbridge", Err(Refusal::Subprotocol)),
        ];
        for (offer, expected) in offers {
            let lines = [HOST, ("sec-websocket-protocol", offer)];
            assert_eq!(checked(&access, &address, &lines), expected, "{offer}");
        }
        assert_eq!(
            checked(&access, &address, &[HOST]),
            Err(Refusal::Subprotocol)
        );
    }
}
