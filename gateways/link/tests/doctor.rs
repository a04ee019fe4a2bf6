//! Verdicts of `rcc-link doctor` about certificates, names and addresses, with certificates that the test makes and sessions that
//! answer on loopback. Run by the threads of the test harness.

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use rcc_api::findings::{FindingLevel, LinkFinding};
use rcc_config::CellConfig;
use rcc_config::link::TlsFiles;
use rcc_link::access::Role;
use rcc_link::doctor::verify;
use rcc_link::session::{self, Identity};
use rcgen::{ExtendedKeyUsagePurpose, SanType};
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

/// Verifies the cell `feeder` of the site `lab` with this link and these settings of a device.
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
    verify(
        &cell.unwrap_or_else(|faults| panic!("{faults}")),
        "feeder",
        now_s,
    )
}

/// Verifies a device that connects to `endpoint`.
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
    let words =
        "is lab/other, and not settings.peer, lab/press: all that arrives from there is dropped";
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
    has(
        &without,
        FindingLevel::Fail,
        "does not answer as TLS 1.3 does",
    );
}

/// A TLS server with these files, for one client, which needs no certificate.
fn server_without_clients(files: &TlsFiles) -> (JoinHandle<()>, String) {
    let config =
        ServerConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
            .with_safe_default_protocol_versions()
            .expect("versions")
            .with_no_client_auth();
    let key = PrivateKeyDer::from_pem_file(&files.key).expect("a key");
    let chain = vec![CertificateDer::from_pem_file(&files.certificate).expect("a certificate")];
    let config = config.with_single_cert(chain, key).expect("settings");
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let endpoint = format!("tls/{}", listener.local_addr().expect("an address"));
    let accept = move || {
        let (tcp, _) = listener.accept().expect("a client");
        let tls = ServerConnection::new(Arc::new(config)).expect("a connection");
        // Until the client goes.
        let _ = StreamOwned::new(tls, tcp).read(&mut [0]);
    };
    (std::thread::spawn(accept), endpoint)
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
        "does not contain a private key",
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
        "is open to everybody",
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
        "by certificate: lab/press may start close-door",
    );
    has(
        &good,
        FindingLevel::Note,
        "by certificate: lab/office may deploy",
    );
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
        "and every connection with it: renew it",
    );
    let before = link(&short, "127.0.0.1", now_s() - 60 * DAY_S);
    assert!(
        before.iter().all(|it| it.level < FindingLevel::Warn),
        "{before:#?}"
    );
}

/// A setting that the device's driver would refuse when it starts is a fault here, too.
#[test]
fn settings_that_the_driver_refuses_are_faults() {
    let authority = Authority::new();
    let tls = yaml(&authority.files("lab/feeder"));
    let at = "connect: [\"tls/127.0.0.1:7447\"]";
    for (settings, words) in [
        (
            format!(
                "{{peer: lab/press, {at}, tls: {{authority: ca.pem, certificate: a.pem, key: a.key}}}}"
            ),
            "settings.tls",
        ),
        (
            format!("{{peer: lab/press, {at}}}"),
            "without them `tcp/HOST:PORT`",
        ),
        (
            format!("{{peer: lab/press, connect: [\"tcp/127.0.0.1:7447\"], tls: {tls}}}"),
            "every endpoint is `tls/HOST:PORT`",
        ),
        (
            format!("{{peer: lab/press, conect: [], tls: {tls}}}"),
            "conect",
        ),
        (
            format!("{{peer: lab/press, tls: {tls}}}"),
            "is missing, and `listen` and `router` too",
        ),
        (format!("{{{at}, tls: {tls}}}"), "settings.peer"),
        (
            format!("{{peer: lab/press, router: [\"tls/127.0.0.1:7447\"], tls: {tls}}}"),
            "settings.router",
        ),
    ] {
        has(&found_at("", &settings, now_s()), FindingLevel::Fail, words);
    }
    let alone = found_at(
        "{site: lab}",
        "{peer: lab/press, connect: [\"tcp/127.0.0.1:1\"]}",
        now_s(),
    );
    has(&alone, FindingLevel::Fail, "so nobody can be reached");
    let away = "{site: lab, listen: [\"tcp/192.0.2.1:7447\", \"tcp/127.0.0.1:00\"], connect: [\"tcp/127.0.0.1:0\"]}";
    let away = found_at(
        away,
        "{peer: lab/press, connect: [\"tcp/127.0.0.1:1\"]}",
        now_s(),
    );
    has(
        &away,
        FindingLevel::Fail,
        "tcp/192.0.2.1:7447 cannot be listened at",
    );
    has(
        &away,
        FindingLevel::Warn,
        "an automatic port has no number here",
    );
}

