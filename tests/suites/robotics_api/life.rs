//! Clients that come back, die, flood, poll and do not read; many nets; a gateway and a cell that die.

use std::process::Stdio;
use std::time::Duration;

use nix::sys::signal::Signal;
use rcc_protocol::Role;
use rcc_tests::cell_fixture::await_told;
use rcc_tests::processes::{signal, with_runtime_dir};
use rcc_tests::{TestCell, await_some};
use serde_json::Value;

use super::client::{Client, Connection, LoadedNet, post};
use super::gateway::{self, GatewayFixture};
use super::nets::{AT_ONCE, IDLE, joint_positions, recorded, values};

/// Starts a net that runs until it is canceled.
fn idle(client: &mut Client) -> LoadedNet {
    let net = client.load(IDLE);
    let name = net.name.as_str();
    client.rule(&format!("{name}.out_c"), [&[name], &[], &[]]);
    client.rule("t", [&[], &[], &[name]]);
    client.data.push(&net.tag, "ns(\"RUNNING\")");
    net
}

/// Returns the commands of the gateway's cell.
fn commands(gateway: &GatewayFixture) -> Vec<Value> {
    let reply = gateway.place.rest("GET", "/commands", "");
    reply.body.as_array().cloned().unwrap_or_default()
}

#[test]
fn clients_come_back_die_flood_and_poll() {
    let gateway = GatewayFixture::own(&["--session-timeout", "2"]);
    nets_survive_a_lost_connection(&gateway);
    nets_of_a_client_that_died_end(&gateway);
    hundreds_of_nets_leave_nothing(&gateway);
    floods_do_not_delay_others(&gateway);
    a_client_that_does_not_read_loses_its_connection(&gateway);
    gateway.stop();
}

/// The library reconnects with the session that it has, and subscribes to its nets again.
fn nets_survive_a_lost_connection(gateway: &GatewayFixture) {
    let mut client = Client::connect(gateway.port);
    let net = idle(&mut client);
    let name = net.name.clone();
    client.control.die();
    client.data.die();
    client.data.await_end();
    let session = client.session.clone();
    client.control = Connection::open(gateway.port);
    client.data = Connection::open(gateway.port);
    let again = client.subscribe(&name);
    assert!(client.data.with_tag(&again.tag)[1].text.contains("RUNNING"));
    let devices = client.data.ask("gde()");
    assert_eq!(client.data.answer(&devices), "ok()");
    // Longer than the time after which a session without connections ends.
    client.data.listen_for(Duration::from_secs(3));
    assert!(
        !client
            .data
            .log
            .iter()
            .any(|heard| heard.text.contains("TERMINATED")),
        "the session has a connection"
    );
    client.session = session;
    client.load(IDLE);
    client.rule("t", [&[], &[name.as_str()], &[]]);
    client.await_end(&again);
}

fn nets_of_a_client_that_died_end(gateway: &GatewayFixture) {
    let mut client = Client::connect(gateway.port);
    let net = idle(&mut client);
    let waits = client.load(IDLE);
    let (running, waiting) = (net.name.as_str(), waits.name.as_str());
    // It must not be started by what happens to the first one.
    client.rule(&format!("{running}.out_c"), [&[], &[], &[waiting]]);
    client.control.die();
    client.data.die();
    await_some("the nets of the client to be unloaded", || {
        let all = commands(gateway);
        let is_left = all
            .iter()
            .any(|row| row["net"] == running || row["net"] == waiting);
        let started = all
            .iter()
            .any(|row| row["net"] == waiting && row["state"] == "running");
        assert!(!started, "{all:?}");
        (!is_left).then_some(())
    });
    let mut other = Client::connect(gateway.port);
    assert_eq!(
        other.data.request(&format!("gne(\"{running}\",0.02)")),
        "err(\"invalid net\")"
    );
}

/// The library unloads few nets; the core's table has 64 places.
fn hundreds_of_nets_leave_nothing(gateway: &GatewayFixture) {
    const NETS: usize = 200;
    let mut client = Client::connect(gateway.port);
    let mut never_started = Vec::new();
    for number in 0..NETS {
        let net = client.load(AT_ONCE);
        match number % 3 {
            0 => never_started.push(net),
            _ => {
                client.start(&net, &["out_2"]);
                client.await_end(&net);
            }
        }
    }
    assert!(commands(gateway).len() < 64, "{}", commands(gateway).len());
    // A net that made room for others can still be started.
    let first = never_started.swap_remove(0);
    client.start(&first, &["out_2"]);
    client.await_end(&first);
    client.control.die();
    client.data.die();
    await_some("the nets to be unloaded", || {
        commands(gateway).is_empty().then_some(())
    });
}

