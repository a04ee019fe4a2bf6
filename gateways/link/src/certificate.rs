//! Checks the files of mutual TLS before a session uses them, as the other side of a connection will, so that an error names
//! the file and what to do. Reads files.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rcc_config::link::TlsFiles;
use rustls::client::danger::ServerCertVerifier as _;
use rustls::client::{ResolvesClientCert, WebPkiServerVerifier};
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::server::WebPkiClientVerifier;
use rustls::sign::CertifiedKey;
use rustls::version::TLS13;
use rustls::{ClientConfig, RootCertStore, SignatureScheme};
use x509_parser::prelude::{FromDer as _, X509Certificate};

/// Bits of a file's mode that others than its owner and group have.
const OTHERS: u32 = 0o007;
/// Longest file that is read, bytes.
const BYTES_MAX: u64 = 1 << 20;
/// Characters of a cause.
const CAUSE_MAX: usize = 200;

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
        cause: String,
    },
    /// A private key belongs to another certificate.
    #[error("{file} is not the key of {certificate}: give the two that were made together")]
    OtherKey {
        /// The file.
        file: String,
        /// File of the certificate.
        certificate: String,
    },
    /// A private key is of a kind that TLS does not take.
    #[error(
        "{file} is a key of a kind that is not supported: make one of P-256, P-384, Ed25519 or RSA from 2048 bits"
    )]
    KeyKind {
        /// The file.
        file: String,
    },
    /// A file holds several private keys.
    #[error("{file} holds several private keys: leave the one of the certificate")]
    KeyCount {
        /// The file.
        file: String,
    },
    /// A certificate has no common name.
    #[error("{file} has no common name: write SITE/CELL, such as lab/press, as its subject's CN")]
    NoName {
        /// The file.
        file: String,
    },
    /// A file holds no private key.
    #[error(
        "{file} does not contain a private key: expected an unencrypted PEM file with `BEGIN PRIVATE KEY`"
    )]
    NoKey {
        /// The file.
        file: String,
    },
    /// Everybody on the machine can read a private key.
    #[error("{file} is open to everybody: `chmod 640 {file}`")]
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

/// End of a certificate's validity.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CertificateEnd {
    /// Seconds since 1970.
    pub at_s: i64,
    /// In words.
    pub words: String,
}

/// The own certificate, its key, and the authority.
#[derive(Clone, Debug)]
pub struct OwnCertificate {
    /// File of the certificate.
    pub file: String,
    /// File of the authority that signed it.
    pub authority_file: String,
    /// Common name, if it has one.
    pub name: Option<String>,
    /// When the first certificate of its file ends, and every connection with it.
    pub end: CertificateEnd,
    /// When the first certificate of the authority's file ends.
    pub authority_end: CertificateEnd,
    chain: Vec<CertificateDer<'static>>,
    key: Arc<PrivateKeyDer<'static>>,
    authority: Arc<RootCertStore>,
}

impl OwnCertificate {
    /// Reads all files; checks that the certificate is valid now, and that the key is its own.
    ///
    /// # Errors
    /// Fails for the first file that cannot be used.
    pub fn read(files: &TlsFiles) -> Result<OwnCertificate, CertificateError> {
        let [authority_file, file, key_file] = [&files.authority, &files.certificate, &files.key]
            .map(|path| path.display().to_string());
        let authorities = certificates(&files.authority)?;
        let chain = certificates(&files.certificate)?;
        // A connection ends with the first of them.
        for certificate in &chain {
            valid_now(certificate, &file)?;
        }
        let key = private_key(&files.key)?;
        let authority_end = first_end(&authorities, &authority_file)?;
        let mut authority = RootCertStore::empty();
        for certificate in authorities {
            authority
                .add(certificate)
                .map_err(|_| CertificateError::Form {
                    file: authority_file.clone(),
                })?;
        }
        CertifiedKey::from_der(chain.clone(), key.clone_key(), &provider()).map_err(|cause| {
            let certificate = file.clone();
            match cause {
                rustls::Error::InconsistentKeys(_) => CertificateError::OtherKey {
                    file: key_file,
                    certificate,
                },
                _ => CertificateError::KeyKind { file: key_file },
            }
        })?;
        Ok(OwnCertificate {
            name: common_name(&chain[0]),
            end: first_end(&chain, &file)?,
            authority_end,
            file,
            authority_file,
            chain,
            key: Arc::new(key),
            authority: Arc::new(authority),
        })
    }

