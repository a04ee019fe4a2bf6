//! What `rcc-link doctor` says of certificates, names and addresses, with certificates that the test makes and sessions that
//! answer on loopback. Run by the threads of the test harness.

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use rcc_config::CellConfig;
use rcc_config::link::TlsFiles;
use rcc_link::access::Role;
use rcc_link::doctor::{FindingLevel, LinkFinding, verify};
use rcc_link::session::{self, Identity};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::WebPkiClientVerifier;
use rustls::{RootCertStore, ServerConfig, ServerConnection, StreamOwned};
use zenoh::{Session, Wait as _};

use authority::{Authority, permit};

mod authority;

const PEER: &str = "lab/press";
const DAY_S: i64 = 24 * 3600;

fn now_s() -> i64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    i64::try_from(since.expect("after 1970").as_secs()).expect("seconds")
}

fn free_endpoint() -> String {
    let port = rcc_config::free_port(rcc_config::Protocol::Tcp).expect("a port");
    format!("tls/127.0.0.1:{port}")
}

fn yaml(files: &TlsFiles) -> String {
    let [authority, certificate, key] =
        [&files.authority, &files.certificate, &files.key].map(|path| path.display().to_string());
    format!("{{authority: {authority}, certificate: {certificate}, key: {key}}}")
}

/// What is found in the cell `feeder` of the site `lab` with this link and these settings of a device.
fn found_at(link: &str, device: &str, now_s: i64) -> Vec<LinkFinding> {
    let link = match link {
        "" => String::new(),
        text => format!("link: {text}\n"),
    };
    let text = format!(
        "cell: feeder\nperiod: 1 ms\n{link}devices:\n  press:\n    driver: {{program: rcc-link-device}}\n    settings: {device}\n    \
         channels: {{open: {{kind: digital input, address: door/open}}}}\n"
    );
    let cell = CellConfig::parse_offline(&text, "cell.yaml", Path::new(""));
    verify(&cell.unwrap_or_else(|faults| panic!("{faults}")), now_s)
}

/// What is found of a device that connects to `endpoint`.
fn found(endpoint: &str, files: &TlsFiles) -> Vec<LinkFinding> {
    let tls = yaml(files);
    let settings = format!("{{peer: {PEER}, connect: [\"{endpoint}\"], tls: {tls}}}");
    found_at("", &settings, now_s())
}

/// Asserts that there is such a finding.
#[track_caller]
fn has(found: &[LinkFinding], level: FindingLevel, words: &str) {
    let is = |it: &LinkFinding| it.level == level && it.what.contains(words);
    assert!(found.iter().any(is), "{words}: {found:#?}");
}

/// A session that listens at an endpoint with these files.
fn listening(files: &TlsFiles) -> (Session, String) {
    let endpoint = free_endpoint();
    let role = Role::Operator;
    let identity = Some(Identity { files, role });
    let session = session::open(std::slice::from_ref(&endpoint), &[], identity).expect("a session");
    (session, endpoint)
}

#[test]
fn the_name_at_the_other_end_is_that_of_the_peer_or_what_it_sends_is_dropped() {
    let authority = Authority::new();
    let own = authority.files("lab/feeder");
    let (_press, at_press) = listening(&authority.files(PEER));
    let good = found(&at_press, &own);
    has(&good, FindingLevel::Ok, "(lab/feeder) is signed by");
    has(
        &good,
        FindingLevel::Ok,
        &format!("{PEER} answers at {at_press}"),
    );
    assert!(
        good.iter().all(|it| it.level == FindingLevel::Ok),
        "{good:#?}"
    );
    let (_other, at_other) = listening(&authority.files("lab/other"));
    let words = "is that of lab/other, so all that arrives from there is dropped: settings.peer is lab/press";
    has(&found(&at_other, &own), FindingLevel::Fail, words);
    let nobody = free_endpoint();
    let words = format!("nothing answers at {nobody} (");
    has(&found(&nobody, &own), FindingLevel::Warn, &words);
}

#[test]
fn a_certificate_that_either_side_refuses_is_told_with_the_side() {
    let (own, others) = (Authority::new(), Authority::new());
    let stranger = others.files(PEER);
    let (_press, at_press) = listening(&stranger);
    let here = found(&at_press, &own.files("lab/feeder"));
    has(
        &here,
        FindingLevel::Fail,
        &format!("the certificate at {at_press} is refused here"),
    );
    // Its own certificate is good for us, and ours is not for it.
    let (server, at_server) = server(&own.files(PEER), &stranger.authority);
    let there = found(&at_server, &own.files("lab/feeder"));
    has(&there, FindingLevel::Fail, &format!("{at_server} refuses "));
    has(
        &there,
        FindingLevel::Fail,
        "both sides must name the same authority",
    );
    server.join().expect("it ends");
    // Without TLS.
    let plain = session::open(&["tcp/127.0.0.1:0".to_owned()], &[], None).expect("a session");
    let locators = plain.info().locators().wait();
    let address = locators[0].address().to_string();
    let without = found(&format!("tls/{address}"), &own.files("lab/feeder"));
    has(&without, FindingLevel::Fail, "does not answer as TLS does");
}