fn floods_do_not_delay_others(gateway: &GatewayFixture) {
    let mut client = Client::connect(gateway.port);
    let net = idle(&mut client);
    let mut flood = Client::connect(gateway.port);
    let flooded = flood.load(IDLE).name;
    let tags: Vec<String> = (0..500)
        .map(|_| {
            flood
                .control
                .ask(&format!("snc({{{flooded}:{{in_go:\"true\"}}}})"))
        })
        .collect();
    let polls: Vec<String> = (0..500)
        .map(|_| flood.data.ask(&format!("gne(\"{flooded}\",0.0)")))
        .collect();
    let evaluations: Vec<_> = (0..8)
        .map(|_| {
            let port = gateway.port;
            std::thread::spawn(move || {
                let net = "dionet={1=Core::BooleanValue(Value='true'),2=Core::BooleanNetcommOut(inValue=1.outValue,Key='b')}";
                (0..5).filter(|_| post(port, "/eval/", net).1.contains("true")).count()
            })
        })
        .collect();
    // A cancel is carried out while the others are served.
    client.rule("t", [&[], &[net.name.as_str()], &[]]);
    client.await_end(&net);
    for tag in tags.iter().chain([&flood.control.ask("neca(\"x\")")]) {
        flood.control.answer(tag);
    }
    for tag in &polls {
        assert_eq!(flood.data.answer(tag), "ok()");
    }
    for evaluation in evaluations {
        assert_eq!(evaluation.join().expect("an evaluation"), 5);
    }
    // Bytes that are not a valid frame end their connection, and only that one.
    for bytes in [
        &b"\xff\xff\xff\xff"[..],
        b"\x81\x7f\x7f\xff\xff\xff\xff\xff\xff\xff",
        b"\x81\x01\xff",
    ] {
        let mut broken = Connection::open(gateway.port);
        broken.try_send_raw(bytes);
        broken.await_end();
    }
    assert!(client.control.request("neca(\"x\")").starts_with("err("));
}

fn a_client_that_does_not_read_loses_its_connection(gateway: &GatewayFixture) {
    use std::io::Write;
    let mut stream = std::net::TcpStream::connect((std::net::Ipv4Addr::LOCALHOST, gateway.port))
        .expect("it listens");
    let head = "GET /DirectIO/ HTTP/1.1\r\nUpgrade: websocket\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
    stream.write_all(head.as_bytes()).expect("a request");
    let request = b"\x81\x05c=x()";
    let mut frames = Vec::new();
    (0..1000).for_each(|_| frames.extend_from_slice(&[&[0x81, 5], &request[2..]].concat()));
    // Answers that nobody reads fill the buffers of the system, then the queue; then the connection is closed.
    await_some("the connection to be closed", || {
        stream.write_all(&frames).is_err().then_some(())
    });
    Client::connect(gateway.port);
}

#[test]
fn the_cell_of_a_gateway_that_is_killed_ends_with_it() {
    let mut gateway = GatewayFixture::own(&[]);
    let mut client = Client::connect(gateway.port);
    client.create("lwr", "type=kuka_lwr_sim");
    let net = client.load(&recorded("flat/lwr_lin-01-lwr-ptp.net"));
    client.start(&net, &["out_1", "out_2"]);
    client.data.push(&net.tag, "ns(\"RUNNING\")");
    // The executor dies: the net is lost, and nothing moves again by itself.
    gateway.place.kill(Role::Executor, "exec");
    let all = client.await_end(&net);
    assert_eq!(
        all.last().map(|heard| heard.text.as_str()),
        Some("ns(\"ERROR\")"),
        "{all:?}"
    );
    gateway.kill();
    await_some("the cell to end", || {
        with_runtime_dir(gateway.place.folder())
            .is_empty()
            .then_some(())
    });
}

#[test]
fn a_gateway_drives_a_cell_that_it_did_not_make() {
    let cell = TestCell::start(
        &rcc_tests::repository().join("configs/cells/two-arms.yaml"),
        |text| {
            text.replace(
                "start: [0, -30 deg, 0, 90 deg, 0, -60 deg, 0]",
                "start: [0, 0, 0, 0, 0, 0, 0]",
            )
        },
    );
    let mut command = gateway::command(&cell);
    command.args([
        "--cell",
        rcc_tests::cell_fixture::NAME,
        "--device",
        "lwr=left",
        "--session-timeout",
        "1",
    ]);
    let (mut child, port) = gateway::start(command.stderr(Stdio::inherit()));
    let mut client = Client::connect(port);
    client.await_device("lwr", "op");
    client.await_device("right", "op");
    let (status, reason) = post(port, "//devices/", "name=lwr&type=kuka_lwr_sim");
    assert!(
        status >= 400 && reason.contains("fixed"),
        "{status} {reason}"
    );
    let found = values(&client.evaluate(&joint_positions("lwr", 7)));
    assert!(found.iter().all(|(_, value)| value == "0.0"), "{found:?}");
    // Its own limits refuse the steps of acceleration of the library's motions.
    let refused = client.load_any(&recorded("flat/lwr_lin-01-lwr-ptp.net"));
    assert!(
        refused.starts_with("err(") && refused.contains("jerk"),
        "{refused}"
    );
    assert!(signal(child.id(), Signal::SIGTERM));
    assert!(child.wait().expect("a child").success());
    cell.stop();
}

#[test]
fn nets_of_a_gateway_that_is_killed_are_canceled_in_a_cell_that_lives_on() {
    let config = rcc_tests::repository().join("configs/cells/two-arms.yaml");
    let cell = TestCell::start(&config, |text| text);
    let mut command = gateway::command(&cell);
    command.args(["--cell", rcc_tests::cell_fixture::NAME]);
    let (mut child, port) = gateway::start(command.stderr(Stdio::inherit()));
    let mut client = Client::connect(port);
    idle(&mut client);
    let state = || cell.rest("GET", "/commands", "").body[0]["state"].clone();
    assert_eq!(state(), "running");
    child.kill().expect("a child");
    child.wait().expect("a child");
    await_some("the net to be canceled", || {
        (state() != "running").then_some(())
    });
    // Events are written after the state has changed.
    await_told("the event of the lost lease", || {
        let events = cell.rest("GET", "/events", "").body.to_string();
        match events.contains("lease") {
            true => Ok(()),
            false => Err(events),
        }
    });
    cell.stop();
}
