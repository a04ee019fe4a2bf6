//! Connects to an endpoint as a session would, but only so far as to learn who is there, or why nobody is. Run by the main thread
//! of `rcc-link`.

use std::io::{self, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::sync::Arc;
use std::time::Duration;

use rcc_config::link::is_tls;
use rustls::{AlertDescription, ClientConnection, StreamOwned};

use crate::certificate::{OwnCertificate, common_name, server_name};

/// Longest wait for a connection, and for each message of the handshake.
const ANSWER_MAX: Duration = Duration::from_secs(2);

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
    /// What answers does not speak TLS.
    #[error(
        "{endpoint} does not answer as TLS does ({cause}): its `link` has no `tls`, or something else listens there"
    )]
    Plain {
        /// The endpoint.
        endpoint: String,
        /// Why.
        cause: String,
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

/// Returns the common name of the certificate at an endpoint `tls/HOST:PORT`, if it has one, once both sides have accepted each
/// other's; `None` for an endpoint without TLS that accepts a connection.
///
/// # Errors
/// Fails with the reason why there is no connection.
pub fn peer_name(
    endpoint: &str,
    own: Option<&OwnCertificate>,
) -> Result<Option<String>, HandshakeError> {
    let nobody = |cause| HandshakeError::Nobody {
        endpoint: endpoint.to_owned(),
        cause,
    };
    let address = endpoint.split_once('/').map_or(endpoint, |(_, rest)| rest);
    let mut tcp = connected(address).map_err(nobody)?;
    let Some(own) = own.filter(|_| is_tls(endpoint)) else {
        return Ok(None);
    };
    let plain = |cause: String| HandshakeError::Plain {
        endpoint: endpoint.to_owned(),
        cause,
    };
    let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
    let config = own.client().map_err(|error| plain(error.to_string()))?;
    let mut tls = ClientConnection::new(Arc::new(config), server_name(host).map_err(plain)?)
        .map_err(|error| plain(error.to_string()))?;
    while tls.is_handshaking() {
        if let Err(error) = tls.complete_io(&mut tcp) {
            return Err(explained(endpoint, own, error));
        }
    }
    let certificate = tls.peer_certificates().and_then(<[_]>::first);
    let name = certificate.and_then(common_name);
    // The other side judges the own certificate only now: it sends a ticket, or an alert, or nothing.
    let mut stream = StreamOwned::new(tls, tcp);
    match stream.flush().and_then(|()| stream.read(&mut [0])) {
        Err(error) if rustls_error(&error).is_some() => Err(explained(endpoint, own, error)),
        _ => Ok(name),
    }
}

fn connected(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(io::ErrorKind::NotFound, "no such address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, ANSWER_MAX) {
            Ok(stream) => {
                stream.set_read_timeout(Some(ANSWER_MAX))?;
                stream.set_write_timeout(Some(ANSWER_MAX))?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn rustls_error(error: &io::Error) -> Option<&rustls::Error> {
    error.get_ref()?.downcast_ref()
}

fn explained(endpoint: &str, own: &OwnCertificate, error: io::Error) -> HandshakeError {
    let endpoint = endpoint.to_owned();
    match rustls_error(&error) {
        Some(
            cause @ (rustls::Error::InvalidCertificate(_) | rustls::Error::NoCertificatesPresented),
        ) => HandshakeError::RefusedHere {
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
        _ => HandshakeError::Plain {
            endpoint,
            cause: error.to_string(),
        },
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
