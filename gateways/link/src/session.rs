//! Opens the Zenoh session of a process: explicit endpoints, no multicast, and a lease that is short enough to connect again
//! soon after a cut; mutual TLS and access control if there are certificates. Zenoh's own threads run it.

use std::collections::BTreeSet;

use rcc_config::link::{TlsFiles, is_cell_key, is_tls};
use rcc_process::helpers;
use serde_json::{Value, json};
use zenoh::{Config, Session, Wait};

use crate::access::{Role, access_control};
use crate::certificate::{CertificateError, OwnCertificate};

/// Time without a sign of life after which a connection is closed, ms. A shorter one would close connections of a machine
/// that is merely busy.
const LEASE_MS: u32 = 2000;
/// Signs of life in that time.
const KEEP_ALIVES: u32 = 8;
/// Time between attempts to connect, first and longest, ms.
const RETRY_MS: [u32; 2] = [100, 1000];

/// Why there is no session.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The configuration is refused.
    #[error("the link cannot be configured: {0}")]
    Config(String),
    /// A certificate or key cannot be used.
    #[error(transparent)]
    Certificate(#[from] CertificateError),
    /// An endpoint does not go with the certificates.
    #[error(
        "`{0}`: with certificates every endpoint is `tls/HOST:PORT`, without them `tcp/HOST:PORT`"
    )]
    Protocol(String),
    /// An endpoint has no port number.
    #[error(
        "{0}: an automatic port has no number here: give the one of the cell (--port NAME=NUMBER), or a fixed one, which others need"
    )]
    NoPort(String),
    /// The certificate of a router could be taken for that of a cell.
    #[error(
        "`{0}` is the name of a cell or person: give a router a certificate with another common name, such as `router-1`"
    )]
    RouterName(String),
    /// The session cannot be opened.
    #[error("the link cannot be opened: {0}")]
    Open(String),
    /// There is no thread.
    #[error("the link cannot be opened: {0}")]
    Thread(#[from] std::io::Error),
    /// A subscription or token cannot be declared.
    #[error("the link cannot be used: {0}")]
    Declare(String),
}

/// Certificates of a process, and its role.
#[derive(Clone, Copy, Debug)]
pub struct Identity<'a> {
    /// Its files.
    pub files: &'a TlsFiles,
    /// Its role.
    pub role: Role<'a>,
}

/// The processes and routers that a session is connected to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Connections {
    /// Their number.
    pub count: usize,
    /// The common names of their certificates.
    pub names: BTreeSet<String>,
}

/// Returns the connections of a session, number and names of the same moment.
#[must_use]
pub fn connections(session: &Session) -> Connections {
    let (mut ids, mut names) = (BTreeSet::new(), BTreeSet::new());
    for link in session.info().links().wait() {
        ids.insert(link.zid().to_string());
        names.extend(link.auth_identifier().map(str::to_owned));
    }
    let count = ids.len();
    Connections { count, names }
}

/// Opens a session that listens at and connects to these endpoints, and connects again for ever; with an identity by mutual
/// TLS and with access control.
///
/// # Errors
/// Fails if an endpoint is invalid or cannot be listened at, or if a certificate cannot be used. A peer that does not answer
/// is not an error.
pub fn open(
    listen: &[String],
    connect: &[String],
    identity: Option<Identity<'_>>,
) -> Result<Session, SessionError> {
    opened(configured("peer", (listen, connect), identity)?)
}

/// Opens a session that reaches others through the first of these routers that answers, and calls `then` with it; a thread of
/// its own waits for that, as long as it takes. A lost connection is made again for ever. A Zenoh router passes nothing on
/// between peers, only between its clients, so this is one.
///
/// # Errors
/// Fails if an endpoint is invalid, if a certificate cannot be used, or if there is no thread.
pub fn open_by_router(
    routers: &[String],
    identity: Option<Identity<'_>>,
    then: impl FnOnce(Result<Session, SessionError>) + Send + 'static,
) -> Result<(), SessionError> {
    let config = configured("client", (&[], routers), identity)?;
    helpers::thread("router", move || then(opened(config)))?;
    Ok(())
}

