//! Checks the files of mutual TLS before a session uses them, so that an error names the file and what to do. Reads files.

use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use rcc_config::link::TlsFiles;
use x509_parser::pem::Pem;

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
    /// A certificate has no common name.
    #[error("{file} has no common name: write SITE/CELL, such as lab/press, as its subject's CN")]
    NoName {
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

/// Checks all files, and that the certificate is that of `cell` (`SITE/CELL`), if one is given.
///
/// # Errors
/// Fails for the first file that cannot be used.
pub fn check(files: &TlsFiles, cell: Option<&str>) -> Result<(), CertificateError> {
    read_certificate(&files.authority)?;
    let name = read_certificate(&files.certificate)?;
    let file = files.key.display().to_string();
    match File::open(&files.key).and_then(|key| key.metadata()) {
        Err(cause) => return Err(CertificateError::Read { file, cause }),
        Ok(about) if about.permissions().mode() & OTHERS != 0 => {
            return Err(CertificateError::Open { file });
        }
        Ok(_) => {}
    }
    let file = files.certificate.display().to_string();
    match (cell, name) {
        (None, _) => Ok(()),
        (Some(cell), Some(name)) if cell == name => Ok(()),
        (Some(cell), Some(found)) => Err(CertificateError::Other {
            file,
            found,
            expected: cell.to_owned(),
        }),
        (Some(_), None) => Err(CertificateError::NoName { file }),
    }
}

/// Returns the common name of the own certificate, by which other cells know this process.
///
/// # Errors
/// Fails if the file cannot be used or has no common name.
pub fn own_name(files: &TlsFiles) -> Result<String, CertificateError> {
    let file = files.certificate.display().to_string();
    read_certificate(&files.certificate)?.ok_or(CertificateError::NoName { file })
}

/// Returns the common name of the first certificate in a file, if it has one.
fn read_certificate(path: &Path) -> Result<Option<String>, CertificateError> {
    let file = path.display().to_string();
    let bytes = fs::read(path).map_err(|cause| CertificateError::Read {
        file: file.clone(),
        cause,
    })?;
    let form = || CertificateError::Form { file: file.clone() };
    let pem = Pem::iter_from_buffer(&bytes).next();
    let pem = pem.and_then(Result::ok).ok_or_else(form)?;
    let certificate = pem.parse_x509().map_err(|_| form())?;
    let validity = certificate.validity();
    if !validity.is_valid() {
        let validity = format!("from {} to {}", validity.not_before, validity.not_after);
        return Err(CertificateError::Expired { file, validity });
    }
    let name = certificate.subject().iter_common_name().next();
    let name = name.and_then(|name| name.as_str().ok());
    Ok(name.map(str::to_owned))
}