/// Usage and end of certificates, as the other side of a connection judges them.
#[test]
fn a_certificate_is_judged_by_the_side_that_it_is_for_and_by_its_whole_chain() {
    let authority = Authority::new();
    let serves = authority.signed("lab/feeder", |params| {
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
    });
    let link = |what: &str, files: &TlsFiles| {
        let link = format!("{{site: lab, {what}, tls: {}}}", yaml(files));
        found_at(
            &link,
            "{peer: lab/press, connect: [\"tcp/127.0.0.1:1\"]}",
            now_s(),
        )
    };
    let (listen, connect) = (
        "listen: [\"tls/127.0.0.1:7447\"]",
        "connect: [\"tls/127.0.0.1:1\"]",
    );
    has(
        &link(listen, &serves),
        FindingLevel::Ok,
        "(lab/feeder) is signed by",
    );
    has(
        &link(connect, &serves),
        FindingLevel::Fail,
        "is refused by every other side",
    );
    let asks = authority.signed("lab/feeder", |params| {
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ClientAuth];
    });
    has(
        &link(connect, &asks),
        FindingLevel::Ok,
        "(lab/feeder) is signed by",
    );
    for everywhere in ["0.0.0.0", "::"] {
        let listen = format!("listen: [\"tls/{everywhere}:7447\"]");
        has(
            &link(&listen, &asks),
            FindingLevel::Fail,
            "is refused by every other side",
        );
    }
    let nowhere = authority.signed("lab/feeder", |params| params.subject_alt_names.clear());
    let everywhere = "listen: [\"tls/0.0.0.0:7447\"]";
    has(
        &link(everywhere, &nowhere),
        FindingLevel::Fail,
        "must name each at which others connect",
    );
    // A connection ends with the first certificate of its chain.
    let old = authority.signed("lab/old", |params| {
        params.not_after = rcgen::date_time_ymd(2020, 1, 1)
    });
    let own = authority.files("lab/feeder");
    let read = |path: &Path| std::fs::read_to_string(path).expect("a file");
    let both = read(&own.certificate) + &read(&old.certificate);
    std::fs::write(&own.certificate, both).expect("a file");
    has(&link(connect, &own), FindingLevel::Fail, "is not valid now");
    // That of the authority matters to nobody before the next one is made.
    let soon = authority.files("lab/feeder");
    let old_authority = TlsFiles {
        authority: old.certificate.clone(),
        ..soon
    };
    has(
        &link(connect, &old_authority),
        FindingLevel::Warn,
        "make the next one, and sign anew",
    );
}