    /// Returns the common name, by which others know this process.
    ///
    /// # Errors
    /// Fails if the certificate has no common name.
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

    /// Checks that those accept it whom this process connects to.
    ///
    /// # Errors
    /// Fails if they refuse it.
    pub fn connects(&self) -> Result<(), CertificateError> {
        let authority = Arc::clone(&self.authority);
        let [own, others] = [&self.chain[..1], &self.chain[1..]];
        let verifier = WebPkiClientVerifier::builder_with_provider(authority, provider()).build();
        let verified = verifier
            .map_err(|error| rustls::Error::General(error.to_string()))
            .and_then(|it| it.verify_client_cert(&own[0], others, UnixTime::now()));
        verified.map(drop).map_err(|cause| self.refused(&cause))
    }

    /// Checks that those accept it who connect to this process, whatever address they use.
    ///
    /// # Errors
    /// Fails if they refuse it.
    pub fn listens(&self) -> Result<(), CertificateError> {
        let any = ServerName::IpAddress(std::net::Ipv4Addr::UNSPECIFIED.into());
        match self.verified_at(&any) {
            Ok(()) => Ok(()),
            Err(error) if is_about_address(&error) => Ok(()),
            Err(cause) => Err(self.refused(&cause)),
        }
    }

    /// Checks that it is for this address, a number or a name, at which others connect.
    ///
    /// # Errors
    /// Fails with the words for `subjectAltName` that are missing.
    pub fn is_at(&self, host: &str) -> Result<(), String> {
        let name = server_name(host)?;
        match self.verified_at(&name) {
            Err(error) if is_about_address(&error) => Err(match name {
                ServerName::IpAddress(_) => format!("IP:{host}"),
                _ => format!("DNS:{host}"),
            }),
            // All else is told by `listens`.
            _ => Ok(()),
        }
    }

    /// Returns true if it names any address.
    #[must_use]
    pub fn names_addresses(&self) -> bool {
        let own = self.chain.first();
        let read = own.and_then(|own| X509Certificate::from_der(own).ok());
        let names = read.and_then(|(_, own)| {
            let names = own.subject_alternative_name().ok().flatten()?;
            Some(!names.value.general_names.is_empty())
        });
        names.unwrap_or(false)
    }

    fn verified_at(&self, name: &ServerName<'_>) -> Result<(), rustls::Error> {
        let authority = Arc::clone(&self.authority);
        let verifier = WebPkiServerVerifier::builder_with_provider(authority, provider())
            .build()
            .map_err(|error| rustls::Error::General(error.to_string()))?;
        let [own, others] = [&self.chain[..1], &self.chain[1..]];
        let verified = verifier.verify_server_cert(&own[0], others, name, &[], UnixTime::now());
        verified.map(drop)
    }

    fn refused(&self, cause: &rustls::Error) -> CertificateError {
        let mut cause = cause.to_string();
        if let Some((at, _)) = cause.char_indices().nth(CAUSE_MAX) {
            cause.truncate(at);
            cause.push('…');
        }
        CertificateError::Refused {
            file: self.file.clone(),
            authority: self.authority_file.clone(),
            cause,
        }
    }

    /// Returns the settings of one who connects with this certificate, of the version of TLS that Zenoh has; `asked` becomes true
    /// when the other side asks for it.
    ///
    /// # Errors
    /// Fails if TLS cannot use it.
    pub fn client(&self, asked: Arc<AtomicBool>) -> Result<ClientConfig, rustls::Error> {
        let key = CertifiedKey::from_der(self.chain.clone(), self.key.clone_key(), &provider())?;
        let key = Arc::new(key);
        Ok(ClientConfig::builder_with_provider(provider())
            .with_protocol_versions(&[&TLS13])?
            .with_root_certificates(Arc::clone(&self.authority))
            .with_client_cert_resolver(Arc::new(OwnResolver { key, asked })))
    }
}

/// Shows the own certificate, and remembers that it was asked for.
#[derive(Debug)]
struct OwnResolver {
    key: Arc<CertifiedKey>,
    asked: Arc<AtomicBool>,
}

impl ResolvesClientCert for OwnResolver {
    fn resolve(&self, _: &[&[u8]], _: &[SignatureScheme]) -> Option<Arc<CertifiedKey>> {
        // Read by the same thread.
        self.asked.store(true, Ordering::Relaxed);
        Some(Arc::clone(&self.key))
    }

