//! Certificates that tests make.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use rcc_config::link::TlsFiles;
use rcc_testing::TempDir;
use rcgen::{BasicConstraints, CertificateParams, DnType, IsCa, Issuer, KeyPair};

/// An authority and the certificates that it signed, in a folder of their own.
pub struct Authority {
    folder: TempDir,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    pub fn new() -> Authority {
        let folder = rcc_testing::folder();
        let mut params = CertificateParams::new(Vec::new()).expect("parameters");
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().expect("a key");
        let certificate = params.self_signed(&key).expect("a certificate");
        fs::write(folder.path().join("ca.pem"), certificate.pem()).expect("a file");
        let issuer = Issuer::new(params, key);
        Authority { folder, issuer }
    }

    /// Signs a certificate for `name` at 127.0.0.1.
    pub fn files(&self, name: &str) -> TlsFiles {
        self.signed(name, |_| {})
    }

    pub fn signed(&self, name: &str, change: impl Fn(&mut CertificateParams)) -> TlsFiles {
        let mut params = CertificateParams::new(vec!["127.0.0.1".to_owned()]).expect("a name");
        params.distinguished_name.push(DnType::CommonName, name);
        change(&mut params);
        let key = KeyPair::generate().expect("a key");
        let certificate = params.signed_by(&key, &self.issuer).expect("signed");
        let path = |ending: &str| {
            let file = format!("{}.{ending}", name.replace('/', "-"));
            self.folder.path().join(file)
        };
        let files = TlsFiles {
            authority: self.folder.path().join("ca.pem"),
            certificate: path("pem"),
            key: path("key"),
        };
        fs::write(&files.certificate, certificate.pem()).expect("a file");
        fs::write(&files.key, key.serialize_pem()).expect("a file");
        permit(&files.key, 0o600);
        files
    }
}

/// Sets the mode of a file.
pub fn permit(file: &Path, mode: u32) {
    fs::set_permissions(file, fs::Permissions::from_mode(mode)).expect("permissions");
}