/// A TLS server at an endpoint with these files, which accepts one client, of another authority only.
fn server(files: &TlsFiles, authority: &Path) -> (JoinHandle<()>, String) {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let read = |path: &Path| CertificateDer::from_pem_file(path).expect("a certificate");
    let mut roots = RootCertStore::empty();
    roots.add(read(authority)).expect("an authority");
    let clients =
        WebPkiClientVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&provider));
    let key = PrivateKeyDer::from_pem_file(&files.key).expect("a key");
    let config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .expect("versions")
        .with_client_cert_verifier(clients.build().expect("a verifier"))
        .with_single_cert(vec![read(&files.certificate)], key)
        .expect("settings");
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let endpoint = format!("tls/{}", listener.local_addr().expect("an address"));
    let accept = move || {
        let (tcp, _) = listener.accept().expect("a client");
        tcp.set_read_timeout(Some(Duration::from_secs(60)))
            .expect("a limit");
        let tls = ServerConnection::new(Arc::new(config)).expect("a connection");
        let mut stream = StreamOwned::new(tls, tcp);
        let refused = stream
            .read(&mut [0])
            .expect_err("the certificate is of another authority");
        assert!(refused.to_string().contains("certificate"), "{refused}");
        // The alert has been written by the reading side already, or is written now.
        let _ = stream.flush();
    };
    (std::thread::spawn(accept), endpoint)
}

#[test]
fn files_are_judged_as_the_other_side_would() {
    let (own, others) = (Authority::new(), Authority::new());
    let nobody = free_endpoint();
    let (good, stranger) = (own.files("lab/feeder"), others.files("lab/feeder"));
    let mixed = TlsFiles {
        authority: stranger.authority.clone(),
        ..good.clone()
    };
    has(
        &found(&nobody, &mixed),
        FindingLevel::Fail,
        "is refused by every other side (invalid peer certificate",
    );
    let swapped = TlsFiles {
        key: stranger.key.clone(),
        ..good.clone()
    };
    has(
        &found(&nobody, &swapped),
        FindingLevel::Fail,
        "is not the key of",
    );
    let no_key = TlsFiles {
        key: good.certificate.clone(),
        ..good.clone()
    };
    permit(&no_key.key, 0o600);
    has(
        &found(&nobody, &no_key),
        FindingLevel::Fail,
        "is no private key",
    );
    let missing = TlsFiles {
        authority: "/no/such.pem".into(),
        ..good.clone()
    };
    has(
        &found(&nobody, &missing),
        FindingLevel::Fail,
        "/no/such.pem: No such file",
    );
    permit(&good.key, 0o644);
    has(
        &found(&nobody, &good),
        FindingLevel::Fail,
        "can be read by everybody",
    );
}

#[test]
fn the_gateway_has_its_own_name_at_the_address_where_it_listens() {
    let authority = Authority::new();
    let device = format!("{{peer: {PEER}, listen: [\"tcp/127.0.0.1:7447\"]}}");
    let link = |files: &TlsFiles, listen: &str, now_s: i64| {
        let tls = yaml(files);
        let rights = "start: {lab/press: [close-door]}, deploy: [lab/office]";
        let link = format!("{{site: lab, listen: [\"tls/{listen}:7447\"], {rights}, tls: {tls}}}");
        found_at(&link, &device, now_s)
    };
    let own = authority.files("lab/feeder");
    let good = link(&own, "127.0.0.1", now_s());
    assert!(
        good.iter().all(|it| it.level < FindingLevel::Warn),
        "{good:#?}"
    );
    has(
        &good,
        FindingLevel::Note,
        "lab/press may start close-door (by its certificate)",
    );
    has(&good, FindingLevel::Note, "lab/office may deploy");
    // The device beside it has no TLS.
    has(
        &good,
        FindingLevel::Note,
        "no `tls`: a peer's name is what it says of itself",
    );
    has(
        &link(&own, "127.0.0.2", now_s()),
        FindingLevel::Fail,
        "is not for 127.0.0.2, at which others connect",
    );
    has(
        &link(&own, "0.0.0.0", now_s()),
        FindingLevel::Note,
        "is every address of this machine",
    );
    let other = authority.files("lab/other");
    has(
        &link(&other, "127.0.0.1", now_s()),
        FindingLevel::Fail,
        "is the certificate of `lab/other`, but this is `lab/feeder`",
    );
    let short = authority.signed("lab/feeder", |params| {
        let until = SystemTime::now() + Duration::from_secs(10 * 24 * 3600);
        params.not_after = until.into();
    });
    has(
        &link(&short, "127.0.0.1", now_s()),
        FindingLevel::Warn,
        "and the link with it: renew it",
    );
    let before = link(&short, "127.0.0.1", now_s() - 60 * DAY_S);
    assert!(
        before.iter().all(|it| it.level < FindingLevel::Warn),
        "{before:#?}"
    );
}