/// Opens a session that also passes on what others send to each other. With certificates its own must not have the name of a
/// cell or person: every message that it passes on comes with its certificate, so that such a name in `link: start`, `deploy` or
/// a device's `peer` would be that of everybody behind it.
///
/// # Errors
/// As [`open`].
pub fn route(
    listen: &[String],
    connect: &[String],
    files: Option<&TlsFiles>,
) -> Result<Session, SessionError> {
    if let Some(files) = files {
        let certificate = OwnCertificate::read(files)?;
        let name = certificate.name()?;
        if is_cell_key(name) {
            return Err(SessionError::RouterName(name.to_owned()));
        }
    }
    let role = Role::Operator;
    let identity = files.map(|files| Identity { files, role });
    opened(configured("router", (listen, connect), identity)?)
}

fn opened(config: Config) -> Result<Session, SessionError> {
    zenoh::open(config)
        .wait()
        .map_err(|error| SessionError::Open(error.to_string()))
}

/// Checks that an endpoint has a port number: an open port is another one at each start, which no peer knows.
///
/// # Errors
/// Fails if it is 0.
pub fn has_port(endpoint: &str) -> Result<(), SessionError> {
    let port = endpoint.rsplit_once(':');
    match port.is_some_and(|(_, port)| port.parse() == Ok(0_u16)) {
        false => Ok(()),
        true => Err(SessionError::NoPort(endpoint.to_owned())),
    }
}

/// Checks that all endpoints are `tls/…` with certificates, and none without.
///
/// # Errors
/// Fails with the first that is not.
pub fn of_one_protocol(endpoints: &[&[String]], has_tls: bool) -> Result<(), SessionError> {
    let mixed = |endpoint: &&String| is_tls(endpoint) != has_tls;
    match endpoints.iter().copied().flatten().find(mixed) {
        None => Ok(()),
        Some(endpoint) => Err(SessionError::Protocol(endpoint.clone())),
    }
}

fn configured(
    mode: &str,
    (listen, connect): (&[String], &[String]),
    identity: Option<Identity<'_>>,
) -> Result<Config, SessionError> {
    of_one_protocol(&[listen, connect], identity.is_some())?;
    let mut config = Config::default();
    if let Some(identity) = identity {
        let own = OwnCertificate::read(identity.files)?;
        if let Role::Gateway { cell, .. } = identity.role {
            own.is_of(cell)?;
        }
        if !listen.is_empty() {
            own.listens()?;
        }
        if !connect.is_empty() {
            own.connects()?;
        }
        insert(&mut config, "transport/link/tls", &tls(identity.files))?;
        if let Some(control) = access_control(identity.role) {
            insert(&mut config, "access_control", &control)?;
        }
    }
    let [first, longest] = RETRY_MS;
    let rows = [
        ("mode", format!("\"{mode}\"")),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        ("listen/endpoints", endpoints(listen)),
        ("connect/endpoints", endpoints(connect)),
        ("connect/timeout_ms", "-1".to_owned()),
        ("connect/exit_on_failure", "false".to_owned()),
        (
            "connect/retry",
            format!(
                "{{period_init_ms: {first}, period_max_ms: {longest}, period_increase_factor: 2}}"
            ),
        ),
        ("open/return_conditions/connect_scouted", "false".to_owned()),
        ("transport/link/tx/lease", LEASE_MS.to_string()),
        ("transport/link/tx/keep_alive", KEEP_ALIVES.to_string()),
    ];
    for (key, value) in rows {
        set(&mut config, key, &value)?;
    }
    Ok(config)
}

fn insert(config: &mut Config, key: &str, value: &Value) -> Result<(), SessionError> {
    set(config, key, &value.to_string())
}

fn set(config: &mut Config, key: &str, value: &str) -> Result<(), SessionError> {
    let set = config.insert_json5(key, value);
    set.map_err(|error| SessionError::Config(format!("{key}: {error}")))
}

/// Returns the part of the configuration for mutual TLS: both sides show a certificate that the authority signed, the
/// listening one also for its address, and a connection ends when a certificate expires.
fn tls(files: &TlsFiles) -> Value {
    json!({
        "root_ca_certificate": files.authority,
        "listen_private_key": files.key,
        "listen_certificate": files.certificate,
        "connect_private_key": files.key,
        "connect_certificate": files.certificate,
        "enable_mtls": true,
        "verify_name_on_connect": true,
        "close_link_on_expiration": true,
    })
}

/// Returns endpoints as JSON. For TLS Zenoh compares the host with the certificate as it is written, so that an IPv6 address
/// must have no brackets.
fn endpoints(list: &[String]) -> String {
    let bare = |endpoint: &String| match is_tls(endpoint) {
        true => endpoint.replace(['[', ']'], ""),
        false => endpoint.clone(),
    };
    json!(list.iter().map(bare).collect::<Vec<String>>()).to_string()
}
