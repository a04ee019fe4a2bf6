//! Mutual TLS and access control on loopback, with certificates that the test makes. Run by the threads of the test harness.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use rcc_config::link::TlsFiles;
use rcc_link::access::Role;
use rcc_link::fleet::{self, FleetError};
use rcc_link::keys::{CellKeys, Operation};
use rcc_link::session::{self, Identity};
use rcc_testing::TempDir;
use rcgen::{BasicConstraints, CertificateParams, DnType, IsCa, Issuer, KeyPair};
use zenoh::{Session, Wait};

/// Longest wait for anything that must happen.
const LIMIT: Duration = Duration::from_secs(60);
const PEER: &str = "lab/press";

/// An authority and the certificates that it signed, in a folder of their own.
struct Authority {
    folder: TempDir,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    fn new() -> Authority {
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
    fn files(&self, name: &str) -> TlsFiles {
        self.signed(name, |_| {})
    }

    fn signed(&self, name: &str, change: impl Fn(&mut CertificateParams)) -> TlsFiles {
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

fn permit(file: &Path, mode: u32) {
    fs::set_permissions(file, fs::Permissions::from_mode(mode)).expect("permissions");
}

fn port() -> u16 {
    rcc_config::free_port(rcc_config::Protocol::Tcp).expect("a port")
}

/// A session with an identity that listens on loopback, and its endpoint.
fn listening(files: &TlsFiles, role: Role<'_>) -> (Session, Vec<String>) {
    let endpoint = vec![format!("tls/127.0.0.1:{}", port())];
    let identity = Some(Identity { files, role });
    let session = session::open(&endpoint, &[], identity).expect("a session");
    (session, endpoint)
}

/// Values of a topic of [`PEER`] as they arrive.
fn values(session: &Session) -> Receiver<String> {
    let (told, values) = channel();
    let key = CellKeys::of(PEER).topic("door").expect("a key");
    let subscriber = session.declare_subscriber(key).callback(move |sample| {
        let text = String::from_utf8_lossy(&sample.payload().to_bytes()).into_owned();
        let _ = told.send(text);
    });
    subscriber.background().wait().expect("a subscription");
    values
}

/// Publishes `text` from each session until `enough` says so of what arrived.
fn publish(
    from: &[(&Session, &str)],
    values: &Receiver<String>,
    enough: impl Fn(&[String]) -> bool,
) -> Vec<String> {
    let key = CellKeys::of(PEER).topic("door").expect("a key");
    let until = Instant::now() + LIMIT;
    let mut arrived = Vec::new();
    while !enough(&arrived) {
        assert!(Instant::now() < until, "{arrived:?}");
        for (session, text) in from {
            session.put(&key, *text).wait().expect("published");
        }
        arrived.extend(values.recv_timeout(Duration::from_millis(20)));
    }
    arrived
}

#[test]
fn values_in_the_name_of_another_cell_are_dropped() {
    let authority = Authority::new();
    let (cell, start) = (PEER, &BTreeMap::new());
    let own = authority.files(PEER);
    let (press, at_press) = listening(&own, Role::Gateway { cell, start });
    let other = authority.files("lab/other");
    // Without access control the impostor is believed: the way is there.
    for (role, is_believed) in [(Role::Operator, true), (Role::Device { peer: PEER }, false)] {
        let reader = authority.files("lab/feeder");
        let endpoint = vec![format!("tls/127.0.0.1:{}", port())];
        let identity = Some(Identity {
            files: &reader,
            role,
        });
        let device = session::open(&endpoint, &at_press, identity).expect("a session");
        let values = values(&device);
        let impostor = fleet::connect(&endpoint, Some(&other)).expect("a connection");
        let from = [(&press, "true"), (&impostor, "false")];
        let count =
            |arrived: &[String], text: &str| arrived.iter().filter(|it| *it == text).count();
        let arrived = publish(&from, &values, |arrived| {
            count(arrived, "true") >= 50 && (!is_believed || count(arrived, "false") > 0)
        });
        assert_eq!(count(&arrived, "false") > 0, is_believed, "{arrived:?}");
    }
}

#[test]
fn a_net_is_started_with_the_certificate_of_its_peer_only() {
    let authority = Authority::new();
    let start = BTreeMap::from([("lab/feeder".to_owned(), vec!["close-door".to_owned()])]);
    let (cell, start) = (PEER, &start);
    let own = authority.files(PEER);
    let (press, at_press) = listening(&own, Role::Gateway { cell, start });
    let answer = press
        .declare_queryable(CellKeys::of(PEER).requests())
        .callback(|query| {
            let key = query.key_expr().clone();
            query.reply(key, "{\"ok\": true}").wait().expect("answered");
        });
    answer.background().wait().expect("a queryable");
    let feeder =
        fleet::connect(&at_press, Some(&authority.files("lab/feeder"))).expect("a connection");
    let other =
        fleet::connect(&at_press, Some(&authority.files("lab/other"))).expect("a connection");
    let ask = |session: &Session, operation, net| {
        fleet::ask(session, ("lab/feeder", PEER), operation, net)
    };
    // The declaration may arrive after the connection.
    let until = Instant::now() + LIMIT;
    while let Err(error) = ask(&feeder, Operation::Start, "close-door") {
        assert!(Instant::now() < until, "{error}");
    }
    ask(&other, Operation::Cancel, "close-door").expect("anyone cancels");
    for (session, net) in [(&other, "close-door"), (&feeder, "open-door")] {
        let refused = ask(session, Operation::Start, net).expect_err("dropped");
        assert!(matches!(refused, FleetError::NoAnswer { .. }), "{refused}");
        assert!(
            refused.to_string().contains("with TLS it drops START"),
            "{refused}"
        );
    }
}

#[test]
fn a_certificate_of_another_authority_connects_to_nothing() {
    let own = Authority::new();
    let files = own.files(PEER);
    let (_press, at_press) = listening(&files, Role::Operator);
    let others = Authority::new();
    let stranger = others.files("lab/feeder");
    let refused = fleet::connect(&at_press, Some(&stranger)).expect_err("no connection");
    assert!(matches!(refused, FleetError::NoConnection(_)), "{refused}");
    fleet::connect(&at_press, Some(&own.files("lab/feeder"))).expect("a connection");
}

#[test]
fn files_that_cannot_be_used_are_named_with_what_to_do() {
    let authority = Authority::new();
    let good = authority.files("lab/feeder");
    let endpoint = [format!("tls/127.0.0.1:{}", port())];
    let words = |files: &TlsFiles| {
        let role = Role::Operator;
        let opened = session::open(&[], &endpoint, Some(Identity { files, role }));
        opened.expect_err("refused").to_string()
    };
    let missing = TlsFiles {
        key: "/no/such.key".into(),
        ..good.clone()
    };
    assert!(
        words(&missing).starts_with("/no/such.key: No such file"),
        "{}",
        words(&missing)
    );
    let swapped = TlsFiles {
        certificate: good.key.clone(),
        ..good.clone()
    };
    assert!(
        words(&swapped).contains("is no certificate"),
        "{}",
        words(&swapped)
    );
    let old = authority.signed("lab/old", |params| {
        params.not_after = rcgen::date_time_ymd(2020, 1, 1)
    });
    assert!(words(&old).contains("is not valid now"), "{}", words(&old));
    let (cell, start) = (PEER, &BTreeMap::new());
    let role = Role::Gateway { cell, start };
    let files = &good;
    let other = session::open(&[], &endpoint, Some(Identity { files, role }));
    let other = other.expect_err("refused").to_string();
    assert!(
        other.contains("is the certificate of `lab/feeder`, but this is `lab/press`"),
        "{other}"
    );
    permit(&good.key, 0o644);
    assert!(
        words(&good).contains("can be read by everybody"),
        "{}",
        words(&good)
    );
    let plain = session::open(&[], &endpoint, None).expect_err("no certificates");
    assert!(
        plain
            .to_string()
            .contains("every endpoint is `tls/HOST:PORT`"),
        "{plain}"
    );
}
