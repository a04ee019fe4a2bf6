//! Connects to an endpoint as a session would, but only so far as to learn who is there, or why nobody is. Run by the main thread
//! of `rcc-link`.

use std::io::{self, ErrorKind};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rustls::{AlertDescription, ClientConnection};

use crate::certificate::{CertificateEnd, OwnCertificate, common_name, first_end, server_name};

/// Longest wait for a connection.
const CONNECT_MAX: Duration = Duration::from_secs(2);
/// Longest wait for the whole handshake.
const HANDSHAKE_MAX: Duration = Duration::from_secs(3);

/// Why a connection to an endpoint does not come about.
#[derive(Debug, thiserror::Error)]
pub enum HandshakeError {
    /// Nobody answers.
    #[error(
        "nothing answers at {endpoint} ({cause}): start the rcc-link there, and check its `link: listen`, the address and the network"
    )]
    Nobody {
        /// The endpoint.
        endpoint: String,
        /// Why.
        cause: io::Error,
    },
    /// The endpoint cannot be a server's.
    #[error("{endpoint}: {cause}")]
    Endpoint {
        /// The endpoint.
        endpoint: String,
        /// Why.
        cause: String,
    },
    /// The server does not speak TLS 1.3.
    #[error(
        "{endpoint} does not answer as TLS 1.3 does ({cause}): its `link` has no `tls`, or something else listens there"
    )]
    Plain {
        /// The endpoint.
        endpoint: String,
        /// Why.
        cause: String,
    },
    /// Another server with TLS.
    #[error("{endpoint} asks for no certificate, so no rcc-link with `tls` listens there")]
    NotMutual {
        /// The endpoint.
        endpoint: String,
    },
    /// The other side ends the connection.
    #[error(
        "{endpoint} closes the connection as soon as it is there: see the log of the rcc-link there"
    )]
    Closed {
        /// The endpoint.
        endpoint: String,
    },
    /// The certificate there is not acceptable.
    #[error(
        "the certificate at {endpoint} is refused here ({cause}): sign it with {authority}, for this address, and let it be valid now"
    )]
    RefusedHere {
        /// The endpoint.
        endpoint: String,
        /// File of the authority of this side.
        authority: String,
        /// Why.
        cause: rustls::Error,
    },
    /// The other side does not accept the own certificate.
    #[error(
        "{endpoint} refuses {certificate} ({cause}): both sides must name the same authority in `tls`"
    )]
    RefusedThere {
        /// The endpoint.
        endpoint: String,
        /// File of the own certificate.
        certificate: String,
        /// Why.
        cause: String,
    },
}

/// The certificate of the other side.
#[derive(Clone, Debug)]
pub struct PeerCertificate {
    /// Its common name, if it has one.
    pub name: Option<String>,
    /// When the first of its certificates ends, and the connection with it.
    pub end: Option<CertificateEnd>,
}

/// Connects to `tcp/HOST:PORT`.
///
/// # Errors
/// Fails if nobody answers.
pub fn answers(endpoint: &str) -> Result<(), HandshakeError> {
    connected(endpoint).map(drop)
}

/// Returns the certificate at `tls/HOST:PORT`, once both sides have accepted each other's.
///
/// # Errors
/// Fails if the connection or the TLS handshake fails, or if either side rejects the certificate of the other.
pub fn peer_certificate(
    endpoint: &str,
    own: &OwnCertificate,
) -> Result<PeerCertificate, HandshakeError> {
    let invalid = |cause: String| HandshakeError::Endpoint {
        endpoint: endpoint.to_owned(),
        cause,
    };
    let name = server_name(&host(endpoint)).map_err(invalid)?;
    let asked = Arc::new(AtomicBool::new(false));
    let config = own.client(Arc::clone(&asked));
    let config = config.map_err(|error| invalid(error.to_string()))?;
    let client = ClientConnection::new(Arc::new(config), name);
    let mut tls = client.map_err(|error| invalid(error.to_string()))?;
    let mut tcp = connected(endpoint)?;
    let until = Instant::now() + HANDSHAKE_MAX;
    while tls.is_handshaking() {
        exchange(&mut tls, &mut tcp, until).map_err(|error| explained(endpoint, own, error))?;
    }
    // Written by this thread.
    if !asked.load(Ordering::Relaxed) {
        let endpoint = endpoint.to_owned();
        return Err(HandshakeError::NotMutual { endpoint });
    }
    // The other side judges the own certificate only now, and sends a ticket or an alert.
    match exchange(&mut tls, &mut tcp, until) {
        Ok(()) => {}
        Err(error) if is_late(&error) => {}
        Err(error) => return Err(explained(endpoint, own, error)),
    }
    let chain = tls.peer_certificates().unwrap_or_default();
    Ok(PeerCertificate {
        name: chain.first().and_then(common_name),
        end: first_end(chain, endpoint).ok(),
    })
}

