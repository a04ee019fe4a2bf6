//! Checks the files of mutual TLS before a session uses them, as the other side of a connection will, so that an error names
//! the file and what to do. Reads files.

use std::fs::File;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;

use rcc_config::link::TlsFiles;
use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::ServerCertVerifier as _;
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime, pem};
use rustls::server::WebPkiClientVerifier;
use rustls::sign::CertifiedKey;
use rustls::{ClientConfig, RootCertStore};
use x509_parser::prelude::{FromDer as _, X509Certificate};

/// Bits of a file's mode that others than its owner and group have.
const OTHERS: u32 = 0o007;

/// Why a certificate or key cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CertificateError {
    /// A file cannot be read.
    #[error("{file}: {cause}: check the path in `tls`, and that this user may read it")]
    Read {
        /// The file.
        file: String,
        /// Why.
        cause: std::io::Error,
    },
    /// A file holds no certificate.
    #[error("{file} is no certificate: a PEM file with `BEGIN CERTIFICATE` is expected")]
    Form {
        /// The file.
        file: String,
    },
    /// A certificate is not valid now.
    #[error("{file} is not valid now, but {validity}: renew it, or set the clock")]
    Expired {
        /// The file.
        file: String,
        /// From when to when it is valid.
        validity: String,
    },
    /// The other side would refuse the certificate.
    #[error(
        "{file} is refused by every other side ({cause}): sign it anew with {authority}, as docs/link.md shows"
    )]
    Refused {
        /// The file.
        file: String,
        /// File of the authority.
        authority: String,
        /// Why.
        cause: rustls::Error,
    },
    /// A private key cannot be used.
    #[error(
        "{file} is not the key of {certificate} ({cause}): give the two that were made together"
    )]
    Key {
        /// The file.
        file: String,
        /// File of the certificate.
        certificate: String,
        /// Why.
        cause: String,
    },
    /// A certificate has no common name.
    #[error("{file} has no common name: write SITE/CELL, such as lab/press, as its subject's CN")]
    NoName {
        /// The file.
        file: String,
    },
    /// A file holds no private key.
    #[error("{file} is no private key: a PEM file with `BEGIN PRIVATE KEY` is expected")]
    NoKey {
        /// The file.
        file: String,
    },
    /// Everybody on the machine can read a private key.
    #[error("{file} can be read by everybody: `chmod 640 {file}`")]
    Open {
        /// The file.
        file: String,
    },
    /// The certificate is that of another cell.
    #[error(
        "{file} is the certificate of `{found}`, but this is `{expected}`: use its own, with that common name"
    )]
    Other {
        /// The file.
        file: String,
        /// Its common name.
        found: String,
        /// `SITE/CELL`.
        expected: String,
    },
}

/// The own certificate, which the other side will accept.
#[derive(Clone, Debug)]
pub struct OwnCertificate {
    /// File of the certificate.
    pub file: String,
    /// File of the authority that signed it.
    pub authority_file: String,
    /// Common name, if it has one.
    pub name: Option<String>,
    /// End of its validity, seconds since 1970.
    pub not_after_s: i64,
    /// The end of its validity in words.
    pub until: String,
    chain: Vec<CertificateDer<'static>>,
    key: Arc<PrivateKeyDer<'static>>,
    authority: Arc<RootCertStore>,
}

impl OwnCertificate {
    /// Reads and checks all files.
    ///
    /// # Errors
    /// Fails for the first file that cannot be used.
    pub fn read(files: &TlsFiles) -> Result<OwnCertificate, CertificateError> {
        let [authority_file, file, key_file] = [&files.authority, &files.certificate, &files.key]
            .map(|path| path.display().to_string());
        let authorities = certificates(&files.authority)?;
        valid(&authorities[0], &authority_file)?;
        let chain = certificates(&files.certificate)?;
        let own = valid(&chain[0], &file)?;
        let key = private_key(&files.key)?;
        let refused = |cause| CertificateError::Refused {
            file: file.clone(),
            authority: authority_file.clone(),
            cause,
        };
        let mut authority = RootCertStore::empty();
        for certificate in authorities {
            authority.add(certificate).map_err(refused)?;
        }
        let authority = Arc::new(authority);
        let verifier =
            WebPkiClientVerifier::builder_with_provider(Arc::clone(&authority), provider())
                .build()
                .map_err(|cause| refused(rustls::Error::General(cause.to_string())))?;
        verifier
            .verify_client_cert(&chain[0], &chain[1..], UnixTime::now())
            .map_err(refused)?;
        CertifiedKey::from_der(chain.clone(), key.clone_key(), &provider()).map_err(|cause| {
            CertificateError::Key {
                file: key_file,
                certificate: file.clone(),
                cause: cause.to_string(),
            }
        })?;
        Ok(OwnCertificate {
            name: common_name(&chain[0]),
            file,
            authority_file,
            not_after_s: own.not_after_s,
            until: own.until,
            chain,
            key: Arc::new(key),
            authority,
        })
    }