    fn has_certs(&self) -> bool {
        true
    }
}

fn is_about_address(error: &rustls::Error) -> bool {
    use rustls::CertificateError as Cause;
    matches!(
        error,
        rustls::Error::InvalidCertificate(
            Cause::NotValidForName | Cause::NotValidForNameContext { .. }
        )
    )
}

/// Reads the host of an endpoint as certificates name it.
///
/// # Errors
/// Fails if it is neither an address nor a name.
pub fn server_name(host: &str) -> Result<ServerName<'static>, String> {
    ServerName::try_from(host.to_owned())
        .map_err(|_| format!("`{host}` is neither an address nor a name"))
}

/// Returns the common name of a certificate, if it has one.
#[must_use]
pub fn common_name(certificate: &CertificateDer<'_>) -> Option<String> {
    let (_, read) = X509Certificate::from_der(certificate).ok()?;
    let name = read.subject().iter_common_name().next()?;
    name.as_str().ok().map(str::to_owned)
}

/// Returns when the first of these certificates, of one file or connection, ends.
///
/// # Errors
/// Fails if one cannot be read.
pub fn first_end(
    certificates: &[CertificateDer<'_>],
    file: &str,
) -> Result<CertificateEnd, CertificateError> {
    let ends = certificates.iter().map(|certificate| {
        let read = X509Certificate::from_der(certificate);
        let (_, read) = read.map_err(|_| CertificateError::Form {
            file: file.to_owned(),
        })?;
        let end = read.validity().not_after;
        Ok(CertificateEnd {
            at_s: end.timestamp(),
            words: end.to_string(),
        })
    });
    let ends = ends.collect::<Result<Vec<CertificateEnd>, CertificateError>>()?;
    ends.into_iter()
        .min()
        .ok_or_else(|| CertificateError::Form {
            file: file.to_owned(),
        })
}

/// The cryptography that the link uses.
fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

/// Returns the text of a regular file of bounded size: no device and no pipe, which may have no end.
fn text(path: &Path) -> Result<Vec<u8>, CertificateError> {
    let file = path.display().to_string();
    let read = fs::metadata(path).and_then(|about| {
        if !about.is_file() {
            return Err(io::Error::other("is not a regular file"));
        }
        if about.len() > BYTES_MAX {
            return Err(io::Error::other(format!(
                "has {} bytes, at most {BYTES_MAX} are read",
                about.len()
            )));
        }
        // Some files of the system have no length.
        let mut text = Vec::new();
        File::open(path)?.take(BYTES_MAX).read_to_end(&mut text)?;
        Ok(text)
    });
    read.map_err(|cause| CertificateError::Read { file, cause })
}

/// Returns the certificates of a file, of which there is at least one.
fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, CertificateError> {
    let text = text(path)?;
    let read: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&text).collect();
    let read = read.ok().filter(|all| !all.is_empty());
    read.ok_or_else(|| CertificateError::Form {
        file: path.display().to_string(),
    })
}

/// Returns the private key of a file that not everybody can use.
fn private_key(path: &Path) -> Result<PrivateKeyDer<'static>, CertificateError> {
    let text = text(path)?;
    let file = path.display().to_string();
    let about = fs::metadata(path);
    match about {
        Err(cause) => return Err(CertificateError::Read { file, cause }),
        Ok(about) if about.permissions().mode() & OTHERS != 0 => {
            return Err(CertificateError::Open { file });
        }
        Ok(_) => {}
    }
    let mut keys = PrivateKeyDer::pem_slice_iter(&text);
    match (keys.next(), keys.next()) {
        (Some(Ok(key)), None) => Ok(key),
        (Some(Ok(_)), Some(_)) => Err(CertificateError::KeyCount { file }),
        _ => Err(CertificateError::NoKey { file }),
    }
}

/// Checks that a certificate of this file can be read and is valid now.
fn valid_now(certificate: &CertificateDer<'_>, file: &str) -> Result<(), CertificateError> {
    let file = file.to_owned();
    let Ok((_, read)) = X509Certificate::from_der(certificate) else {
        return Err(CertificateError::Form { file });
    };
    let validity = read.validity();
    if validity.is_valid() {
        return Ok(());
    }
    let validity = format!("from {} to {}", validity.not_before, validity.not_after);
    Err(CertificateError::Expired { file, validity })
}
