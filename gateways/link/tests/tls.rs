//! Mutual TLS and access control on loopback, with certificates that the test makes. Run by the threads of the test harness.

use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use rcc_config::link::TlsFiles;
use rcc_config::{CellConfig, LinkRights};
use rcc_driver_kit::driver::{Driver as _, Inputs, LinkError};
use rcc_link::access::Role;
use rcc_link::device::{LinkDevice, NO_CELL, OTHER_NAME};
use rcc_link::fleet::{self, CellRequest, FleetError};
use rcc_link::keys::{CellKeys, DeployStep, Operation};
use rcc_link::session::{self, Identity};
use zenoh::{Session, Wait};

use authority::{Authority, permit};

mod authority;

/// Longest wait for anything that must happen.
const LIMIT: Duration = Duration::from_secs(60);
const PEER: &str = "lab/press";

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
    let (cell, rights) = (PEER, &LinkRights::default());
    let own = authority.files(PEER);
    let (press, at_press) = listening(&own, Role::Gateway { cell, rights });
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

/// Opens the gateway of a cell with these rights; it agrees to every request that arrives.
fn answering(authority: &Authority, rights: &LinkRights) -> (Session, Vec<String>) {
    let role = Role::Gateway { cell: PEER, rights };
    let (session, endpoints) = listening(&authority.files(PEER), role);
    let answer = session
        .declare_queryable(CellKeys::of(PEER).requests())
        .callback(|query| {
            let key = query.key_expr().clone();
            let reply = query.reply(&key, "{\"ok\": true}").attachment(key.as_str());
            reply.wait().expect("answered");
        });
    answer.background().wait().expect("a queryable");
    (session, endpoints)
}

#[test]
fn a_net_is_started_with_the_certificate_of_its_peer_only() {
    let authority = Authority::new();
    let nets = vec!["close-door".to_owned()];
    let rights = LinkRights {
        start: [("lab/feeder".to_owned(), nets)].into(),
        ..LinkRights::default()
    };
    let (_press, at_press) = answering(&authority, &rights);
    let feeder =
        fleet::connect(&at_press, Some(&authority.files("lab/feeder"))).expect("a connection");
    let other =
        fleet::connect(&at_press, Some(&authority.files("lab/other"))).expect("a connection");
    let ask = |session: &Session, operation, net| {
        let request = CellRequest {
            peer: "lab/feeder",
            cell: PEER,
            operation,
            net,
            text: "",
        };
        request.ask(session)
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
            refused
                .to_string()
                .contains("with TLS it drops what its `link: start`"),
            "{refused}"
        );
    }
}