    /// Returns the common name, by which others know this process.
    ///
    /// # Errors
    /// Fails if there is none.
    pub fn name(&self) -> Result<&str, CertificateError> {
        self.name
            .as_deref()
            .ok_or_else(|| CertificateError::NoName {
                file: self.file.clone(),
            })
    }

    /// Checks that it is the certificate of `cell` (`SITE/CELL`).
    ///
    /// # Errors
    /// Fails if it is that of another one.
    pub fn is_of(&self, cell: &str) -> Result<(), CertificateError> {
        match self.name()? {
            name if name == cell => Ok(()),
            found => Err(CertificateError::Other {
                file: self.file.clone(),
                found: found.to_owned(),
                expected: cell.to_owned(),
            }),
        }
    }

    /// Checks that one who connects to this address, a number or a name, accepts the certificate there.
    ///
    /// # Errors
    /// Fails with the reason why not.
    pub fn is_at(&self, host: &str) -> Result<(), String> {
        let name = server_name(host)?;
        let authority = Arc::clone(&self.authority);
        let verifier = WebPkiServerVerifier::builder_with_provider(authority, provider())
            .build()
            .map_err(|error| error.to_string())?;
        let [own, others] = [&self.chain[..1], &self.chain[1..]];
        verifier
            .verify_server_cert(&own[0], others, &name, &[], UnixTime::now())
            .map(drop)
            .map_err(|error| error.to_string())
    }

    /// Returns the settings of one who connects with this certificate.
    ///
    /// # Errors
    /// Fails if TLS cannot use it.
    pub fn client(&self) -> Result<ClientConfig, rustls::Error> {
        ClientConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()?
            .with_root_certificates(Arc::clone(&self.authority))
            .with_client_auth_cert(self.chain.clone(), self.key.clone_key())
    }
}

/// Reads the host of an endpoint as certificates name it.
///
/// # Errors
/// Fails if it is neither an address nor a name.
pub fn server_name(host: &str) -> Result<ServerName<'static>, String> {
    let bare = host.trim_start_matches('[').trim_end_matches(']');
    ServerName::try_from(bare.to_owned()).map_err(|error| format!("{host}: {error}"))
}

/// Returns the common name of a certificate, if it has one.
#[must_use]
pub fn common_name(certificate: &CertificateDer<'_>) -> Option<String> {
    let (_, read) = X509Certificate::from_der(certificate).ok()?;
    let name = read.subject().iter_common_name().next()?;
    name.as_str().ok().map(str::to_owned)
}

/// The cryptography that the link uses.
fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

/// Returns the certificates of a file, of which there is at least one.
fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, CertificateError> {
    let file = path.display().to_string();
    let read = CertificateDer::pem_file_iter(path).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    match read {
        Err(pem::Error::Io(cause)) => Err(CertificateError::Read { file, cause }),
        Ok(all) if !all.is_empty() => Ok(all),
        Ok(_) | Err(_) => Err(CertificateError::Form { file }),
    }
}

/// Returns the private key of a file that not everybody can read.
fn private_key(path: &Path) -> Result<PrivateKeyDer<'static>, CertificateError> {
    let file = path.display().to_string();
    match File::open(path).and_then(|key| key.metadata()) {
        Err(cause) => return Err(CertificateError::Read { file, cause }),
        Ok(about) if about.permissions().mode() & OTHERS != 0 => {
            return Err(CertificateError::Open { file });
        }
        Ok(_) => {}
    }
    PrivateKeyDer::from_pem_file(path).map_err(|_| CertificateError::NoKey { file })
}

/// The end of a certificate's validity.
struct Validity {
    not_after_s: i64,
    until: String,
}

/// Checks that a certificate of this file can be read and is valid now.
fn valid(certificate: &CertificateDer<'_>, file: &str) -> Result<Validity, CertificateError> {
    let file = file.to_owned();
    let Ok((_, read)) = X509Certificate::from_der(certificate) else {
        return Err(CertificateError::Form { file });
    };
    let validity = read.validity();
    if !validity.is_valid() {
        let validity = format!("from {} to {}", validity.not_before, validity.not_after);
        return Err(CertificateError::Expired { file, validity });
    }
    Ok(Validity {
        not_after_s: validity.not_after.timestamp(),
        until: validity.not_after.to_string(),
    })
}