/// Returns the host of an endpoint; an IPv6 address without brackets, as certificates have it.
#[must_use]
pub fn host(endpoint: &str) -> String {
    let address = endpoint.split_once('/').map_or(endpoint, |(_, rest)| rest);
    let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
    host.replace(['[', ']'], "")
}

/// Writes what is to be written, and reads once.
fn exchange(tls: &mut ClientConnection, tcp: &mut TcpStream, until: Instant) -> io::Result<()> {
    while tls.wants_write() {
        tls.write_tls(tcp)?;
    }
    let left = until.saturating_duration_since(Instant::now());
    if left.is_zero() {
        return Err(ErrorKind::TimedOut.into());
    }
    tcp.set_read_timeout(Some(left))?;
    if tls.read_tls(tcp)? == 0 {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    let processed = tls.process_new_packets().map(drop);
    processed.map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}

fn is_late(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

fn connected(endpoint: &str) -> Result<TcpStream, HandshakeError> {
    let nobody = |cause| HandshakeError::Nobody {
        endpoint: endpoint.to_owned(),
        cause,
    };
    let port = endpoint.rsplit_once(':').map_or("", |(_, port)| port);
    // Checked when the configuration was read.
    let port: u16 = port.parse().unwrap_or(0);
    let addresses = (host(endpoint).as_str(), port).to_socket_addrs();
    let mut last = io::Error::new(ErrorKind::NotFound, "no such address");
    for address in addresses.map_err(nobody)? {
        let stream = TcpStream::connect_timeout(&address, CONNECT_MAX).and_then(|stream| {
            stream
                .set_write_timeout(Some(HANDSHAKE_MAX))
                .map(|()| stream)
        });
        match stream {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(nobody(last))
}

fn explained(endpoint: &str, own: &OwnCertificate, error: io::Error) -> HandshakeError {
    let endpoint = endpoint.to_owned();
    let cause = error.get_ref().and_then(|cause| cause.downcast_ref());
    match cause {
        Some(cause @ rustls::Error::InvalidCertificate(_)) => HandshakeError::RefusedHere {
            endpoint,
            authority: own.authority_file.clone(),
            cause: cause.clone(),
        },
        Some(rustls::Error::AlertReceived(alert)) if is_about_certificates(*alert) => {
            HandshakeError::RefusedThere {
                endpoint,
                certificate: own.file.clone(),
                cause: format!("{alert:?}"),
            }
        }
        Some(cause) => HandshakeError::Plain {
            endpoint,
            cause: cause.to_string(),
        },
        None if is_late(&error) => HandshakeError::Plain {
            endpoint,
            cause: format!("no answer within {} s", HANDSHAKE_MAX.as_secs()),
        },
        None => HandshakeError::Closed { endpoint },
    }
}

fn is_about_certificates(alert: AlertDescription) -> bool {
    use AlertDescription as Alert;
    matches!(
        alert,
        Alert::BadCertificate
            | Alert::UnsupportedCertificate
            | Alert::CertificateRevoked
            | Alert::CertificateExpired
            | Alert::CertificateUnknown
            | Alert::UnknownCA
            | Alert::AccessDenied
            | Alert::DecryptError
            | Alert::CertificateRequired
    )
}
