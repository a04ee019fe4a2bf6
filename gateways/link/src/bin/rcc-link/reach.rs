//! How other cells are reached: endpoints and certificate.

use std::path::PathBuf;

use clap::Args;
use rcc_config::link::{TlsFiles, is_cell_key, is_endpoint};
use rcc_link::certificate::OwnCertificate;
use rcc_link::fleet::{self, FleetError};

use crate::LinkError;

/// Endpoints, and files for those with TLS.
#[derive(Args)]
pub struct Reach {
    /// Endpoints of rcc-link, such as tcp/192.168.0.7:7447, with commas between them
    #[arg(long, value_name = "ENDPOINT", env = "RCC_LINK_CONNECT", required_unless_present = "router", value_delimiter = ',', value_parser = endpoint)]
    connect: Vec<String>,
    /// Endpoints of routers instead, of which the first that answers is used
    #[arg(long, value_name = "ENDPOINT", env = "RCC_LINK_ROUTER", conflicts_with = "connect", value_delimiter = ',', value_parser = endpoint)]
    router: Vec<String>,
    #[command(flatten)]
    tls: Tls,
}

/// Files (PEM) for endpoints `tls/…`: all three, or none.
#[derive(Args)]
struct Tls {
    /// Certificate of the authority that signed those of all cells
    #[arg(long, value_name = "FILE", env = "RCC_LINK_AUTHORITY", requires_all = ["certificate", "key"])]
    authority: Option<PathBuf>,
    /// Own certificate; its common name is SITE/CELL, or that of a person
    #[arg(long, value_name = "FILE", env = "RCC_LINK_CERTIFICATE", requires_all = ["authority", "key"])]
    certificate: Option<PathBuf>,
    /// Its private key
    #[arg(long, value_name = "FILE", env = "RCC_LINK_KEY", requires_all = ["authority", "certificate"])]
    key: Option<PathBuf>,
}

impl Reach {
    /// Connects.
    pub fn session(&self) -> Result<zenoh::Session, FleetError> {
        let files = self.tls.files();
        match self.router.as_slice() {
            [] => fleet::connect(&self.connect, files.as_ref()),
            routers => fleet::connect_by_router(routers, files.as_ref()),
        }
    }

    /// Connects as the peer that the certificate names.
    pub fn as_peer(&self) -> Result<(zenoh::Session, String), LinkError> {
        let files = self.tls.files().ok_or(LinkError::NoCertificate)?;
        let own = OwnCertificate::read(&files)?;
        let peer = own.name()?;
        if !is_cell_key(peer) {
            return Err(LinkError::NoPeer(peer.to_owned()));
        }
        Ok((self.session()?, peer.to_owned()))
    }
}

impl Tls {
    fn files(&self) -> Option<TlsFiles> {
        Some(TlsFiles {
            authority: self.authority.clone()?,
            certificate: self.certificate.clone()?,
            key: self.key.clone()?,
        })
    }
}

fn endpoint(text: &str) -> Result<String, String> {
    match is_endpoint(text) {
        true => Ok(text.to_owned()),
        false => Err(
            "write protocol, host and port: tcp/192.168.0.7:7447 or tls/192.168.0.7:7447"
                .to_owned(),
        ),
    }
}
