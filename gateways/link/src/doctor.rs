//! Verifies the link of a cell as its file has it, before it is needed: files of mutual TLS, names and addresses in certificates, and
//! who answers at each endpoint. Access control drops in silence, so what would be dropped is told here. Run by the main thread
//! of `rcc-link`.

use rcc_config::link::{LinkConfig, TlsFiles, is_cell_key};
use rcc_config::{CellConfig, DeviceConfig, DriverConfig};
use serde::Serialize;

use crate::certificate::OwnCertificate;
use crate::device::{DEVICE_PROGRAM, endpoints, tls};
use crate::handshake::{HandshakeError, peer_name};
use crate::rights::CellRights;

/// A certificate that ends sooner is worth a word, s.
const SOON_S: i64 = 30 * 24 * 3600;
/// Hosts that stand for all addresses of a machine.
const EVERYWHERE: [&str; 2] = ["0.0.0.0", "[::]"];

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FindingLevel {
    /// As it should be.
    Ok,
    /// Worth knowing.
    Note,
    /// Works now, or not yet.
    Warn,
    /// Cannot work.
    Fail,
}

impl FindingLevel {
    /// Returns the word before a finding.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            FindingLevel::Ok => "ok  ",
            FindingLevel::Note => "note",
            FindingLevel::Warn => "WARN",
            FindingLevel::Fail => "FAIL",
        }
    }
}

/// What was found, with what to do.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LinkFinding {
    /// Severity.
    pub level: FindingLevel,
    /// `link`, or the name of a device.
    pub of: String,
    /// In words.
    pub what: String,
}

/// One who uses the link: the gateway of a cell, or a device.
struct LinkUser {
    /// `link`, or the name of the device.
    of: String,
    /// The name that its certificate must have.
    name: Option<String>,
    /// The name that the certificate at the other end must have.
    peer: Option<String>,
    listen: Vec<String>,
    connect: Vec<String>,
    router: Vec<String>,
    tls: Option<TlsFiles>,
}

/// Verifies the link of a cell and its link devices, against the time `now_s`, seconds since 1970; connects to each endpoint.
#[must_use]
pub fn verify(config: &CellConfig, now_s: i64) -> Vec<LinkFinding> {
    let gateway = config.link.iter().map(|link| gateway(&config.name, link));
    let devices = config.devices.iter().filter_map(device);
    let mut findings = Findings::default();
    for user in gateway.chain(devices) {
        findings.verify(&user, now_s);
    }
    if let Some(link) = &config.link {
        findings.tell_rights(link);
    }
    findings.0
}

fn gateway(cell: &str, link: &LinkConfig) -> LinkUser {
    LinkUser {
        of: "link".to_owned(),
        name: Some(format!("{}/{cell}", link.site)),
        peer: None,
        listen: link.listen.clone(),
        connect: link.connect.clone(),
        router: link.router.clone(),
        tls: link.tls.clone(),
    }
}

/// Returns what a link device uses; `None` for another device. What its driver refuses when it starts is not looked at here.
fn device(device: &DeviceConfig) -> Option<LinkUser> {
    let DriverConfig::Program(own) = &device.driver else {
        return None;
    };
    let program = own.program.rsplit('/').next();
    let settings = &device.settings;
    let list = |key: &str| endpoints(&settings[key]).unwrap_or_default();
    (program == Some(DEVICE_PROGRAM)).then(|| LinkUser {
        of: device.name.clone(),
        name: None,
        peer: settings["peer"].as_str().map(str::to_owned),
        listen: list("listen"),
        connect: list("connect"),
        router: list("router"),
        tls: tls(&settings["tls"]),
    })
}

#[derive(Default)]
struct Findings(Vec<LinkFinding>);

impl Findings {
    fn add(&mut self, level: FindingLevel, of: &str, what: impl Into<String>) {
        let (of, what) = (of.to_owned(), what.into());
        self.0.push(LinkFinding { level, of, what });
    }