/// Neither a file nor a server without end keeps the doctor, and a name from a certificate makes no line of its own.
#[test]
fn what_has_no_end_and_what_pretends_is_told() {
    let authority = Authority::new();
    let own = authority.files("lab/feeder");
    for path in ["/dev/zero", "/tmp"] {
        let endless = TlsFiles {
            key: path.into(),
            ..own.clone()
        };
        has(
            &found(&free_endpoint(), &endless),
            FindingLevel::Fail,
            "is not a regular file",
        );
    }
    let slow = TcpListener::bind("127.0.0.1:0").expect("a port");
    let endpoint = format!("tls/{}", slow.local_addr().expect("an address"));
    let (told, ended) = std::sync::mpsc::channel();
    let drip = std::thread::spawn(move || {
        let (mut stream, _) = slow.accept().expect("a client");
        // The header of a long record, byte by byte, for as long as somebody reads.
        while ended.recv_timeout(Duration::from_millis(100))
            == Err(std::sync::mpsc::RecvTimeoutError::Timeout)
        {
            let _ = stream.write_all(&[22]);
        }
    });
    let slowly = found(&endpoint, &own);
    told.send(()).expect("it writes");
    drip.join().expect("it ends");
    has(
        &slowly,
        FindingLevel::Fail,
        "does not answer as TLS 1.3 does",
    );
    let forged = authority.signed("forged", |params| {
        let name = &mut params.distinguished_name;
        name.push(rcgen::DnType::CommonName, "lab/x\nok    press: fine");
    });
    let (_session, at_forged) = listening(&forged);
    let found = found(&at_forged, &own);
    assert!(found.iter().all(|it| !it.what.contains('\n')), "{found:?}");
    has(&found, FindingLevel::Fail, "is lab/x");
}

/// A server of TLS that asks for no certificate is no rcc-link.
#[test]
fn another_server_of_tls_is_not_taken_for_a_cell() {
    let authority = Authority::new();
    let (server, endpoint) = server_without_clients(&authority.files(PEER));
    let found = found(&endpoint, &authority.files("lab/feeder"));
    has(&found, FindingLevel::Fail, "asks for no certificate");
    server.join().expect("it ends");
}

/// An IPv6 address is written with brackets, as everywhere, and is in certificates without them.
#[test]
fn an_address_with_brackets_is_reached() {
    if TcpListener::bind("[::1]:0").is_err() {
        eprintln!("skipped: an address with brackets (no IPv6)");
        return;
    }
    let authority = Authority::new();
    let at_home = |name| {
        authority.signed(name, |params| {
            let address = "::1".parse().expect("an address");
            params.subject_alt_names.push(SanType::IpAddress(address));
        })
    };
    let port = rcc_config::free_port(rcc_config::Protocol::Tcp).expect("a port");
    let endpoint = format!("tls/[::1]:{port}");
    let files = at_home(PEER);
    let role = Role::Operator;
    let identity = Some(Identity {
        files: &files,
        role,
    });
    let _press = session::open(std::slice::from_ref(&endpoint), &[], identity).expect("a session");
    let own = at_home("lab/feeder");
    has(
        &found(&endpoint, &own),
        FindingLevel::Ok,
        &format!("{PEER} answers at {endpoint}"),
    );
    rcc_link::fleet::connect(&[endpoint], Some(&own)).expect("a connection");
}

/// An open port has the number that the cell was started with, or none, and then nobody could connect.
#[test]
fn an_open_port_needs_its_number() {
    let folder = rcc_testing::folder();
    let file = folder.path().join("press.yaml");
    let text = "cell: press\nperiod: 1 ms\nports: {hall: auto tcp}\nlink: {site: lab, listen: [\"tcp/127.0.0.1:${hall}\"]}\n\
                devices: {io: {driver: modbus}}\n";
    std::fs::write(&file, text).expect("a file");
    let said = |what: &str, port: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rcc-link"));
        let command = command
            .args([what, "--config"])
            .arg(&file)
            .env_remove("RCC_PORTS");
        let output = match port {
            "" => command.output(),
            port => command.args(["--port", port]).output(),
        };
        let Output {
            status,
            stdout,
            stderr,
        } = output.expect("rcc-link runs");
        let text = String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned();
        (status.success(), text)
    };
    let words = "tcp/127.0.0.1:0: an automatic port has no number here";
    let (done, text) = said("serve", "");
    assert!(!done && text.contains(words), "{text}");
    // The cell gives it one when it starts.
    let (done, text) = said("doctor", "");
    assert!(done && text.contains(words), "{text}");
    let port = rcc_config::free_port(rcc_config::Protocol::Tcp).expect("a port");
    let (done, text) = said("doctor", &format!("hall={port}"));
    assert!(done && !text.contains(words), "{text}");
}
