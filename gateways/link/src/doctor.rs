//! Verifies the link of a cell as its file has it, before it is needed: files of mutual TLS, names and addresses in certificates, and
//! who answers at each endpoint. Access control drops in silence, so what would be dropped is told here. Run by the main thread
//! of `rcc-link`.

use std::net::{IpAddr, TcpListener};

use rcc_api::findings::{FindingLevel, LinkFinding};
use rcc_config::link::{LinkConfig, TlsFiles, is_cell_key, is_link_device};
use rcc_config::{CellConfig, DeviceConfig};
use rcc_core::printable::OneLine;
use rcc_driver_kit::driver::DriverError;

use crate::certificate::{CertificateEnd, CertificateError, OwnCertificate};
use crate::device::{LinkSettings, link_channels};
use crate::handshake::{HandshakeError, PeerCertificate, answers, host, peer_certificate};
use crate::rights::CellRights;
use crate::session::has_port;

/// A certificate that ends sooner is worth a word, s.
const SOON_S: i64 = 30 * 24 * 3600;

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
/// `cell` is the name under which the cell runs.
#[must_use]
pub fn verify(config: &CellConfig, cell: &str, now_s: i64) -> Vec<LinkFinding> {
    let mut findings = Findings {
        all: Vec::new(),
        now_s,
    };
    if let Some(link) = &config.link {
        findings.verify(&gateway(cell, link));
    }
    for device in config
        .devices
        .iter()
        .filter(|device| is_link_device(&device.driver))
    {
        match device_user(device) {
            Ok(user) => findings.verify(&user),
            Err(error) => findings.fail(&device.name, error.to_string()),
        }
    }
    if let Some(link) = &config.link {
        findings.tell_rights(link);
    }
    findings.all
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

fn device_user(device: &DeviceConfig) -> Result<LinkUser, DriverError> {
    let LinkSettings {
        peer,
        listen,
        connect,
        router,
        tls,
        ..
    } = LinkSettings::read(device)?;
    link_channels(device)?;
    Ok(LinkUser {
        of: device.name.clone(),
        name: None,
        peer: Some(peer),
        listen,
        connect,
        router,
        tls,
    })
}

struct Findings {
    all: Vec<LinkFinding>,
    now_s: i64,
}

impl Findings {
    fn add(&mut self, level: FindingLevel, of: &str, what: impl AsRef<str>) {
        // Names in certificates are those of others.
        let what = OneLine(what.as_ref()).to_string();
        let of = of.to_owned();
        self.all.push(LinkFinding { level, of, what });
    }

    fn fail(&mut self, of: &str, what: impl AsRef<str>) {
        self.add(FindingLevel::Fail, of, what);
    }

    fn is_soon(&self, end: &CertificateEnd) -> bool {
        end.at_s.saturating_sub(self.now_s) < SOON_S
    }

    fn verify(&mut self, user: &LinkUser) {
        let of = user.of.as_str();
        if user.listen.is_empty() && user.connect.is_empty() && user.router.is_empty() {
            return self.fail(
                of,
                "neither `listen` nor `connect` nor `router`, so nobody can be reached",
            );
        }
        let own = match user.tls.as_ref().map(OwnCertificate::read) {
            None => {
                let what = "no `tls`: a peer's name is what it says of itself; use a network that only the cells reach";
                self.add(FindingLevel::Note, of, what);
                None
            }
            Some(Err(error)) => return self.fail(of, error.to_string()),
            Some(Ok(own)) => Some(own),
        };
        if let Some(own) = &own {
            self.verify_own(user, own);
        }
        let endpoints = user.listen.iter().chain(&user.connect).chain(&user.router);
        for error in endpoints.filter_map(|endpoint| has_port(endpoint).err()) {
            // The cell may give it a number when it starts.
            self.add(FindingLevel::Warn, of, error.to_string());
        }
        for endpoint in &user.listen {
            self.verify_address(user, endpoint, own.as_ref());
        }
        let with_port = |endpoint: &&String| has_port(endpoint).is_ok();
        for endpoint in user.connect.iter().chain(&user.router).filter(with_port) {
            let answered = match &own {
                None => answers(endpoint).map(|()| {
                    self.add(
                        FindingLevel::Ok,
                        of,
                        format!("{endpoint} accepts connections"),
                    );
                }),
                Some(own) => peer_certificate(endpoint, own)
                    .map(|certificate| self.tell_peer(user, endpoint, &certificate)),
            };
            if let Err(error) = answered {
                let level = match &error {
                    // It may be switched off.
                    HandshakeError::Nobody { .. } => FindingLevel::Warn,
                    _ => FindingLevel::Fail,
                };
                self.add(level, of, error.to_string());
            }
        }
    }

    /// Verifies the own certificate: its name, its end, and that the other sides accept it.
    fn verify_own(&mut self, user: &LinkUser, own: &OwnCertificate) {
        let of = user.of.as_str();
        let connects = !user.connect.is_empty() || !user.router.is_empty();
        let checks = [
            user.name.as_deref().map(|name| own.is_of(name)),
            connects.then(|| own.connects()),
            (!user.listen.is_empty()).then(|| own.listens()),
        ];
        let failed = checks.into_iter().flatten().filter_map(Result::err);
        let failed: Vec<CertificateError> = failed.collect();
        for error in &failed {
            self.fail(of, error.to_string());
        }
        let OwnCertificate {
            file,
            authority_file,
            end,
            authority_end,
            ..
        } = own;
        let name = own.name.as_deref().unwrap_or("without a common name");
        let until = &end.words;
        match self.is_soon(end) {
            true => {
                let what = format!(
                    "{file} ({name}) ends at {until}, and every connection with it: renew it"
                );
                self.add(FindingLevel::Warn, of, what);
            }
            false if failed.is_empty() => {
                let what = format!("{file} ({name}) is signed by {authority_file}, until {until}");
                self.add(FindingLevel::Ok, of, what);
            }
            false => {}
        }
        if self.is_soon(authority_end) {
            let until = &authority_end.words;
            let what =
                format!("{authority_file} ends at {until}: make the next one, and sign anew");
            self.add(FindingLevel::Warn, of, what);
        }
    }

    /// Verifies an endpoint at which this process listens: an address of this machine, which the certificate names.
    fn verify_address(&mut self, user: &LinkUser, endpoint: &str, own: Option<&OwnCertificate>) {
        let of = user.of.as_str();
        let host = host(endpoint);
        // Port 0 is a free one: the right one may be in use by the process itself.
        if let Err(cause) = TcpListener::bind((host.as_str(), 0)) {
            self.fail(
                of,
                format!(
                    "{endpoint} cannot be listened at ({cause}): give an address of this machine"
                ),
            );
        }
        let Some(own) = own else {
            return;
        };
        if let Some(peer) = &user.peer {
            let what = format!(
                "listens at {endpoint}: who connects must have the certificate of {peer}; what others send is dropped"
            );
            self.add(FindingLevel::Note, of, what);
        }
        let file = &own.file;
        if host
            .parse()
            .is_ok_and(|address: IpAddr| address.is_unspecified())
        {
            let what = format!(
                "{endpoint} is every address of this machine: {file} must name each at which others connect (subjectAltName)"
            );
            let level = match own.names_addresses() {
                true => FindingLevel::Note,
                false => FindingLevel::Fail,
            };
            self.add(level, of, what);
        } else if let Err(missing) = own.is_at(&host) {
            let what = format!(
                "{file} is not for {host}, at which others connect: sign it with subjectAltName={missing}"
            );
            self.fail(of, what);
        }
    }

    /// Tells whose certificate is at an endpoint, and whether what it sends would be dropped.
    fn tell_peer(&mut self, user: &LinkUser, endpoint: &str, certificate: &PeerCertificate) {
        let of = user.of.as_str();
        let PeerCertificate { name, end } = certificate;
        let is_router = user.router.iter().any(|one| one == endpoint);
        let words = name
            .as_deref()
            .unwrap_or("a certificate without a common name");
        match (name, &user.peer) {
            (name, Some(peer)) if name.as_ref() != Some(peer) => {
                let what = format!(
                    "at {endpoint} is {words}, and not settings.peer, {peer}: all that arrives from there is dropped"
                );
                self.fail(of, what);
            }
            (Some(name), _) if is_router && is_cell_key(name) => {
                let what = format!(
                    "the router at {endpoint} has the certificate of {name}, so that everybody behind it has that name: give it another one"
                );
                self.fail(of, what);
            }
            _ => self.add(
                FindingLevel::Ok,
                of,
                format!("{words} answers at {endpoint}"),
            ),
        }
        let until = end.as_ref().map_or("", |end| end.words.as_str());
        match end {
            Some(end) if end.at_s <= self.now_s => {
                let what = format!(
                    "a certificate in the file of {endpoint} has ended, {until}, and connections end with it: remove or renew it there"
                );
                self.fail(of, what);
            }
            Some(end) if self.is_soon(end) => {
                let what = format!("the certificate at {endpoint} ends at {until}: renew it there");
                self.add(FindingLevel::Warn, of, what);
            }
            _ => {}
        }
    }

    /// Tells who may do more than read and cancel.
    fn tell_rights(&mut self, link: &LinkConfig) {
        let by = match link.tls {
            Some(_) => "by certificate",
            None => "by the name that a peer gives itself",
        };
        for line in CellRights::from(link).lines() {
            self.add(FindingLevel::Note, "link", format!("{by}: {line}"));
        }
    }
}