    fn verify(&mut self, user: &LinkUser, now_s: i64) {
        let of = user.of.as_str();
        let own = match user.tls.as_ref().map(OwnCertificate::read) {
            None => {
                let what = "no `tls`: a peer's name is what it says of itself; use a network that only the cells reach";
                self.add(FindingLevel::Note, of, what);
                None
            }
            Some(Err(error)) => return self.add(FindingLevel::Fail, of, error.to_string()),
            Some(Ok(own)) => {
                self.verify_own(user, &own, now_s);
                Some(own)
            }
        };
        for endpoint in user.connect.iter().chain(&user.router) {
            let answer = peer_name(endpoint, own.as_ref());
            self.tell_answer(user, endpoint, own.is_some(), answer);
        }
    }

    /// Verifies the own certificate: its name, its end, and the addresses at which others connect.
    fn verify_own(&mut self, user: &LinkUser, own: &OwnCertificate, now_s: i64) {
        let of = user.of.as_str();
        if let Some(Err(error)) = user.name.as_deref().map(|name| own.is_of(name)) {
            self.add(FindingLevel::Fail, of, error.to_string());
        }
        let (file, until) = (&own.file, &own.until);
        let name = own.name.as_deref().unwrap_or("without a common name");
        match own.not_after_s.saturating_sub(now_s) {
            ..SOON_S => {
                let what =
                    format!("{file} ({name}) ends at {until}, and the link with it: renew it");
                self.add(FindingLevel::Warn, of, what);
            }
            _ => {
                let authority = &own.authority_file;
                let what = format!("{file} ({name}) is signed by {authority}, until {until}");
                self.add(FindingLevel::Ok, of, what);
            }
        }
        for endpoint in &user.listen {
            let address = endpoint.split_once('/').map_or("", |(_, address)| address);
            let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
            if let Some(peer) = &user.peer {
                let what = format!(
                    "listens at {endpoint}: who connects must have the certificate of {peer}; what others send is dropped"
                );
                self.add(FindingLevel::Note, of, what);
            }
            if EVERYWHERE.contains(&host) {
                let what = format!(
                    "{endpoint} is every address of this machine: {file} must name each at which others connect (subjectAltName)"
                );
                self.add(FindingLevel::Note, of, what);
            } else if let Err(cause) = own.is_at(host) {
                let what = format!(
                    "{file} is not for {host}, at which others connect ({cause}): sign it with subjectAltName={host}"
                );
                self.add(FindingLevel::Fail, of, what);
            }
        }
    }

    /// Tells who answers at an endpoint, and whether what it sends would be dropped.
    fn tell_answer(
        &mut self,
        user: &LinkUser,
        endpoint: &str,
        has_tls: bool,
        answer: Result<Option<String>, HandshakeError>,
    ) {
        let of = user.of.as_str();
        let is_router = user.router.iter().any(|one| one == endpoint);
        let (level, what) = match (answer, &user.peer) {
            // It may be switched off.
            (Err(error @ HandshakeError::Nobody { .. }), _) => {
                (FindingLevel::Warn, error.to_string())
            }
            (Err(error), _) => (FindingLevel::Fail, error.to_string()),
            (Ok(None), _) if !has_tls => (FindingLevel::Ok, format!("{endpoint} answers")),
            (Ok(name), Some(peer)) if name.as_ref() != Some(peer) => {
                let name = name.unwrap_or_else(|| "nobody".to_owned());
                let what = format!(
                    "the certificate at {endpoint} is that of {name}, so all that arrives from there is dropped: settings.peer is {peer}"
                );
                (FindingLevel::Fail, what)
            }
            (Ok(Some(name)), _) if is_router && is_cell_key(&name) => {
                let what = format!(
                    "the router at {endpoint} has the certificate of {name}, so that everybody behind it has that name: give it another one"
                );
                (FindingLevel::Fail, what)
            }
            (Ok(name), _) => {
                let name = name.unwrap_or_else(|| "a certificate without a common name".to_owned());
                (FindingLevel::Ok, format!("{name} answers at {endpoint}"))
            }
        };
        self.add(level, of, what);
    }

    /// Tells who may do more than read and cancel.
    fn tell_rights(&mut self, link: &LinkConfig) {
        let lines = CellRights::from(link).lines();
        if lines.is_empty() {
            let what = "nobody elsewhere may start or deploy";
            self.add(FindingLevel::Note, "link", what);
        }
        for line in lines {
            let by = match link.tls {
                Some(_) => "by its certificate",
                None => "whoever has that name",
            };
            self.add(FindingLevel::Note, "link", format!("{line} ({by})"));
        }
    }
}