/// A device drops all that arrives from elsewhere than its peer, and says so with the names of those it is connected to.
#[test]
fn a_device_that_is_connected_to_another_cell_says_so() {
    let authority = Authority::new();
    let own = authority.files("lab/feeder");
    for (name, reason) in [("lab/other", OTHER_NAME), (PEER, NO_CELL)] {
        let (_session, endpoints) = listening(&authority.files(name), Role::Operator);
        let [ca, certificate, key] =
            [&own.authority, &own.certificate, &own.key].map(|path| path.display().to_string());
        let text = format!(
            "cell: feeder\nperiod: 1 ms\ndevices:\n  press:\n    driver: {{program: rcc-link-device}}\n    settings: {{peer: {PEER}, connect: \
             {endpoints:?}, tls: {{authority: {ca}, certificate: {certificate}, key: {key}}}}}\n    channels: {{open: {{kind: digital input, \
             address: door/open}}}}\n"
        );
        let cell = CellConfig::parse_offline(&text, "cell.yaml", Path::new(""));
        let cell = cell.unwrap_or_else(|faults| panic!("{faults}"));
        let mut device = LinkDevice::open(&cell.devices[0]).expect("a device");
        let diagnosis = device.diagnosis().expect("a diagnosis");
        let until = Instant::now() + LIMIT;
        while diagnosis.link()["names"] != serde_json::json!([name]) {
            assert!(Instant::now() < until, "{}", diagnosis.link());
            std::thread::yield_now();
        }
        let lost = device.receive(Duration::from_secs(1), &mut Inputs::NONE.clone());
        let is_named = matches!(lost, Err(LinkError::Lost { reason: told }) if told == reason);
        assert!(is_named, "{name}: {lost:?}");
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
    let (cell, rights) = (PEER, &LinkRights::default());
    let role = Role::Gateway { cell, rights };
    let files = &good;
    let other = session::open(&[], &endpoint, Some(Identity { files, role }));
    let other = other.expect_err("refused").to_string();
    assert!(
        other.contains("is the certificate of `lab/feeder`, but this is `lab/press`"),
        "{other}"
    );
    permit(&good.key, 0o644);
    assert!(
        words(&good).contains("is open to everybody"),
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

/// Everybody with a certificate may ask whether a net would be taken, and is told; nobody else's net arrives.
#[test]
fn nets_arrive_with_the_certificates_of_those_who_may_deploy_only() {
    let authority = Authority::new();
    let rights = LinkRights {
        deploy: vec!["lab/office".to_owned()],
        ..LinkRights::default()
    };
    let (_press, at_press) = answering(&authority, &rights);
    let ask = |session: &Session, peer, step| {
        let request = CellRequest {
            peer,
            cell: PEER,
            operation: Operation::Deploy(step),
            net: "line",
            text: "net: line",
        };
        request.ask(session)
    };
    let connect = |name| fleet::connect(&at_press, Some(&authority.files(name)));
    let office = connect("lab/office").expect("a connection");
    let other = connect("lab/other").expect("a connection");
    let until = Instant::now() + LIMIT;
    while let Err(error) = ask(&office, "lab/office", DeployStep::Check) {
        assert!(Instant::now() < until, "{error}");
    }
    ask(&office, "lab/office", DeployStep::Load).expect("allowed");
    ask(&office, "lab/office", DeployStep::Unload).expect("allowed");
    ask(&other, "lab/other", DeployStep::Check).expect("the cell answers who may not");
    let rows = [
        (&office, "lab/office", DeployStep::Replace),
        (&other, "lab/other", DeployStep::Load),
        (&other, "lab/office", DeployStep::Load),
    ];
    // Asked together, since each waits for an answer that does not come.
    std::thread::scope(|scope| {
        for (session, peer, step) in rows {
            scope.spawn(move || {
                let dropped = ask(session, peer, step).expect_err("dropped");
                assert!(matches!(dropped, FleetError::NoAnswer { .. }), "{dropped}");
            });
        }
    });
}

/// A session through a router that is there.
fn by_router(router: &[String], identity: Identity<'_>) -> Session {
    let (told, opened) = channel();
    session::open_by_router(router, Some(identity), move |session| {
        told.send(session).expect("it is awaited");
    })
    .expect("a thread");
    opened
        .recv_timeout(LIMIT)
        .expect("a router")
        .expect("a session")
}

/// A router shows its own certificate for everything that it passes on. So what anybody may do goes through it, and what needs a
/// name does not: no START, no deployment, no values for a device.
#[test]
fn through_a_router_goes_only_what_every_certificate_may() {
    let authority = Authority::new();
    let named = authority.files("lab/router");
    let endpoint = vec![format!("tls/127.0.0.1:{}", port())];
    let refused = session::route(&endpoint, &[], Some(&named)).expect_err("the name of a cell");
    assert!(
        refused
            .to_string()
            .contains("`lab/router` is the name of a cell"),
        "{refused}"
    );
    let own = authority.files("router-1");
    let _router = session::route(&endpoint, &[], Some(&own)).expect("a router");
    let peer = "lab/feeder".to_owned();
    let rights = LinkRights {
        start: [(peer.clone(), vec!["close-door".to_owned()])].into(),
        deploy: vec![peer],
        ..LinkRights::default()
    };
    let (cell, rights) = (PEER, &rights);
    let files = &authority.files(PEER);
    let role = Role::Gateway { cell, rights };
    let press = by_router(&endpoint, Identity { files, role });
    let answer = press
        .declare_queryable(CellKeys::of(PEER).requests())
        .callback(|query| {
            let key = query.key_expr().clone();
            let reply = query.reply(&key, "{\"ok\": true}").attachment(key.as_str());
            reply.wait().expect("answered");
        });
    answer.background().wait().expect("a queryable");
    let feeder = authority.files("lab/feeder");
    let asks = fleet::connect_by_router(&endpoint, Some(&feeder)).expect("a connection");
    let ask = |operation| {
        let request = CellRequest {
            peer: "lab/feeder",
            cell: PEER,
            operation,
            net: "close-door",
            text: "net: close-door",
        };
        request.ask(&asks)
    };
    let until = Instant::now() + LIMIT;
    while let Err(error) = ask(Operation::Cancel) {
        assert!(Instant::now() < until, "CANCEL goes through: {error}");
    }
    ask(Operation::Deploy(DeployStep::Check)).expect("so does the question who may deploy");
    for operation in [Operation::Start, Operation::Deploy(DeployStep::Load)] {
        let dropped = ask(operation).expect_err("the router is not lab/feeder");
        assert!(matches!(dropped, FleetError::NoAnswer { .. }), "{dropped}");
    }
    // A reader has the values; a device, which must know whose they are, has not.
    let role = Role::Device { peer: PEER };
    let device = by_router(
        &endpoint,
        Identity {
            files: &feeder,
            role,
        },
    );
    let (read, taken) = (values(&asks), values(&device));
    let from = [(&press, "true")];
    publish(&from, &read, |arrived| arrived.len() >= 50);
    assert_eq!(taken.try_recv(), Err(std::sync::mpsc::TryRecvError::Empty));
}
